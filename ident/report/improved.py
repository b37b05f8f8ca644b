"""What the improvement says, as every view of it tells it: names, sizes, and its tables as lines to draw.

Tables of the stage ``improve``:

- "improve", one row for each grid time of each run and layer: run, time [s since the start of the run],
  layer (actuator or motion); for each compared signal S ``S_measured``, ``S_before`` (the base model) and
  ``S_after`` (the improved model), NaN where there is none; ``regressor``, the variable that explains what
  the base model leaves (``ImproveResult.regressor`` names it); ``activity``, how strongly the first effect
  that was added acts, 0 to 1. The last two may be missing.
- "improve_held_out", one row a sample of runs while they took no part in the fit: run, time [s], signal,
  measured, before, after.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from ident.glossary import SIGNALS
from ident.report.condense import Array, Line, broken, contiguous
from ident.report.numbers import NONE, estimate_interval, estimate_value, significant, unit_text
from ident.report.page import Tone
from ident.report.tyre_parameters import DISPLAYED, ERRORS, displayed, in_order, signal_unit
from ident.results import (
    Candidate,
    CheckVerdict,
    ErrorRange,
    Estimate,
    ImproveResult,
    LayerName,
    SensorCheck,
    Verdict,
)

ENTERS = {
    "A": "actuator",
    "G": "linkage",
    "T": "tyre",
    "Y": "lateral force",
    "R": "yaw moment",
    "X": "longitudinal",
    "M": "measurement",
}
BADGES: dict[Verdict, tuple[str, Tone]] = {
    "adequate": ("adequate", "good"),
    "named": ("named", "good"),
    "equivalent": ("one of several", "caution"),
    "unexplained": ("unexplained", "bad"),
}
CHECKED: dict[CheckVerdict, tuple[str, Tone]] = {
    "differs": ("differs", "caution"),
    "agrees": ("agrees", "good"),
    "not_testable": ("not testable", "muted"),
}
LAYERS: dict[LayerName, str] = {
    "actuator": "actuator (request to angle)",
    "motion": "motion (angle to yaw rate, acceleration, place)",
}
WAYS = ("measured", "before", "after")
ROLES = {"measured": "measured", "before": "other_1", "after": "modelled", "activity": "other_2"}
"""Colours."""
MEAN_BINS = 24


def effect_name(key: str) -> str:
    """Name an effect for a reader: "sensor_bias yaw_rate" is "sensor bias of the yaw rate"."""
    name, _, signal = key.partition(" ")
    own = name.replace("_", " ")
    return f"{own} of the {signal.replace('_', ' ')}" if signal in SIGNALS else f"{own} {signal}".strip()


def parameter_name(name: str) -> str:
    """Name a parameter of an effect for a reader, given as "length" or as "tyre_relaxation.length"."""
    return name.rpartition(".")[2].replace("_", " ")


def place_name(equation: str) -> str:
    """Name an equation of the truck for a reader, given as a letter of the catalogue or in full."""
    return ENTERS.get(equation, equation.replace("_", " "))


def added_names(result: ImproveResult) -> list[str]:
    """Name what was added, in order: effects, then a term that was discovered."""
    names = [effect_name(effect.key) for effect in result.effects]
    found = result.discovered
    return names + ([f"{found.term} in the {place_name(found.equation)}"] if found else [])


def signals_of(result: ImproveResult) -> list[str]:
    """Name every signal with an error before and after, in the order in which errors are told."""
    error = result.error
    return in_order(name for name in error.before if name in error.after)


def shown(signal: str, error: ErrorRange | float | None) -> str:
    """Give the size of an error in the unit that ``signal_unit`` names."""
    value = error.value if isinstance(error, ErrorRange) else error
    return NONE if value is None else significant(value * signal_unit(signal)[0])


def shown_interval(signal: str, error: ErrorRange | None) -> str | None:
    """Give the 95 % interval of an error in the unit that ``signal_unit`` names, None without one."""
    if error is None or error.low is None or error.high is None:
        return None
    low, high = (shown(signal, end) for end in (error.low, error.high))
    return f"{low} … {high}"


def over_noise(result: ImproveResult, signal: str, *, after: bool) -> tuple[float, float, float] | None:
    """Give an error with its interval in parts of the noise floor [-], None where that is not known."""
    floor = result.error.noise.get(signal)
    error = (result.error.after if after else result.error.before).get(signal)
    if error is None or not floor:
        return None
    ends = (error.value, error.low, error.high)
    value, low, high = (error.value if end is None else end for end in ends)
    return value / floor, low / floor, high / floor


def taken(result: ImproveResult, signal: str) -> float | None:
    """Give how much of the error above the noise is gone [-], √(RMS² − σ²); None without any above it."""
    before, after = result.error.before.get(signal), result.error.after.get(signal)
    floor = result.error.noise.get(signal)
    if before is None or after is None or floor is None or before.value <= floor:
        return None
    left = math.sqrt(max(after.value**2 - floor**2, 0.0))
    return 1.0 - left / math.sqrt(before.value**2 - floor**2)


def main_signal(result: ImproveResult) -> str | None:
    """Give the signal to look at first: the one that is explained, else that furthest above its noise."""
    names = signals_of(result)
    if result.regressor is not None and result.regressor.signal in names:
        return result.regressor.signal

    def excess(name: str) -> float:
        found = over_noise(result, name, after=False)
        return found[0] if found else 0.0

    return max(names, key=excess, default=None)


def size_text(estimate: Estimate) -> str:
    """Give an estimate with its interval and unit in one line."""
    own = displayed(estimate)
    unit = "" if own.unit == "1" else f" {unit_text(own.unit)}"
    interval = "" if own.low is None or own.high is None else f" ({estimate_interval(own)})"
    return f"{estimate_value(own)}{interval}{unit}"


def in_unit(value: float, unit: str) -> tuple[float, str]:
    """Give a value and its unit as they are shown."""
    factor, own = DISPLAYED.get(unit, (1.0, unit))
    return factor * value, unit_text(own)


def ranked(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Sort candidates: those fitted in full by what they gain, then the others by their score."""
    return sorted(candidates, key=lambda one: (one.gain is None, -(one.gain or 0.0), -one.statistic))


