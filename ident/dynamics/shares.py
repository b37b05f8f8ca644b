"""Segments of a simulation shared out over the cores of the processor."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

LEAST = 2000  # grid points that are worth a thread; they take about a millisecond


def threads() -> int:
    """How many a process may use: the cores that it may run on, at most ``OMP_NUM_THREADS``."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    told = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(told)) if told.isdecimal() and int(told) > 0 else cores


def shares(offsets: NDArray[np.int64], count: int) -> list[tuple[int, int]]:
    """At most ``count`` stretches of whole segments, of about as many grid points each.

    offsets : (s + 1,) first grid point of each segment, and the number of them all
    """
    wanted = np.linspace(0, offsets[-1], count + 1)
    ends = np.unique(np.searchsorted(offsets, wanted))
    return list(pairwise(ends.tolist()))


def shared_out(offsets: NDArray[np.int64], work: Callable[[int, int], None]) -> None:
    """Call ``work(first, last)`` for all segments, in as many threads as are worth it.

    work : releases the interpreter's lock, and writes the results of its own segments only
    """
    parts = shares(offsets, max(1, min(threads(), int(offsets[-1]) // LEAST)))
    waiting = [_pool(os.getpid()).submit(work, *part) for part in parts[1:]]
    for part in parts[:1]:
        work(*part)
    for one in waiting:
        one.result()


@cache
def _pool(_process: int) -> ThreadPoolExecutor:
    """The threads of a process; those of its parent are not there after a fork."""
    return ThreadPoolExecutor(max(1, threads() - 1), thread_name_prefix="segments")
