"""Do the intervals of the tyre parameters hold, and are they as narrow as the data allow?

    python studies/tyre_coverage.py [--seeds 500] [--jobs 2] [--part planar|varied|two_track]

Three parts, each of simulated runs that are measured again for every seed and fitted as ``ident tyres`` does,
from the signals on (steering, speed, noise and biases are as in the sample logs):

* planar: the three planar sample runs, whose truck is exactly the model that is fitted. How often the 95 %
  and the 99 % interval hold the truth; spread over the Cramér-Rao bound with steering and speed seen through
  their sensors, which ``tyre_inputs.py`` makes; bias.
* varied: the same with another truck for every seed, tyres and yaw inertia drawn at random, and another
  drive: coverage must not rest on a truth that lies near what the fit believes beforehand.
* two_track: the manual and the slow sample runs of the truck on two tracks, which the model is not. What is
  held against the intervals is the pseudo-true value: the same fit to the same runs without noise, with the
  noise model of a noisy fit.

What is called not identifiable has no interval and does not count. Fits of the first and third part start
where the fit without noise ended, which saves time and changes no minimum; every 25th is fitted from the data
alone as well, and the largest difference between both, in standard errors, is told. Every finished seed is
kept in studies/results/, so a study that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from generator.motion_sets import MotionSet, measured_again, motion_set, noise_free  # noqa: E402
from generator.runs import TRIPS, Trip, driver_run  # noqa: E402
from generator.truth import AxleTyre, Planar, Truth, load_truth  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.stats import norm  # noqa: E402
from truck_runs import run_of, vehicle_of  # noqa: E402
from tyre_bound import derived  # noqa: E402

from ident.estimation.tyre_estimates import Uncertainty, tyre_fit, uncertainty  # noqa: E402
from ident.estimation.tyre_fit import KindFit, fit_tyres  # noqa: E402
from ident.estimation.tyre_start import tyre_starts  # noqa: E402
from ident.results import Estimate, TyreFit  # noqa: E402
from ident.signals.signal import LoadedLogs  # noqa: E402
from ident.stages.inputs import AlignSettings  # noqa: E402
from ident.stages.tyre_data import TyreData, tyre_data  # noqa: E402

Array = NDArray[np.float64]

KEPT = HERE / "results" / "tyre_coverage.jsonl"
BOUND = KEPT.with_name("tyre_bound.json")
KIND = "magic_formula"
LEAST_SPEED = 3.0  # [m/s]
AGAIN = 25  # one in so many is fitted from the data alone as well
Z_95, Z_99 = float(norm.ppf(0.975)), float(norm.ppf(0.995))
RUNS = {
    "planar": tuple(name for name, trip in TRIPS.items() if trip.vehicle == "planar"),
    "two_track": ("manual_a", "manual_b", "manual_c", "slow_slalom", "slow_circle"),
}
PARTS = {"planar": 1.0, "varied": 0.4, "two_track": 0.4}  # share of the seeds
AXLES = ("front", "rear")
NOT_HELD = ("stiffness_factor",)  # follows from the others


# --- data and fit ----------------------------------------------------------------------------------


def data_of(runs: Mapping[str, MotionSet], truth: Truth) -> TyreData:
    """What the stage makes of runs, as from log files."""
    vehicle = vehicle_of(truth.planar)
    loaded = [run_of(name, motion, vehicle) for name, motion in runs.items()]
    return tyre_data(LoadedLogs(loaded, [], [], []), AlignSettings(), None, LEAST_SPEED)


def fitted(data: TyreData, starts: Sequence[Mapping[str, float]] | None = None) -> KindFit:
    """Fit as the stage does, from its own starts unless others are given."""
    starts = starts or tyre_starts(KIND, data.records, data.body)
    return fit_tyres(data.records, KIND, data.body, starts, floor=data.floor)


@cache
def noise_free_runs(part: str) -> dict[str, MotionSet]:
    """Return the runs of a part, in which no sensor errs."""
    return {name: motion_set(name, noise_free(load_truth()), 1) for name in RUNS[part]}


def measured_runs(part: str, seed: int) -> dict[str, MotionSet]:
    """Return the same runs, measured with the noise of a seed."""
    truth = load_truth()
    return {name: measured_again(true, truth, seed, name) for name, true in noise_free_runs(part).items()}


@cache
def pseudo_true(part: str) -> dict[str, float]:
    """What the fit makes of the runs without noise, weighed by the noise of the first seed."""
    truth = load_truth()
    noisy = fitted(data_of(measured_runs(part, 0), truth))
    data = data_of(noise_free_runs(part), truth)
    clean = fit_tyres(
        data.records,
        KIND,
        data.body,
        [noisy.parameters],
        noise=noisy.fit.point.noise,
        window=noisy.window,
        bank=noisy.bank,
    )
    return {name: float(one.value) for name, one in told(clean).items() if one.value is not None}


def told(found: KindFit, ratio_std: float = 0.0) -> dict[str, Estimate]:
    """Every estimate, by name."""
    known: Uncertainty = uncertainty(found, ratio_std)
    fit: TyreFit = tyre_fit(found, known, 0.0)
    axles = {"front": fit.front, "rear": fit.rear}
    own = {
        f"{axle}.{name}": one
        for axle, of in axles.items()
        for name, one in of.items()
        if name not in NOT_HELD
    }
    return {**own, "yaw_inertia": fit.yaw_inertia, "understeer_gradient": fit.understeer_gradient}


# --- one seed --------------------------------------------------------------------------------------


def one_seed(task: tuple[str, int]) -> dict[str, Any]:
    """Fit the runs of one part and seed; values, standard errors, intervals, and what is true."""
    part, seed = task
    if part == "varied":
        truth = varied_truth(seed)
        found = fitted(data_of(varied_runs(truth, seed), truth))
        return _row(part, seed, found, true_values(truth.planar))
    start = pseudo_true(part)
    found = fitted(data_of(measured_runs(part, seed), load_truth()), [start])
    row = _row(part, seed, found, true_values(load_truth().planar) if part == "planar" else start)
    if seed % AGAIN == 0:
        row["from_data"] = _difference(found, fitted(data_of(measured_runs(part, seed), load_truth())))
    return row


def _row(part: str, seed: int, found: KindFit, true: Mapping[str, float]) -> dict[str, Any]:
    estimates = told(found)
    return {
        "part": part,
        "seed": seed,
        "true": [true[name] for name in estimates],
        "names": list(estimates),
        "value": [one.value for one in estimates.values()],
        "std": [one.std for one in estimates.values()],
        "interval": [[one.low, one.high] for one in estimates.values()],
        "status": [one.status for one in estimates.values()],
        "converged": bool(found.fit.converged),
        "coloured": bool(found.fit.is_coloured),
        "window": found.window,
        "bank": bool(found.bank),
    }


def _difference(one: KindFit, other: KindFit) -> float:
    """Largest difference of two fits in standard errors."""
    std = np.sqrt(np.diag(one.fit.covariance))
    return float(np.max(np.abs(one.fit.shared - other.fit.shared) / std))


def true_values(truck: Planar) -> dict[str, float]:
    """What the truth is in the names of the fit."""
    made = {**derived(truck), "yaw_inertia": truck.body.yaw_inertia}
    for axle in AXLES:
        tyre = getattr(truck, axle)
        made |= {
            f"{axle}.peak_force": tyre.peak,
            f"{axle}.shape": tyre.shape,
            f"{axle}.curvature": tyre.curvature,
        }
    return made


def varied_truth(seed: int) -> Truth:
    """Another planar truck: stiffness ±30 %, friction 0.6 to 1, shape 1.15 to 1.6, curvature -1.5 to 0.3."""
    truth, random = load_truth(), np.random.default_rng([seed, 4])
    body = replace(truth.planar.body, yaw_inertia=truth.planar.body.yaw_inertia * random.uniform(0.8, 1.25))
    tyres = {axle: _varied_tyre(getattr(truth.planar, axle), random) for axle in AXLES}
    return replace(truth, planar=replace(truth.planar, body=body, **tyres))


def _varied_tyre(tyre: AxleTyre, random: np.random.Generator) -> AxleTyre:
    slope = tyre.stiffness * tyre.shape * tyre.peak * random.uniform(0.75, 1.3)
    peak, shape = tyre.peak * random.uniform(0.78, 1.28), random.uniform(1.15, 1.6)
    return AxleTyre(slope / (shape * peak), shape, peak, random.uniform(-1.5, 0.3))


def varied_runs(truth: Truth, seed: int) -> dict[str, MotionSet]:
    """Three drives of a minute, measured."""
    names = [f"varied_{number}" for number in range(3)]
    return {name: motion_set(driver_run(Trip("planar", 4.5)), truth, seed, name) for name in names}


# --- tables ----------------------------------------------------------------------------------------


def summary(rows: Sequence[Mapping[str, Any]], part: str) -> str:
    """Coverage, spread and bias of everything that is fitted."""
    own = [row for row in rows if row["part"] == part]
    if len(own) < 2:
        return f"{part}: {len(own)} sets"
    head = (
        f"{part}: n = {len(own)}, converged {_share(own, 'converged')}, coloured {_share(own, 'coloured')}, "
        f"with bank {_share(own, 'bank')}, whole runs {sum(row['window'] > 20 for row in own)}"
    )
    again = [row["from_data"] for row in own if "from_data" in row]
    if again:
        head += f"; from the data alone ({len(again)}): at most {max(again):.2f} standard errors elsewhere"
    title = f"{'':28}{'told':>6}{'95 % cover':>12}{'99 % cover':>12}{'std/spread':>12}{'bias/spread':>12}"
    bounds = planar_bound(own) if part == "planar" else {}
    lines = [head, title + (f"{'spread/bound':>14}" if bounds else "")]
    lines += [_line(own, name, bounds) for name in own[0]["names"]]
    return "\n".join(lines)


def _share(rows: Sequence[Mapping[str, Any]], key: str) -> int:
    return sum(bool(row[key]) for row in rows)


def _line(rows: Sequence[Mapping[str, Any]], name: str, bounds: Mapping[str, float]) -> str:
    at = rows[0]["names"].index(name)
    value, std, true = (np.array([row[key][at] for row in rows]) for key in ("value", "std", "true"))
    ends = np.array([row["interval"][at] for row in rows], dtype=float)
    has = np.isfinite(ends[:, 0])
    error = value - true
    spread = error.std(ddof=1)
    text = f"{name:28}{has.mean():>6.2f}"
    if has.any():
        inside = (ends[has, 0] <= true[has]) & (true[has] <= ends[has, 1])
        wide = np.abs(_stretched(ends[has], value[has], true[has])) <= Z_99 / Z_95
        text += f"{inside.mean():>12.3f}{wide.mean():>12.3f}"
    else:
        text += f"{'-':>12}{'-':>12}"
    text += f"{np.sqrt(np.mean(std**2)) / spread:>12.3f}{error.mean() / spread:>12.3f}"
    return text + (f"{spread / bounds[name]:>14.3f}" if name in bounds else "")


def _stretched(ends: Array, value: Array, true: Array) -> Array:
    """How far the truth lies from the value, in parts of the half of the 95 % interval on that side."""
    half = np.where(true > value, ends[:, 1] - value, value - ends[:, 0])
    return (true - value) / half


def planar_bound(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Cramér-Rao bound of the planar runs, cut as most of the fits cut them, with what the fit believes."""
    if not BOUND.exists():
        return {}
    whole = np.median([row["window"] for row in rows]) > 20
    return json.loads(BOUND.read_text()).get("whole" if whole else "windows", {})


def main() -> None:
    """Run the seeds that are not yet there, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=500, help="of the first part; the others have 40 %%")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--part", choices=list(PARTS), action="append", help="all of them unless said")
    options = parser.parse_args()
    KEPT.parent.mkdir(exist_ok=True)
    kept = [json.loads(line) for line in KEPT.read_text().splitlines()] if KEPT.exists() else []
    done = {(row["part"], row["seed"]) for row in kept}
    parts = options.part or list(PARTS)
    tasks = [(part, seed) for part in parts for seed in range(1, round(PARTS[part] * options.seeds) + 1)]
    with ProcessPoolExecutor(options.jobs) as pool, KEPT.open("a") as file:
        for row in pool.map(one_seed, [task for task in tasks if task not in done]):
            file.write(json.dumps(row) + "\n")
            file.flush()
            kept.append(row)
    print("\n\n".join(summary(kept, part) for part in parts))


if __name__ == "__main__":
    main()
