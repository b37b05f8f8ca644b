"""The steering of a vehicle that runs Autoware: the pair is the road wheel's, by the built-in channel map."""

from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.truth import load_truth
from log_files import TYPES, header, nanoseconds, new, plain, write_bag
from rosbags.typesys import get_types_from_msg

from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.steering import SteeringSettings, steering

_text = resources.files("ident.logs").joinpath("definitions").joinpath("autoware.msg").read_text()
_first, _, _rest = _text.partition("\n")
TYPES.register(get_types_from_msg(_rest, _first.removeprefix("MSG: ")))

TRUTH = replace(load_truth().steering.actuator, gain=0.97)
RATIO = 20.5
NOISE = 0.0001  # [rad] at the road wheel
ENGAGED_FROM, END = 3.0, 45.0


def control(time, angle):
    stamp = {"stamp": header(nanoseconds(time)).stamp, "control_time": header(nanoseconds(time)).stamp}
    kinds = "autoware_control_msgs/msg"
    lateral = new(
        f"{kinds}/Lateral",
        **stamp,
        steering_tire_angle=np.float32(angle),
        steering_tire_rotation_rate=0.0,
        is_defined_steering_tire_rotation_rate=False,
    )
    longitudinal = new(
        f"{kinds}/Longitudinal",
        **stamp,
        velocity=0.0,
        acceleration=0.0,
        jerk=0.0,
        is_defined_acceleration=False,
        is_defined_jerk=False,
    )
    fields = {**stamp, "lateral": lateral, "longitudinal": longitudinal}
    return plain("/control/command/control_cmd", f"{kinds}/Control", nanoseconds(time), **fields)


def status(topic, kind, time, **fields):
    stamp = header(nanoseconds(time)).stamp
    return plain(
        f"/vehicle/status/{topic}",
        f"autoware_vehicle_msgs/msg/{kind}",
        nanoseconds(time),
        stamp=stamp,
        **fields,
    )


def request(time):
    """Pulses of two sizes, then sines of 1 and 5 rad/s, at the road wheel [rad]."""
    pulses = np.where((time % 7 > 2) & (time < 28), np.where(time < 14, 0.05, -0.075), 0.0)
    slow = np.where((time >= 28) & (time < 36), 0.02 * np.sin(1.0 * (time - 28)), 0.0)
    fast = np.where(time >= 36, 0.02 * np.sin(5.0 * (time - 36)), 0.0)
    return pulses + slow + fast


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """While the driver steers, until ENGAGED_FROM, the request is sent and not acted on."""
    random = np.random.default_rng(3)
    sent_time = np.arange(0.0, END, 1 / 30)
    sent = np.float32(request(sent_time)).astype(float)
    time = np.arange(0.004, END, 0.02)
    engaged = sent_time >= ENGAGED_FROM
    driver = 0.03 * np.sin(2.0 * time) * (time < ENGAGED_FROM)
    rest = WheelState(ENGAGED_FROM - 1, 0.0, 0.0, 0.0)
    acting = np.maximum(time, ENGAGED_FROM - 1)
    true, _ = held_response(TRUTH, sent_time[engaged], sent[engaged], acting, rest)
    measured = np.where(time < ENGAGED_FROM, driver, true) + NOISE * random.standard_normal(time.size)
    messages = [control(t, u) for t, u in zip(sent_time, sent, strict=True)]
    messages += [
        status("steering_status", "SteeringReport", t, steering_tire_angle=np.float32(y))
        for t, y in zip(time, measured, strict=True)
    ]
    modes = np.arange(0.0, END, 0.1)
    messages += [
        status("control_mode", "ControlModeReport", t, mode=1 if t >= ENGAGED_FROM else 4) for t in modes
    ]
    folder = write_bag(
        tmp_path_factory.mktemp("autoware") / "drive", sorted(messages, key=lambda message: message.time)
    )
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return steering([folder], InputSettings(), SteeringSettings(), context).result


def test_the_pair_is_the_road_wheels(result):
    assert result.pair == "road_wheel"
    assert result.runs[0].channels == "built-in autoware"
    assert result.ratio == []


@pytest.mark.parametrize("name", ["gain", "dead_time", "time_constant_1", "time_constant_2"])
def test_the_truth_lies_within_four_standard_errors_and_is_identified(result, name):
    found = getattr(result.model, name)
    assert found.status == "identified"
    assert abs(found.value - float(np.real(getattr(TRUTH, name)))) < 4 * found.std
    assert found.std < 0.05 * found.value


def test_what_the_driver_did_is_left_out(result):
    assert result.adequate
    assert min(experiment.start for experiment in result.experiments) >= ENGAGED_FROM
    assert result.rms_error == pytest.approx(NOISE, rel=0.1)


def test_pulses_and_sines_are_found(result):
    kinds = [experiment.kind for experiment in result.experiments]
    assert kinds.count("pulse") == 3
    frequencies = sorted(e.frequency for e in result.experiments if e.kind == "sine")
    assert frequencies == pytest.approx([1.0, 5.0], rel=0.01)
