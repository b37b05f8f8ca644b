"""Do the intervals of the scaling factors of PAC2002 tyres hold?

    python studies/pac2002_coverage.py [--seeds 500]

For every seed a truck on PAC2002 tyres, by the published formulas in plain numbers, whose factors are drawn
at random (LKY 0.8 to 1.25 and LMUY 0.7 to 1.2 of the file's, the rest as in the file) drives two runs up to
another steering angle, is measured with noise, and is fitted as ``ident tyres`` does. Told are, for every
factor: how often it was free, how often the 95 % interval held the truth where it was, and mean and spread of
the errors in standard errors. A factor that is held at the file's value though the truth has another (LMUY in
gentle driving) is what the intervals of the others do not know of; such sets are told apart.

Every finished seed is kept in studies/results/, so a study that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "tests" / "helpers")]

import numpy as np  # noqa: E402
from pac2002_truck import measured, runs  # noqa: E402
from plane_truck import BODY, INERTIA  # noqa: E402
from tyre_files import SCALING, tyre_text  # noqa: E402

from ident.dynamics.tyres import Tyre  # noqa: E402
from ident.dynamics.tyres.pac2002_axle import pac2002_axle  # noqa: E402
from ident.dynamics.tyres.pac2002_coefficients import pac2002_from_file  # noqa: E402
from ident.dynamics.tyres.property_file import parse_property_file  # noqa: E402
from ident.estimation.tyre_estimates import tyre_fit, uncertainty  # noqa: E402
from ident.estimation.tyre_scaling import ORDER, fit_scaling  # noqa: E402

KEPT = HERE / "results" / "pac2002_coverage.jsonl"
AXLES = ("front", "rear")
OWN = {f"{axle}.{name}": SCALING[name] for axle in AXLES for name in ("LKY", *ORDER)}
SECONDS = 12.0


@cache
def tyre() -> Tyre:
    """Tyre of the file, as the truth has it."""
    text = tyre_text(model={"TYRESIDE": "SYMMETRIC"})
    return pac2002_axle(pac2002_from_file(parse_property_file(text.encode(), "truck.tir")))


def studied(seed: int) -> dict[str, Any]:
    """One truck, driven, measured and fitted."""
    random = np.random.default_rng([seed, 21])
    ranges = {"LKY": (0.8, 1.25), "LMUY": (0.7, 1.2)}
    drawn = {
        f"{axle}.{n}": OWN[f"{axle}.{n}"] * random.uniform(*ends)
        for axle in AXLES
        for n, ends in ranges.items()
    }
    most = float(random.uniform(0.05, 0.16))
    records = measured(runs(most, SECONDS, true=drawn), seed)
    found = fit_scaling(records, dict.fromkeys(AXLES, tyre()), OWN, BODY, bank=False)
    told = tyre_fit(found, uncertainty(found), 0.0)
    estimates = {f"{axle}.{name}": getattr(told, axle)[name] for axle in AXLES for name in ("LKY", *ORDER)}
    true = OWN | drawn | {"yaw_inertia": INERTIA}
    rows = {
        name: {"true": true[name], "value": one.value, "std": one.std, "low": one.low, "high": one.high}
        for name, one in (estimates | {"yaw_inertia": told.yaw_inertia}).items()
    }
    return {"seed": seed, "most": most, "wrongly_held": _wrongly_held(rows), "estimates": rows}


def _wrongly_held(rows: Mapping[str, Mapping[str, Any]]) -> bool:
    return any(row["std"] is None and abs(row["value"] / row["true"] - 1) > 1e-9 for row in rows.values())


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Coverage, mean and spread of the errors, with all held factors true and with one that is not."""
    lines = []
    for held in (False, True):
        own = [row["estimates"] for row in rows if row["wrongly_held"] is held]
        lines.append(
            f"{'a' if held else 'no'} factor held at a value that is not the truth's: n = {len(own)}"
        )
        lines.append(f"{'':16}{'free':>6}{'95 % cover':>12}{'mean z':>9}{'spread z':>10}")
        lines += [_line(own, name) for name in own[0]] if len(own) > 1 else []
    return "\n".join(lines)


def _line(rows: Sequence[Mapping[str, Mapping[str, Any]]], name: str) -> str:
    own = [row[name] for row in rows if row[name]["low"] is not None]
    text = f"{name:16}{len(own) / len(rows):>6.2f}"
    if len(own) < 2:
        return text
    inside = np.mean([one["low"] <= one["true"] <= one["high"] for one in own])
    z = np.array([(one["value"] - one["true"]) / one["std"] for one in own])
    return text + f"{inside:>12.3f}{z.mean():>9.2f}{z.std(ddof=1):>10.2f}"


def main() -> None:
    """Go on with the study and print what is there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=500)
    wanted = range(parser.parse_args().seeds)
    lines = KEPT.read_text(encoding="utf-8").splitlines() if KEPT.is_file() else []
    rows = {row["seed"]: row for row in map(json.loads, lines)}
    KEPT.parent.mkdir(exist_ok=True)
    with KEPT.open("a", encoding="utf-8") as kept:
        for seed in wanted:
            if seed not in rows:
                rows[seed] = studied(seed)
                kept.write(json.dumps(rows[seed]) + "\n")
                kept.flush()
    print(table([rows[seed] for seed in wanted]))


if __name__ == "__main__":
    main()
