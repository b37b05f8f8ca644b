"""Are the tyres of a truck with a tandem behind found, and by which model?

    python studies/two_track_tandem.py [--trucks 8]

A truck on two tracks with two rear axles 1.35 m apart, written out by hand in plain numbers, drives two
runs for every seed and is measured with white noise. Fitted are the bicycle, the two-track model with one
rear axle and that with a tandem. Told are, for each, mean and spread of the errors of both stiffnesses and
the yaw inertia in standard errors of the fit: about 0 and 1 where the model is right.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "tests" / "helpers")]

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from plane_truck import BODY, INERTIA  # noqa: E402
from two_track_drive import CHASSIS, START, STIFFNESS, driven  # noqa: E402

from ident.dynamics.two_track import FRONT, TANDEM  # noqa: E402
from ident.estimation.two_track_fit import fit_two_track  # noqa: E402
from ident.estimation.tyre_fit import KindFit, fit_tyres  # noqa: E402

Array = NDArray[np.float64]

TRUTH = {**STIFFNESS, "yaw_inertia": INERTIA}
SPACING = {"rear_spacing": 1.35}


def fits(truck: int) -> dict[str, KindFit]:
    """Every model fitted to two runs of a truck."""
    records = [driven(2 * truck + run, run, axles=(1, 2), more=SPACING) for run in (0, 1)]
    bicycle = fit_tyres(records, "linear", BODY, [START], bank=False, misaligned=False)
    tandem = fit_two_track(bicycle, CHASSIS | SPACING, groups=(FRONT, TANDEM))
    return {"bicycle": bicycle, "single rear axle": fit_two_track(bicycle, CHASSIS), "tandem": tandem}


def errors(found: KindFit) -> Array:
    """Estimate less truth of each of ``TRUTH``, in standard errors."""
    spread = np.sqrt(np.diag(found.fit.covariance))
    at = [found.names.index(name) for name in TRUTH]
    wrong = [found.fit.shared[k] - math.log(value) for k, value in zip(at, TRUTH.values(), strict=True)]
    return np.asarray(wrong) / spread[at]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trucks", type=int, default=8)
    told: dict[str, list[Array]] = {}
    for truck in range(parser.parse_args().trucks):
        for name, found in fits(truck).items():
            told.setdefault(name, []).append(errors(found))
    print(f"{'model':18}" + "".join(f"{name:>26}" for name in TRUTH))
    for name, rows in told.items():
        mean, spread = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
        print(f"{name:18}" + "".join(f"{m:+17.2f} ± {s:6.2f}" for m, s in zip(mean, spread, strict=True)))


if __name__ == "__main__":
    main()
