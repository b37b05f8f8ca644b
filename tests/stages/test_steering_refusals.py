"""What cannot be identified is refused in one line: what was found, what is needed, what to do."""

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.truth import Actuator
from log_files import ANGLE, REQUEST, message, nanoseconds, write_bag

from ident.errors import BadRecipe, NotIdentifiable, UnusableLog
from ident.stages.inputs import InputSettings
from ident.stages.output import Context
from ident.stages.steering import SteeringSettings, steering

TRUTH = Actuator(gain=1.0, dead_time=0.12, time_constant_1=0.25, time_constant_2=0.08)
END = 30.0
SENT = np.arange(0.0, END, 0.02)
SEEN = np.arange(0.003, END, 0.01)
NOISE = 0.002 * np.random.default_rng(0).standard_normal(SEEN.size)
PULSES = np.where(SENT % 7 > 2, 0.8, 0.0)


def answer(sent):
    rest = WheelState(-1.0, 0.0, 0.0, 0.0)
    return held_response(TRUTH, SENT, sent, SEEN, rest)[0] + NOISE


def log(folder, sent, seen):
    messages = []
    if sent is not None:
        messages += [
            message("/control/steering_wheel_request", REQUEST, nanoseconds(t), angle=float(u))
            for t, u in zip(SENT, sent, strict=True)
        ]
    messages += [
        message("/vehicle/steering_wheel", ANGLE, nanoseconds(t), angle=float(y))
        for t, y in zip(SEEN, seen, strict=True)
    ]
    return write_bag(folder / "run", sorted(messages, key=lambda each: each.time))


def identify(*logs):
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return steering(list(logs), InputSettings(), SteeringSettings(), context).result


CASES = {
    "no request": (
        None,
        answer(PULSES),
        "no steering request with a measured angle in 1 run: found steering_wheel_angle",
    ),
    "only noise": (PULSES, NOISE, "the measured angle does not follow the request: gain"),
    "constant request": (0 * PULSES + 0.3, 0.3 + NOISE, "the request is constant: 0.3 rad"),
    "degrees": (PULSES, np.rad2deg(answer(PULSES)), "steering_wheel_angle seems to be in degrees"),
    "request in degrees": (
        np.rad2deg(PULSES),
        answer(PULSES),
        "steering_wheel_request seems to be in degrees",
    ),
    "wrong sign": (-PULSES, answer(PULSES), "turns against its request"),
    "never settles": (
        np.where(SENT > END - 0.3, 0.8, 0.0),
        answer(np.where(SENT > END - 0.3, 0.8, 0.0)),
        "the answers never settle: gain",
    ),
}


@pytest.mark.parametrize(("sent", "seen", "told"), CASES.values(), ids=CASES)
def test_refuses_in_one_line(tmp_path, sent, seen, told):
    with pytest.raises(NotIdentifiable) as caught:
        identify(log(tmp_path, sent, seen))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_squares_faster_than_the_lag_are_refused_by_the_step_methods_and_used_by_the_likelihood(tmp_path):
    squares = np.where(np.floor(SENT / 0.3) % 2 > 0, 0.8, 0.0)
    result = identify(log(tmp_path, squares, answer(squares)))
    assert {fit.method: fit.steps for fit in result.step_methods}["modified_harriott"] == 0
    steps = [one for one in result.experiments if one.kind in ("step", "pulse")]
    assert len(steps) > 50
    assert all(one.used_by == ["likelihood"] for one in steps)
    assert all(
        "settle" in one.rejected["modified_harriott"] or "rest" in one.rejected["modified_harriott"]
        for one in steps
    )
    for name in ("gain", "dead_time", "time_constant_1", "time_constant_2"):
        found = getattr(result.model, name)
        assert abs(found.value - float(np.real(getattr(TRUTH, name)))) < 4 * found.std


def test_a_measured_angle_that_leads_its_request_is_told(tmp_path):
    ahead = answer(PULSES)[30:]
    result = identify(log(tmp_path, PULSES, np.append(ahead, np.full(30, ahead[-1]))))
    assert result.model.dead_time.value == pytest.approx(0.12 - 0.3, abs=0.01)
    assert any("different clocks" in warning for warning in result.warnings)


def test_a_run_in_which_the_request_was_not_acted_on_is_left_out_and_told(tmp_path):
    good = log(tmp_path / "good", PULSES, answer(PULSES))
    driver = 0.5 * np.sin(0.7 * SEEN) + NOISE
    other = log(tmp_path / "driver", np.roll(PULSES, 150), driver)
    result = identify(tmp_path)
    assert {good.parent.name, other.parent.name} == {"good", "driver"}
    assert [run.run for run in result.by_run if run.used] == ["good/run"]
    assert any("driver/run: left out" in warning for warning in result.warnings)
    assert abs(result.model.dead_time.value - 0.12) < 4 * result.model.dead_time.std


def test_no_log_and_no_such_folder_are_unusable(tmp_path):
    with pytest.raises(UnusableLog, match="no log found"):
        identify(tmp_path)
    with pytest.raises(UnusableLog, match="no such file or folder"):
        identify(tmp_path / "missing")


def test_a_file_that_is_no_log_is_unusable(tmp_path):
    (tmp_path / "x.mcap").write_text("hello")
    with pytest.raises(UnusableLog, match="is no log"):
        identify(tmp_path)


def test_a_unit_of_another_dimension_is_a_bad_recipe(tmp_path):
    log(tmp_path, PULSES, answer(PULSES))
    (tmp_path / "channels.yaml").write_text(
        "signals:\n"
        "  steering_wheel_request: {topic: /control/steering_wheel_request, field: angle, unit: m/s}\n"
        "  steering_wheel_angle: {topic: /vehicle/steering_wheel, field: angle, unit: rad}\n"
    )
    with pytest.raises(
        BadRecipe, match=r"steering_wheel_request: unit 'm/s' does not fit, need a unit of 'rad'"
    ):
        identify(tmp_path)
