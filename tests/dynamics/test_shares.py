"""Segments shared out over cores: all of them, once, with the same results."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest
from vehicle_values import MOUNTED, TILTED, segments, truck

from ident.dynamics import shares as module
from ident.dynamics.bicycle import bicycle
from ident.dynamics.engine import compiled
from ident.dynamics.shares import LEAST, shared_out, shares, threads

ENDS = {
    "even": [0, 10, 20, 30, 40],
    "one long": [0, 1000, 1001, 1002],
    "one": [0, 7],
    "none": [0],
    "many short": list(range(200)),
}


@pytest.mark.parametrize("name", ENDS)
@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_every_segment_is_in_one_share(name: str, count: int) -> None:
    offsets = np.array(ENDS[name])
    made = shares(offsets, count)
    assert [k for first, last in made for k in range(first, last)] == list(range(offsets.size - 1))
    assert len(made) <= count


@pytest.mark.parametrize("count", [2, 3, 5])
def test_shares_are_even_but_for_one_segment(count: int) -> None:
    lengths = np.random.default_rng(count).integers(1, 50, 300)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    for first, last in shares(offsets, count):
        assert abs(offsets[last] - offsets[first] - offsets[-1] / count) <= lengths.max()


@pytest.mark.parametrize(("told", "most"), [("1", 1), ("0", 64), ("many", 64), ("", 64)])
def test_fewer_threads_where_that_is_told(monkeypatch: pytest.MonkeyPatch, told: str, most: int) -> None:
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda _: range(64), raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", told)
    assert threads() == most


def _simulated(count: int) -> list[np.ndarray]:
    """States, outputs and derivatives of many segments, in so many threads."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "threads", lambda: count)
        engine = compiled(bicycle("magic_formula", "magic_formula"))
        lengths = np.random.default_rng(5).integers(50, 400, 40).tolist()
        *known, offsets = segments(5, lengths, 0.02)
        assert offsets[-1] > 3 * LEAST
        parameters = engine.vector(truck("magic_formula", MOUNTED, TILTED))
        arguments = (*known, offsets, parameters)
        return [*engine.simulate(*arguments), *engine.sensitivities(*arguments, active=engine.parameters)]


def test_results_are_the_same_in_one_thread_and_in_several() -> None:
    alone = _simulated(1)
    for count in (2, 3):
        for one, other in zip(alone, _simulated(count), strict=True):
            np.testing.assert_array_equal(one, other)


def test_threads_work_in_a_process_that_was_forked_after_they_began() -> None:
    _simulated(2)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        forked = pool.apply_async(_simulated, (2,)).get(timeout=120)
    for one, other in zip(_simulated(1), forked, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_a_share_raises_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "threads", lambda: 2)
    offsets = np.array([0, LEAST, 2 * LEAST])

    def work(first: int, _last: int) -> None:
        if first == 1:
            raise FloatingPointError("second share")

    with pytest.raises(FloatingPointError, match="second share"):
        shared_out(offsets, work)
