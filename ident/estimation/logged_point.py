"""Which point of the vehicle a logged lateral velocity, or a logged position, belongs to.

The rear axle moves sideways only by the slip of its tyres, v_y,R = -v F_yr/C_r, and any other point at x
ahead of it by x r more. With linear tyres and F_yr = (l_f m a_y - I_z ṙ)/L,

    v_y,P = x r - b v² r + c v ṙ + d v + e,

where x, b, c are unknown, d is a turned sensor and e its bias. What is late by τ adds v r τ to the velocity
of the position across the heading; then that is a column as well. r, v r and v² r differ where v does.
Taken where the lateral acceleration v r is below ``LINEAR``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.estimation.handling import estimate, unknown
from ident.estimation.sandwich import coefficient
from ident.estimation.smooth_motion import SmoothMotion, smooth_motion
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord
from ident.results import Estimate

Array = NDArray[np.float64]

LINEAR = 2.0  # [m/s²]
FEWEST = 200  # grid points
FEWEST_BLOCKS = 12
BLOCK = 2.5  # [s]
LEAST_YAW_RATE = 0.03  # [rad/s] standard deviation

VELOCITY = ("yaw_rate", "heading", "lateral_velocity", "lateral_acceleration")
POSITION = ("yaw_rate", "heading", "position_x", "position_y")


def point_of_lateral_velocity(records: Sequence[MotionRecord], body: Body) -> Estimate:
    """How far the point of the lateral velocity is ahead of the rear axle [m]."""
    return _point(_motion(records, VELOCITY, "lateral_velocity", body), may_be_late=False)


def point_of_position(records: Sequence[MotionRecord], body: Body) -> Estimate:
    """How far the point of the position is ahead of the rear axle [m]."""
    return _point(_motion(records, POSITION, "position_x", body), may_be_late=True)


def _motion(
    records: Sequence[MotionRecord], names: Sequence[str], needed: str, body: Body
) -> list[SmoothMotion]:
    """Smoothed motion of the logged point, as if it were the centre of gravity."""
    kept = [
        replace(record, measured={n: s for n, s in record.measured.items() if n in names}, reference_x=0.0)
        for record in records
        if needed in record.measured
    ]
    return smooth_motion(kept, body)


def _point(motions: Sequence[SmoothMotion], *, may_be_late: bool) -> Estimate:
    parts, values, blocks, count = [], [], [], 0
    for motion in motions:
        use = motion.valid & np.isfinite(motion.lateral_velocity)
        use &= np.abs(motion.speed * motion.yaw_rate) <= LINEAR
        parts.append(_columns(motion, may_be_late=may_be_late)[use])
        values.append(motion.lateral_velocity[use])
        number = ((motion.times - motion.times[0]) // BLOCK).astype(np.intp)
        blocks.append(number[use] + count)
        count += int(number[-1]) + 1
    rows = sum(part.shape[0] for part in parts)
    if rows < FEWEST or np.unique(np.concatenate(blocks)).size < FEWEST_BLOCKS:
        return unknown("m", f"{rows} instants below {LINEAR:g} m/s², need {FEWEST} in {FEWEST_BLOCKS} blocks")
    columns = np.concatenate(parts)
    turning = float(np.std(columns[:, 0]))
    if turning < LEAST_YAW_RATE:
        return unknown("m", f"the yaw rate varies by {turning:.3f} rad/s, need {LEAST_YAW_RATE:g} rad/s")
    value, influence, freedom = coefficient(np.concatenate(values), columns, np.concatenate(blocks), 0)
    return estimate(value, float(np.linalg.norm(influence)), "m", freedom)


def _columns(motion: SmoothMotion, *, may_be_late: bool) -> Array:
    """(m, c) of one window."""
    v, r = motion.speed, motion.yaw_rate
    columns = [r, v**2 * r, v * motion.yaw_acceleration, v, np.ones(v.size)]
    return np.column_stack([*columns, v * r] if may_be_late else columns)
