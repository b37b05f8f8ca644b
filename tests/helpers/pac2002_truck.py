"""A truck on PAC2002 tyres that shares nothing with the models under test: published formulas alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pac2002_published import published
from plane_truck import BODY, NOISE, Force, PlaneTruck, inputs
from tyre_files import ALIGNING, DIMENSION, LATERAL, LONGITUDINAL, SCALING, VERTICAL

from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]

OF_FILE = VERTICAL | DIMENSION | SCALING | LONGITUDINAL | LATERAL | ALIGNING
PULLING = "PEY3 PHY1 PHY2 PVY1 PVY2 RBY3 RHX1 RVY1 RVY2 QBZ4 QDZ3 QDZ6 QDZ7 QEZ4 QHZ1 QHZ2 SSZ1"
PRESSURE = (850000.0 * SCALING["LIP"] - 800000.0) / 800000.0
TRUE = {"front.LKY": 0.95, "front.LMUY": 0.8, "rear.LKY": 1.2, "rear.LMUY": 1.0}
LOAD = {"front": BODY.load("front"), "rear": BODY.load("rear")}


def tyre_of(factors: Mapping[str, float], *, symmetric: bool = True) -> dict[str, float]:
    """Coefficients of the file in ``tyre_files`` with other factors; a symmetric tyre pulls nowhere."""
    zero = dict.fromkeys(PULLING.split(), 0.0) if symmetric else {}
    return OF_FILE | {"PRESSURE": PRESSURE} | zero | dict(factors)


def axle_force(axle: str, factors: Mapping[str, float], *, number: int = 2, symmetric: bool = True) -> Force:
    """Force of an axle at its load at rest: half of its tyres mirrored, the slip angle of the other sign."""
    tyre, load = tyre_of(factors, symmetric=symmetric), LOAD[axle] / number

    def force(slip: float) -> float:
        own, mirrored = (published(tyre, load, side * float(slip)).fy0 for side in (-1.0, 1.0))
        return number / 2 * (own - mirrored)

    return force


def truck(true: Mapping[str, float] = TRUE, *, number: int = 2, symmetric: bool = True) -> PlaneTruck:
    """Both axles of one file with factors of their own, ``number`` tyres behind."""
    forces = {
        axle: axle_force(
            axle,
            {name.partition(".")[2]: value for name, value in true.items() if name.startswith(axle)},
            number=tyres,
            symmetric=symmetric,
        )
        for axle, tyres in (("front", 2), ("rear", number))
    }
    return PlaneTruck(**forces)


def runs(most: float, seconds: float = 16.0, **of_truck: object) -> list[MotionRecord]:
    """Two runs without noise, the road wheels turned up to about ``most`` [rad]."""
    one = truck(**of_truck)  # type: ignore[arg-type]
    return [one.drive(*inputs(seconds, seed=run, most=most), run=run) for run in range(2)]


def measured(records: list[MotionRecord], seed: int) -> list[MotionRecord]:
    """The same runs with white noise on every sensor."""
    random = np.random.default_rng([seed, 5])
    return [
        replace(
            record,
            measured={
                name: Samples(one.times, one.values + NOISE[name] * random.standard_normal(one.times.size))
                for name, one in record.measured.items()
            },
        )
        for record in records
    ]
