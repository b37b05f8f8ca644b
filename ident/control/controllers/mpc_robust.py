"""Robust LTV-MPC in time: a nominal truck with tightened limits, and the truck held in a tube about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from ident.control.controllers.mpc_controller import Mpc, Settings
from ident.control.controllers.mpc_model import Terminal
from ident.control.controllers.mpc_tubes import Tubes, check_room, corrected_bounds, usual_bounds
from ident.control.controllers.weights import ACCEPTABLE
from ident.control.prediction import Prediction
from ident.control.qp import QuadraticProgram
from ident.control.truck import Truck

CHECKED_AT = 22.0  # [m/s] speed for which a tube without room is refused


def mpc_robust(
    truck: Truck,
    period: float,
    weights: Mapping[str, float] | None = None,
    *,
    noise: Mapping[str, float] | None = None,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """Tube LTV-MPC in time.

    noise : signal of a log -> size of its residual by the identified model, from which the set is made
        (``mpc_tubes.corrected_bounds``); where None it is one of usual size (``mpc_tubes.USUAL``)
    """
    settings = Settings("time", acceptable=ACCEPTABLE if weights is None else weights)
    make = partial(_tubes, noise=None if noise is None else dict(noise), period=period)
    return Mpc("mpc_robust", truck, period, settings, tubes=make, keep=keep)


def _tubes(
    prediction: Prediction, terminal: Terminal, *, noise: dict[str, float] | None, period: float
) -> Tubes:
    usual = usual_bounds(prediction, period)
    bounds = (lambda _: usual) if noise is None else corrected_bounds(prediction, period, noise)
    tubes = Tubes(prediction, terminal, bounds)
    room = prediction.truck.highest_angle / abs(prediction.mean_ratio * prediction.truck.steering.gain)
    check_room(tubes, prediction, room, CHECKED_AT)
    return tubes
