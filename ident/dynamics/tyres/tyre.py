"""What every kind of tyre is: parameters, and the force of an axle as one expression.

Sign: that of the source, a positive slip angle gives a positive force (opposite to ISO 8855 and to ``.tir``
files, whose slip angle has the other sign). Forces are those of the whole axle: where the source writes 2 F
for the two tyres of an axle, the factor 2 is inside the parameters of the axle (stiffness, peak force).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.printing import ArrayPrinter
from ident.dynamics.symbols import symbol

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tyre:
    """One kind of axle tyre.

    parameters : in the order of every vector of them
    lateral_force : (slip_angle [rad], vertical_load [N] of the axle, **parameters) -> force of the axle [N];
        kinds whose parameters are those of one load do not use the load
    by_load : whether the force depends on the load
    """

    kind: str
    parameters: tuple[Parameter, ...]
    lateral_force: Callable[..., Expr]
    by_load: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    def force_at(self, axle: str, slip_angle: Expr, vertical_load: Expr) -> Expr:
        """Force of the axle "front" or "rear", with parameters named such as "front.cornering_stiffness"."""
        own = {name: symbol(f"{axle}.{name}") for name in self.names}
        return self.lateral_force(slip_angle, vertical_load, **own)


@dataclass(frozen=True)
class Stiffness:
    """Cornering stiffness of an axle, the slope of its force at zero slip, and how it moves.

    value : [N/rad]; by_parameter : (k,) derivatives, in the order of ``Tyre.parameters``
    by_load : derivative to the load of the axle [1/rad]
    """

    value: float
    by_parameter: Array
    by_load: float


@cache
def _evaluated(tyre: Tyre) -> Callable[..., list[Array]]:
    """Force, its slope to the slip angle and its derivatives to the parameters, as NumPy function."""
    slip, load = symbol("slip_angle"), symbol("vertical_load")
    own = [symbol(name) for name in tyre.names]
    force = tyre.lateral_force(slip, load, **dict(zip(tyre.names, own, strict=True)))
    wanted = [force, *(sympy.diff(force, to) for to in (slip, *own))]
    function: Callable[..., list[Array]] = sympy.lambdify(
        [slip, load, *own], wanted, [{"np": np}], printer=ArrayPrinter({}), cse=True
    )
    return function


def evaluate(
    tyre: Tyre, slip_angle: Array, values: Mapping[str, float], vertical_load: float = 0.0
) -> tuple[Array, Array, Array]:
    """Force curve of an axle from the same expression that the models use.

    Parameters
    ----------
    slip_angle : (n,) [rad]
    values : parameter name -> value
    vertical_load : of the axle [N]; kinds whose parameters are those of one load do not use it

    Returns
    -------
    force : (n,) [N]
    slope : (n,) derivative to the slip angle [N/rad]
    derivative : (n, k) to each parameter, in the order of ``tyre.parameters``
    """
    slip_angle = np.asarray(slip_angle, dtype=np.float64)
    numbers = [values[name] for name in tyre.names]
    with np.errstate(all="ignore"):
        found = _evaluated(tyre)(slip_angle, vertical_load, *numbers)
    force, slope, *columns = (np.broadcast_to(part, slip_angle.shape).astype(np.float64) for part in found)
    return force, slope, np.stack(columns, axis=-1)


@cache
def _slope_at_zero(tyre: Tyre) -> Callable[..., list[float]]:
    """Slope of the force at zero slip and its derivatives to load and parameters, as function."""
    slip, load = symbol("slip_angle"), symbol("vertical_load")
    own = [symbol(name) for name in tyre.names]
    force = tyre.lateral_force(slip, load, **dict(zip(tyre.names, own, strict=True)))
    slope = sympy.diff(force, slip).subs(slip, 0)
    wanted = [slope, *(sympy.diff(slope, to) for to in (load, *own))]
    function: Callable[..., list[float]] = sympy.lambdify(
        [load, *own], wanted, [{"np": np}], printer=ArrayPrinter({}), cse=True
    )
    return function


def stiffness(tyre: Tyre, values: Mapping[str, float], vertical_load: float = 0.0) -> Stiffness:
    """Cornering stiffness of an axle from the same expression that the models use.

    Parameters
    ----------
    values : parameter name -> value
    vertical_load : of the axle [N]; kinds whose parameters are those of one load do not use it
    """
    numbers = [np.float64(values[name]) for name in tyre.names]
    with np.errstate(all="ignore"):
        value, by_load, *by_parameter = _slope_at_zero(tyre)(np.float64(vertical_load), *numbers)
    return Stiffness(float(value), np.array(by_parameter, dtype=np.float64), float(by_load))
