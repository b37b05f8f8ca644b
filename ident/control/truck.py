"""A truck as a set of numbers: once as the controller believes it to be, once as the simulation has it.

The two are always separate objects. A controller is made from a ``Truck`` and sees measurements only; the
simulation is made from another one, which no controller is ever given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SteeringActuator:
    """K exp(-L s) / ((T1 s + 1)(T2 s + 1)) from the request to the angle (2.25), then the ratio map.

    gain : K [-]; dead_time : L [s]; time_constant_1, time_constant_2 : T1 >= T2 > 0 [s]
    ratio : (k, 2) angle of the steering wheel, rising, and of the road wheels [rad]; the identity where the
        request is one of the road wheels
    rate_limit : of the angle before the ratio map [rad/s]; None where there is none
    play : width of the play in the column, between actuator and measured angle [rad]
    dead_zone : largest request that is not answered, and that is missing from every larger one [rad]
    """

    gain: float
    dead_time: float
    time_constant_1: float
    time_constant_2: float
    ratio: Array
    rate_limit: float | None = None
    play: float = 0.0
    dead_zone: float = 0.0


@dataclass(frozen=True)
class Drive:
    """Longitudinal: the acceleration follows its request by a first-order lag after a dead time.

    lag : [s]; dead_time : [s]; lowest, highest : of the acceleration [m/s²]
    """

    lag: float = 0.3
    dead_time: float = 0.1
    lowest: float = -3.0
    highest: float = 1.0


@dataclass(frozen=True)
class Truck:
    """Everything that a controller is designed with, or that a simulation runs with.

    model : kinematic, or the kind of the bicycle's tyres (a name in ``dynamics.tyres.TYRES``)
    parameters : those of the bicycle without those of its effects: mass [kg], yaw_inertia [kg m²],
        cg_to_front_axle, cg_to_rear_axle [m], front.<tyre parameter>, rear.<tyre parameter>
    effects : effect of ``dynamics.effects`` by its name (such as tyre_relaxation) -> its parameters; what
        belongs to the actuator (rate limit, column play, dead zone) stands in ``steering`` instead
    highest_angle : of the road wheels [rad]
    """

    model: str
    parameters: Mapping[str, float]
    steering: SteeringActuator
    drive: Drive = field(default_factory=Drive)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    highest_angle: float = 0.6

    @property
    def wheelbase(self) -> float:
        """L = l_f + l_r [m]."""
        return self.parameters["cg_to_front_axle"] + self.parameters["cg_to_rear_axle"]
