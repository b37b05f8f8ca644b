"""The controllers, one module each; a further one is one more module and one more line here."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Protocol

from ident.control.controllers.controller import Controller
from ident.control.truck import Truck
from ident.results.validate import ControllerName


class Factory(Protocol):
    """Makes a controller from a truck as it is believed to be."""

    def __call__(self, truck: Truck, period: float, weights: Mapping[str, float] | None = None) -> Controller:
        """Return one for a period [s]; ``weights`` are those of ``weights`` where None."""


def _lazy(module: str, name: str) -> Factory:
    """A factory that loads its module when it is first used."""

    def make(truck: Truck, period: float, weights: Mapping[str, float] | None = None) -> Controller:
        found: Factory = getattr(import_module(f"{__name__}.{module}"), name)
        return found(truck, period, weights)

    return make


CONTROLLERS: dict[ControllerName, Factory] = {
    "pid": _lazy("pid", "PID"),
    "pure_pursuit": _lazy("pure_pursuit", "PurePursuit"),
    "stanley": _lazy("stanley", "Stanley"),
    "lqr": _lazy("lqr", "LQR"),
    "mpc_time_kinematic": _lazy("mpc_time", "mpc_time_kinematic"),
    "mpc_time": _lazy("mpc_time", "mpc_time"),
    "mpc_spatial": _lazy("mpc_spatial", "mpc_spatial"),
    "mpc_spatial_rate": _lazy("mpc_spatial", "mpc_spatial_rate"),
    "mpc_robust": _lazy("mpc_robust", "mpc_robust"),
}
