"""Work done in threads, and its results in order: for work that does not hold the interpreter's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")
MOST_THREADS = 4
AHEAD = 2


def threads() -> int:
    """How many threads work: one for each processor that this process may use, a few at most."""
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2, MOST_THREADS)


def in_order(work: Callable[[Job], Result], jobs: Iterable[Job]) -> Generator[Result]:
    """Yield the results in the order of the jobs; only a few are worked at or wait at any moment."""
    waiting: deque[Future[Result]] = deque()
    left = iter(jobs)
    first = list(islice(left, 2))
    if len(first) < 2 or threads() < 2:  # a thread would be made for nothing
        yield from map(work, chain(first, left))
        return
    left = chain(first, left)
    with ThreadPoolExecutor(threads(), thread_name_prefix="unpack") as pool:
        try:
            for job in islice(left, threads() + AHEAD):
                waiting.append(pool.submit(work, job))
            while waiting:
                done = waiting.popleft().result()
                for job in islice(left, 1):
                    waiting.append(pool.submit(work, job))
                yield done
        finally:
            for future in waiting:
                future.cancel()
