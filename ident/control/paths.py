"""Paths that a controller is tried on: lane changes and a slalom of clothoids, straight before and after.

A clothoid's curvature runs linearly with the arc length, k(s) = k_0 + k' s, so a chain of them has
continuous curvature (G2) and asks for a steering angle that never jumps. A change from one line to another
is three clothoids that meet position, heading and curvature at both ends (Bertolazzi and Frego 2018, "On the
G2 Hermite interpolation problem with clothoids", doi:10.1016/j.cam.2018.03.029). Axes are those of ISO 8855:
a path begins at the origin along x, curvature is positive to the left.

Lanes of the double lane change (ISO 3888-1, of a vehicle of width w): 15 m of lane, 30 m to change, 25 m of
lane beside it by 3.5 m, 25 m to change back, 30 m of lane (the 2018 edition splits this into 15 m and 15 m);
widths 1.1 w + 0.25, 1.2 w + 0.25, 1.3 w + 0.25. The lane offset is taken here between the centre lines;
between the right edges it would move the second lane by 0.05 w. The path does not keep to the centre lines up
to the last cone: no steering could follow that at a speed worth a test. It leaves them so early that at the
cones it is off by half the room beside the vehicle in the narrowest lane, m = (0.05 w + 0.125)/2.
Three even ramps of curvature that go over by d in a length L are 4.5 d (c/L)³ off after c, so each change
begins and ends c = L (m/(4.5 d))^⅓ inside its lanes. The standard is one for cars; a truck is slow on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pyclothoids import Clothoid, SolveG2
from scipy.optimize import brentq

from ident.errors import BadRecipe

Array = NDArray[np.float64]
Node = tuple[float, float, float, float]

SPACING = 0.25  # [m] longest step of a path's grid
LANE_OFFSET = 3.5  # [m]
ISO_LENGTHS = (15.0, 30.0, 25.0, 25.0, 30.0)  # [m]
ISO_WIDTHS = ((1.1, 0.25), (1.2, 0.25), (1.3, 0.25))  # of the vehicle's width, and added to it [m]
LONGEST_CHANGE = 100.0  # times the offset; what is longer has no curvature worth the name
SHORTEST_CHANGE = 2.0  # times the offset; what is shorter turns by more than 60 degrees
CONES = 5


@dataclass(frozen=True)
class Lane:
    """A stretch between two rows of cones along x.

    begin, end : [m]; centre : y of its middle [m]; width : [m]
    """

    begin: float
    end: float
    centre: float
    width: float


@dataclass(frozen=True)
class Path:
    """A line on the ground at a strictly rising arc length, with continuous curvature.

    arc_length : (n,) [m], from zero; position_x, position_y : (n,) [m]
    heading : (n,) of the tangent, unwrapped [rad]; curvature : (n,) [1/m], linear between the points
    lanes : between cones, where the path has such
    """

    name: str
    arc_length: Array
    position_x: Array
    position_y: Array
    heading: Array
    curvature: Array
    lanes: tuple[Lane, ...] = ()

    @property
    def sharpest(self) -> float:
        """The largest curvature, either side [1/m]."""
        return float(np.max(np.abs(self.curvature)))


def single_lane_change(
    length: float, *, offset: float = LANE_OFFSET, lead_in: float = 50.0, run_out: float = 100.0
) -> Path:
    """Change to a line beside: ``offset`` to the left over ``length`` along x [m]."""
    ends = [_on_line(lead_in, 0.0), _on_line(lead_in + length, offset)]
    nodes = [_on_line(0.0, 0.0), *ends, _on_line(lead_in + length + run_out, offset)]
    return _joined("single_lane_change", nodes)


def double_lane_change(*, width: float = 2.5, lead_in: float = 50.0, run_out: float = 100.0) -> Path:
    """ISO 3888-1: to the left by 3.5 m and back, between the cones.

    width : of the vehicle [m]
    """
    return _double("double_lane_change", 1.0, width, lead_in, run_out)


def double_lane_change_scaled(
    sharpest: float, *, width: float = 2.5, lead_in: float = 50.0, run_out: float = 100.0
) -> Path:
    """That of ISO 3888-1 stretched along x until its curvature reaches ``sharpest`` [1/m] and no more.

    The offset and the widths of the lanes stay; all lengths grow by the same factor. It is no track of the
    standard, hence its own name.

    Raises
    ------
    BadRecipe
        If no stretch gives that curvature.
    """
    shortest = min(ISO_LENGTHS[1], ISO_LENGTHS[3]) / (1.0 - 2.0 * _share_inside(width))
    factor = lane_change_length(sharpest) / shortest
    return _double("double_lane_change_scaled", factor, width, lead_in, run_out)


def truncated_slalom(
    sharpest: float,
    *,
    amplitude: float = 1.75,
    cones: int = CONES,
    lead_in: float = 50.0,
    run_out: float = 100.0,
) -> Path:
    """Left and right of ``cones`` cones in a row, cut off after the last: back to the line they stand on.

    At each cone the path is ``amplitude`` [m] beside it, parallel to the row and as sharp as the sine
    a cos(π x/d) through the same points is, k = a (π/d)²; d is the distance of the cones that makes the
    sharpest place of the whole path, wherever that is, ``sharpest`` [1/m].

    Raises
    ------
    BadRecipe
        If no distance of the cones gives that curvature.
    """

    def shape(distance: float) -> list[Node]:
        peak = amplitude * (np.pi / distance) ** 2
        places = lead_in + distance * np.arange(cones + 2.0)
        sides = [(-1.0) ** i for i in range(cones)]
        tops = [(float(x), a * amplitude, 0.0, -a * peak) for x, a in zip(places[1:-1], sides, strict=True)]
        begin, end = [_on_line(0.0, 0.0), _on_line(lead_in, 0.0)], _on_line(places[-1], 0.0)
        return [*begin, *tops, end, _on_line(places[-1] + run_out, 0.0)]

    distance = _stretched(lambda d: _sharpest(shape(d)), sharpest, amplitude)
    return _joined("truncated_slalom", shape(distance))


def lane_change_length(sharpest: float, offset: float = LANE_OFFSET) -> float:
    """How long a change by ``offset`` [m] is whose curvature reaches ``sharpest`` [1/m].

    Raises
    ------
    BadRecipe
        If there is none.
    """

    def curvature(length: float) -> float:
        return _sharpest([_on_line(0.0, 0.0), _on_line(length, offset)])

    return _stretched(curvature, sharpest, offset)


def mirrored(path: Path) -> Path:
    """The same path to the other side."""
    return replace(
        path,
        position_y=-path.position_y,
        heading=-path.heading,
        curvature=-path.curvature,
        lanes=tuple(replace(lane, centre=-lane.centre) for lane in path.lanes),
    )


def _double(name: str, factor: float, width: float, lead_in: float, run_out: float) -> Path:
    ends = lead_in + factor * np.cumsum([0.0, *ISO_LENGTHS])
    sides = (0.0, 0.0, LANE_OFFSET, LANE_OFFSET, 0.0, 0.0)
    inside = _share_inside(width) / (1.0 - 2.0 * _share_inside(width))
    there, back = inside * (ends[2] - ends[1]), inside * (ends[4] - ends[3])
    places = ends + np.array([0.0, -there, there, -back, back, 0.0])
    nodes = [_on_line(0.0, 0.0), *map(_on_line, places, sides), _on_line(ends[-1] + run_out, 0.0)]
    widths = [share * width + added for share, added in ISO_WIDTHS]
    lanes = tuple(
        Lane(float(ends[i]), float(ends[i + 1]), sides[i], lane_width)
        for i, lane_width in zip((0, 2, 4), widths, strict=True)
    )
    return replace(_joined(name, nodes), lanes=lanes)


def _share_inside(width: float) -> float:
    """c/L, see above, for a vehicle of this width [m]."""
    share, added = min(ISO_WIDTHS)
    margin = ((share - 1.0) * width + added) / 4.0
    return float(np.cbrt(margin / (4.5 * LANE_OFFSET)))


def _on_line(x: float, y: float) -> Node:
    """A point of a straight along x."""
    return float(x), y, 0.0, 0.0


def _stretched(curvature: Callable[[float], float], sharpest: float, offset: float) -> float:
    """The length along x for which ``curvature``, falling with it, is ``sharpest``."""
    shortest, longest = SHORTEST_CHANGE * offset, LONGEST_CHANGE * offset
    highest, lowest = curvature(shortest), curvature(longest)
    if not lowest <= sharpest <= highest:
        raise BadRecipe(
            f"no change by {offset:g} m has a curvature of {sharpest:.3g} 1/m: it is between {lowest:.3g} "
            f"and {highest:.3g} 1/m; ask for another speed or lateral acceleration"
        )
    return float(
        brentq(lambda length: curvature(length) - sharpest, shortest, longest, xtol=1e-12, rtol=1e-14)
    )


def _arcs(nodes: Sequence[Node]) -> list[Clothoid]:
    """Clothoids through the nodes, of which no two in a row stand at the same place."""
    arcs = []
    for start, end in pairwise(nodes):
        is_straight = start[1:] == (end[1], 0.0, 0.0) and end[2:] == (0.0, 0.0)
        if is_straight and end[0] > start[0]:
            arcs.append(Clothoid.StandardParams(*start, 0.0, end[0] - start[0]))
        elif not is_straight:
            arcs.extend(SolveG2(*start, *end))
    return arcs


def _sharpest(nodes: Sequence[Node]) -> float:
    """Largest curvature: it lies at an end of a clothoid."""
    return float(max(max(abs(arc.KappaStart), abs(arc.KappaEnd)) for arc in _arcs(nodes)))


def _joined(name: str, nodes: Sequence[Node]) -> Path:
    """The clothoids through the nodes, on a grid that has all their ends on it."""
    rows: list[tuple[float, float, float, float, float]] = []
    begin = 0.0
    for arc in _arcs(nodes):
        count = int(np.ceil(arc.length / SPACING))
        within = np.linspace(0.0, arc.length, count + 1)[:-1]
        rows.extend(_row(arc, begin, s) for s in within)
        begin += arc.length
    rows.append(_row(arc, begin - arc.length, arc.length))
    arc_length, x, y, heading, curvature = np.array(rows).T
    return Path(name, arc_length, x, y, np.unwrap(heading), curvature)


def _row(arc: Clothoid, begin: float, s: float) -> tuple[float, float, float, float, float]:
    return begin + s, arc.X(s), arc.Y(s), arc.Theta(s), arc.ThetaD(s)
