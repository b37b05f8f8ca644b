"""`ident info`: everything that is in the logs, whatever their state."""

import json
import os
from dataclasses import asdict
from pathlib import Path

import pytest
from log_files import angles, nanoseconds, velocity, write_bag, write_mcap

import ident
from ident.errors import UnusableLog
from ident.report.text import describe
from ident.stages.info import info
from ident.stages.inputs import InputSettings
from ident.stages.output import Context

ROOT = Path(__file__).parents[2]
SHARED = ROOT / ".." / "shared"
FORMATS = Path(os.environ.get("IDENT_FORMATS", SHARED / "formats"))
MEASURED = Path(os.environ.get("IDENT_MEASURED", SHARED / "measured"))
CONTEXT = Context("ident info logs", "2026-01-01T00:00:00+00:00", seed=3)


def ask(*logs, **settings):
    return info(logs, InputSettings(**settings), CONTEXT).result


def test_says_what_is_there_and_where_it_came_from(tmp_path):
    write_bag(tmp_path / "run", [*angles(100), *(velocity(nanoseconds(k / 50), 5.0) for k in range(50))])
    (tmp_path / "vehicle.yaml").write_text("mass: 1 t")
    result = ask(tmp_path)
    (run,) = result.runs
    assert (run.name, run.format, run.channels, run.vehicle) == (
        "run",
        "rosbag2 mcap",
        "built-in sample_truck",
        "vehicle.yaml",
    )
    assert {topic.name: topic.messages for topic in run.topics} == {
        "/vehicle/steering_wheel": 100,
        "/vehicle/velocity": 50,
    }
    assert set(run.signals) == {"steering_wheel_angle", "speed"}
    assert "yaw_rate" in run.missing
    provenance = result.provenance
    assert (provenance.version, provenance.seed) == (ident.__version__, 3)
    assert (provenance.command, provenance.date) == (CONTEXT.command, CONTEXT.date)
    assert provenance.applied == {"run": "channels: built-in sample_truck; vehicle: vehicle.yaml"}
    assert [file.path for file in provenance.files] == ["run/run.mcap"]


def test_damage_is_reported_with_what_it_cost(tmp_path):
    folder = write_bag(tmp_path / "run", angles(1000))
    file = folder / "run.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 6 // 10])
    damage = ask(tmp_path).runs[0].damage
    assert any(item.messages_lost for item in damage)
    assert any(item.seconds_lost for item in damage)


def test_a_log_without_messages_has_no_start(tmp_path):
    write_mcap(tmp_path / "a.mcap", [])
    (run,) = ask(tmp_path).runs
    assert (run.start, run.duration, run.topics) == ("", 0.0, [])
    assert "a: no messages, mcap" in describe(ask(tmp_path))


def test_a_log_without_signals_says_how_to_map_it(tmp_path):
    write_mcap(tmp_path / "a.mcap", angles(5, topic="/unheard_of"))
    text = describe(ask(tmp_path))
    assert "signals   none: `ident init LOGS` guesses a channel map" in text
    assert "/unheard_of (truck_msgs/msg/SteeringWheelAngle, 5 messages)" in text


def test_unreadable_logs_do_not_stop_the_others(tmp_path):
    write_bag(tmp_path / "good", angles(10))
    (tmp_path / "bad.mcap").write_bytes(b"")
    result = ask(tmp_path)
    assert [run.name for run in result.runs] == ["good"]
    assert [refusal.what for refusal in result.unreadable] == ["bad"]
    assert result.warnings


def test_nothing_readable_is_an_error(tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"")
    with pytest.raises(UnusableLog):
        ask(tmp_path)


def test_the_result_is_plain_json_without_nan(tmp_path):
    write_mcap(tmp_path / "a.mcap", angles(1))
    write_mcap(tmp_path / "b.mcap", [])
    result = asdict(ask(tmp_path))
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_a_stated_latency_is_taken_out_and_said(tmp_path):
    write_bag(tmp_path / "run", angles(100))
    from ident.stages.inputs import load  # noqa: PLC0415 (this test alone looks below the stage)

    plain = load([tmp_path], InputSettings(), CONTEXT).runs[0]
    settings = InputSettings(align={"latency": {"steering_wheel_angle": "30 ms"}})
    moved = load([tmp_path], settings, CONTEXT).runs[0]
    shift = plain.signals["steering_wheel_angle"].time - moved.signals["steering_wheel_angle"].time
    assert shift == pytest.approx(0.03)
    assert "steering_wheel_angle: moved 0.03 s earlier, as align.latency says" in moved.health.clocks


