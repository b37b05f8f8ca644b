"""The actuator layer against an actuator integrated in plain Python: it finds what is there, no more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from actuator_integrated import Truck
from numpy.typing import NDArray

from ident.estimation.actuator_effects import EffectsProblem, with_effects
from ident.estimation.actuator_layer import ActuatorLayer
from ident.estimation.actuator_layer_fit import ActuatorLayerFit, named_effects
from ident.estimation.actuator_likelihood import BIAS, ActuatorRecord, with_repeats
from ident.estimation.actuator_runs import RunRecords
from ident.estimation.improvement import improve_layers, with_term
from ident.estimation.layer import LayerScores
from ident.estimation.vehicle_records import Samples

Array = NDArray[np.float64]

NOISE = 0.002
START = np.array([1.0, 0.1, 0.28, 0.2])
PLAY, LIMIT, ZONE = "steering_column_play", "steering_rate_limit", "steering_dead_zone"
SLOW_LAG = "lags: v u'"
TRUE = {PLAY: 0.02, LIMIT: 1.5, ZONE: 0.02}
TRUCKS = {
    PLAY: Truck(play=TRUE[PLAY]),
    LIMIT: Truck(rate=TRUE[LIMIT]),
    ZONE: Truck(dead_zone=TRUE[ZONE]),
}


def drive(
    truck: Truck, seed: int, *, runs: int = 4, side: float = 1.0, correlation: float = 0.0
) -> list[RunRecords]:
    """Sines and steps of three sizes with noise; every run has a bias of its own."""
    random = np.random.default_rng(seed)
    made = []
    for number in range(runs):
        sent = np.arange(random.uniform(0, 0.01), 20.0, 0.02)
        times = np.arange(sent[0] + random.uniform(0, 0.01), 20.0, 0.02)
        size = (0.1, 0.3, 1.0)[number % 3]
        request = size * np.sin(1.3 * sent) + 0.3 * size * np.sin(3.3 * sent + 1)
        if number % 2 == 0:
            levels = random.choice([-1.0, -0.5, 0.0, 0.4, 1.0], 7)
            request = size * np.repeat(levels, 150)[: sent.size] * (sent > 1)
        answer = truck.answer(sent, request, times, steps=2) if sent.size else times
        noise = coloured(random.normal(size=times.size), correlation)
        made.append(
            run_of(number, sent, side * request, times, side * (answer + NOISE * noise + 0.01 * number))
        )
    return made


def coloured(white: Array, correlation: float) -> Array:
    noise = white.copy()
    for k in range(1, noise.size):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * white[k]
    return noise


def run_of(number: int, sent: Array, request: Array, times: Array, measured: Array) -> RunRecords:
    record = ActuatorRecord(
        run=0,
        command_times=sent,
        command_values=request,
        times=times,
        measured=measured,
        starts=np.zeros(1, dtype=np.intp),
        start_uncertainty=0.01,
        rest_rate=0.1,
    )
    return RunRecords(f"run_{number}", [record])


def statistics(scores: LayerScores) -> Mapping[str, float]:
    """Largest 2 log likelihood that one step along a shape would gain, by candidate."""
    length = np.diag(scores.gram)
    total = scores.scores.sum(axis=0)
    gain = np.divide(total**2, length, out=np.zeros_like(total), where=length > 0)
    return {
        group.key: max(float(gain[shape.columns[0]]) for shape in group.shapes) for group in scores.groups
    }


@pytest.fixture(scope="module")
def layers() -> dict[str, ActuatorLayer]:
    trucks = {"none": Truck(), **TRUCKS}
    return {name: ActuatorLayer(drive(truck, 7), start=START) for name, truck in trucks.items()}


@pytest.mark.parametrize("name", TRUE)
def test_each_effect_is_first_in_the_screen_and_fitted_to_its_size(
    name: str, layers: dict[str, ActuatorLayer]
) -> None:
    base = layers[name].fitted()
    gains = statistics(base.scores())
    assert max(gains, key=lambda key: gains[key]) == name
    fit = layers[name].fitted([name], start=base)
    (estimate,) = fit.estimates()[name].parameters.values()
    assert estimate.value == pytest.approx(TRUE[name], abs=4 * estimate.std, rel=0)
    assert estimate.std < 0.02 * TRUE[name]
    assert fit.rms()["steering_wheel_angle"] == pytest.approx(NOISE, rel=0.05)
    assert fit.is_allowed() == {}


def test_nothing_scores_high_where_nothing_is_missing(layers: dict[str, ActuatorLayer]) -> None:
    base = layers["none"].fitted()
    np.testing.assert_allclose(base.fit.shared[:BIAS], [1.0, 0.1, 0.28, 0.016 / 0.28**2], rtol=0.01)
    assert base.noise()["steering_wheel_angle"] == pytest.approx(NOISE, rel=0.05)
    assert base.slow_noise() == []
    # Of about 60 directions, a dozen of them independent: chi-squared of one degree of freedom.
    assert max(statistics(base.scores()).values()) < 18


@pytest.mark.parametrize("name", TRUE)
def test_every_effect_has_a_card(name: str, layers: dict[str, ActuatorLayer]) -> None:
    card = layers["none"].effect(name)
    assert card.name == name
    assert card.unit
    assert card.meaning
    assert card.meanings[card.size]


@pytest.mark.parametrize("name", TRUE)
def test_an_effect_that_is_not_there_gains_nothing_and_loses_nothing(
    name: str, layers: dict[str, ActuatorLayer]
) -> None:
    base = layers["none"].fitted()
    fit = layers["none"].fitted([name])
    gain = float((fit.likelihood(base).values - base.likelihood().values).sum())
    assert -0.01 < gain < 12


def test_all_effects_at_once_are_told_apart() -> None:
    truck = Truck(play=TRUE[PLAY], rate=TRUE[LIMIT], dead_zone=TRUE[ZONE])
    layer = ActuatorLayer(drive(truck, 3), start=START)
    fit = layer.fitted([PLAY, LIMIT, ZONE])
    assert fit.keys == (PLAY, LIMIT, ZONE)
    for name, effect in fit.estimates().items():
        (estimate,) = effect.parameters.values()
        assert estimate.value == pytest.approx(TRUE[name], abs=4 * estimate.std, rel=0)
    assert fit.rms()["steering_wheel_angle"] == pytest.approx(NOISE, rel=0.05)


def test_intervals_hold_the_true_size() -> None:
    truck = Truck(play=0.01, dead_zone=0.01)
    distances = []
    for seed in range(40):
        layer = ActuatorLayer(drive(truck, seed, runs=3, correlation=0.6), start=START)
        fit = layer.fitted([PLAY, ZONE], shapes={PLAY: [{"width": 0.02}], ZONE: [{"width": 0.02}]})
        for effect in fit.estimates().values():
            (estimate,) = effect.parameters.values()
            distances.append((estimate.value - 0.01) / estimate.std)
    inside = float(np.mean(np.abs(distances) < 1.96))
    # 80 intervals of 95 %: fewer than 70 would be a chance of 2 in 1000.
    assert inside >= 70 / 80
    assert np.std(distances) == pytest.approx(1.0, abs=0.25)


def test_held_out_runs_have_the_error_of_the_noise_once_the_effect_is_in(
    layers: dict[str, ActuatorLayer],
) -> None:
    layer = layers[PLAY]
    rest = layer.without(["run_1"])
    assert rest.runs == ["run_0", "run_2", "run_3"]
    before = rest.held_out(rest.fitted(), ["run_1"])
    after = rest.held_out(rest.fitted([PLAY]), ["run_1"])
    # Once the initial state, which has taken up the wrong bias, has decayed.
    late = [one.errors["steering_wheel_angle"][100:] for one in (before, after)]
    assert np.std(late[1]) < 1.05 * NOISE < 2 * NOISE < np.std(late[0])
    # The bias of a run that took no part is the mean of the others: 0, 0.02 and 0.03.
    mean = float(np.mean(late[1]))
    assert mean == pytest.approx(0.01 - 0.05 / 3, abs=5e-4)
    assert set(after.run["steering_wheel_angle"]) == {0}  # place among the runs that were asked for
    np.testing.assert_array_equal(after.likelihood.time, before.likelihood.time)


def test_each_run_alone_gives_the_same_size_or_says_that_it_is_mute(
    layers: dict[str, ActuatorLayer],
) -> None:
    fit = layers[LIMIT].fitted([LIMIT])
    sizes, errors = fit.sizes_by_run(LIMIT)
    # Only the run of size 1 reaches the limit.
    assert np.isfinite(errors).tolist() == [False, False, True, False]
    assert sizes[2] == pytest.approx(TRUE[LIMIT], abs=4 * errors[2])
    assert errors[2] < 0.01


def test_a_limit_that_is_never_reached_is_not_allowed(layers: dict[str, ActuatorLayer]) -> None:
    why = layers["none"].fitted([LIMIT]).is_allowed()
    assert "never reached" in why[LIMIT] or "at the end" in why[LIMIT]


def test_mirrored_data_give_the_same_fit() -> None:
    fits = [
        ActuatorLayer(drive(TRUCKS[PLAY], 5, side=side), start=START).fitted([PLAY]) for side in (1.0, -1.0)
    ]
    assert fits[0].sizes()[PLAY] == pytest.approx(fits[1].sizes()[PLAY], rel=1e-5)


def test_other_units_give_the_same_fit(layers: dict[str, ActuatorLayer]) -> None:
    scaled = []
    for run in drive(TRUCKS[PLAY], 7):
        (one,) = run.records
        values = {"command_values": one.command_values / 20, "measured": one.measured / 20}
        scaled.append(RunRecords(run.name, [replace(one, **values, rest_rate=one.rest_rate / 20)]))
    road = ActuatorLayer(scaled, signal="road_wheel_angle", start=START)
    fit, wheel = road.fitted([PLAY]), layers[PLAY].fitted([PLAY])
    assert 20 * fit.sizes()[PLAY] == pytest.approx(wheel.sizes()[PLAY], rel=1e-4)
    assert road.effect(PLAY).typical == pytest.approx(layers[PLAY].effect(PLAY).typical / 20)


def test_scores_are_freed_of_what_is_fitted_and_add_up(layers: dict[str, ActuatorLayer]) -> None:
    scores = layers[ZONE].fitted().scores()
    bins, directions = scores.scores.shape
    assert scores.gram.shape == (directions, directions)
    assert scores.energy.shape == (bins, directions)
    np.testing.assert_allclose(scores.energy.sum(axis=0), np.diag(scores.gram), rtol=1e-9, atol=1e-12)
    columns = [column for group in scores.groups for shape in group.shapes for column in shape.columns]
    assert sorted(columns) == list(range(directions))
    assert scores.count.sum() == sum(r.times.size for r in layers[ZONE].fitted().problem.records)
    assert set(np.unique(scores.run)) == {0, 1, 2, 3}
    assert scores.activity.shape == (bins, len(scores.activities))


@pytest.mark.parametrize("names", [(PLAY,), (LIMIT,), (ZONE,), (PLAY, LIMIT, ZONE)], ids=str)
def test_derivatives_of_the_problem_agree_with_differences(names: tuple[str, ...]) -> None:
    records = [replace(r, run=i) for i, run in enumerate(drive(Truck(), 1, runs=2)) for r in run.records]
    records[0] = replace(records[0], lost=np.array([200, 201]))
    problem = EffectsProblem(records, 2, named_effects(names), scale=20.0)
    base = np.array([0.95, 0.1043, 0.28, 0.19, 0.0, 0.01])
    shared = with_effects(base, problem, TRUE)
    local = [np.concatenate([[0.03, 0.1, 0.02, 0.003, 0.2], 0.07 * np.ones(r.lost.size)]) for r in records]
    exact = problem.linearise(shared, local)
    for index in range(shared.size):
        step = 1e-7 * np.eye(shared.size)[index]
        more, less = problem.linearise(shared + step, local), problem.linearise(shared - step, local)
        for one, up, down in zip(exact, more, less, strict=True):
            close(one.shared[:, index], (down.residual - up.residual) / 2e-7)
    for index in range(7):
        step = 1e-7 * np.eye(7)[index]
        up = problem.linearise_one(records[0], shared, local[0] + step)
        down = problem.linearise_one(records[0], shared, local[0] - step)
        close(exact[0].local[:, index], (down.residual - up.residual) / 2e-7)


def close(exact: Array, difference: Array) -> None:
    """Equal but for the few samples at which a difference straddles a kink."""
    scale = max(1.0, float(np.abs(difference).max()))
    assert np.mean(np.abs(exact - difference) < 1e-5 * scale) > 0.99


def test_what_is_no_effect_of_the_actuator_is_refused(layers: dict[str, ActuatorLayer]) -> None:
    with pytest.raises(ValueError, match="tyre_relaxation: no effect of the actuator"):
        layers["none"].fitted(["tyre_relaxation"])


def test_a_fit_of_fewer_runs_can_begin_from_one_of_all(layers: dict[str, ActuatorLayer]) -> None:
    whole = layers[PLAY].fitted([PLAY])
    rest = layers[PLAY].without(["run_0"])
    fit: ActuatorLayerFit = rest.fitted([PLAY], start=whole)
    assert fit.sizes()[PLAY] == pytest.approx(TRUE[PLAY], rel=0.02)
    assert fit.fit.shared.size == BIAS + 3 + 1


# --- generic terms -----------------------------------------------------------------------------------


def slowing(number: int) -> Samples:
    """Speed of a run: each at two speeds, high in some, low in others."""
    low, high = (3.0, 9.0) if number % 2 else (5.0, 14.0)
    times = np.arange(0.0, 20.5, 0.5)
    return Samples(times, np.where(times < 10, low, high))


def with_slow_lag(seed: int, share: float) -> list[RunRecords]:
    """T1 longer by a share at standstill, falling to none at 15 m/s: integrated by small steps."""
    random = np.random.default_rng(seed)
    made = []
    for number, run in enumerate(drive(Truck(), seed)):
        (one,) = run.records
        speed = slowing(number)
        grid = np.arange(one.times[0], one.times[-1] + 0.001, 0.001)
        at = np.searchsorted(one.command_times + 0.1, grid, side="right") - 1
        asked = np.where(at >= 0, one.command_values[np.maximum(at, 0)], 0.0)
        slow = 0.2 * (1 + share * (1 - np.interp(grid, speed.times, speed.values) / 15))
        first, second = np.zeros(grid.size), np.zeros(grid.size)
        for k in range(grid.size - 1):
            first[k + 1] = first[k] + (asked[k] - first[k]) * 0.001 / slow[k]
            second[k + 1] = second[k] + (first[k] - second[k]) * 0.001 / 0.08
        angle = np.interp(one.times, grid, second)
        made.append(
            RunRecords(run.name, [replace(one, measured=angle + NOISE * random.normal(size=angle.size))])
        )
    return made


@pytest.fixture(scope="module")
def slow() -> ActuatorLayer:
    speed = {f"run_{k}": slowing(k) for k in range(4)}
    return ActuatorLayer(with_slow_lag(2, 0.3), start=START, speed=speed)


def test_a_lag_that_depends_on_speed_is_found_in_the_lags_and_sized(slow: ActuatorLayer) -> None:
    base = slow.fitted()
    gains = statistics(base.scores())
    assert max(gains, key=lambda key: gains[key]) == SLOW_LAG
    known = slow.with_term(SLOW_LAG, {}, base)
    assert known is not None
    fit = known.fitted([SLOW_LAG], start=base)
    assert fit.keys == (SLOW_LAG,)
    assert fit.freedom == 1
    value, std = fit.term(SLOW_LAG)
    # (T1 + c v) at the speed v, to first order in what the lag changes.
    assert value == pytest.approx(0.2 * 0.3 / 15, rel=0.1)
    assert 0 < std < 0.1 * value
    limit = slow.fitted([LIMIT], start=base)
    gained, other = (
        float((one.likelihood(fit).values - base.likelihood(fit).values).sum()) for one in (fit, limit)
    )
    assert gained > 5 * max(other, 1.0)
    assert fit.rms()["steering_wheel_angle"] < 0.5 * base.rms()["steering_wheel_angle"]


def test_a_term_that_is_in_the_fit_is_screened_no_more_and_judges_what_took_no_part(
    slow: ActuatorLayer,
) -> None:
    base = slow.fitted()
    known = slow.with_term(SLOW_LAG, {}, base)
    assert known is not None
    rest = known.without(["run_1"])
    fit = rest.fitted([SLOW_LAG], start=known.fitted([SLOW_LAG], start=base))
    assert SLOW_LAG not in [group.key for group in fit.scores().groups]
    before, after = (known.held_out(one, ["run_1"]) for one in (rest.fitted(), fit))
    errors = [float(np.std(one.errors["steering_wheel_angle"])) for one in (before, after)]
    assert errors[1] < 0.6 * errors[0]
    sizes, stds = fit.sizes_by_run(SLOW_LAG)
    assert sizes.shape == stds.shape == (3,)


def test_a_lag_that_depends_on_speed_gets_no_name_but_a_term(slow: ActuatorLayer) -> None:
    found = improve_layers([slow], level=0.05, draws=300, seed=1)
    assert found.added == []
    assert not found.passes
    made = with_term(found)
    assert made is not None
    assert made[1].key == SLOW_LAG
    fit = found.fits["actuator"]
    assert fit.keys == (SLOW_LAG,)
    shorter = found.shorter("actuator", fit)
    assert shorter.keys == ()
    found.take_back("actuator", shorter)
    assert found.dropped == [SLOW_LAG]


def test_speed_is_in_no_term_where_a_run_does_not_know_it(layers: dict[str, ActuatorLayer]) -> None:
    keys = [group.key for group in layers["none"].fitted().scores().groups]
    assert not [key for key in keys if "v" in key.partition(": ")[2]]
    assert layers["none"].with_term(SLOW_LAG, {}, layers["none"].fitted()) is None


def test_a_step_of_the_angle_is_fitted_to_its_size() -> None:
    runs = drive(Truck(), 4)
    (one,) = runs[2].records
    runs[2] = RunRecords("run_2", [replace(one, measured=one.measured + 0.01 * (one.times >= 8.0))])
    layer = ActuatorLayer(runs, start=START)
    base = layer.fitted()
    known = layer.with_term("angle: step", {"run": 2.0, "time": 8.0}, base)
    assert known is not None
    value, std = known.fitted(["angle: step"], start=base).term("angle: step")
    assert value == pytest.approx(0.01, abs=4 * std)
    assert std < 0.001


@pytest.mark.parametrize("key", ["request: u|u|", "lags: u'|u'|", "angle: |u|"])
def test_terms_stand_beside_effects_with_exact_derivatives(
    key: str, layers: dict[str, ActuatorLayer]
) -> None:
    base = layers[ZONE].fitted()
    known = layers[ZONE].with_term(key, {}, base)
    assert known is not None
    problem = known.fitted([ZONE, key]).problem
    assert problem.keys == (ZONE, key)
    shared = with_effects(base.fit.shared, problem, {ZONE: 0.02, key: 0.03})
    exact = problem.linearise(shared, base.fit.local)
    for index in (0, 1, problem.first_size, problem.first_term):
        step = 1e-7 * np.eye(shared.size)[index]
        more, less = (problem.linearise(shared + side * step, base.fit.local) for side in (1, -1))
        for one, up, down in zip(exact, more, less, strict=True):
            close(one.shared[:, index], (down.residual - up.residual) / 2e-7)


def test_commands_that_are_said_again_change_nothing() -> None:
    (one,) = drive(Truck(), 1, runs=1)[0].records
    sparse = replace(one, command_times=one.command_times[::20], command_values=one.command_values[::20])
    sparse = replace(sparse, lost=np.array([5]))
    again = with_repeats(sparse)
    assert np.diff(again.command_times)[8:].max() < 0.41
    assert again.command_values[again.lost] == sparse.command_values[5]
    assert again.command_times[again.lost] == sparse.command_times[5]
    problem = EffectsProblem([sparse], 1)
    shared, local = np.array([1.0, 0.1, 0.28, 0.2, 0.0]), np.array([0.0, 0.1, 0.02, 0.01, 0.0, 0.3])
    whole, other = (problem.linearise_one(r, shared, local) for r in (sparse, again))
    np.testing.assert_allclose(other.residual, whole.residual, atol=1e-12)
    np.testing.assert_allclose(other.shared, whole.shared, atol=1e-9)
    np.testing.assert_allclose(other.local, whole.local, atol=1e-9)
