"""The catalogue: every effect that the base model may lack, whether it is built yet or not.

To add an effect: its row here, and its own file in ``ident.dynamics.effects``.
"""

from __future__ import annotations

from ident.dynamics.effects.catalogue.entry import BuiltIn, Entry, Usual
from ident.dynamics.effects.catalogue.longitudinal import LONGITUDINAL
from ident.dynamics.effects.catalogue.sensors import SENSORS
from ident.dynamics.effects.catalogue.steering import STEERING
from ident.dynamics.effects.catalogue.vehicle import VEHICLE

__all__ = ["CATALOGUE", "BuiltIn", "Entry", "Usual", "not_built"]

CATALOGUE: dict[str, Entry] = {entry.name: entry for entry in (*STEERING, *VEHICLE, *SENSORS, *LONGITUDINAL)}


def not_built() -> list[Entry]:
    """Effects that no part of the loop can tell yet: their absence is never to be read as adequate."""
    return [entry for entry in CATALOGUE.values() if not entry.built]
