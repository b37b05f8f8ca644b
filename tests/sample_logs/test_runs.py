"""The sample logs as written: readable, complete but for what was lost on purpose, and the same each time."""

import dataclasses
import filecmp
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from generator.commands import Sine, sines
from generator.runs import RUNS, generate, make_topics
from generator.steering import ANGLE, REQUEST, SteeringTest, steering_signals
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

MEGABYTES = 1e6
RATES = {
    REQUEST: 50.0,
    ANGLE: 100.0,
    "/vehicle/velocity": 50.0,
    "/sensing/imu": 100.0,
    "/localization/odometry": 50.0,
    "/control/reference": 50.0,
    "/control/reference_speed": 50.0,
    "/control/engaged": 50.0,
}
STEERED = {REQUEST, ANGLE, "/vehicle/velocity"}
MOVING = {ANGLE, "/vehicle/velocity", "/sensing/imu", "/localization/odometry"}
FOLLOWING = MOVING | {REQUEST, "/control/reference", "/control/reference_speed", "/control/engaged"}
TOPICS = {
    "steering_sines_b": STEERED - {"/vehicle/velocity"},
    "steering": STEERED,
    "slow": MOVING | {REQUEST},
    "manual_b": MOVING | {REQUEST},
    "manual": MOVING,
    "path": FOLLOWING,
    "planar": MOVING,
}


@dataclasses.dataclass(frozen=True)
class Column:
    stamp: np.ndarray
    log_time: np.ndarray
    messages: list


def read(folder: Path, topic: str) -> Column:
    with AnyReader([folder]) as log:
        chosen = [c for c in log.connections if c.topic == topic]
        rows = [(at, log.deserialize(raw, c.msgtype)) for c, at, raw in log.messages(connections=chosen)]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in rows]
    return Column(np.array(stamps), np.array([at for at, _ in rows]), [m for _, m in rows])


@pytest.mark.parametrize("name", RUNS)
def test_every_run_holds_the_topics_and_messages_intended(sample_logs, name):
    with AnyReader([sample_logs / name]) as log:
        counts = {c.topic: c.msgcount for c in log.connections}
        duration = log.duration / 1e9
        start = log.start_time
    expected = next(topics for begin, topics in TOPICS.items() if name.startswith(begin))
    assert set(counts) == expected
    assert RUNS[name].start <= start < RUNS[name].start + 50_000_000
    silent = {REQUEST} if name == "manual_b" else set()
    lost = 0.52 if name == "steering_pulses_b" else 0.0
    for topic, count in counts.items():
        wanted = 0 if topic in silent else RATES[topic] * (duration - lost)
        assert count == pytest.approx(wanted, abs=3), topic


@pytest.mark.parametrize("name", ["steering_pulses_a", "steering_pulses_b", "manual_a"])
def test_messages_arrive_after_their_stamps_in_order(sample_logs, name):
    angle = read(sample_logs / name, ANGLE)
    wait = (angle.log_time - angle.stamp) / 1e9
    assert np.all(np.diff(angle.stamp) > 0)
    assert np.all(np.diff(angle.log_time) > 0)
    assert 0.001 < np.min(wait) < np.max(wait) < 0.2


def test_a_lost_command_was_sent_and_acted_on(truth, sample_logs):
    signals = steering_signals("steering_pulses_a", truth.steering, 1)
    missing = np.setdiff1d(signals.sent_time[signals.sent_time >= 0.0], signals.request_time)
    assert len(missing) == 1
    index = int(np.searchsorted(signals.sent_time, missing[0]))
    assert signals.sent[index - 1] == 0.0
    assert signals.sent[index] == pytest.approx(np.pi / 2)
    logged = read(sample_logs / "steering_pulses_a", REQUEST).stamp - RUNS["steering_pulses_a"].start
    np.testing.assert_array_equal(logged, np.round(signals.request_time * 1e9))
    assert np.max(np.diff(logged)) / 1e9 == pytest.approx(0.04, abs=0.004)


def test_a_gap_hides_the_moment_of_a_step(sample_logs):
    for topic in STEERED:
        stamps = read(sample_logs / "steering_pulses_b", topic).stamp
        gaps = np.diff(stamps) / 1e9
        assert np.max(gaps) == pytest.approx(0.53, abs=0.02)
        assert np.sort(gaps)[-2] < 0.04
    request = read(sample_logs / "steering_pulses_b", REQUEST)
    last = int(np.argmax(np.diff(request.stamp)))
    assert request.messages[last].angle == 0.0
    assert request.messages[last + 1].angle == pytest.approx(-np.pi / 3)


