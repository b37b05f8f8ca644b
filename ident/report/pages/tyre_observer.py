"""The observed axle forces on the page of the tyre stage: a band with its line, and two tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ident.glossary import AXLES
from ident.report import figures, shades
from ident.report.condense import Array, Line, broken, contiguous, thinned
from ident.report.numbers import NONE, fixed, significant
from ident.report.page import Block, Cell, Column, Table, Text
from ident.report.tyre_signals import column
from ident.results import ForceObserver

BAND = 1.96  # standard deviations
BINS = 400
CAPTION = (
    "Observed: forces as states of their own, by a smoother without a tyre model, with the 95 % band that "
    "the noise of the sensors leaves."
)


def is_observed(points: pd.DataFrame) -> bool:
    """Whether a table of force points holds observed forces."""
    return "observed_force" in points and bool(points["observed_force"].notna().any())


def traces(points: pd.DataFrame) -> list[figures.Trace]:
    """Draw the band of the observed force of one axle [kN] and the force in it, where there is one."""
    if not is_observed(points):
        return []
    seen = points[points["observed_force"].notna()]
    time = column(seen, "time")
    force, room = 1e-3 * column(seen, "observed_force"), 1e-3 * BAND * column(seen, "observed_std")
    stretches = contiguous(time)
    line = thinned(broken(time, force, stretches), BINS)
    return [
        _band(time, force, room, stretches),
        figures.line(Line(line.time, line.value), "other_1", "observed", unit="kN", width=1.3),
    ]


def _band(time: Array, force: Array, room: Array, stretches: list[slice]) -> figures.Trace:
    """One polygon for each stretch without a gap, with a point for each of ``BINS`` parts of the whole."""
    every = max(1, time.size // BINS)
    every_place = np.arange(time.size)
    parts = [np.unique(np.append(own[::every], own[-1])) for own in (every_place[each] for each in stretches)]
    made = [
        shades.filled(time[own], (force - room)[own], (force + room)[own], "band", "95 % band")
        for own in parts
    ]
    corners = {axis: np.concatenate([np.append(one[axis], np.nan) for one in made]) for axis in ("x", "y")}
    return made[0] | corners


def tables(found: ForceObserver) -> list[Block]:
    """Give the observed forces beside the inversion, and whether the sensors agree in them."""
    columns = [
        Column("axle"),
        Column("half of the 95 % band [N]", "number"),
        Column("observer against inversion, rms [N]", "number"),
        Column("observer against wheels, rms [N]", "number"),
        Column("inversion against wheels, rms [N]", "number"),
    ]
    rows = [
        [Cell(axle), *[_newtons(size) for size in _of_axle(found, axle)]]
        for axle in AXLES
        if axle in found.half_width
    ]
    sensors = [
        [
            Cell(name.replace("_", " ")),
            Cell(f"{fixed(mean, 2)}", raw=mean),
            Cell(f"{fixed(low, 2)} … {fixed(high, 2)}"),
        ]
        for name, (mean, low, high) in found.innovations.items()
    ]
    heads = [Column("signal"), Column("squared innovations [–]", "number"), Column("expected [–]", "number")]
    told = (
        f"Observed forces: their rates of change wander by {significant(found.rate, 2)} of the load of the "
        "axle per s^1.5, where the innovations are most likely. Noise of the sensors: "
        f"{found.noise_from}. The band holds that noise alone, not the error of mass, yaw inertia or biases."
    )
    return [Text(told), Table(columns, rows, download="observed_forces.csv"), Table(heads, sensors)]


def _of_axle(found: ForceObserver, axle: str) -> tuple[float | None, ...]:
    wheels = found.from_wheels.get(axle, {})
    own = (found.half_width[axle], found.from_inversion[axle])
    return (*own, wheels.get("observer"), wheels.get("inversion"))


def _newtons(size: float | None) -> Cell:
    return Cell(NONE if size is None else fixed(size, 0), raw=size)
