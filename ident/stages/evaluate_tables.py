"""Table of the evaluation: every held-out run as measured and as each model predicts it, free-running."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.vehicle_records import Windows
from ident.stages.evaluate_data import HeldOut
from ident.stages.evaluate_errors import Evaluated
from ident.stages.tyre_tables import SIGNALS, measured_on_grid

Array = NDArray[np.float64]


def evaluate_tables(data: HeldOut, evaluated: Sequence[Evaluated]) -> dict[str, pd.DataFrame]:
    """Table ``evaluate``: one row a grid point of a held-out run."""
    measured = next(one for one in evaluated if one.level.name == "measured")
    windows = measured.level.cuts["whole"].windows
    names = np.array(data.names, dtype=object)[np.repeat(windows.run, np.diff(windows.offsets))]
    table: dict[str, object] = {"run": pd.Categorical(names), "time": windows.times}
    table |= {name: measured_on_grid(windows, name) for name in SIGNALS}
    table |= {"road_wheel_angle": windows.inputs[:, 0], "speed": windows.inputs[:, 1]}
    for one in evaluated:
        outputs, own = one.predictions["whole"].outputs, one.level.cuts["whole"].windows
        ending = "" if one.level.name == "measured" else "__request"
        for name in SIGNALS:
            table[f"{name}__{one.candidate.name}{ending}"] = _placed(outputs[name], own, windows)
    return {"evaluate": pd.DataFrame(table)}


def _placed(values: Array, own: Windows, windows: Windows) -> Array:
    """(N,) values on the grid of all segments, NaN where the level does not have them."""
    if own is windows:
        return values
    placed = np.full(windows.times.size, np.nan)
    for number, part in enumerate(own.records):
        for record, offset in zip(windows.records, windows.offsets.tolist(), strict=False):
            if record.run == part.run and record.times[0] <= part.times[0] <= record.times[-1]:
                at = offset + int(np.searchsorted(record.times, part.times[0]))
                placed[at : at + part.times.size] = values[own.offsets[number] : own.offsets[number + 1]]
    return placed
