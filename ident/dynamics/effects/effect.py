"""One effect: where it enters a model, and what it does there.

A model is built port by port: each value that an effect may change (``road_wheel_angle``, ``lateral_force``,
``yaw_moment``, each output as ``measured_<signal>``) goes through ``Ports.through`` on its way to what uses
it. So an effect changes all that follows, and several compose in the order in which they are given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import sympy
from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

Enters = Literal["A", "G", "T", "Y", "R", "X", "M"]
Change = Callable[[Expr, Mapping[str, Expr]], Expr]


@dataclass(frozen=True, eq=False)
class Effect:
    """A term that a base model may have or lack.

    name : its identifier in code, JSON and reports
    enters : actuator A, linkage G, tyre T, lateral force Y, yaw moment R, longitudinal X, measurement M
    parameters : their names are symbols of the model; all zero is no effect
    changes : port -> (value of the port, all that is known there by name) -> changed value
    needs : signals of the log without which it cannot be told
    """

    name: str
    enters: Enters
    parameters: tuple[Parameter, ...]
    changes: Mapping[str, Change]
    needs: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)


class Ports:
    """The values of a model that is being built, each after the effects that enter there.

    known : states, inputs and parameters by name, to begin with
    intermediates : name -> expression, of every port that is more than a name; what follows uses the name
    """

    def __init__(self, known: Mapping[str, Expr], effects: Sequence[Effect]) -> None:
        self.known = dict(known)
        self.intermediates: dict[str, Expr] = {}
        self._effects = effects
        self._passed: set[str] = set()

    def through(self, port: str, value: Expr) -> Expr:
        """The value of a port after all effects that enter there."""
        for effect in self._effects:
            if port in effect.changes:
                value = effect.changes[port](value, self.known)
        self._passed.add(port)
        return self.named(port, value)

    def named(self, name: str, value: Expr) -> Expr:
        """Give a value on the way a name of its own, and return that."""
        value = sympy.sympify(value)
        if not value.is_Atom:
            self.intermediates[f"at.{name}"] = value
            value = symbol(f"at.{name}")
        self.known[name] = value
        return value

    def parameter_names(self) -> tuple[str, ...]:
        """Parameters of all effects.

        Raises
        ------
        ValueError
            If an effect enters at a port that this model does not have.
        """
        for effect in self._effects:
            if missing := sorted(set(effect.changes) - self._passed):
                raise ValueError(
                    f"{effect.name} enters at {', '.join(missing)}, which this model does not have"
                )
        return tuple(name for effect in self._effects for name in effect.names)


def known_symbols(*names: Sequence[str]) -> dict[str, Expr]:
    """Symbols by name."""
    return {name: symbol(name) for group in names for name in group}
