"""The two sides of a split: which runs, and which parts of their windows, lie on each."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.experiments.motion import Measurement, MotionRun, MotionWindow
from ident.experiments.splits import GUARD
from ident.stages.inputs import SplitSettings

Side = Literal["training", "held_out"]
OTHER_SIDE: dict[Side, str] = {
    "training": "held out for the evaluation",
    "held_out": "not held out: the models were fitted to it",
}


def takes_part(run: str, split: SplitSettings, side: Side) -> bool:
    """Whether a run has data on this side."""
    whole = split.holds_out(run)
    return whole or split.block_of(run) is not None if side == "held_out" else not whole


def split_motion(run: MotionRun, split: SplitSettings, side: Side, shortest: float) -> MotionRun:
    """Return a run with what of its windows lies on this side.

    Training keeps a guard from a block that is held out.

    Parameters
    ----------
    shortest : what is left of a window is used if it is this long [s]
    """
    block = split.block_of(run.name)
    if block is None or split.holds_out(run.name):
        return run
    begin, end = block
    if side == "held_out":
        kept, told = [(begin, end)], f"only [{begin:.1f}, {end:.1f}] s is held out"
    else:
        kept = [(-np.inf, begin - GUARD), (end + GUARD, np.inf)]
        told = f"[{begin:.1f}, {end:.1f}] s is {OTHER_SIDE[side]}, {GUARD:g} s beside it are left out"
    windows = [cut for window in run.windows for span in kept if (cut := _cut(window, *span, shortest))]
    return replace(run, windows=windows, notes=[*run.notes, told])


def _cut(window: MotionWindow, begin: float, end: float, shortest: float) -> MotionWindow | None:
    inside = _between(window.times, begin, end)
    times = window.times[inside]
    if not times.size or times[-1] - times[0] < shortest:
        return None
    measured = {name: _part(one, times[0], times[-1]) for name, one in window.measurements.items()}
    return MotionWindow(
        times,
        window.road_wheel_angle[inside],
        window.speed[inside],
        {name: one for name, one in measured.items() if one.times.size},
    )


def _part(measured: Measurement, begin: float, end: float) -> Measurement:
    inside = _between(measured.times, begin, end)
    return replace(measured, times=measured.times[inside], values=measured.values[inside])


def _between(times: NDArray[np.float64], begin: float, end: float) -> NDArray[np.bool_]:
    return np.asarray((times >= begin) & (times <= end))
