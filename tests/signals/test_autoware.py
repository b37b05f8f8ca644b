"""Logs of Autoware, of today and of before its messages were renamed."""

from importlib import resources

import pytest
from log_files import TYPES, header, message, nanoseconds, new, odometry, plain, write_bag
from rosbags.typesys import get_types_from_msg

from ident.signals.run import load_runs

_text = resources.files("ident.logs").joinpath("definitions").joinpath("autoware.msg").read_text()
_first, _, _rest = _text.partition("\n")
TYPES.register(get_types_from_msg(_rest, _first.removeprefix("MSG: ")))


def stamp(k):
    return header(nanoseconds(k / 10)).stamp


def control(k):
    time = {"stamp": stamp(k), "control_time": stamp(k)}
    package = "autoware_control_msgs/msg"
    lateral = new(
        f"{package}/Lateral",
        **time,
        steering_tire_angle=0.01 * k,
        steering_tire_rotation_rate=0.0,
        is_defined_steering_tire_rotation_rate=False,
    )
    longitudinal = new(
        f"{package}/Longitudinal",
        **time,
        velocity=5.0,
        acceleration=0.5,
        jerk=0.0,
        is_defined_acceleration=True,
        is_defined_jerk=False,
    )
    fields = {**time, "lateral": lateral, "longitudinal": longitudinal}
    return plain("/control/command/control_cmd", f"{package}/Control", nanoseconds(k / 10), **fields)


def old_control(k):
    package = "autoware_auto_control_msgs/msg"
    time = {"stamp": stamp(k)}
    turn = {"steering_tire_angle": 0.01 * k, "steering_tire_rotation_rate": 0.0}
    lateral = new(f"{package}/AckermannLateralCommand", **time, **turn)
    drive = {"speed": 5.0, "acceleration": 0.5, "jerk": 0.0}
    longitudinal = new(f"{package}/LongitudinalCommand", **time, **drive)
    fields = {**time, "lateral": lateral, "longitudinal": longitudinal}
    topic = "/control/command/control_cmd"
    return plain(topic, f"{package}/AckermannControlCommand", nanoseconds(k / 10), **fields)


def vehicle(k, package):
    at = nanoseconds(k / 10)
    status = "/vehicle/status"
    return [
        plain(
            f"{status}/steering_status",
            f"{package}/SteeringReport",
            at,
            stamp=stamp(k),
            steering_tire_angle=0.02,
        ),
        plain(
            f"{status}/control_mode",
            f"{package}/ControlModeReport",
            at,
            stamp=stamp(k),
            mode=4 if k < 5 else 1,
        ),
        message(
            f"{status}/velocity_status",
            f"{package}/VelocityReport",
            at,
            longitudinal_velocity=5.0,
            lateral_velocity=0.1,
            heading_rate=0.2,
        ),
    ]


def localization(k):
    pose = odometry(nanoseconds(k / 10), k, 0.0, 0.1, 5.0)
    object.__setattr__(pose, "topic", "/localization/kinematic_state")
    return pose


@pytest.mark.parametrize("sqlite", [False, True])
@pytest.mark.parametrize(
    ("command", "package"),
    [(control, "autoware_vehicle_msgs/msg"), (old_control, "autoware_auto_vehicle_msgs/msg")],
    ids=["new", "old"],
)
def test_the_built_in_map_finds_the_signals_of_autoware(tmp_path, command, package, sqlite):
    messages = [each for k in range(20) for each in (command(k), *vehicle(k, package), localization(k))]
    folder = write_bag(tmp_path / "run", messages, sqlite=sqlite)
    (run,) = load_runs([folder]).runs
    assert run.health.channels == "built-in autoware"
    signals = run.signals
    assert signals["road_wheel_request"].values[:3].tolist() == pytest.approx([0, 0.01, 0.02], abs=1e-7)
    assert signals["road_wheel_request"].time[:3].tolist() == pytest.approx([0, 0.1, 0.2])
    assert signals["road_wheel_angle"].values[0] == pytest.approx(0.02)
    assert signals["speed"].values[0] == pytest.approx(5.0)
    assert signals["reference_speed"].values[0] == pytest.approx(5.0)
    assert signals["acceleration_request"].values[0] == pytest.approx(0.5)
    assert signals["engaged"].values.tolist() == [0.0] * 5 + [1.0] * 15
    assert signals["lateral_velocity"].at == "rear_axle"
    assert signals["heading"].values[0] == pytest.approx(0.1)
    assert run.health.damage == [] or all("speed" in item.what for item in run.health.damage)
