"""The table ``evaluate`` as lines to draw: signals of a run as measured and as each model simulates them.

A model runs freely from the logged initial state of the run, or of each stretch of it. One that was driven by
the request is named with ``REQUEST`` behind it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ident.report.condense import Array, Line, broken, contiguous
from ident.report.evaluated import MODELS
from ident.report.poses import Poses, from_first, poses_of
from ident.report.tyre_signals import column

SIGNALS = (
    *("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"),
    *("position_x", "position_y", "longitudinal_velocity", "road_wheel_angle"),
)
POSITIONS = ("position_x", "position_y")
REQUEST = "__request"
_SIMULATED = re.compile(rf"(?:{'|'.join(SIGNALS)})__({'|'.join(MODELS)})")


def simulated_by(rows: pd.DataFrame) -> list[str]:
    """Name the models of which the table has anything on measured steering, the simplest first."""
    found = {
        match.group(1)
        for name in rows.columns
        if (match := _SIMULATED.fullmatch(str(name))) and np.isfinite(column(rows, str(name))).any()
    }
    return [name for name in MODELS if name in found]


def on_request(rows: pd.DataFrame, model: str) -> list[str]:
    """Name a model as it was driven by the request, in a list that is empty where it was not."""
    asked = f"{model}{REQUEST}"
    known = (column(rows, f"{signal}__{asked}") for signal in SIGNALS)
    return [asked] if any(bool(np.isfinite(values).any()) for values in known) else []


def measured_signals(rows: pd.DataFrame, models: Sequence[str]) -> list[str]:
    """Name the signals that were measured and that one of the models simulates as something of its own.

    What a model is driven by it gives back as it was: such a signal compares nothing.
    """
    return [name for name in SIGNALS if compares(rows, name, models)]


def compares(rows: pd.DataFrame, signal: str, models: Sequence[str]) -> bool:
    """Say whether one of the models differs from what was measured anywhere."""
    measured = column(rows, signal)
    errors = [measured - column(rows, f"{signal}__{model}") for model in models]
    return any(bool(np.any(np.abs(error[np.isfinite(error)]) > 0)) for error in errors)


def measured(rows: pd.DataFrame, signal: str) -> Line:
    """Give a signal as it was measured, positions from where the run begins."""
    return _line(rows, column(rows, signal) - _begin(rows, signal))


def simulated(rows: pd.DataFrame, signal: str, model: str) -> Line:
    """Give a signal as a model simulates it, positions from where the run begins."""
    return _line(rows, column(rows, f"{signal}__{model}") - _begin(rows, signal))


def residual(rows: pd.DataFrame, signal: str, model: str) -> Line:
    """Give what is left of a signal when the model's is taken off."""
    return _line(rows, column(rows, signal) - column(rows, f"{signal}__{model}"))


def _line(rows: pd.DataFrame, values: Array) -> Line:
    time, there = column(rows, "time"), np.isfinite(values)
    return broken(time[there], values[there], contiguous(time[there]))


def _begin(rows: pd.DataFrame, signal: str) -> float:
    if signal not in POSITIONS:
        return 0.0
    known = column(rows, signal)
    known = known[np.isfinite(known)]
    return float(known[0]) if known.size else 0.0


def places(rows: pd.DataFrame, models: Sequence[str]) -> dict[str, Poses]:
    """Give where the truck was measured ("measured") and where each model puts it, each where it is known."""
    ways = {"measured": ""} | {model: f"__{model}" for model in models}
    found = {way: _poses(rows, ending) for way, ending in ways.items()}
    return from_first({way: pose for way, pose in found.items() if pose.time.size})


def _poses(rows: pd.DataFrame, ending: str) -> Poses:
    place = (column(rows, f"position_x{ending}"), column(rows, f"position_y{ending}"))
    return poses_of(
        column(rows, "time"), np.zeros(len(rows), dtype=np.int64), place, [column(rows, f"heading{ending}")]
    )
