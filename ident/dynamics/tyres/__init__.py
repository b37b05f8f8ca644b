"""Axle tyres: the lateral force of a whole axle against its slip angle, one module a kind."""

from ident.dynamics.tyres.kinds import TYRES, axle_force, tyre_of
from ident.dynamics.tyres.tyre import Tyre, evaluate

__all__ = ["TYRES", "Tyre", "axle_force", "evaluate", "tyre_of"]
