"""The step methods against exact step responses, and what each of them can and cannot give."""

import numpy as np
import pytest
from generator.actuator import WheelState, held_response
from generator.truth import Actuator

from ident.errors import NotIdentifiable
from ident.estimation.step_methods import (
    STEP_METHODS,
    combined,
    early_level,
    first_order_63,
    modified_harriott,
    modified_harriott_iterated,
    scaled_time_72,
    sundaresan_krishnaswamy,
    tangent,
    underdamped,
)
from ident.estimation.step_response import StepRecord

PAIRS = [(0.25, 0.08), (0.4, 0.3), (0.3, 0.05), (1.0, 0.2)]


def step(actuator, *, size=1.0, hold=None, rate=200.0, noise=0.0, before=0.5, level=0.3):
    total = abs(actuator.time_constant_1) + abs(actuator.time_constant_2) + actuator.dead_time
    time = np.arange(-before, 12 * total if hold is None else hold, 1 / rate)
    rest = WheelState(-before - 1, 0.0, 0.0, 0.0)
    angle, _ = held_response(actuator, np.zeros(1), np.array([size]), time, rest)
    random = np.random.default_rng(0)
    return StepRecord(time, level + angle + noise * random.standard_normal(time.size), size)


def two_lags(first, second, delay=0.12, gain=0.9):
    return Actuator(gain, delay, first, second)


def test_the_curves_are_those_of_the_exact_response():
    assert scaled_time_72(0.5) == pytest.approx(1.268, abs=5e-4)
    assert scaled_time_72(1.0) == pytest.approx(1.273, abs=5e-4)
    shares = np.linspace(0.5, 1.0, 501)
    times = [scaled_time_72(z) for z in shares]
    assert min(times) == pytest.approx(1.246, abs=5e-4)
    assert shares[int(np.argmin(times))] == pytest.approx(0.82, abs=0.01)
    assert early_level(0.5) == pytest.approx(0.270, abs=1e-3)
    assert early_level(1.0) == pytest.approx(0.399, abs=1e-3)
    assert np.all(np.diff([early_level(z) for z in shares]) >= 0)


@pytest.mark.parametrize("method", STEP_METHODS.values(), ids=STEP_METHODS)
def test_every_method_gives_the_gain_and_not_the_level(method):
    plant = Actuator.from_damping(0.9, 0.12, 6.0, 0.5) if method is underdamped else two_lags(0.25, 0.08)
    found = method(step(plant))
    assert found.gain == pytest.approx(0.9, rel=1e-3)
    mirrored = method(step(plant, size=-1.0, level=-0.3))
    assert mirrored.gain == pytest.approx(found.gain, rel=1e-9)
    assert mirrored.dead_time == pytest.approx(found.dead_time, abs=1e-9)


@pytest.mark.parametrize("lag", [0.1, 0.5])
def test_one_lag_is_found_by_the_methods_for_one_lag(lag):
    """The tangent is averaged over part of the rise, and one lag is steepest at its very start."""
    record = step(two_lags(lag, 0.0), rate=1000.0)
    for method, within in ((first_order_63, 0.03), (tangent, 0.31), (sundaresan_krishnaswamy, 0.03)):
        found = method(record)
        assert found.time_constant_1 == pytest.approx(lag, rel=within)
        assert found.dead_time == pytest.approx(0.12, abs=within * lag)
        assert found.time_constant_2 is None


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_the_iterated_method_comes_close_to_two_lags(first, second):
    found = modified_harriott_iterated(step(two_lags(first, second), rate=1000.0))
    assert found.dead_time + found.time_constant_1 + found.time_constant_2 == pytest.approx(
        0.12 + first + second, rel=0.01
    )
    assert found.time_constant_1 == pytest.approx(first, rel=0.12)


@pytest.mark.parametrize(("first", "second"), [(0.25, 0.08), (1.0, 0.2)])
def test_the_plain_method_is_off_by_its_mean_time(first, second):
    """Its 1.25 and its eye for the dead time cost some per cent of the sum, not more."""
    found = modified_harriott(step(two_lags(first, second), rate=1000.0))
    assert found.dead_time + found.time_constant_1 + found.time_constant_2 == pytest.approx(
        0.12 + first + second, rel=0.03
    )


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.6])
def test_overshoot_gives_frequency_and_damping(damping):
    found = underdamped(step(Actuator.from_damping(1.0, 0.1, 8.0, damping), rate=1000.0, hold=8.0))
    assert found.damping_ratio == pytest.approx(damping, rel=0.01)
    assert found.natural_frequency == pytest.approx(8.0, rel=0.04)
    assert found.time_constant_1 is None


def test_two_real_lags_do_not_overshoot():
    with pytest.raises(NotIdentifiable, match="not underdamped"):
        underdamped(step(two_lags(0.25, 0.08), noise=0.001))


def test_refuses_a_step_that_never_settles_with_how_far_it_still_moves():
    with pytest.raises(NotIdentifiable, match=r"never settles: it still moves by \d+ % .* hold of 0\.60 s"):
        first_order_63(step(two_lags(0.25, 0.08), hold=0.6))


def test_refuses_a_step_that_does_not_begin_at_rest():
    record = step(two_lags(0.25, 0.08))
    moving = StepRecord(record.times, record.measured + np.where(record.times < 0, record.times, 0), 1.0)
    with pytest.raises(NotIdentifiable, match="not at rest before the step: off by"):
        first_order_63(moving)


def test_refuses_a_change_within_the_noise():
    with pytest.raises(NotIdentifiable, match="is not 10 times its noise"):
        first_order_63(step(two_lags(0.25, 0.08, gain=0.02), noise=0.01))


def test_steps_are_combined_by_their_medians_with_their_spread():
    records = [step(two_lags(0.25, 0.08, gain=gain)) for gain in (0.8, 0.9, 1.3)]
    fit = combined("modified_harriott", [(record, modified_harriott(record)) for record in records])
    assert fit.steps == 3
    assert fit.gain == pytest.approx(0.9, rel=1e-3)
    assert fit.spread["gain"] == pytest.approx(np.std([0.8, 0.9, 1.3], ddof=1), rel=1e-2)
    assert fit.rms_error > 0.1


def test_without_a_step_the_reason_is_told():
    assert combined("tangent", []).reason == "no step begins and ends at rest"
    assert combined("underdamped", []).reason == "no step overshoots"
