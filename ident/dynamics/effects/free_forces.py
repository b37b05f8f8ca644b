"""Axle forces that no tyre model makes: states of their own, driven by noise.

    F' = G,      G' = w

for the force F of each axle, with white noise w: a force whose rate of change wanders. With these in the
place of the forces of the tyres the bicycle is mass, yaw inertia and geometry only, and its forces are what
the measured motion says (see ``estimation.force_observer``). The noise is no part of the equations; it is
the observer's.
"""

from __future__ import annotations

import sympy

from ident.dynamics.effects.effect import Change, Effect
from ident.glossary import AXLES

FORCES = tuple(f"{axle}_free_force" for axle in AXLES)
RATES = tuple(f"{axle}_free_force_rate" for axle in AXLES)


def _replaced(state: str) -> Change:
    return lambda _, known: known[state]


FREE_FORCES = Effect(
    "free_forces",
    "T",
    (),
    {f"{axle}_tyre_force": _replaced(state) for axle, state in zip(AXLES, FORCES, strict=True)},
    states={
        FORCES[0]: lambda known: known[RATES[0]],
        FORCES[1]: lambda known: known[RATES[1]],
        RATES[0]: lambda _: sympy.Integer(0),
        RATES[1]: lambda _: sympy.Integer(0),
    },
    meaning="The forces of the axles are states that no tyre model ties to a slip angle.",
)
