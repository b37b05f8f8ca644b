"""Error before and after on runs that took no part in the fit, and whether that confirms what was added."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.before_after import gain_interval, rms_range
from ident.estimation.improvement import Improvement
from ident.estimation.layer import BIN, HeldOut, Layer, LayerFit, Likelihood
from ident.glossary import SIGNALS
from ident.results import Confirmation, ErrorComparison, ErrorRange, Estimate, SplitBy
from ident.stages.improve_folds import Folds, folds_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]

ASTRAY = 10.0  # times the error of the fit to all runs
HELD_OUT = ["run", "time", "signal", "measured", "before", "after"]
CONFIRMED_BY = {"run": "leave some runs out", "block": "blocks within one run"}
WEAKEST: tuple[SplitBy, ...] = ("none", "block", "part", "run")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Compared:
    """Errors of base and improved model in the same samples.

    rows : signal -> (n, 5) run, time, measured, before, after
    noise : of each signal; at_least : those of which it is a lower limit
    by : what took no part in the fits, "none" where all did
    left_in : run -> why it was not held out; it has no rows
    """

    rows: dict[str, Array]
    noise: dict[str, float]
    runs: list[str]
    by: SplitBy
    at_least: list[str] = field(default_factory=list)
    left_in: dict[str, str] = field(default_factory=dict)

    @property
    def held_out(self) -> bool:
        """Whether the samples took no part in the fits."""
        return self.by != "none"


def unit_of(signal: str) -> str:
    """Unit of a compared signal."""
    return SIGNALS["position_x"].unit if signal.startswith("position") else SIGNALS[signal].unit


def held_up(found: Improvement, name: str, folds: int | None, progress: Progress) -> Compared:
    """As ``compared``, after what does not hold on other data is taken back, last first.

    Where the errors are larger on the whole, the best of the shorter sequences is kept, by how much the error
    of a run falls on average; nothing is kept under which that rises.
    """
    made = compared(found, name, folds, progress)
    tried = [(found.fits[name], made)]
    while tried[-1][0].keys and tried[-1][1].held_out and gain_of(tried[-1][1]) <= 0:
        fit = found.shorter(name, tried[-1][0])
        tried.append((fit, compared(found.with_fit(name, fit), name, folds, progress)))
    fit, made = max(tried, key=lambda one: fall_of(one[1]) if one[0].keys else 0.0)
    found.take_back(name, fit)
    return made


def gain_of(part: Compared) -> float:
    """Mean log likelihood a sample that the improved model gains, each signal weighed by its noise."""
    gained, count = 0.0, 0
    for signal, rows in part.rows.items():
        before, after = ((rows[:, 2] - rows[:, k]) ** 2 for k in (3, 4))
        gained += float(np.sum(before - after)) / (2 * part.noise[signal] ** 2)
        count += len(rows)
    return gained / max(count, 1)


def fall_of(part: Compared) -> float:
    """Mean over the runs of the logarithm of error before over error after, all signals over their noise."""
    sums = np.zeros((len(part.runs), 2))
    for signal, rows in part.rows.items():
        run = rows[:, 0].astype(np.intp)
        for way, column in enumerate((3, 4)):
            error = ((rows[:, 2] - rows[:, column]) / part.noise[signal]) ** 2
            sums[:, way] += np.bincount(run, error, len(part.runs))
    told = (sums > 0).all(axis=1)
    return float(np.mean(np.log(sums[told, 0] / sums[told, 1])) / 2) if told.any() else 0.0


def compared(found: Improvement, name: str, folds: int | None, progress: Progress) -> Compared:
    """Errors of a layer in runs (or blocks) from fits without them; of the fit itself where they are few."""
    layer, base, fit = found.layers[name], found.base[name], found.fits[name]
    divided = folds_of(layer, base, folds)
    left_in = dict(divided.left_in)
    parts = []
    for number, runs in enumerate(divided.groups):
        progress("errors on data that take no part", number, len(divided.groups))
        one = _without(divided, runs, base, fit)
        if isinstance(one, str):
            left_in |= {run: f"{run} is in every fit: {one}" for run in runs}
        else:
            parts.append(one)
    if not parts:
        return _gathered([_both(layer, base, fit, layer.runs)], fit, replace(divided, by="none"), layer.runs)
    return replace(_gathered(parts, fit, divided, layer.runs), left_in=left_in)


def _without(
    divided: Folds, runs: Sequence[str], base: LayerFit, fit: LayerFit
) -> tuple[Sequence[str], HeldOut, HeldOut] | str:
    """Errors in some runs of models that were fitted without them, or why there are none."""
    rest = divided.layer.without(runs)
    try:
        before = rest.fitted((), start=base)
        after = rest.fitted(fit.keys, start=fit) if fit.keys else before
    except ValueError as error:
        return f"no fit without it: {error}"
    made = _both(divided.layer, before, after, runs)
    errors = [one for held in made[1:] for one in held.errors.values()]
    if not all(np.isfinite(one).all() for one in errors):
        return "the model fitted without it blows up there"
    whole = _both(divided.layer, base, fit, runs)
    if any(_astray(one, other) for one, other in zip(made[1:], whole[1:], strict=True)):
        return "the model fitted without it goes astray there, beyond what the other runs show"
    return made


def _astray(one: HeldOut, other: HeldOut) -> bool:
    """Whether any signal's errors are far above those of the fit to all runs, as when a model spins."""
    return any(
        float(np.mean(error**2)) > ASTRAY**2 * float(np.mean(other.errors[name] ** 2))
        for name, error in one.errors.items()
    )


