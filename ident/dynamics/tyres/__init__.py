"""Axle tyres: the lateral force of a whole axle against its slip angle, one module a kind."""

from ident.dynamics.tyres.kinds import TYRES, axle_force, by_name, tyre_of
from ident.dynamics.tyres.tyre import Stiffness, Tyre, evaluate, stiffness

__all__ = ["TYRES", "Stiffness", "Tyre", "axle_force", "by_name", "evaluate", "stiffness", "tyre_of"]
