"""Longitudinal control of the controllers that steer only: to be where the reference is, when it is there.

    a = a_ref(s) + (v_ref(s) - v)/τ + d/τ_t² - a_d,      d = v_ref lateness

A proportional part on speed, and in the place of its integral the distance d by which the truck is behind:
the integral of the speed error along the reference, so that the truck arrives at the stipulated time. A
constant disturbance a_d of the drive is what the estimator found. The distance is limited to what
``LARGEST_SHARE`` of the drive's authority answers, so that nothing winds up while the drive is at its limit.
"""

from __future__ import annotations

from ident.control.truck import Drive

SPEED_TIME = 1.0  # [s] τ, well above lag and dead time of the drive
DISTANCE_TIME = 2.5  # [s] τ_t; with τ a damping ratio of 1.25
LARGEST_SHARE = 0.5


def acceleration_for(
    drive: Drive, reference: tuple[float, float], speed: float, lateness: float, disturbance: float
) -> float:
    """Acceleration request [m/s²], not limited yet.

    Parameters
    ----------
    reference : speed [m/s] and acceleration [m/s²] at the place of the truck
    speed : of the truck [m/s]
    lateness : time since the start less the stipulated one [s]
    disturbance : of the drive, as estimated [m/s²]
    """
    wanted, feed_forward = reference
    lowest, highest = LARGEST_SHARE * drive.lowest, LARGEST_SHARE * drive.highest
    catching_up = min(max(wanted * lateness / DISTANCE_TIME**2, lowest), highest)
    return feed_forward + (wanted - speed) / SPEED_TIME + catching_up - disturbance