def by_verdict(checks: Sequence[SensorCheck]) -> list[SensorCheck]:
    """Sort checks of sensors, those that differ first."""
    order = list(CHECKED)
    return sorted(checks, key=lambda one: order.index(one.verdict))


def column(rows: pd.DataFrame, name: str) -> Array:
    """Give a column as numbers, all NaN where there is none."""
    return rows[name].to_numpy(dtype=np.float64) if name in rows else np.full(len(rows), np.nan)


def runs_in(tables: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    """Give the rows of each run, that in which the effect acts most first."""
    if "improve" not in tables:
        return {}
    found = {str(run): rows for run, rows in tables["improve"].groupby("run", sort=False, observed=True)}
    return dict(sorted(found.items(), key=lambda item: -_mean_activity(item[1])))


def _mean_activity(rows: pd.DataFrame) -> float:
    activity = column(rows, "activity")
    activity = activity[np.isfinite(activity)]
    return float(activity.mean()) if activity.size else 0.0


def compared_signals(rows: pd.DataFrame) -> list[str]:
    """Name the signals of a run that were measured and modelled at the same time at least once."""
    names = [str(name).removesuffix("_after") for name in rows.columns if str(name).endswith("_after")]
    return in_order(name for name in names if (name in SIGNALS or name in ERRORS) and _overlaps(rows, name))


def _overlaps(rows: pd.DataFrame, signal: str) -> bool:
    both = column(rows, f"{signal}_measured") - column(rows, f"{signal}_after")
    return bool(np.isfinite(both).any())


def line_of(rows: pd.DataFrame, signal: str, way: str) -> Line:
    """Give a signal of a run as measured, before or after, positions from the first one measured."""
    return _line(rows, column(rows, f"{signal}_{way}") - _begin(rows, signal))


def _begin(rows: pd.DataFrame, signal: str) -> float:
    known = column(rows, f"{signal}_measured")
    known = known[np.isfinite(known)]
    return float(known[0]) if known.size and signal.startswith("position_") else 0.0


def unit_of(signal: str) -> str:
    """Give the SI unit of a signal as it is shown."""
    return unit_text(SIGNALS[signal].unit) if signal in SIGNALS else "m"


def residual_of(rows: pd.DataFrame, signal: str, way: str) -> Line:
    """Give what the model before or after leaves of a signal of a run."""
    return _line(rows, column(rows, f"{signal}_measured") - column(rows, f"{signal}_{way}"))


def activity_of(rows: pd.DataFrame) -> Line:
    """Give how strongly the effect acts over a run, 0 to 1."""
    return _line(rows, column(rows, "activity"))


def _line(rows: pd.DataFrame, values: Array) -> Line:
    there = np.isfinite(values)
    time, values = column(rows, "time")[there], values[there]
    order = np.argsort(time, kind="stable")
    return broken(time[order], values[order], contiguous(time[order]))


def against_regressor(table: pd.DataFrame, signal: str) -> tuple[Array, Array, Array]:
    """Give (n,) the variable that explains, and what is left of a signal before and after, of all runs."""
    measured = column(table, f"{signal}_measured")
    found = [column(table, "regressor"), *(measured - column(table, f"{signal}_{way}") for way in WAYS[1:])]
    there = np.isfinite(found).all(axis=0)
    variable, before, after = (values[there] for values in found)
    return variable, before, after


def binned_means(x: Array, y: Array, bins: int = MEAN_BINS) -> tuple[Array, Array]:
    """Give the means of x and y in at most so many bins of x that hold equally many samples.

    Samples with the same x are in the same bin, so that a variable of few values has one mean for each.
    """
    values, place = np.unique(x, return_inverse=True)
    if values.size > bins:
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
        place = np.searchsorted(edges[1:-1], x, side="right")
    counts = np.bincount(place)
    kept = counts > 0
    return np.bincount(place, x)[kept] / counts[kept], np.bincount(place, y)[kept] / counts[kept]


def held_out_rms(table: pd.DataFrame) -> dict[str, dict[str, tuple[float, float]]]:
    """Give run -> signal -> RMS error before and after, in SI units, while the run was held out."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for (run, signal), rows in table.groupby(["run", "signal"], sort=False, observed=True):
        errors = [column(rows, "measured") - column(rows, way) for way in WAYS[1:]]
        there = np.isfinite(errors).all(axis=0)
        if there.any():
            before, after = (float(np.sqrt(np.mean(values[there] ** 2))) for values in errors)
            found.setdefault(str(run), {})[str(signal)] = (before, after)
    return found
