"""LTV-MPC in time: on the truck's own model, and on the kinematic one made from the same truck."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from ident.control.controllers.mpc_controller import Mpc, Settings
from ident.control.controllers.weights import ACCEPTABLE, weights_of
from ident.control.prediction import KINEMATIC
from ident.control.qp import QuadraticProgram
from ident.control.truck import Truck

LASTING = 3.0  # [s] in which a drift is believed that the kinematic model cannot tell from slip
KINEMATIC_EFFECTS = ("steering_offset",)  # those that a model without tyres has too


def mpc_time(
    truck: Truck,
    period: float,
    weights: Mapping[str, float] | None = None,
    *,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """LTV-MPC in time on the model of the truck."""
    settings = Settings("time", acceptable=ACCEPTABLE if weights is None else weights)
    return Mpc("mpc_time", truck, period, settings, keep=keep)


def mpc_time_kinematic(
    truck: Truck,
    period: float,
    weights: Mapping[str, float] | None = None,
    *,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """LTV-MPC in time that takes the truck to be kinematic: no tyre slips.

    What such a model sees of slip in a manoeuvre looks like a drift; only one that lasts is taken for one.
    """
    effects = {name: truck.effects[name] for name in KINEMATIC_EFFECTS if name in truck.effects}
    believed = replace(truck, model=KINEMATIC, effects=effects)
    acceptable = weights_of("mpc_time_kinematic") if weights is None else weights
    settings = Settings("time", slowness=LASTING, acceptable=acceptable)
    return Mpc("mpc_time_kinematic", believed, period, settings, keep=keep)
