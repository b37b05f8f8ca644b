"""How often the gate of the motion fires on a sound truck: false alarms out of thousands of sets.

    python studies/improve_null.py [--sets 100] [--jobs 2] [--hours H] [--kind KIND]

A set is a campaign of a truck that is exactly the base model, measured with noise of its own: of eight runs
for trucks of odd number, of ``FEW`` for the others. Kinds:

* planar: the truck of the sample logs and its sensors (coloured noise, quantised);
* another: another truck for each seed (mass, inertia, tyres, steering ratio, place of the centre of gravity);
* colour: another truck, and other colours of the noise of the inertial unit, the odometry and the speed: an
  autoregression of 0.6 to 0.95 a sample with white noise of the same size on it;
* gusts: a coloured side force without steady part (500 N), which is noise to the loop, too;
* actuator: request and measured angle of another truck, the layer before the motion; its fits share nothing.

Every other fit begins from parameters that are wrong by 20 to 50 %. One fit of a truck gives all of its sets
but those with gusts a start and the colour of the noise, that of the inputs among it; from there each set is
fitted, scored along directions of its own, and tested as the loop does. One set in ``AGAIN`` is fitted from
the wrong start as well, its noise identified anew: both p-values are told.

A kept row that says ``joined`` was not scored anew when the comparison of the size of residuals changed: its
p-value is the smaller one of that comparison alone and of the gate before.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from generator.truth import Channel, Sensor  # noqa: E402
from improve_kept import Row, grow, kept_rows  # noqa: E402
from improve_runs import (  # noqa: E402
    Drive,
    Truth,
    TyreData,
    actuator_runs,
    drive_campaign,
    measured,
    motion_data,
    motion_layer,
    tyre_starts,
)
from scipy.stats import beta  # noqa: E402

from ident.estimation.actuator_layer import ActuatorLayer  # noqa: E402
from ident.estimation.gauss_newton import minimise  # noqa: E402
from ident.estimation.layer import LayerScores  # noqa: E402
from ident.estimation.motion_fit import MotionFit  # noqa: E402
from ident.estimation.motion_layer import KIND, MotionLayer  # noqa: E402
from ident.estimation.residual_tests import screen  # noqa: E402
from ident.estimation.vehicle_fit import NEGLIGIBLE  # noqa: E402
from ident.estimation.vehicle_point import VehiclePoint  # noqa: E402

KEPT = HERE / "results" / "improve_null.jsonl"
TRUCKS = {"planar": 4, "another": 5, "colour": 4, "gusts": 20, "actuator": 7}
FEW = ("there_and_back", "sweep_fast", "ramp_steer", "steps")
LEVEL, DRAWS = 0.05, 999
ITERATIONS = 10
GUSTS = 500.0  # [N]
WRONG = (0.2, 0.5)  # by which the start is, up or down
AT_ONCE = 50  # sets
AGAIN = 25  # one set in so many is fitted from the wrong start as well
MOST_ALLOWED = 111  # of 2,000


# --- trucks and noise ------------------------------------------------------------------------------


def driven(kind: str, seed: int) -> Drive:
    """Return the campaign of one truck."""
    gusts = GUSTS if kind == "gusts" else 0.0
    runs = FEW if seed % 2 == 0 else None
    made = drive_campaign([], seed, truck=None if kind == "planar" else "another", gusts=gusts, runs=runs)
    return replace(made, truth=coloured(made.truth, seed)) if kind == "colour" else made


def coloured(truth: Truth, seed: int) -> Truth:
    """Return the truck with other colours of the noise of its sensors, each of the size that it has."""
    random = np.random.default_rng([seed, 61])

    def other(one: Channel) -> Channel:
        size = float(np.hypot(one.white_std, one.noise_std)) / np.sqrt(2)
        return replace(one, white_std=size, noise_std=size, noise_ar=(random.uniform(0.6, 0.95),))

    def sensor(one: Sensor) -> Sensor:
        return replace(one, channels={name: other(channel) for name, channel in one.channels.items()})

    others = {name: sensor(getattr(truth, name)) for name in ("imu", "odometry", "velocity")}
    return replace(truth, **others)


def wrong_start(data: TyreData, seed: int) -> dict[str, float]:
    """Return what the fit begins from, each parameter wrong by 20 to 50 %."""
    random = np.random.default_rng([seed, 62])
    begin = tyre_starts(KIND, data.records, data.body)[0]
    return {
        name: value * (1 + random.uniform(*WRONG)) ** random.choice([-1.0, 1.0])
        for name, value in begin.items()
    }


def fitted(drive: Drive, noise: int, seed: int) -> MotionFit:
    """Fit a campaign with the noise of a seed, from a start that is wrong."""
    data = motion_data(measured(drive, noise), drive.truth)
    return motion_layer(data, wrong_start(data, seed)).fitted()


# --- sets of one truck -----------------------------------------------------------------------------


def cells(kinds: Sequence[str], sets: int) -> Iterator[list[Any]]:
    """Yield all cells: (kind, seed of the truck, first set, end), the first truck of each kind first."""
    for number in range(1, max(TRUCKS.values()) + 1):
        for kind in kinds:
            if number <= TRUCKS[kind]:
                last = 2 if kind == "gusts" else sets + 1
                for begin in range(1, last, AT_ONCE):
                    yield [kind, number, begin, min(begin + AT_ONCE, last)]


def one_cell(cell: Sequence[Any]) -> Iterable[Row]:
    """Sets of one truck; a row a set."""
    kind, number, begin, end = cell
    drive = driven(kind, number)
    if kind == "actuator":
        return [_of_actuator(drive, number, noise) for noise in range(begin, end)]
    fit = fitted(drive, noise_seed(kind, number, 0), number)
    known = fit.scores()
    if kind == "gusts":
        return [_tested(known, number, begin)]
    rows = []
    for noise in range(begin, end):
        seed = noise_seed(kind, number, noise)
        layer = motion_layer(motion_data(measured(drive, seed), drive.truth), fit.parameters)
        rows.append(_tested(scores_of(refitted(fit, layer), known), number, noise))
        if noise % AGAIN == 0:
            again = _tested(fitted(drive, seed, number).scores(), number, noise)
            rows[-1]["again"] = again["p"]
    return rows


def _of_actuator(drive: Drive, number: int, noise: int) -> Row:
    runs = actuator_runs(measured(drive, noise_seed("actuator", number, noise)), drive.truth)
    layer = ActuatorLayer(runs, steering_ratio=drive.truth.planar.steering_ratio)
    return _tested(layer.fitted().scores(), number, noise)


def noise_seed(kind: str, number: int, noise: int) -> int:
    """Return another seed for every set of every truck."""
    return 1_000_000 * (1 + list(TRUCKS).index(kind)) + 10_000 * number + noise


def refitted(fit: MotionFit, layer: MotionLayer) -> MotionFit:
    """Fit other measurements from the parameters of a fit on, with its colour of the noise."""
    problem, known = layer.problem(()), fit.point
    begin = VehiclePoint(problem, known.shared, known.of_runs, problem.initial_local, known.noise)
    return MotionFit(layer, (), minimise(begin, ITERATIONS, negligible=NEGLIGIBLE)[0])


def scores_of(fit: MotionFit, known: LayerScores) -> LayerScores:
    """Score a fit along its own directions, with the colour by the noise of the inputs that is known."""
    return replace(fit.directions(noises=()).scores(), colour=known.colour)


def _tested(scores: LayerScores, number: int, noise: int) -> Row:
    found = screen([scores], level=LEVEL, draws=DRAWS, seed=1000 * number + noise)
    first = found.groups[0]
    return {"set": noise, "p": found.p_value, "first": first.key, "worth": found.worth, "block": found.block}


# --- what it comes to ------------------------------------------------------------------------------


def limits(hits: int, count: int, level: float = 0.05) -> tuple[float, float]:
    """Clopper-Pearson interval of a share."""
    low = float(beta.ppf(level / 2, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - level / 2, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def summary(rows: Sequence[Row]) -> str:
    """Return the rate of rejections by kind and truck, and what fired."""
    tested = [row for row in rows if "p" in row]
    lines = [_line(kind, [row for row in tested if row["cell"][0] == kind]) for kind in TRUCKS]
    without = [row for row in tested if row["cell"][0] != "gusts"]
    lines.append(_line("all but gusts", without))
    lines.append(f"allowed: {MOST_ALLOWED} of 2000 = {MOST_ALLOWED / 2000:.4f}")
    lines += _by_truck(tested)
    again = [(row["p"], row["again"]) for row in tested if "again" in row]
    if again:
        most = max(abs(p - other) for p, other in again)
        lines.append(f"fitted from the start as well: {len(again)}, p-values differ by {most:.3f} at most")
    return "\n".join(line for line in lines if line)


def _line(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return ""
    p_values = np.array([row["p"] for row in rows])
    hits = int(np.sum(p_values <= LEVEL))
    low, high = limits(hits, len(rows))
    return (
        f"{name:16} n = {len(rows):5d}: fires {hits:4d} = {hits / len(rows):.3f} ({low:.3f} to {high:.3f}), "
        f"at 1 % {np.mean(p_values <= 0.01):.3f}"
    )


def _by_truck(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = []
    for kind, number in sorted({(row["cell"][0], row["cell"][1]) for row in rows}):
        own = [row for row in rows if row["cell"][:2] == [kind, number]]
        fired = [row["first"] for row in own if row["p"] <= LEVEL]
        often = sorted(set(fired), key=lambda key: -fired.count(key))[:4]
        told = ", ".join(f"{key} {fired.count(key)}" for key in often)
        if kind != "gusts" or fired:
            lines.append(f"  {kind} {number}: {len(fired)} of {len(own)}  {told}")
    return lines


def main() -> None:
    """Run the cells that are not yet there, then print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sets", type=int, default=100, help="of each truck")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--hours", type=float, help="after which nothing new is begun")
    parser.add_argument("--kind", choices=list(TRUCKS), action="append", help="all of them unless said")
    parser.add_argument("--kept", type=Path, default=KEPT)
    given = parser.parse_args()
    todo = cells(given.kind or list(TRUCKS), given.sets)
    grow(given.kept, todo, one_cell, jobs=given.jobs, hours=given.hours)
    print(summary(kept_rows(given.kept)))


if __name__ == "__main__":
    main()
