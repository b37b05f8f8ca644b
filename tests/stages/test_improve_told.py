"""What the loop found, as it is told: rounds, effects, sizes, the next run; over layers that are linear."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from linear_layer import LinearLayer, column, made_layer

from ident.dynamics.effects.catalogue import CATALOGUE, not_built
from ident.estimation.improvement import Improvement, Tried, improve_layers, with_term
from ident.estimation.layer import EffectCard, Shape
from ident.estimation.residual_tests import Screened, screen
from ident.stages.improve import farther_off, verdict_of
from ident.stages.improve_held_out import Compared
from ident.stages.improve_told import (
    _candidate,
    _one_step,
    discovered,
    found_effects,
    localisation,
    minimum_detectable,
    next_experiment,
    not_testable,
    step_of,
)

SIZE = 0.3


def improved(layer: LinearLayer, **how) -> Improvement:
    return improve_layers([layer], level=0.05, draws=500, seed=0, **how)


@cache
def one_effect() -> Improvement:
    return improved(made_layer({"e3": SIZE}, 0))


@cache
def twins() -> Improvement:
    alike = column(3) + 0.05 * column(50)
    return improved(made_layer({"e3": SIZE}, 7, effects={"twin": alike}))


@cache
def nameless() -> tuple[Improvement, str, Screened]:
    found = improved(made_layer({"force: g2": SIZE}, 2))
    layer, term = with_term(found)
    return found, layer, term


def compared(found: Improvement) -> list[Compared]:
    """Every sample of the fits themselves, before and after."""
    before, after = (fits["motion"] for fits in (found.base, found.fits))
    layer = before.layer
    rows = [layer.run, layer.time, layer.values, *(layer.values - fit.residual for fit in (before, after))]
    return [Compared({"reading": np.column_stack(rows)}, {"reading": 1.0}, layer.runs, "none")]


# --- rounds --------------------------------------------------------------------------------------


def test_a_round_is_told_with_its_gate_and_every_candidate() -> None:
    found = one_effect()
    first, last = (step_of(one, found.layers) for one in found.rounds)
    assert first.gate.rejected
    assert (first.gate.strongest, first.gate.layer, first.gate.draws) == ("e3", "motion", 500)
    assert first.gate.p_value == found.rounds[0].screen.p_value <= first.gate.level == 0.05
    assert first.added == "e3"
    assert [one.key for one in first.candidates] == [one.key for one in found.rounds[0].tried]
    assert len(first.candidates) == 6
    added = first.candidates[0]
    assert (added.key, added.why_not, added.in_class) == ("e3", None, True)
    assert added.parameters == found.fits["motion"].estimates()["e3"].parameters
    for one in first.candidates[1:]:
        assert one.gain is None
        assert one.why_not
        assert list(one.parameters) == ["size"]
    assert not last.gate.rejected
    assert (last.added, last.candidates, last.localisation) == (None, [], [])
    assert last.why == "nothing is left that noise does not explain"


def card(size: str, unit: str) -> EffectCard:
    return EffectCard("an effect", "T", None, size, unit, 0.5, None, "", "")


@pytest.mark.parametrize(
    ("size", "shape", "coefficient", "told"),
    [
        ("length", Shape((0,), {"tyre_relaxation.length": 0.5}), 0.55, 0.55),  # a column of change per metre
        ("rate", Shape((0,), {"rate": 4.0}, size=4.0), 1.1, 4.4),  # the whole difference that 4 rad/s make
        ("width", Shape((0,), {"width": 0.1}, size=0.1), 1.2, 0.12),
        ("gain", Shape((0,), {"body_roll.frequency": 4.5}), 0.011, 0.011),
    ],
)
def test_a_size_by_one_step_is_in_the_unit_of_the_effect(size, shape, coefficient, told) -> None:
    coefficients, covariance = np.array([coefficient]), np.array([[0.01 * coefficient**2]])
    screened = Screened("key", "key", "motion", 9.0, 1, 0.01, 0.02, shape, coefficients, covariance)
    estimate = _one_step(card(size, "unit"), screened)[size]
    assert estimate.value == pytest.approx(told)
    assert estimate.std == pytest.approx(0.1 * told)
    assert (estimate.high - estimate.low) / 2 == pytest.approx(1.96 * 0.1 * told, rel=1e-3)
    assert estimate.unit == "unit"


def test_a_candidate_without_a_score_has_no_size() -> None:
    nothing = np.zeros(0)
    screened = Screened("e1", "e1", "motion", 0.0, 0, 1.0, 1.0, None, nothing, np.zeros((0, 0)), "taken up")
    told = _candidate(Tried("e1", screened, why_not="taken up"), made_layer({}, 0))
    assert told.parameters == {}
    assert told.why_not == "taken up"


# --- localisation --------------------------------------------------------------------------------


def test_what_is_left_is_localised_in_the_equation_whose_terms_explain_it() -> None:
    moment = {"moment: h1": column(201), "moment: h2": column(202)}
    layer = made_layer({"moment: h1": SIZE}, 3, generic=moment)
    gate = screen([layer.fitted().scores()], level=0.05, draws=500)
    told = localisation(gate, "motion")
    assert told[0].equation == "moment"
    assert told[0].share > 0.95
    assert all(0.02 < one.share <= 1.0 for one in told)
    assert localisation(gate, "actuator") == []
    assert localisation(gate, None) == []


def test_shares_of_two_equations_that_are_both_wrong_add_up() -> None:
    moment = {"moment: h1": column(201)}
    layer = made_layer({"moment: h1": SIZE, "force: g3": SIZE}, 4, generic=moment)
    told = localisation(screen([layer.fitted().scores()], level=0.05, draws=500), "motion")
    shares = {one.equation: one.share for one in told}
    assert set(shares) == {"moment", "force"}
    assert shares == pytest.approx({"moment": 0.5, "force": 0.5}, abs=0.12)
    assert sum(shares.values()) == pytest.approx(1.0, abs=0.15)


# --- effects -------------------------------------------------------------------------------------


def test_an_effect_is_told_with_its_class_its_sizes_by_run_and_what_it_takes_away() -> None:
    found = one_effect()
    (effect,) = found_effects(found, compared(found))
    assert (effect.key, effect.name, effect.members) == ("e3", "e3", ["e3"])
    assert effect.parameters["size"].value == pytest.approx(SIZE, abs=0.08)
    assert effect.p_value < 1e-3
    assert effect.meaning == "what e3 does"
    assert effect.same_in_runs_p > 0.001
    assert effect.share == pytest.approx({"reading": 1.0}, abs=0.6)
    assert effect.share["reading"] > 0.4


def test_what_an_effect_takes_away_is_told_without_the_noise() -> None:
    found = one_effect()
    (part,) = compared(found)
    rows = part.rows["reading"].copy()
    rows[:, 3] = rows[:, 2] + np.where(np.arange(len(rows)) % 2, 5.0, -5.0)  # an error of 5, of which 3 stays
    rows[:, 4] = rows[:, 2] + np.where(np.arange(len(rows)) % 2, 3.0, -3.0)
    (effect,) = found_effects(found, [replace(part, rows={"reading": rows})])
    assert effect.share["reading"] == pytest.approx(1 - np.sqrt((9 - 1) / (25 - 1)))


def test_the_class_of_an_effect_is_told_whole() -> None:
    (effect,) = found_effects(twins(), [])
    assert set(effect.members) == {"e3", "twin"}
    assert effect.members[0] == effect.key
    assert effect.share == {}


# --- sizes that would show, the next run -----------------------------------------------------------


def test_an_effect_of_the_detectable_size_is_detected_about_as_often_as_said() -> None:
    sound = improved(made_layer({}, 1))
    sizes = minimum_detectable(sound.rounds[-1].screen, sound.layers)
    assert set(sizes) == {f"e{k}" for k in range(1, 7)}
    size = sizes["e3"]
    assert (size.unit, size.typical) == ("m", 0.5)
    seen = {
        factor: sum(
            screen([made_layer({"e3": factor * size.value}, 500 + k).fitted().scores()], draws=500).rejected
            for k in range(40)
        )
        for factor in (1.0, 0.25)
    }
    assert seen[1.0] >= 27  # of 40 at 85 %: fewer would be a chance of 1 in 300
    assert seen[0.25] <= 12


def test_an_effect_that_is_in_the_model_has_no_detectable_size() -> None:
    found = one_effect()
    sizes = minimum_detectable(found.rounds[-1].screen, found.layers)
    assert set(sizes) == {"e1", "e2", "e4", "e5", "e6"}


def test_the_next_run_separates_what_these_data_cannot() -> None:
    found = twins()
    told = next_experiment(found, found.rounds[-1].screen)
    assert set(told.separates) == {"e3", "twin"}
    assert "a run for e3" in told.drive
    assert "a run for twin" in told.drive


def test_the_next_run_shows_what_these_data_hide_most() -> None:
    faint = {"e5": 0.02 * column(5)}
    layer = made_layer({}, 1, effects=faint)
    found = improved(layer)
    told = next_experiment(found, found.rounds[-1].screen)
    assert (told.drive, told.separates) == ("a run for e5", ["e5"])
    size = minimum_detectable(found.rounds[-1].screen, found.layers)["e5"]
    assert f"only at {size.value / 0.5:.1f} times its usual size" in told.why
    clear = improved(made_layer({}, 1))
    assert next_experiment(clear, clear.rounds[-1].screen) is None


# --- what the catalogue lacks, what nobody looked at -------------------------------------------------


def test_a_term_that_the_catalogue_lacks_is_told_with_its_equation_and_how_stable_it_is() -> None:
    found, layer, term = nameless()
    told = discovered(found, layer, term, compared(found), seed=1)
    assert (told.equation, told.term) == ("force", "g2")
    assert told.coefficient.value == pytest.approx(SIZE, abs=4 * told.coefficient.std)
    assert told.stability > 0.95
    assert told.p_value < 1e-3
    assert told.share["reading"] > 0.4


def test_a_term_that_is_one_of_two_alike_is_not_stable() -> None:
    alike = {"force: g2": column(102), "force: twin": column(102) + 0.1 * column(60)}
    found = improved(made_layer({"force: g2": 0.1}, 5, generic=alike))
    layer, term = with_term(found)
    told = discovered(found, layer, term, [], seed=1)
    assert told.term in {"g2", "twin"}
    assert 0.2 < told.stability < 0.98


def test_every_effect_of_the_catalogue_that_nothing_is_said_about_is_listed() -> None:
    found = one_effect()
    gate = found.rounds[-1].screen
    told = not_testable(found, gate, {"actuator": "no run holds a request"})
    reasons = {one.what: one.reason for one in told}
    assert {one.name for one in not_built()} <= {k for k, v in reasons.items() if v == "not built yet"}
    alone = [entry.name for entry in CATALOGUE.values() if tuple(entry.built) == ("actuator",)]
    assert alone
    for name in alone:
        assert reasons[name] == "no run holds a request"
    assert not {"e1", "e3"} & set(reasons)


def test_an_effect_that_the_fit_takes_up_is_listed_as_not_testable() -> None:
    found = improved(made_layer({}, 1, effects={"e2": 2.0 * column(0)}))
    told = {one.what: one.reason for one in not_testable(found, found.rounds[-1].screen, {})}
    assert told["e2"] == "the fitted parameters take up all that it does here"
    assert "e2" not in minimum_detectable(found.rounds[-1].screen, found.layers)


def test_an_effect_that_only_half_of_the_runs_show_has_no_name() -> None:
    seen = 0
    for seed in range(4):
        whole = made_layer({}, seed)
        half = replace(whole, values=whole.values + SIZE * column(3) * (whole.run < 2))
        everywhere = replace(whole, values=whole.values + SIZE * column(3))
        found = [improved(layer) for layer in (everywhere, half)]
        assert [one.added for one in found] == 2 * [[("motion", "e3")]]
        if not all(one.passes for one in found):
            continue  # by chance, in one of twenty
        seen += 1
        assert verdict_of(found[0]) == ("named", "")
        verdict, why = verdict_of(found[1])
        assert verdict == "unexplained"
        assert why.startswith("e3 is not of one size in all runs (p = ")
    assert seen >= 2


def test_a_run_that_is_predicted_worse_than_the_others_is_told() -> None:
    rows = []
    for run, size in enumerate((1.0, 1.1, 1.9, 0.9)):
        error = size * (-1.0) ** np.arange(500)
        rows.append(np.column_stack([np.full(500, run), np.arange(500.0), error, error, np.zeros(500)]))
    runs = [f"run_{number}" for number in range(4)]
    (told,) = farther_off([Compared({"yaw_rate": np.vstack(rows)}, {}, runs, "run")])
    assert told.startswith("yaw_rate in run_2: 1.9 times the error of the other runs")
    assert not farther_off([Compared({"yaw_rate": np.vstack(rows[:2])}, {}, runs, "run")])
