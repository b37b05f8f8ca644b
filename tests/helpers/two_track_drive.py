"""A vehicle with two tracks, written out by hand, driven and measured with white noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from plane_truck import BODY, INERTIA, NOISE, STEP, inputs, linear
from two_track_written_out import accelerations

from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]

CHASSIS = {
    "cg_height": 1.5,
    "front_roll_share": 0.7,
    "ackermann_share": 0.8,
    "load_sensitivity": 0.35,
    "front_track": 1.9,
    "rear_track": 1.9,
}
STIFFNESS = {"front.cornering_stiffness": 3.3e5, "rear.cornering_stiffness": 4.0e5}
START = STIFFNESS | {"yaw_inertia": INERTIA, "steering_offset": 0.0}
TRUTH = CHASSIS | {
    "mass": BODY.mass,
    "yaw_inertia": INERTIA,
    "cg_to_front_axle": BODY.cg_to_front_axle,
    "cg_to_rear_axle": BODY.cg_to_rear_axle,
}
CURVES = {axle: linear(STIFFNESS[f"{axle}.cornering_stiffness"]) for axle in ("front", "rear")}


def driven(
    seed: int,
    run: int,
    *,
    seconds: float = 20.0,
    axles: tuple[int, int] = (1, 1),
    more: Mapping[str, float] | None = None,
) -> MotionRecord:
    """Sensors at the CG, their noise white; two Heun steps a sample, which is exact to a hundredth of it.

    axles : how many in front and behind; more : parameters beside those of ``TRUTH``, such as rear_spacing
    """
    truth = TRUTH | dict(more or {})
    angle, speed = inputs(seconds, most=0.075, seed=seed)
    angle[:100] *= np.linspace(0, 1, 100)
    state, rows = np.zeros(2), []

    def rates(at: Array, k: float) -> Array:
        delta, along = (np.interp(k, np.arange(angle.size), each) for each in (angle, speed))
        felt, turning = accelerations(at.tolist(), float(delta), float(along), truth, CURVES, axles)
        return np.array([felt - along * at[1], turning, felt])

    for k in range(angle.size):
        rows.append([*state, rates(state, k)[2]])
        for half in (0.0, 0.5):
            first = rates(state, k + half)[:2]
            ahead = state + STEP / 2 * first
            state = state + STEP / 4 * (first + rates(ahead, k + half + 0.5)[:2])
    times = STEP * np.arange(angle.size)
    random = np.random.default_rng(seed)
    read = dict(zip(("lateral_velocity", "yaw_rate", "lateral_acceleration"), np.array(rows).T, strict=True))
    measured = {n: Samples(times, v + NOISE[n] * random.standard_normal(v.size)) for n, v in read.items()}
    return MotionRecord(run, times, angle, speed, measured)
