"""Axle forces from the motion alone, with the slip angles at which they act.

    F_yf = (I_z ṙ + l_r m a_y)/(L cos δ)          α_f = δ - atan((v_y + l_f r)/v_x)
    F_yr = (l_f m a_y - I_z ṙ)/L                  α_r = -atan((v_y - l_r r)/v_x)

with a_y, v_y of the centre of gravity (see ``smooth_motion`` for the bandwidth). No tyre model is needed, so
the points show what the tyres did; forces are those of the whole axle. Their scale is that of the mass: a
mass 3 % too large gives forces 3 % too large. A bank of the road shows in both forces, an offset of the
steering in the slip angle of the front axle only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.estimation.smooth_motion import SmoothMotion, rear_force, smooth_motion, usual_inertia
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ForcePoints:
    """Forces and slip angles of both axles, one row an instant, all windows one after another.

    run : (n,) index of the run; times : (n,) since the start of the run [s]
    front_slip_angle, rear_slip_angle : (n,) [rad]; front_force, rear_force : (n,) [N]
    lateral_acceleration : (n,) of the CG [m/s²]; yaw_acceleration : (n,) [rad/s²]
    cosine : (n,) of the road-wheel angle
    valid : (n,) where all of it comes from samples nearby
    slip_sources : where the lateral velocity comes from
    """

    run: NDArray[np.intp]
    times: Array
    front_slip_angle: Array
    rear_slip_angle: Array
    front_force: Array
    rear_force: Array
    lateral_acceleration: Array
    yaw_acceleration: Array
    cosine: Array
    valid: Mask
    slip_sources: tuple[str, ...]

    def slip_angle(self, axle: str) -> Array:
        """Slip angle of the "front" or the "rear" axle [rad]."""
        return self.front_slip_angle if axle == "front" else self.rear_slip_angle

    def force(self, axle: str) -> Array:
        """Force of the "front" or the "rear" axle [N]."""
        return self.front_force if axle == "front" else self.rear_force


def invert_forces(
    records: Sequence[MotionRecord],
    body: Body,
    *,
    yaw_inertia: float | None = None,
    bias: Mapping[str, float] | None = None,
) -> ForcePoints:
    """Forces and slip angles of both axles.

    Parameters
    ----------
    yaw_inertia : [kg m²]; None: as stated for the body, else m l_f l_r
    bias : signal -> what is subtracted from it; "steering_offset" -> what is added to the road-wheel angle
    """
    motions = smooth_motion(records, body, bias)
    return points_of(motions, body, usual_inertia(body) if yaw_inertia is None else yaw_inertia)


def points_of(motions: Sequence[SmoothMotion], body: Body, yaw_inertia: float) -> ForcePoints:
    """Forces and slip angles from motion that is smoothed already."""
    rows = np.concatenate(
        [np.zeros((8, 0)), *(_rows(motion, body, yaw_inertia) for motion in motions)], axis=1
    )
    valid = np.concatenate([np.zeros(0, dtype=np.bool_), *(motion.valid for motion in motions)])
    run = np.concatenate([np.zeros(0), *(np.full(motion.times.size, motion.run) for motion in motions)])
    return ForcePoints(
        run=run.astype(np.intp),
        times=rows[0],
        front_slip_angle=rows[1],
        rear_slip_angle=rows[2],
        front_force=rows[3],
        rear_force=rows[4],
        lateral_acceleration=rows[5],
        yaw_acceleration=rows[6],
        cosine=rows[7],
        valid=valid & np.isfinite(rows).all(axis=0),
        slip_sources=tuple(dict.fromkeys(m.slip_source for m in motions if m.slip_source)),
    )


def _rows(motion: SmoothMotion, body: Body, yaw_inertia: float) -> Array:
    """Rows (8, m): the columns of ``ForcePoints`` from ``times`` to ``cosine``."""
    angle, speed = motion.road_wheel_angle, motion.speed
    front_arm, rear_arm = body.cg_to_front_axle, body.cg_to_rear_axle
    front_slip = angle - np.arctan2(motion.lateral_velocity + front_arm * motion.yaw_rate, speed)
    rear_slip = -np.arctan2(motion.lateral_velocity - rear_arm * motion.yaw_rate, speed)
    moment = yaw_inertia * motion.yaw_acceleration + rear_arm * body.mass * motion.lateral_acceleration
    cosine = np.cos(angle)
    front = moment / (body.wheelbase * cosine)
    return np.stack(
        [
            motion.times,
            front_slip,
            rear_slip,
            front,
            rear_force(motion, body, yaw_inertia),
            motion.lateral_acceleration,
            motion.yaw_acceleration,
            cosine,
        ]
    )
