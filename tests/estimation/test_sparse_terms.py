"""The best sparse term is the one that made the residual."""

from __future__ import annotations

import numpy as np
import pytest
from score_sets import Whitened, drawn, truck, whitened

from ident.estimation.sparse_terms import discover


@pytest.fixture(scope="module")
def rows() -> Whitened:
    random = np.random.default_rng(4)
    of = truck(random, 4, 30.0)
    return whitened(of, drawn(random, of, "white"))


def scores_with(rows: Whitened, terms: dict[str, float], seed: int = 1):
    """Scores of noise and terms, each as many standard deviations strong."""
    noise = drawn(np.random.default_rng(seed), rows.truck, "white")
    directions, groups = rows.truck.directions
    sizes = {}
    for key, strength in terms.items():
        column = next(g for g in groups if g.key == key).shapes[0].columns[0]
        sizes[key] = strength / np.sqrt(rows.gram[column, column])
        noise = noise + sizes[key] * directions[:, column].reshape(2, -1).T
    return rows.scores(noise), sizes


def test_the_right_term_is_found_with_its_coefficient(rows: Whitened) -> None:
    scores, sizes = scores_with(rows, {"moment: |u|": 15.0})
    found = discover([scores], draws=300)
    assert found is not None
    first = found.terms[0]
    assert first.key == "moment: |u|"
    assert len(found.terms) == 1
    assert abs(first.coefficients[0] - sizes["moment: |u|"]) < 3.5 * first.stds[0]
    assert found.stability > 0.8


def test_a_second_term_joins_where_it_is_there(rows: Whitened) -> None:
    scores, _ = scores_with(rows, {"moment: |u|": 20.0, "force: sgn u'": 14.0})
    found = discover([scores], draws=300)
    assert found is not None
    assert {term.key for term in found.terms} == {"moment: |u|", "force: sgn u'"}


def test_nothing_is_discovered_in_noise(rows: Whitened) -> None:
    found = [discover([scores_with(rows, {}, seed)[0]], draws=300, seed=seed) for seed in range(15)]
    assert sum(one is not None for one in found) <= 3


def test_only_what_may_be_chosen_is_chosen(rows: Whitened) -> None:
    scores, _ = scores_with(rows, {"moment: |u|": 15.0})
    found = discover([scores], ["force: u³", "force: t"], draws=300)
    assert found is None or found.terms[0].key in {"force: u³", "force: t"}


def test_effects_of_the_catalogue_are_no_terms(rows: Whitened) -> None:
    scores, _ = scores_with(rows, {"relaxation": 15.0})
    found = discover([scores], draws=300)
    catalogue = {g.key for g in scores.groups if g.effect is not None}
    assert found is not None
    assert not catalogue & {term.key for term in found.terms}
