"""The kinds of axle tyres there are; a further kind is one more module and one more line here."""

from __future__ import annotations

from collections.abc import Mapping

from ident.dynamics.tyres.brush import BRUSH
from ident.dynamics.tyres.linear import LINEAR
from ident.dynamics.tyres.magic_formula import MAGIC_FORMULA
from ident.dynamics.tyres.piecewise_linear import PIECEWISE_LINEAR
from ident.dynamics.tyres.tyre import Array, Tyre, evaluate

TYRES: dict[str, Tyre] = {tyre.kind: tyre for tyre in (LINEAR, PIECEWISE_LINEAR, MAGIC_FORMULA, BRUSH)}


def tyre_of(kind: str | Tyre) -> Tyre:
    """Return the tyre of a kind; one that was made from a property file is its own."""
    return kind if isinstance(kind, Tyre) else TYRES[kind]


def by_name(tyre: Tyre) -> str | Tyre:
    """Name of a tyre that its kind alone describes, so that its model is derived once; else the tyre."""
    return tyre.kind if TYRES.get(tyre.kind) == tyre else tyre


def axle_force(
    kind: str, slip_angle: Array, values: Mapping[str, float], vertical_load: float = 0.0
) -> tuple[Array, Array]:
    """Force of an axle and its gradient to the parameters.

    Parameters
    ----------
    kind : name in ``TYRES``
    slip_angle : (n,) [rad]
    values : parameter name -> value, such as {"cornering_stiffness": 3e5}
    vertical_load : of the axle [N]

    Returns
    -------
    force : (n,) [N]
    derivative : (n, k) to the parameters, in the order of ``TYRES[kind].parameters``
    """
    force, _, derivative = evaluate(TYRES[kind], slip_angle, values, vertical_load)
    return force, derivative