def test_the_summary_names_runs_signals_gaps_and_damage(tmp_path):
    messages = angles(300)
    del messages[100:150]
    write_bag(tmp_path / "run", messages)
    (tmp_path / "bad.mcap").write_bytes(b"")
    text = describe(ask(tmp_path))
    assert text.startswith("1 run, 3.0 s")
    assert "run: 3.0 s from 2023-11-14" in text
    assert "steering_wheel_angle 100/s" in text
    assert "/vehicle/steering_wheel 1 (longest 0.51 s, 50 messages)" in text
    assert "bad: " in text
    assert max(map(len, text.splitlines())) < 240


def test_hostile_names_do_not_reach_the_terminal(tmp_path):
    write_mcap(tmp_path / "a.mcap", angles(5, topic="/x\x1b[31m\n\u202egpj"))
    text = describe(ask(tmp_path))
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert all(line.isprintable() for line in text.splitlines())


@pytest.mark.skipif(not FORMATS.is_dir(), reason=f"no files of other tools in {FORMATS} (IDENT_FORMATS)")
def test_files_of_other_tools_are_read_or_refused_in_one_line():
    refused: list[str] = []
    for path in sorted(FORMATS.rglob("*")):
        try:
            describe(ask(path))
        except UnusableLog as error:
            refused.append(str(error))
    assert refused
    assert all("\n" not in message for message in refused)
    result = ask(FORMATS)
    messages = {run.name: sum(topic.messages for topic in run.topics) for run in result.runs}
    assert messages["rosbag2/rosbag2_py_mcap_wbag"] == 6074
    assert messages["rosbag2/rosbag2_py_sqlite3_talker"] == 20
    assert messages["rosbag2/rosbag2_tests_mcap_bag_with_topics_and_service_events"] == 10
    assert messages["rosbag2/ros2bag_empty_bag"] == 0
    assert all(not run.damage for run in result.runs if run.format != "mcap" and "service" not in run.name)


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)")
def test_measured_logs_are_read_as_their_facts_say():
    result = ask(MEASURED)
    runs = {run.name: run for run in result.runs}
    servo = runs["servo_miuzei/steps"]
    assert len(servo.topics[0].gaps) == 29  # 30 rollouts
    assert servo.signals["steering_wheel_angle"].resolution == pytest.approx(6.283185 / 4096, rel=1e-3)
    rav4 = runs["comma2k19_rav4/rav4_segment40"]
    torque = next(topic for topic in rav4.topics if topic.name == "/control/steering_torque_request")
    assert torque.repeated_stamps == 11
    assert rav4.signals["steering_wheel_angle"].resolution == pytest.approx(0.1 * 3.14159265 / 180, rel=1e-6)
    assert rav4.signals["speed"].resolution == pytest.approx(0.01 / 3.6, rel=1e-6)
    assert runs["rhino_volvo_fh16/snake_raw"].missing == ["speed"]
    assert runs["rhino_volvo_fh16/snake_raw"].signals["yaw_rate"].repeated == pytest.approx(0.86, abs=0.01)
    assert runs["kora_k3_bags/speed_6000_steer_0_test_1"].format == "ros1"
    assert runs["kora_k3_bags/speed_6000_steer_0_test_1"].signals["yaw_rate"].resolution > 0
    assert result.unreadable == []


def test_the_sample_logs_are_sound_but_for_what_was_lost_on_purpose():
    result = ask(ROOT / "sample_logs")
    assert result.unreadable == []
    assert all(run.damage == [] for run in result.runs)
    assert all("channels.yaml" in run.channels for run in result.runs)
    lost = {run.name: sum(topic.lost or 0 for topic in run.topics) for run in result.runs}
    assert lost["steering_pulses_b"] > 50  # the gap of half a second
    assert 0 < lost["steering_pulses_a"] < 5  # one command
