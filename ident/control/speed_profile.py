"""How fast a path is to be driven, and when the truck is to be where.

    v² <= v_set²,      v² |k| <= a_y,      -a_brake <= d(v²)/ds / 2 <= a_drive

The fastest profile within these limits is that of a forward and a backward pass. Where the limits of the
acceleration are constant, the forward pass over q = v² is a running minimum,

    q_i = min over j <= i of (limit_j + 2 a_drive (s_i - s_j)),

and the backward pass its mirror image. Between the points of the grid q is a line, that is the acceleration
is held, so the stipulated time follows exactly: dt = 2 ds/(v_i + v_(i+1)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.errors import BadRecipe

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpeedLimits:
    """What a speed profile keeps to.

    set_speed : [m/s]
    lateral_acceleration : [m/s²]; acceleration, deceleration : along the path, both positive [m/s²]
    """

    set_speed: float
    lateral_acceleration: float = 2.0
    acceleration: float = 0.5
    deceleration: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise BadRecipe(f"{name} of a speed profile is {value:g}: need a positive number")


@dataclass(frozen=True)
class SpeedProfile:
    """speed : (n,) [m/s]; acceleration : (n,) [m/s²], until the next point; time : (n,) from zero [s]."""

    speed: Array
    acceleration: Array
    time: Array


def speed_profile(arc_length: Array, curvature: Array, limits: SpeedLimits) -> SpeedProfile:
    """The fastest speeds within the limits; both ends are driven as fast as they allow.

    Parameters
    ----------
    arc_length : (n,) strictly rising [m]
    curvature : (n,) [1/m]
    """
    with np.errstate(divide="ignore"):
        squared = np.minimum(limits.set_speed**2, limits.lateral_acceleration / np.abs(curvature))
    squared = _slowed(squared, arc_length, limits.acceleration)
    squared = _slowed(squared[::-1], -arc_length[::-1], limits.deceleration)[::-1]
    return _timed(arc_length, np.sqrt(squared))


def given_profile(arc_length: Array, speed: Array) -> SpeedProfile:
    """Acceleration and time of speeds that are given.

    arc_length : (n,) strictly rising [m]; speed : (n,) positive [m/s]
    """
    return _timed(arc_length, speed)


def _slowed(squared: Array, arc_length: Array, acceleration: float) -> Array:
    """Largest q below ``squared`` that nowhere rises faster than 2 a."""
    rise = 2.0 * acceleration * arc_length
    return np.asarray(np.minimum.accumulate(squared - rise) + rise)


def _timed(arc_length: Array, speed: Array) -> SpeedProfile:
    steps = np.diff(arc_length)
    acceleration = np.diff(speed**2) / (2.0 * steps)
    time = np.concatenate([[0.0], np.cumsum(2.0 * steps / (speed[1:] + speed[:-1]))])
    return SpeedProfile(speed, np.append(acceleration, acceleration[-1]), time)
