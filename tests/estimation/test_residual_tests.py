"""The gate: noise of any colour passes it, an effect does not; what fired is named and sized."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from score_sets import Truck, Whitened, drawn, truck, whitened

from ident.estimation.detectable import detectable_sizes
from ident.estimation.layer import LayerScores
from ident.estimation.residual_tests import corrected, needed, screen
from ident.estimation.score_blocks import BlockScores, block_index, components, spread

SETS = 30


@cache
def some_truck(runs: int = 3, seconds: float = 20.0) -> Truck:
    return truck(np.random.default_rng(1), runs, seconds)


@cache
def under(kind: str) -> Whitened:
    of = some_truck()
    return whitened(of, drawn(np.random.default_rng(2), of, kind))


def of_noise(kind: str, seed: int) -> LayerScores:
    found = under(kind)
    return found.scores(drawn(np.random.default_rng(seed), found.truck, kind))


def with_effect(key: str, strength: float, kind: str = "white", seed: int = 5) -> tuple[LayerScores, float]:
    """Scores of noise and the middle shape of a group, as many standard deviations of white noise strong."""
    found = under(kind)
    group = next(one for one in found.truck.directions[1] if one.key == key)
    column = group.shapes[len(group.shapes) // 2].columns[0]
    size = strength / np.sqrt(found.gram[column, column])
    noise = drawn(np.random.default_rng(seed), found.truck, kind)
    added = size * found.truck.directions[0][:, column].reshape(2, -1).T
    return found.scores(noise + added), size


@pytest.mark.parametrize("kind", ["white", "AR(1) 0.9 + white", "gusts 1.5 s", "weak gusts", "heavy tails"])
def test_noise_of_any_colour_is_adequate(kind: str) -> None:
    rejected = sum(screen([of_noise(kind, 100 + k)], draws=400, seed=k).rejected for k in range(SETS))
    # a test of 5 % fires five times or more in thirty sets once in sixty
    assert rejected <= 4


def test_scores_taken_as_white_would_fire_under_gusts() -> None:
    found = [of_noise("gusts 1.5 s", 100 + k) for k in range(SETS)]
    worst = [np.max(one.scores.sum(axis=0) ** 2 / np.maximum(np.diag(one.gram), 1e-300)) for one in found]
    assert np.mean(np.array(worst) > 20) > 0.9


@pytest.mark.parametrize("key", ["relaxation", "play", "rate limit", "roll", "latency yaw_rate"])
def test_an_effect_is_found_and_its_size_estimated(key: str) -> None:
    scores, size = with_effect(key, 12.0)
    found = screen([scores], draws=400)
    one = found.of(key)
    assert found.rejected
    assert one.p_value < 1e-3
    assert one.shape is not None
    if len(next(g for g in scores.groups if g.key == key).shapes) == 1:
        assert abs(one.size[0] - size) < 3.5 * one.size[1]
        # never surer than white noise allows, and not much less sure
        assert 0.9 < 12 * one.size[1] / size < 1.8


def test_a_strong_effect_that_shows_in_few_blocks_is_found() -> None:
    scores, _ = with_effect("force: step", 15.0)
    assert screen([scores], draws=400).of("force: step").p_value < 0.01


def test_a_direction_that_the_fit_takes_up_is_told_as_not_testable() -> None:
    scores = of_noise("white", 7)
    column = next(g for g in scores.groups if g.key == "relaxation").shapes[0].columns[0]
    values, energy, gram = scores.scores.copy(), scores.energy.copy(), scores.gram.copy()
    values[:, column], energy[:, column] = 0.0, 0.0
    gram[column], gram[:, column] = 0.0, 0.0
    blind = replace(scores, scores=values, energy=energy, gram=gram)
    found = screen([blind], draws=200)
    one = found.of("relaxation")
    assert one.untestable is not None
    assert one.p_value == 1.0
    assert found.groups[-1].key == "relaxation"
    assert detectable_sizes(found)["motion", "relaxation"] == np.inf


def test_columns_that_depend_on_each_other_count_once() -> None:
    scores = of_noise("white", 8)
    ratio = next(g for g in scores.groups if g.key == "ratio")
    one, two = ratio.shapes[0].columns
    values, energy, gram = scores.scores.copy(), scores.energy.copy(), scores.gram.copy()
    values[:, two], energy[:, two] = 2 * values[:, one], 4 * energy[:, one]
    gram[two], gram[:, two] = 2 * gram[one], 2 * gram[:, one]
    gram[two, two] = 4 * scores.gram[one, one]
    twice = replace(scores, scores=values, energy=energy, gram=gram)
    assert screen([twice], draws=200).of("ratio").freedom == 1


def test_the_same_seed_gives_the_same_verdict_and_no_other_thing_changes_it() -> None:
    scores, _ = with_effect("relaxation", 4.0)
    first, again = screen([scores], seed=3, draws=300), screen([scores], seed=3, draws=300)
    assert first.p_value == again.p_value
    assert [one.key for one in first.groups] == [one.key for one in again.groups]


def test_mirrored_residuals_give_the_same_p_values() -> None:
    scores, _ = with_effect("relaxation", 4.0)
    mirrored = replace(scores, scores=-scores.scores)
    one, other = (screen([each], seed=3, draws=300).of("relaxation") for each in (scores, mirrored))
    assert one.p_value == pytest.approx(other.p_value, rel=1e-9)
    assert one.size[0] == pytest.approx(-other.size[0], rel=1e-9)


def test_units_of_directions_do_not_matter() -> None:
    scores, _ = with_effect("ratio", 5.0)
    scale = np.exp(np.random.default_rng(0).uniform(-10, 10, scores.gram.shape[0]))
    other = replace(
        scores,
        scores=scores.scores * scale,
        energy=scores.energy * scale**2,
        gram=scores.gram * np.outer(scale, scale),
    )
    one, same = (screen([each], seed=3, draws=300) for each in (scores, other))
    assert one.p_value == pytest.approx(same.p_value, rel=1e-6)


def test_two_layers_are_tested_together() -> None:
    quiet, _ = with_effect("relaxation", 6.0)
    alone = screen([quiet], draws=400).of("relaxation").p_value
    other = replace(of_noise("white", 9), layer="actuator")
    both = screen([quiet, other], draws=400)
    assert both.of("relaxation", "motion").p_value > alone
    assert both.of("relaxation", "actuator").p_value > 0.05
    assert both.strongest is not None
    assert both.strongest.layer == "motion"


def test_residuals_that_grow_with_what_is_going_on_are_seen() -> None:
    scores = under("white").scores(drawn(np.random.default_rng(3), some_truck(), "white"))
    doing = np.sqrt(scores.activity[:, 0])
    grown = replace(scores, power=scores.power * (1 + 2 * doing / doing.max())[:, None] ** 2)
    found = screen([grown], draws=300)
    assert found.rejected
    assert found.strongest is not None
    assert "larger residuals" in found.strongest.key


def test_detectable_sizes_are_found_as_often_as_they_say() -> None:
    clean = screen([of_noise("white", 11)], draws=600)
    size = detectable_sizes(clean)["motion", "relaxation"]
    column = next(g for g in under("white").truck.directions[1] if g.key == "relaxation").shapes[0].columns[0]
    strength = size * np.sqrt(under("white").gram[column, column])
    hits = [
        screen([with_effect("relaxation", strength, seed=k)[0]], draws=300, seed=k).of("relaxation").p_value
        for k in range(40)
    ]
    assert 0.65 <= np.mean(np.array(hits) < 0.05) <= 0.99


def test_the_detectable_width_of_a_play_lies_between_widths_that_were_tried() -> None:
    found = screen([of_noise("white", 12)], draws=300)
    width = detectable_sizes(found, {"play": "width"})["motion", "play"]
    seen, _ = with_effect("play", 0.0)
    group = next(g for g in seen.groups if g.key == "play")
    strengths = {s.at["width"]: np.sqrt(seen.gram[s.columns[0], s.columns[0]]) for s in group.shapes}
    below = [w for w, strength in strengths.items() if strength < 3.0]
    above = [w for w, strength in strengths.items() if strength > 8.0]
    assert max(below, default=0.0) < width < min(above, default=np.inf)


def test_the_spread_of_white_blocks_has_one_degree_of_freedom_less_than_blocks() -> None:
    blocks = BlockScores(np.ones((9, 1)), np.full((9, 1), 1 / 9), np.zeros(9, dtype=np.intp))
    assert blocks.freedom[0] == pytest.approx(8.0)
    assert np.abs(blocks.own).max() < 1e-12


def test_blocks_end_where_runs_end() -> None:
    run = np.repeat([0, 1], [40, 24]).astype(np.intp)
    time = np.concatenate([np.arange(40), np.arange(24)]) * 0.25
    block = block_index(run, time, 4.0)
    assert np.bincount(block).tolist() == [20, 20, 12, 12]


def test_the_spread_of_scores_under_gusts_is_what_they_show() -> None:
    found = [of_noise("gusts 1.5 s", 300 + k) for k in range(40)]
    shapes = [shape for group in found[0].groups for shape in group.shapes]
    parts = [components(one, shapes) for one in found]
    spreads = [spread(part, one).factor for part, one in zip(parts, found, strict=True)]
    shown = np.mean([part.total**2 for part in parts], axis=0)
    assert np.median(shown / np.mean(spreads, axis=0)) == pytest.approx(1.0, abs=0.4)
    assert np.median(shown) > 3.0


def test_corrections_undo_each_other() -> None:
    assert corrected(needed(0.05, 37.0), 37.0) == pytest.approx(0.05)
    assert corrected(1e-9, 37.0) == pytest.approx(37e-9, rel=1e-3)
    assert stats.norm.isf(needed(0.05, 100.0) / 2) == pytest.approx(3.47, abs=0.02)
