"""The undeclared sets as written: made by their truth, readable, small, and silent on what they hold."""

import re
from pathlib import Path

import numpy as np
import pytest
from generator.injected import OUTSIDE, TYPICAL
from generator.messages import Topic
from generator.motion import IMU, ODOMETRY, VELOCITY
from generator.steering import ANGLE, REQUEST
from generator.undeclared import (
    ANSWERS,
    FOLDER,
    PARTS,
    SETS,
    generate_undeclared,
    hidden_runs,
    hidden_truck,
    injected_into,
    topics_of,
)
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

SEED = 1
TOPICS = {REQUEST, ANGLE, VELOCITY, IMU, ODOMETRY}
MEGABYTES = 1e6
NAMES = sorted({*TYPICAL, *OUTSIDE})


@pytest.fixture(scope="module")
def folder(sample_logs) -> Path:
    return sample_logs / FOLDER


@pytest.mark.parametrize("name", SETS)
def test_every_set_holds_eight_runs_with_all_topics(folder, name):
    runs = sorted(path.name for path in (folder / name).iterdir() if path.is_dir())
    assert runs == [f"run_{number:02d}" for number in range(1, 9)]
    durations = []
    for run in runs:
        with AnyReader([folder / name / run]) as log:
            assert {connection.topic for connection in log.connections} == TOPICS
            durations.append(log.duration / 1e9)
    assert min(durations) > 25.0
    assert max(durations) < 43.0


@pytest.mark.parametrize("name", [SETS[0], SETS[-1]])
def test_the_logs_are_those_that_the_program_makes(folder, name):
    truth, injected = hidden_truck(name, SEED)
    run = hidden_runs(name, SEED)[3]
    made = {topic.name: topic for topic in topics_of(run, truth, injected, SEED, name)}[IMU]
    with AnyReader([folder / name / run.name]) as log:
        chosen = [connection for connection in log.connections if connection.topic == IMU]
        found = [log.deserialize(raw, one.msgtype) for one, _, raw in log.messages(connections=chosen)]
    stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in found]
    np.testing.assert_array_equal(stamps, made.stamps + run.start)
    np.testing.assert_array_equal([one.angular_velocity.z for one in found], made.columns[2])


def test_runs_of_a_set_are_driven_one_after_another_in_an_order_of_their_own():
    orders = set()
    for name in SETS:
        runs = hidden_runs(name, SEED)
        assert {run.plan for run in runs} == set(PARTS)
        assert min(np.diff([run.start for run in runs])) > 60e9
        orders.add(tuple(run.plan for run in runs))
    assert len(orders) == len(SETS)


def test_the_answers_are_of_the_six_kinds():
    """One fault of the actuator, one of the motion, two, none, one of no catalogue, one of a sensor."""
    table = YAML(typ="safe", pure=True).load(Path(__file__).parents[1] / "truth" / ANSWERS)
    assert tuple(sorted(table)) == SETS
    kinds = sorted([one.name in TYPICAL for one in injected_into(name)] for name in SETS)
    assert kinds == [[], [False], [True], [True], [True], [True, True]]


def test_each_set_is_a_truck_of_its_own_that_its_file_describes(folder):
    files = set()
    for name in SETS:
        told = YAML(typ="safe", pure=True).load(folder / name / "vehicle.yaml")
        body = hidden_truck(name, SEED)[0].planar.body
        assert float(told["mass"].split()[0]) == body.mass
        assert float(told["cg_to_front_axle"].split()[0]) == body.cg_to_front_axle
        assert "yaw_inertia" not in told
        files.add((folder / name / "vehicle.yaml").read_text("utf-8"))
    assert len(files) == len(SETS)


def test_what_is_injected_reaches_the_logs(folder, tmp_path):
    """The run of a set differs from that of the same truck without its fault."""
    for name in SETS:
        truth, injected = hidden_truck(name, SEED)
        if not injected:
            continue
        run = hidden_runs(name, SEED)[0]
        one, other = (
            {topic.name: topic for topic in topics_of(run, truth, effects, SEED, name)}
            for effects in (injected, [])
        )
        changed = {topic for topic in TOPICS if _differ(one[topic], other[topic])}
        assert changed, name
        assert REQUEST not in changed


def _differ(one: Topic, other: Topic) -> bool:
    return any(np.any(a != b) for a, b in zip(one.columns, other.columns, strict=True))


def test_the_same_seed_writes_the_same_bytes(folder, tmp_path):
    answers = Path(__file__).parents[1] / "truth" / ANSWERS
    made = generate_undeclared(tmp_path, SEED, [SETS[2]], answers)[0]
    for file in sorted(path for path in made.rglob("*") if path.is_file()):
        assert file.read_bytes() == (folder / SETS[2] / file.relative_to(made)).read_bytes(), file.name


def test_the_sets_are_small(folder):
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) < 12.5 * MEGABYTES


# --- nothing tells the answer ----------------------------------------------------------------------


def told_by(text: str) -> list[str]:
    """Names of effects in a text, however their words are joined."""
    plain = re.sub(r"[\s_-]+", " ", text.lower())
    return [name for name in NAMES if name.replace("_", " ") in plain]


def test_a_name_is_found_however_it_is_written():
    assert told_by("It has Steering-Column play.") == ["steering_column_play"]
    assert told_by("steering_wheel_request") == []


def test_no_text_or_name_beside_the_logs_says_what_they_hold(sample_logs, folder):
    texts = [*folder.rglob("*.yaml"), *folder.rglob("*.md"), sample_logs / "README.md"]
    texts += [sample_logs / "channels.yaml"]
    assert len(texts) > 6 * 8
    for file in texts:
        assert told_by(file.read_text("utf-8")) == [], file
    for path in folder.rglob("*"):
        assert told_by(str(path.relative_to(folder))) == []
        assert path.is_dir() or path.suffix in {".mcap", ".yaml"}, path


def test_no_log_says_what_it_holds(folder):
    files = list(folder.rglob("*.mcap"))
    assert len(files) == 6 * 8
    for file in files:
        assert told_by(file.read_bytes().decode("latin-1")) == [], file
        with file.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            said = [schema.data.decode("latin-1") + schema.name for schema in summary.schemas.values()]
            said += [f"{channel.topic} {channel.metadata}" for channel in summary.channels.values()]
            said += [f"{record.name} {record.metadata}" for record in reader.iter_metadata()]
            assert list(reader.iter_attachments()) == []
        assert told_by(" ".join(said)) == [], file


def test_messages_hold_numbers_and_frames_alone(folder):
    for name in SETS:
        with AnyReader([folder / name / "run_01"]) as log:
            raw = b"".join(bytes(data) for _, _, data in log.messages())
        assert told_by(raw.decode("latin-1")) == []
        assert set(re.findall(rb"[a-z_]{8,}", raw)) <= {b"base_link"}


def test_the_program_that_makes_them_does_not_say_which_set_has_what(sample_logs):
    """A file that names sets names no effect."""
    for file in sample_logs.rglob("*.py"):
        text = file.read_text("utf-8")
        if any(name in text for name in SETS):
            assert told_by(text) == [], file
