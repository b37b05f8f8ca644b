"""Whether the intervals of the effects' sizes hold the truth: one truck, measured again and again.

    python studies/improve_coverage.py [--sets 500] [--jobs 2] [--hours H] [--only LAYER]

The truck of a layer has several effects at once, at their usual sizes. Each set measures the same campaign
with noise of its own; the model with these effects is fitted as the loop fits it, its noise identified anew,
and the intervals are those that the command reports. Told of each parameter: how often the 95 % interval
holds the truth, its bias in standard errors, and its spread over the standard errors (one where they are
right; a right standard error is that of the Cramér-Rao bound).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from improve_kept import Row, grow, kept_rows  # noqa: E402
from improve_null import limits  # noqa: E402
from improve_runs import (  # noqa: E402
    Drive,
    actuator_runs,
    drive_campaign,
    key_of,
    measured,
    motion_data,
    motion_layer,
    speeds,
    true_parameters,
    typical,
)

from ident.estimation.actuator_layer import ActuatorLayer  # noqa: E402
from ident.estimation.layer import Layer  # noqa: E402

KEPT = HERE / "results" / "improve_coverage.jsonl"
SEED = 2  # of the campaign
LAYERS = {
    "motion": {
        **dict.fromkeys(("steering_offset", "tyre_relaxation", "load_transfer", "wheel_speed_scale"), None),
        "sensor_latency": "yaw_rate",
        "sensor_bias": "lateral_acceleration",
    },
    "geometry": {
        **dict.fromkeys(("steering_linkage_play", "steering_ratio_nonlinearity", "body_roll"), None),
        "sensor_latency": "lateral_acceleration",
        "sensor_bias": "yaw_rate",
    },
    "column play": {"steering_column_play": None},
    "rate limit": {"steering_rate_limit": None},
    "dead zone": {"steering_dead_zone": None},
}
"""Truck -> its effects, and the signals that they act on where there is more than one."""
ACTUATOR = ("column play", "rate limit", "dead zone")
AT_ONCE = 10  # sets


@cache
def driven(name: str) -> Drive:
    """Return the campaign of one truck."""
    return drive_campaign([typical(effect, 1.0, of) for effect, of in LAYERS[name].items()], SEED)


def cells(sets: int, only: Sequence[str] | None = None) -> Iterator[list[Any]]:
    """Yield (truck, first set, end), the first sets of every truck first."""
    for begin in range(1, sets + 1, AT_ONCE):
        yield from ([name, begin, begin + AT_ONCE] for name in LAYERS if not only or name in only)


def layer_of(name: str, noise: int) -> Layer:
    """Measure the campaign of a truck with the noise of a seed."""
    runs, truth = measured(driven(name), noise), driven(name).truth
    if name in ACTUATOR:
        ratio = truth.planar.steering_ratio
        return ActuatorLayer(actuator_runs(runs, truth), steering_ratio=ratio, speed=speeds(runs, truth))
    return motion_layer(motion_data(runs, truth))


def one_cell(cell: Sequence[Any]) -> Iterable[Row]:
    """Fit sets of one truck; each begins where the one before ended."""
    name, begin, end = cell
    injected = [typical(effect, 1.0, of) for effect, of in LAYERS[name].items()]
    keys, start = tuple(key_of(one) for one in injected), None
    for noise in range(begin, end):
        layer = layer_of(name, noise)
        base = layer.fitted() if start is None else start
        fit = start = layer.fitted(keys, start=base).renoised()
        told = {
            f"{key}.{parameter}": [one.value, one.std, one.low, one.high]
            for key, effect in fit.estimates().items()
            for parameter, one in effect.parameters.items()
        }
        yield {"set": noise, "truth": true_parameters(injected), "told": told}


def summary(rows: Sequence[Row]) -> str:
    """Return one line for each parameter of each truck."""
    lines = [f"{'truck':14}{'parameter':52}{'n':>5}{'covers':>8}{'':>16}{'bias':>8}{'spread':>8}"]
    for name in LAYERS:
        own = [row for row in rows if row["cell"][0] == name]
        for key in own[0]["told"] if own else []:
            effect, _, parameter = key.rpartition(".")
            true = own[0]["truth"].get(effect, {}).get(parameter)
            if true is not None:
                told = np.array([row["told"][key] for row in own if key in row["told"]], dtype=np.float64)
                lines.append(f"{name:14}{key:52}{_line(told, float(true))}")
    return "\n".join(lines)


def _line(told: np.ndarray, true: float) -> str:
    """Coverage with its interval, bias in standard errors, spread over the standard error."""
    value, std, low, high = told.T
    holds = int(np.sum((low <= true) & (true <= high)))
    ends = limits(holds, len(told))
    spread = float(np.std(value, ddof=1) / np.mean(std)) if len(told) > 1 else float("nan")
    bias = float(np.mean(value - true) / np.mean(std))
    between = f"({ends[0]:.3f} to {ends[1]:.3f})"
    return f"{len(told):5d}{holds / len(told):8.3f}{between:>16}{bias:8.2f}{spread:8.2f}"


def main() -> None:
    """Run the sets that are not yet there, then print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sets", type=int, default=500, help="of each truck")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--hours", type=float, help="after which nothing new is begun")
    parser.add_argument("--only", choices=list(LAYERS), action="append", help="of the trucks")
    parser.add_argument("--kept", type=Path, default=KEPT)
    given = parser.parse_args()
    grow(given.kept, cells(given.sets, given.only), one_cell, jobs=given.jobs, hours=given.hours)
    print(summary(kept_rows(given.kept)))


if __name__ == "__main__":
    main()
