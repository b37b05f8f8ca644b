"""Spatial-error LTV-MPC: the model over arc length, without and with a limit of the steering rate.

    dx/ds = ẋ/ṡ,  dt/ds = 1/ṡ

The path is known exactly at every step ahead, whatever the speed, and the time of arrival is a state that
steering and acceleration are balanced against. A limit ρ of the steering's rate becomes one for each step of
the way,

    |Δu_k| <= ρ Δs/ṡ_k,

with ṡ_k of the last plan: the slower the truck, the more it may steer in a metre.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ident.control.controllers.mpc_controller import Mpc, Settings
from ident.control.controllers.weights import ACCEPTABLE, weights_of
from ident.control.prediction import Prediction
from ident.control.qp import QuadraticProgram
from ident.control.truck import Truck

COMFORTABLE_RATE = 0.2  # [rad/s] of the road wheels, where the truck has no limit of its own


def mpc_spatial(
    truck: Truck,
    period: float,
    weights: Mapping[str, float] | None = None,
    *,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """Spatial-error LTV-MPC without a limit of the steering's rate."""
    settings = Settings("space", acceptable=ACCEPTABLE if weights is None else weights)
    return Mpc("mpc_spatial", truck, period, settings, keep=keep)


def mpc_spatial_rate(
    truck: Truck,
    period: float,
    weights: Mapping[str, float] | None = None,
    *,
    steering_rate: float | None = None,
    keep: Callable[[QuadraticProgram], None] | None = None,
) -> Mpc:
    """Spatial-error LTV-MPC that keeps a limit of the steering's rate.

    steering_rate : of the road wheels [rad/s]; where None, the truck's own, else ``COMFORTABLE_RATE``
    """
    rate = own_rate(truck) if steering_rate is None else steering_rate
    acceptable = weights_of("mpc_spatial_rate") if weights is None else weights
    settings = Settings("space", steering_rate=rate, acceptable=acceptable)
    return Mpc("mpc_spatial_rate", truck, period, settings, keep=keep)


def own_rate(truck: Truck) -> float:
    """Limit of the steering's rate as one of the road wheels [rad/s]."""
    limit = truck.steering.rate_limit
    if limit is None:
        return COMFORTABLE_RATE
    return abs(Prediction(truck, "time").mean_ratio) * limit
