"""Which runs a model is fitted to, and which it is judged by.

Runs are drawn within groups (manoeuvre and vehicle), so that each side holds every kind of driving; which
ones depends on the seed and on the names in that group alone: a new run elsewhere changes nothing.
Manoeuvres that were driven once form one group together. With fewer than ``FEWEST`` runs the last third of
each run is held out instead, behind a guard in which the residual of the fit is forgotten.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from hashlib import sha256

import numpy as np

FEWEST = 3
GUARD = 2.0  # [s] between what is fitted and what is held out of one run
LAST = 1 / 3  # of a run

_REPEAT = re.compile(r"[_\-. ]?(?:\d+|(?<=[_\-. ])[a-zA-Z])$")


def manoeuvre_of(name: str) -> str:
    """Name without what tells repeats apart: "manual" of "day_1/manual_c", "circle" of "circle12"."""
    last = name.rpartition("/")[2]
    return _REPEAT.sub("", last) or last


def draw_split(names: Sequence[str], groups: Sequence[str], seed: int, share: float) -> list[str]:
    """Draw the runs that are held out.

    Parameters
    ----------
    names : (n,) of runs, all different
    groups : (n,) what each is a repeat of
    share : of the runs that is to be held out, between 0 and 1

    Returns
    -------
    held_out : in the order of ``names``; at least one where any group has two, never all of a group
    """
    members = _groups(names, groups)
    counts = _counts({group: len(runs) for group, runs in members.items()}, share)
    drawn = {name for group, runs in members.items() for name in _drawn(group, runs, seed, counts[group])}
    return [name for name in names if name in drawn]


def last_third(begin: float, end: float) -> tuple[float, float]:
    """Return what is held out of a run that was driven from ``begin`` to ``end`` [s]."""
    return end - LAST * (end - begin), end


def _groups(names: Sequence[str], groups: Sequence[str]) -> dict[str, list[str]]:
    """Return group -> its runs, sorted; the runs that nothing repeats are one group."""
    made: dict[str, list[str]] = {}
    for name, group in sorted(zip(names, groups, strict=True)):
        made.setdefault(group if groups.count(group) > 1 else "", []).append(name)
    return dict(sorted(made.items()))


def _counts(sizes: Mapping[str, int], share: float) -> dict[str, int]:
    """How many of each group are held out: in proportion, the rest to where most is missing."""
    counts = {group: min(math.floor(share * size), size - 1) for group, size in sizes.items()}
    wanted = max(1, round(share * sum(sizes.values())))
    while sum(counts.values()) < wanted:
        room = [group for group, size in sizes.items() if counts[group] < size - 1]
        if not room:
            break
        counts[max(room, key=lambda group: share * sizes[group] - counts[group])] += 1
    return counts


def _drawn(group: str, runs: Sequence[str], seed: int, count: int) -> list[str]:
    key = int.from_bytes(sha256(group.encode(errors="replace")).digest()[:8], "big")
    order = np.random.default_rng([abs(seed), key]).permutation(len(runs))
    return [runs[index] for index in order[:count]]
