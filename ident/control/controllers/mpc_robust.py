"""Robust LTV-MPC in time: a nominal truck with tightened limits, and the truck held in a tube about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from ident.control.controllers.mpc_controller import Mpc, Settings
from ident.control.controllers.mpc_model import Terminal
from ident.control.controllers.mpc_tubes import Tubes, check_room, usual_bounds
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
    bounds: Mapping[str, float] | None = None,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """Tube LTV-MPC in time.

    bounds : state -> what one period's prediction misses at most, such as ``tube.bounds_of_residuals`` gives
        of an identified model; what it does not name is as usual (``mpc_tubes.USUAL``)
    """
    settings = Settings("time", acceptable=ACCEPTABLE if weights is None else weights)
    make = partial(_tubes, bounds=dict(bounds or {}), period=period)
    return Mpc("mpc_robust", truck, period, settings, tubes=make, keep=keep)


def _tubes(prediction: Prediction, terminal: Terminal, *, bounds: dict[str, float], period: float) -> Tubes:
    tubes = Tubes(prediction, terminal, usual_bounds(prediction, period) | bounds)
    room = prediction.truck.highest_angle / abs(prediction.mean_ratio * prediction.truck.steering.gain)
    check_room(tubes, prediction, room, CHECKED_AT)
    return tubes
