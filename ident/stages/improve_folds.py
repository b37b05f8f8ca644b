"""Which data take no part in a fit and judge it: runs, each once, or blocks where there are fewer than three.

A run is held out only where the others come near what it does: a tyre curve that was seen to 4 m/s² says
nothing of 10 m/s², and a model that spins there is no evidence against an effect. Blocks of a run lie apart
by a guard and start from a state of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.layer import HeldOut, Layer, LayerFit
from ident.estimation.motion_effects import LEAD
from ident.estimation.motion_layer import MotionLayer
from ident.estimation.tyre_fit import WINDOW
from ident.estimation.vehicle_records import MotionRecord, cut, part_of
from ident.results import SplitBy

Array = NDArray[np.float64]

FOLDS = 4
LEAST_RUNS = 3
BEYOND = 2.0  # times what all other runs reach: further than that they say nothing
REACHED = 0.99  # quantile of a signal's size
NOT_HARD = (
    "heading",
    "position_along",
    "position_across",
    "lateral_velocity",
)  # no measure of how hard it is driven
BLOCK, GUARD = 20.0, 3.0  # [s]
SHORTEST = 3.0  # [s] of a window


@dataclass(frozen=True)
class Folds:
    """What is held out in turn.

    layer : of runs, or of their blocks; groups : of its runs, held out together
    of : run of that layer -> run of the logs; by : what is held out
    left_in : run -> why it is in every fit
    """

    layer: Layer
    groups: list[list[str]]
    of: dict[str, str]
    by: SplitBy
    left_in: dict[str, str] = field(default_factory=dict)


def folds_of(layer: Layer, base: LayerFit, count: int | None) -> Folds:
    """Divide a layer's runs, of which ``base`` is a fit, into so many groups; blocks where runs are few."""
    if len(layer.runs) >= LEAST_RUNS:
        reached = reach(layer.held_out(base, layer.runs), len(layer.runs))
        groups, left_in = dealt(layer.runs, reached, count or FOLDS)
        return Folds(layer, groups, {name: name for name in layer.runs}, "run" if groups else "none", left_in)
    made = blocks(layer) if isinstance(layer, MotionLayer) else None
    if made is None:
        return Folds(layer, [], {name: name for name in layer.runs}, "none")
    divided, of = made
    groups = [list(divided.runs[number :: count or FOLDS]) for number in range(count or FOLDS)]
    return Folds(divided, [group for group in groups if group], of, "block")


def reach(measured: HeldOut, runs: int) -> dict[str, Array]:
    """Signal -> (runs,) how large it gets in each run; zero where a run has none."""
    made = {}
    for signal, errors in measured.errors.items():
        if signal in NOT_HARD:
            continue
        size, run = np.abs(errors + measured.modelled[signal]), measured.run[signal]
        own = [size[run == number] for number in range(runs)]
        made[signal] = np.array([np.quantile(one, REACHED) if one.size else 0.0 for one in own])
    return made


def dealt(
    runs: Sequence[str], reached: dict[str, Array], count: int
) -> tuple[list[list[str]], dict[str, str]]:
    """Groups of runs, those that go furthest in different ones, and runs that go too far, with the reason."""
    left_in: dict[str, str] = {}
    for number, name in enumerate(runs):
        for signal, sizes in reached.items():
            others = float(np.delete(sizes, number).max())
            if sizes[number] > BEYOND * others:
                left_in.setdefault(name, _too_far(name, signal, float(sizes[number]), others))
    furthest = sum(
        (sizes / max(float(sizes.max()), 1e-300) for sizes in reached.values()), np.zeros(len(runs))
    )
    order = [runs[k] for k in np.argsort(-furthest, kind="stable") if runs[k] not in left_in]
    groups = [order[number::count] for number in range(min(count, len(order)))]
    return [sorted(group) for group in groups], left_in


def _too_far(run: str, signal: str, own: float, others: float) -> str:
    return (
        f"{run} is in every fit: its {signal.replace('_', ' ')} reaches {own:.3g}, that of the other runs "
        f"{others:.3g}: drive another run like it, to confirm what it shows"
    )


def blocks(layer: MotionLayer) -> tuple[MotionLayer, dict[str, str]] | None:
    """The layer with blocks in place of its runs, and the run of each; None where there are not three."""
    records: list[MotionRecord] = []
    places: list[tuple[int, int, int]] = []  # record, window of it and grid points of each that is kept
    of: dict[str, str] = {}
    for number, run in enumerate(layer.runs):
        windows = [
            (r, k, window)
            for r, record in enumerate(layer.records)
            if record.run == number
            for k, window in enumerate(cut(record, WINDOW, LEAD))
        ]
        for name, own in _divided(run, windows).items():
            kept = [(r, k, part) for r, k, part in own if part is not None]
            records += [replace(part, run=len(of)) for _, _, part in kept]
            places += [(r, k, part.times.size) for r, k, part in kept]
            of |= {name: run} if kept else {}
    if len(of) < LEAST_RUNS:
        return None
    terms = {
        key: {name: tuple((parts[r][k][:size],) for r, k, size in places) for name, parts in one.items()}
        for key, one in layer.terms.items()
    }
    return replace(layer, records=records, runs=list(of), terms=terms), of


def _divided(
    run: str, windows: Sequence[tuple[int, int, MotionRecord]]
) -> dict[str, list[tuple[int, int, MotionRecord | None]]]:
    """Windows of a run by block, the last of each shortened by the guard, None where little is left of it."""
    begin, end = windows[0][2].times[0], windows[-1][2].times[-1]
    count = max(1, round((end - begin) / BLOCK))
    width = (end - begin) / count
    made: dict[str, list[tuple[int, int, MotionRecord | None]]] = {}
    for r, k, window in windows:
        block = min(count - 1, int((window.times.mean() - begin) / width))
        first, last = begin + block * width, begin + (block + 1) * width
        made.setdefault(f"{run} {first:.0f} to {last:.0f} s", []).append((r, k, window))
    for own in made.values():
        r, k, end_of_block = own[-1]
        own[-1] = (r, k, _shortened(end_of_block) if end_of_block is not None else None)
    return made


def _shortened(window: MotionRecord) -> MotionRecord | None:
    """A window without its last seconds, None where it is short then."""
    ahead = round(LEAD / window.period)
    last = window.times.size - 1 - round(GUARD / window.period)
    if (last - ahead) * window.period < SHORTEST:
        return None
    return part_of(window, ahead, last, ahead)