def test_one_log_begins_just_after_a_step_was_sent(sample_logs):
    request = read(sample_logs / "steering_pulses_b", REQUEST)
    angle = read(sample_logs / "steering_pulses_b", ANGLE)
    assert request.messages[0].angle == pytest.approx(np.pi / 4)
    first = [m.angle for m in angle.messages[:3]]
    assert np.max(np.abs(first)) < 0.02
    assert angle.messages[150].angle > 0.7


def test_one_measured_message_is_lost(sample_logs):
    stamps = read(sample_logs / "steering_sines_a", ANGLE).stamp
    gaps = np.diff(stamps) / 1e9
    assert np.max(gaps) == pytest.approx(0.02, abs=0.002)
    assert np.sort(gaps)[-2] < 0.013


def test_wheels_that_stand_still_give_no_speed(sample_logs):
    standing = read(sample_logs / "steering_pulses_a", "/vehicle/velocity")
    crawling = read(sample_logs / "steering_sines_a", "/vehicle/velocity")
    assert all(m.twist.linear.x == 0.0 for m in standing.messages)
    speeds = [m.twist.linear.x for m in crawling.messages]
    assert np.mean(speeds) == pytest.approx(5.0, abs=0.01)
    assert np.std(speeds) > 0.005


def test_measured_angles_are_the_truth_but_for_the_sensor(truth):
    signals = steering_signals("steering_sines_b", truth.steering, 1)
    error, channel = signals.angle - signals.angle_true, truth.steering.angle.channels["angle"]
    assert np.mean(error) == pytest.approx(channel.bias, abs=1e-4)
    expected = np.sqrt(channel.white_std**2 + channel.noise_std**2 + channel.resolution**2 / 12.0)
    assert np.std(error) == pytest.approx(expected, rel=0.03)


def test_a_study_gets_data_of_its_own_from_a_seed_and_a_truth(truth):
    test = SteeringTest(sines(0.5, [Sine(2.0, 0.4, 3.0)], 1.0), 12.0)
    actuator = dataclasses.replace(truth.steering.actuator, gain=0.5)
    first, again = (steering_signals(test, truth.steering, 1) for _ in range(2))
    other = steering_signals(test, truth.steering, 2)
    weaker = steering_signals(test, dataclasses.replace(truth.steering, actuator=actuator), 1)
    np.testing.assert_array_equal(first.angle, again.angle)
    assert len(first.angle) != len(other.angle) or np.any(first.angle != other.angle)
    ratio = np.ptp(weaker.angle_true) / np.ptp(first.angle_true)
    assert ratio == pytest.approx(0.5 / truth.steering.actuator.gain, rel=1e-9)


def test_imu_and_odometry_messages_say_what_they_do_not_know(sample_logs):
    imu = read(sample_logs / "slow_circle", "/sensing/imu").messages
    odometry = read(sample_logs / "slow_circle", "/localization/odometry").messages
    assert all(m.orientation_covariance[0] == -1.0 for m in imu)
    gravity = np.mean([m.linear_acceleration.z for m in imu])
    assert gravity == pytest.approx(9.81, abs=0.1)
    lengths = [m.pose.pose.orientation.z**2 + m.pose.pose.orientation.w**2 for m in odometry]
    np.testing.assert_allclose(lengths, 1.0, rtol=1e-12)
    assert {(m.header.frame_id, m.child_frame_id) for m in odometry} == {("map", "base_link")}


def test_the_same_seed_writes_the_same_bytes(truth, tmp_path):
    names = ["steering_pulses_a", "steering_pulses_b"]
    for out in ("one", "two"):
        generate(tmp_path / out, truth, seed=3, only=names)
    files = [f.relative_to(tmp_path / "one") for f in (tmp_path / "one").rglob("*.*")]
    assert len(files) == 4
    same, different, unread = filecmp.cmpfiles(tmp_path / "one", tmp_path / "two", files, shallow=False)
    assert (len(same), different, unread) == (4, [], [])


def test_another_seed_changes_noise_and_phases_but_not_the_command(truth):
    first, second = (make_topics("steering_pulses_a", truth, seed)[REQUEST] for seed in (1, 2))
    assert np.all(first.stamps[:10] != second.stamps[:10])
    assert set(first.columns[0]) == set(second.columns[0])