def _both(
    layer: Layer, before: LayerFit, after: LayerFit, runs: Sequence[str]
) -> tuple[Sequence[str], HeldOut, HeldOut]:
    one = layer.held_out(before, runs)
    return runs, one, one if after is before else layer.held_out(after, runs)


def _gathered(
    parts: Sequence[tuple[Sequence[str], HeldOut, HeldOut]],
    fit: LayerFit,
    divided: Folds,
    runs: Sequence[str],
) -> Compared:
    values: dict[str, list[Array]] = {}
    for own, before, after in parts:
        place = np.array([runs.index(divided.of.get(name, name)) for name in own])
        for signal, error in after.errors.items():
            columns = (
                place[after.run[signal]],
                after.time[signal],
                error + after.modelled[signal],
                before.modelled[signal],
                after.modelled[signal],
            )
            values.setdefault(signal, []).append(np.column_stack(columns))
    rows = {signal: np.vstack(each) for signal, each in values.items()}
    return Compared(rows, fit.noise(), list(runs), divided.by, fit.slow_noise())


def error_comparison(parts: Sequence[Compared], seed: int) -> ErrorComparison:
    """Root mean squares with intervals of blocks of driving."""
    before, after, noise = {}, {}, {}
    for part in parts:
        for signal, rows in part.rows.items():
            run, time = rows[:, 0].astype(np.intp), rows[:, 1]
            unit = unit_of(signal)
            made = [rms_range(rows[:, 2] - rows[:, k], run, time, seed=seed) for k in (3, 4)]
            before[signal], after[signal] = (ErrorRange(*one, unit) for one in made)
            noise[signal] = part.noise[signal]
    by: SplitBy = min((part.by for part in parts), key=WEAKEST.index, default="none")
    at_least = [signal for part in parts for signal in part.at_least if signal in noise]
    return ErrorComparison(before, after, noise, by, at_least)


def confirmation(parts: Sequence[Compared], seed: int) -> Confirmation | None:
    """Gain of log likelihood a sample on what took no part, each signal weighed by its noise."""
    if not parts or not all(part.held_out for part in parts):
        return None
    before: list[tuple[Index, Array, Array]] = []
    after: list[tuple[Index, Array, Array]] = []
    count = 0
    runs = list(dict.fromkeys(name for part in parts for name in part.runs))
    for part in parts:
        place = np.array([runs.index(name) for name in part.runs])
        for signal, rows in part.rows.items():
            variance = part.noise[signal] ** 2
            for into, column in ((before, 3), (after, 4)):
                error = (rows[:, 2] - rows[:, column]) ** 2 / variance
                into.append((place[rows[:, 0].astype(np.intp)], rows[:, 1], -error))
            count += len(rows)
    one, other = _binned(before), _binned(after)
    mean, low, high = gain_interval(one, other, samples=float(count), seed=seed)
    by_run, gained = {}, np.subtract(other.values, one.values)
    for number, name in enumerate(runs):
        own = one.run == number
        if not own.any():
            continue
        by_run[name] = float(gained[own].sum() / 2 / max(count, 1))
    finite = np.isfinite([low, high]).all()
    how = CONFIRMED_BY[min((part.by for part in parts), key=WEAKEST.index)]
    gain = Estimate(mean, None, low if finite else None, high if finite else None, "1")
    return Confirmation(gain, by_run, bool(finite and low > 0), how)


def _binned(parts: Sequence[tuple[Index, Array, Array]]) -> Likelihood:
    """Sums over bins of run and time, of all signals."""
    run = np.concatenate([part[0] for part in parts])
    time = np.concatenate([part[1] for part in parts])
    gathered = np.concatenate([part[2] for part in parts])
    keys = np.column_stack([run, np.floor(time / BIN).astype(np.intp)])
    found, where = np.unique(keys, axis=0, return_inverse=True)
    total = np.bincount(where.ravel(), gathered, len(found)).astype(np.float64)
    return Likelihood(found[:, 0].astype(np.intp), BIN * (found[:, 1] + 0.5), total)


def held_out_table(parts: Sequence[Compared]) -> pd.DataFrame:
    """One row a sample: run, time, signal, measured, before, after."""
    frames = []
    for part in parts:
        if not part.held_out:
            continue
        for signal, rows in part.rows.items():
            names = np.array(part.runs, dtype=object)[rows[:, 0].astype(np.intp)]
            frame = pd.DataFrame(rows[:, 1:], columns=["time", "measured", "before", "after"])
            frames.append(frame.assign(run=pd.Categorical(names), signal=signal)[HELD_OUT])
    if not frames:
        return pd.DataFrame({name: [] for name in HELD_OUT})
    return pd.concat(frames, ignore_index=True)
