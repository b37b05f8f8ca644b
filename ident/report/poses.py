"""Where a truck is on its path, as a map draws it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ident.report.condense import Array


class Poses(NamedTuple):
    """Where a truck is: (n,) time [s], place from the start of the run [m], heading [rad], (n,) window."""

    time: Array
    x: Array
    y: Array
    heading: Array
    window: NDArray[np.int_]


def poses_of(
    time: Array, window: NDArray[np.int_], place: tuple[Array, Array], headings: Sequence[Array]
) -> Poses:
    """Take the places that are known, with the first heading that is known anywhere, else the course.

    Parameters
    ----------
    time, window : (n,) [s] and number
    place : x and y, (n,) each, NaN where not known [m]
    headings : (n,) each, NaN where not known; interpolated between their samples [rad]
    """
    there = np.isfinite(place[0]) & np.isfinite(place[1])
    x, y = (values[there] for values in place)
    for heading in headings:
        known = np.isfinite(heading)
        if known.any() and x.size:
            turned = np.interp(time[there], time[known], np.unwrap(heading[known]))
            return Poses(time[there], x, y, turned, window[there])
    course = np.arctan2(np.gradient(y), np.gradient(x)) if x.size > 1 else np.zeros(x.size)
    return Poses(time[there], x, y, course, window[there])


def from_first(found: dict[str, Poses]) -> dict[str, Poses]:
    """Count all places from the first of the first: on a map they are millions of metres away."""
    if not found:
        return {}
    first = next(iter(found.values()))
    x, y = first.x[0], first.y[0]
    return {way: pose._replace(x=pose.x - x, y=pose.y - y) for way, pose in found.items()}