def test_the_logs_are_those_that_the_program_makes(truth, sample_logs):
    name = "steering_pulses_a"
    made = make_topics(name, truth)[ANGLE]
    found = read(sample_logs / name, ANGLE)
    np.testing.assert_array_equal(found.stamp, made.stamps + RUNS[name].start)
    np.testing.assert_array_equal(found.log_time, made.arrivals + RUNS[name].start)
    np.testing.assert_array_equal([m.angle for m in found.messages], made.columns[0])


def test_the_program_runs_as_a_command(sample_logs, tmp_path):
    command = [
        sys.executable,
        str(sample_logs / "generate.py"),
        "--out",
        str(tmp_path),
        "--only",
        "steering_pulses_a",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "steering_pulses_a" in done.stdout
    written = {str(f.relative_to(tmp_path)) for f in tmp_path.rglob("*.*")}
    assert written == {"steering_pulses_a/metadata.yaml", "steering_pulses_a/steering_pulses_a.mcap"}


def test_all_logs_together_stay_small(sample_logs):
    files = [f for name in RUNS for f in (sample_logs / name).iterdir()]
    assert sum(f.stat().st_size for f in files) < 20 * MEGABYTES


# --- nothing tells the truth ----------------------------------------------------------------------


def numbers(values: object) -> Iterator[float]:
    if isinstance(values, dict):
        for value in values.values():
            yield from numbers(value)
    elif isinstance(values, list):
        for value in values:
            yield from numbers(value)
    elif isinstance(values, (int, float)):
        yield float(values)


def secrets(folder: Path, told: set[float], digits: int) -> set[float]:
    """Numbers of the truth that would give it away: of so many digits, and not told on purpose."""
    yaml = YAML(typ="safe", pure=True)
    found = {number for file in folder.glob("*.yaml") for number in numbers(yaml.load(file))}
    return {abs(n) for n in found if len(f"{n:g}".strip("-0.").replace(".", "")) >= digits} - told


@pytest.fixture(scope="module")
def truth_folder(sample_logs) -> Path:
    return sample_logs.parent / "tests" / "truth"


@pytest.mark.parametrize(("suffixes", "digits"), [({".yaml", ".md"}, 2), ({".py"}, 3)])
def test_no_text_beside_the_logs_tells_a_true_value(sample_logs, truth_folder, suffixes, digits):
    vehicle = (sample_logs / "vehicle.yaml").read_text("utf-8")
    told = {float(n) for n in re.findall(r"\d+\.?\d*", vehicle)}
    hidden = secrets(truth_folder, told, digits)
    assert {0.986, 0.1173, 0.262, 182000.0} <= hidden
    texts = [file for file in sample_logs.rglob("*") if file.suffix in suffixes]
    assert len(texts) > 10
    number = re.compile(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?(?![\w.])")
    for file in texts:
        said = {float(n.replace("_", "")) for n in number.findall(file.read_text("utf-8"))}
        assert not said & hidden, file


def test_no_log_carries_anything_beside_its_messages(sample_logs):
    for name in RUNS:
        metadata = YAML(typ="safe", pure=True).load(sample_logs / name / "metadata.yaml")
        assert metadata["rosbag2_bagfile_information"]["custom_data"] is None
        assert {f.suffix for f in (sample_logs / name).iterdir()} <= {".yaml", ".mcap", ".db3"}
        for file in (sample_logs / name).glob("*.mcap"):
            with file.open("rb") as stream:
                reader = make_reader(stream)
                records = [record.name for record in reader.iter_metadata()]
                attachments = list(reader.iter_attachments())
            assert records == ["rosbag2"], name  # what metadata.yaml says, once more
            assert attachments == [], name


def test_the_vehicle_file_tells_only_what_an_engineer_knows(truth, sample_logs):
    told = YAML(typ="safe", pure=True).load(sample_logs / "vehicle.yaml")
    assert set(told) == {
        "mass",
        "cg_to_front_axle",
        "cg_to_rear_axle",
        "track",
        "cg_height",
        "steering_ratio",
        "reference_point",
        "imu_position",
    }
    for truck in (truth.truck, truth.planar):
        for name in ("mass", "cg_to_front_axle", "cg_to_rear_axle", "track", "cg_height"):
            assert float(told[name].split()[0]) == getattr(truck.body, name)
        assert told["steering_ratio"] == truck.steering_ratio
        assert tuple(float(p.split()[0]) for p in told["imu_position"]) == truck.imu_position
