"""`ident init`: guesses that are right on logs of every kind, and say why."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from log_files import (
    FLAG,
    angles,
    imu,
    message,
    nanoseconds,
    odometry,
    plain,
    velocity,
    write_bag,
    write_mcap,
)

from ident.errors import NotIdentifiable, UnusableLog
from ident.signals.channel_map import read_channel_map
from ident.stages.init import init
from ident.stages.output import Context
from ident.vehicle import read_vehicle

ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get("IDENT_MEASURED", ROOT / ".." / "shared" / "measured"))
CONTEXT = Context("ident init logs", "")


def guess(tmp_path, *logs):
    """The guesses, read back as the files that they become."""
    texts = init(logs, CONTEXT)
    channels, vehicle = tmp_path / "guessed_channels.yaml", tmp_path / "guessed_vehicle.yaml"
    channels.write_text(texts.channels, encoding="utf-8")
    vehicle.write_text(texts.vehicle, encoding="utf-8")
    return texts, read_channel_map(channels).signals, read_vehicle(vehicle)


WHEELBASE, RATIO = 4.0, 16.0


def drive(*, angle_scale=1.0, speed_scale=1.0, rate_scale=1.0, gravity=9.81, seconds=40.0):
    """A slow slalom of a kinematic car, with the reference point on the rear axle."""
    messages = []
    x = y = yaw = 0.0
    for k in range(int(seconds * 50)):
        t = k / 50
        speed, wheel = 4 + np.sin(0.3 * t), 1.6 * np.sin(0.9 * t)
        rate = speed * np.tan(wheel / RATIO) / WHEELBASE
        x, y, yaw = x + speed * np.cos(yaw) / 50, y + speed * np.sin(yaw) / 50, yaw + rate / 50
        stamp = nanoseconds(t)
        messages += [
            *angles_at(stamp, "/lkas/steer_angle", wheel * angle_scale),
            *angles_at(stamp, "/lkas/steer_cmd", 1.6 * np.sin(0.9 * (t + 0.2)) * angle_scale),
            velocity(stamp, speed * speed_scale),
            imu(stamp, rates=(0, 0, rate * rate_scale), forces=(0, speed * rate, gravity), topic="/imu/data"),
            odometry(stamp, x, y, yaw, speed, 0.0, rate),
        ]
    return messages


def length(texts):
    return float(re.search(r"steering ratio x wheelbase (\S+) m", texts.channels)[1])


def angles_at(stamp, topic, value):
    return [plain(topic, "std_msgs/msg/Float64", stamp, data=float(value))]


def test_finds_the_signals_of_a_car_it_has_never_seen(tmp_path):
    write_bag(tmp_path / "run", drive())
    texts, signals, vehicle = guess(tmp_path, tmp_path / "run")
    topics = {name: (channels[0].topic, channels[0].field) for name, channels in signals.items()}
    assert topics["steering_wheel_angle"] == ("/lkas/steer_angle", "data")
    assert topics["steering_wheel_request"] == ("/lkas/steer_cmd", "data")
    assert topics["speed"] == ("/vehicle/velocity", "twist.linear.x")
    assert topics["yaw_rate"] == ("/imu/data", "angular_velocity.z")
    assert topics["lateral_acceleration"] == ("/imu/data", "linear_acceleration.y")
    assert topics["heading"] == ("/localization/odometry", "pose.pose.orientation")
    assert topics["position_x"] == ("/localization/odometry", "pose.pose.position.x")
    assert {channels[0].unit for name, channels in signals.items() if "angle" in name} == {"rad"}
    assert length(texts) == pytest.approx(WHEELBASE * RATIO, rel=0.02)
    assert "the angle 0.20 s later is 1 times it, correlation 1.000" in texts.channels
    assert "gravity: z is up" in texts.channels
    assert texts.found == list(signals)
    assert vehicle.mass is None


def test_sees_units_that_are_not_si(tmp_path):
    write_bag(tmp_path / "run", drive(angle_scale=180 / np.pi, speed_scale=3.6, rate_scale=180 / np.pi))
    _, signals, _ = guess(tmp_path, tmp_path / "run")
    assert signals["speed"][0].unit == "km/h"
    assert signals["yaw_rate"][0].unit == "deg/s"


def test_sees_degrees_of_the_steering_wheel(tmp_path):
    write_bag(tmp_path / "run", drive(angle_scale=180 / np.pi))
    texts, signals, _ = guess(tmp_path, tmp_path / "run")
    assert signals["steering_wheel_angle"][0].unit == "deg"
    assert length(texts) == pytest.approx(WHEELBASE * RATIO, rel=0.02)


def test_warns_of_reversed_signs_and_of_an_imu_upside_down(tmp_path):
    write_bag(tmp_path / "run", drive(rate_scale=-1.0, gravity=-9.81))
    texts, _, _ = guess(tmp_path, tmp_path / "run")
    assert "-1 times the derivative of the heading, correlation -1.000, SIGN REVERSED" in texts.channels
    assert "Z IS DOWN" in texts.channels


def test_flags_references_and_modes_are_found(tmp_path):
    messages = [
        *angles(100, topic="/ctl/target_steering"),
        *(message("/ctl/engaged", FLAG, nanoseconds(k), engaged=k > 2) for k in range(5)),
        *(velocity(nanoseconds(k), 3.0 + k, topic="/ctl/target_speed") for k in range(5)),
    ]
    write_bag(tmp_path / "run", messages)
    _, signals, _ = guess(tmp_path, tmp_path / "run")
    assert set(signals) == {"steering_wheel_request", "engaged", "reference_speed"}


def test_names_from_a_log_cannot_break_out_of_their_place(tmp_path):
    topic = '/steer"} \n  gear: {topic: /evil, field: x, unit: m/s} #'
    write_mcap(tmp_path / "a.mcap", [*angles(100, topic=topic), *angles(100, topic="/other\n- evil: 1")])
    texts, signals, _ = guess(tmp_path, tmp_path / "a.mcap")
    assert list(signals) == ["steering_wheel_angle"]
    assert signals["steering_wheel_angle"][0].topic == topic
    assert "- evil: 1" not in texts.channels.splitlines()


def test_topics_that_are_not_used_are_listed(tmp_path):
    messages = [
        *angles(100),
        *(plain("/camera", "std_msgs/msg/UInt8", nanoseconds(k), data=1) for k in range(3)),
    ]
    write_bag(tmp_path / "run", messages)
    texts, _, _ = guess(tmp_path, tmp_path / "run")
    assert "#   /camera (std_msgs/msg/UInt8)" in texts.channels


def test_what_never_moves_is_not_guessed(tmp_path):
    messages = [*angles(100), *(velocity(nanoseconds(k), 0.0) for k in range(20))]
    write_bag(tmp_path / "run", messages)
    _, signals, _ = guess(tmp_path, tmp_path / "run")
    assert list(signals) == ["steering_wheel_angle"]


def test_a_log_without_anything_known_is_refused(tmp_path):
    write_bag(tmp_path / "run", [plain("/camera", "std_msgs/msg/UInt8", nanoseconds(1), data=1)])
    with pytest.raises(NotIdentifiable, match=r"/camera \(std_msgs/msg/UInt8\)"):
        init([tmp_path / "run"], CONTEXT)


def test_unreadable_logs_are_refused_or_noted(tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"")
    with pytest.raises(UnusableLog, match="is empty"):
        init([tmp_path], CONTEXT)
    write_bag(tmp_path / "good", angles(100))
    assert any("is empty" in note for note in init([tmp_path], CONTEXT).notes)


def test_guesses_the_channels_of_the_sample_logs(tmp_path):
    texts, guessed, vehicle = guess(tmp_path, ROOT / "sample_logs")
    known = read_channel_map(ROOT / "sample_logs" / "channels.yaml").signals
    for name, channels in known.items():
        assert (guessed[name][0].topic, guessed[name][0].field) == (channels[0].topic, channels[0].field), (
            name
        )
        assert guessed[name][0].unit == channels[0].unit, name
    assert vehicle.reference_point == "rear_axle"
    assert "steering ratio x wheelbase 9" in texts.vehicle


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)")
@pytest.mark.parametrize(
    "name", ["p1_psu", "iac_deepdynamics", "comma2k19_rav4", "servo_miuzei", "rhino_volvo_fh16"]
)
def test_guesses_the_channels_of_measured_logs(tmp_path, name):
    _, guessed, _ = guess(tmp_path, MEASURED / name)
    known = read_channel_map(MEASURED / name / "channels.yaml").signals
    wrong = {
        signal: guessed.get(signal, [None])[0]
        for signal, (channel, *_) in known.items()
        if not signal.endswith("_force")
        and not (signal == "speed" and "speed" not in guessed)  # the odometry's, which is both
        and (signal not in guessed or guessed[signal][0].topic != channel.topic)
    }
    assert set(wrong) <= {"longitudinal_velocity", "lateral_velocity"}  # on p1 two topics hold the same
