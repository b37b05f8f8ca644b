"""The motion as a layer of the loop: fits, held-out errors, runs in any order, left and right exchanged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from improve_runs import measured, noise_floor
from motion_campaign import RUNS, SEED, driven, layer_over
from motion_case import TRUCK, TRUE, layer_of, records
from plane_truck import NOISE, PlaneTruck

from ident.estimation.improvement import BEHIND
from ident.estimation.layer import SIZE
from ident.estimation.motion_effects import motion_effects
from ident.estimation.motion_fit import MotionFit
from ident.estimation.motion_layer import MotionLayer
from ident.estimation.motion_scores import Projection
from ident.estimation.residual_tests import screen
from ident.estimation.vehicle_records import Samples

OFFSET, RELAXATION = "steering_offset", "tyre_relaxation"
BOTH = ((OFFSET, None), (RELAXATION, None))


def gate(fit: MotionFit):
    return screen([fit.scores()], level=0.05, draws=500, seed=1)


@cache
def layer() -> MotionLayer:
    return layer_over(driven(*BOTH))


@cache
def fitted() -> MotionFit:
    return layer().fitted([OFFSET, RELAXATION])


def sizes(fit: MotionFit) -> dict[str, float]:
    return {key: fit.size(key) for key in fit.keys}


def statistics(fit: MotionFit) -> dict[str, float]:
    return {one.key: one.statistic for one in gate(fit).groups if one.effect is not None}


# --- nothing wrong ---------------------------------------------------------------------------------


@cache
def sound(seed: int) -> MotionFit:
    return layer_over(driven(), seed).fitted()


def test_the_gate_lets_a_sound_truck_pass() -> None:
    p_values = [gate(sound(seed)).p_value for seed in (SEED, 11, 12)]
    assert min(p_values) > 0.05


def test_the_noise_of_a_sound_truck_is_identified() -> None:
    fit, drive = sound(SEED), driven()
    floor = noise_floor(drive, measured(drive, SEED))
    for signal in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        assert fit.noise()[signal] == pytest.approx(floor[signal], rel=0.1), signal
        assert fit.rms()[signal] == pytest.approx(floor[signal], rel=0.1), signal
    assert fit.keys == ()
    assert fit.freedom == 0
    assert fit.estimates() == {}


def test_an_effect_that_is_not_there_gains_next_to_nothing() -> None:
    base = sound(SEED)
    with_it = base.layer.fitted([OFFSET], start=base)
    gain = float((with_it.likelihood(base).values - base.likelihood().values).sum())
    assert -0.1 < gain < 12
    estimate = with_it.estimates()[OFFSET].parameters["angle"]
    assert abs(estimate.value) < 4 * estimate.std < 1e-3


# --- two effects -----------------------------------------------------------------------------------


def test_a_rough_likelihood_by_another_noise_errs_by_less_than_what_is_out_of_reach() -> None:
    fit = sound(1)
    factors = {"yaw_rate": 2.0, "lateral_acceleration": 0.5}
    noise = {n: replace(one, std=one.std * factors.get(n, 1.0)) for n, one in fit.point.noise.items()}
    like = replace(fit, point=fit.point.with_noise(noise))
    rough, exact = (float(fit.likelihood(like, roughly=one).values.sum()) for one in (True, False))
    stays = float(Projection(like.point).likelihood().values.sum())
    assert stays < exact < rough  # no prior holds back what is projected
    assert rough - exact < 0.2 * BEHIND


def test_two_effects_are_fitted_together() -> None:
    told = fitted().estimates()
    offset, length = told[OFFSET].parameters["angle"], told[RELAXATION].parameters["length"]
    assert offset.value == pytest.approx(3e-3, abs=2.6 * offset.std)
    assert length.value == pytest.approx(0.5, abs=2.6 * length.std)
    assert (offset.unit, length.unit) == ("rad", "m")
    assert fitted().freedom == 2
    assert not gate(fitted()).rejected


def test_left_and_right_exchanged_give_the_same_fit() -> None:
    mirrored = layer_over(driven(*BOTH), mirrored=True).fitted([OFFSET, RELAXATION])
    assert mirrored.size(OFFSET) == pytest.approx(-fitted().size(OFFSET), rel=2e-3)
    assert mirrored.size(RELAXATION) == pytest.approx(fitted().size(RELAXATION), rel=2e-3)
    assert not gate(mirrored).rejected
    assert statistics(mirrored) == pytest.approx(statistics(fitted()), rel=0.05, abs=0.1)
    assert mirrored.rms() == pytest.approx(fitted().rms(), rel=1e-3)


def test_the_order_of_the_runs_changes_nothing() -> None:
    turned = layer().of_runs(list(reversed(RUNS)))
    assert turned.runs == list(reversed(layer().runs))
    fit = turned.fitted([OFFSET, RELAXATION])
    assert sizes(fit) == pytest.approx(sizes(fitted()), rel=2e-3)
    assert not gate(fit).rejected
    assert statistics(fit) == pytest.approx(statistics(fitted()), rel=0.05, abs=0.1)
    one, other = (dict(zip(f.layer.runs, f.sizes_by_run(OFFSET)[0], strict=True)) for f in (fit, fitted()))
    assert one == pytest.approx(other, rel=0.02)


@pytest.mark.parametrize("out", RUNS)
def test_a_run_that_took_no_part_has_the_error_of_the_sensors_with_the_effects_and_more_without(
    out: str,
) -> None:
    rest = layer().without([out])
    assert rest.runs == [run for run in RUNS if run != out]
    whole, drive = fitted(), driven(*BOTH)
    own = {out: measured(drive, SEED)[out]}
    floor = noise_floor(replace(drive, runs={out: drive.runs[out]}), own)
    after = layer().held_out(rest.fitted(whole.keys, start=whole), [out])
    before = layer().held_out(rest.fitted(), [out])
    for name in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        error = [float(np.sqrt(np.mean(one.errors[name] ** 2))) for one in (before, after)]
        assert error[1] < 1.1 * floor[name], name
        assert error[0] > 1.1 * error[1] or name == "lateral_acceleration", name
        assert set(after.run[name]) == {0}
        assert after.modelled[name].shape == after.errors[name].shape == after.time[name].shape
    assert after.likelihood.values.sum() > before.likelihood.values.sum()


def test_the_position_along_and_across_is_that_on_the_measured_path() -> None:
    given = records(seconds=30.0)
    found = layer_of(given).held_out(layer_of(given).fitted(), ["run_0", "run_1"])
    for number, record in enumerate(given):
        along, across = (
            (found.errors[name] + found.modelled[name])[found.run[name] == number]
            for name in ("position_along", "position_across")
        )
        times = found.time["position_along"][found.run["position_along"] == number]
        speed = np.interp(times, record.times, record.speed)
        driven = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(times))])
        np.testing.assert_allclose(along, driven, rtol=0, atol=0.15)
        assert not across.any()


def test_colour_that_was_of_what_the_model_lacked_is_identified_anew_once_that_is_in() -> None:
    """A base that is far off has a heading without noise of its own to see; the fit with the effects has."""
    base = layer().fitted()
    assert base.noise()["heading"] > 10 * fitted().noise()["heading"]
    begun = layer().fitted([OFFSET], start=base)
    fit = layer().fitted([OFFSET, RELAXATION], start=begun, shapes={RELAXATION: [{SIZE: 0.3}]}).renoised()
    for name, model in fit.point.noise.items():
        right = fitted().point.noise[name]
        assert model.std == pytest.approx(right.std, rel=0.02), name
        assert model.shape.coefficients[0] == pytest.approx(right.shape.coefficients[0], abs=0.02), name
    length = fitted().estimates()[RELAXATION].parameters["length"]
    assert fit.size(RELAXATION) == pytest.approx(length.value, abs=length.std / 3)


# --- what is told --------------------------------------------------------------------------------


@pytest.mark.parametrize("key", motion_effects())
def test_every_effect_has_a_card(key: str) -> None:
    card = layer().effect(key)
    assert key.startswith(card.name)
    assert card.typical > 0
    assert card.unit
    assert card.meaning
    assert card.shown_by
    assert card.equation is not None or card.name == "antenna_offset"  # a nuisance, nothing to typeset
    assert card.size in card.meanings
    assert all(card.meanings.values())
    sized = {"steering_linkage_play", "sensor_latency", "tyre_relaxation", "load_transfer", "body_roll"}
    assert card.positive == (card.name in sized)


# --- intervals -----------------------------------------------------------------------------------

TRUTH = {
    (OFFSET, "angle"): 3e-3,
    ("sensor_bias yaw_rate", "bias"): 4e-3,
    ("sensor_bias lateral_acceleration", "bias"): -0.08,
    ("sensor_latency lateral_velocity", "delay"): 0.0213,
}


@cache
def exact():
    """One run without noise, in which four things are wrong."""
    biases = {"yaw_rate": 4e-3, "lateral_acceleration": -0.08}
    truck = PlaneTruck(TRUCK.front, TRUCK.rear, offset=3e-3, biases=biases)
    (made,) = records(truck=truck, noisy=False, count=1, seconds=24.0, most=0.11)
    one = made.measured["lateral_velocity"]
    late = Samples(one.times[:-3] + 0.0213, one.values[:-3])
    return replace(made, measured={**made.measured, "lateral_velocity": late})


def noisy(seed: int):
    random = np.random.default_rng(seed)
    measured_too = {
        name: Samples(one.times, one.values + NOISE[name] * random.standard_normal(one.values.size))
        for name, one in exact().measured.items()
    }
    return replace(exact(), measured=measured_too)


def test_intervals_hold_the_true_sizes() -> None:
    keys, away = list(dict.fromkeys(key for key, _ in TRUTH)), []
    for seed in range(20):
        told = layer_of([noisy(seed)], TRUE).fitted(keys).estimates()
        ones = [(told[key].parameters[short], true) for (key, short), true in TRUTH.items()]
        away += [(one.value - true) / one.std for one, true in ones]
    inside = np.abs(away) < 1.96
    assert inside.sum() >= 70  # of 80: fewer would be a chance of 1 in 300 at 95 %
    assert np.std(away) == pytest.approx(1.0, abs=0.25)
