"""Steps of each size alone: the same parameters for a linear actuator, others for one that is not."""

import numpy as np
import pytest
from generator.commands import pulses, pulses_end
from generator.steering import SteeringTest, steering_signals
from generator.truth import load_truth

from ident.estimation.actuator_runs import RunRecords, identify_runs
from ident.experiments.find import find_experiments
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import find_stretches
from ident.signals.signal import Signal
from ident.stages.steering import actuator_record
from ident.stages.steering_amplitude import amplitude_fits

TRUTH = load_truth().steering
SIZES = (0.8, 0.4, 1.2, -0.8, -0.4, -1.2)


def run_of(angle=lambda angle: angle, seed=1, sizes=SIZES):
    test = SteeringTest(pulses(2.0, sizes), pulses_end(2.0, sizes))
    made = steering_signals(test, TRUTH, seed)
    measured = angle(made.angle)
    stretches = find_stretches(made.request_time, made.request, made.angle_time, measured)
    request = Signal("steering_wheel_request", made.request_time, made.request, "rad")
    answer = Signal("steering_wheel_angle", made.angle_time, measured, "rad")
    return SteeringRun("run", request, answer, stretches, [find_experiments(one) for one in stretches])


def fits_of(run):
    records = [actuator_record(stretch) for stretch in run.stretches]
    return amplitude_fits([run], identify_runs([RunRecords(run.name, records)]))


@pytest.fixture(scope="module")
def linear():
    return fits_of(run_of())


def test_each_size_is_fitted_with_all_its_steps(linear):
    fits, _ = linear
    assert [fit.amplitude for fit in fits] == pytest.approx([0.4, 0.8, 1.2])
    assert [fit.steps for fit in fits] == [4, 4, 4]


def test_a_linear_actuator_is_the_same_at_every_size(linear):
    fits, p = linear
    assert p > 0.01
    for name in ("gain", "dead_time", "time_constant_1", "time_constant_2"):
        true = float(np.real(getattr(TRUTH.actuator, name)))
        for fit in fits:
            found = getattr(fit, name)
            assert abs(found.value - true) < 4 * found.std


def test_larger_steps_are_known_better(linear):
    spread = [fit.gain.std for fit in linear[0]]
    assert spread == sorted(spread, reverse=True)


def test_a_gain_that_falls_with_size_is_found():
    fits, p = fits_of(run_of(lambda angle: angle - 0.02 * angle**3))
    assert p < 1e-6
    assert [fit.gain.value for fit in fits] == sorted((fit.gain.value for fit in fits), reverse=True)


def test_with_one_size_there_is_nothing_to_compare():
    fits, p = fits_of(run_of(sizes=(0.8, -0.8)))
    assert len(fits) == 1
    assert p is None
