"""One effect: where it enters a model, and what it does there.

A model is built port by port: each value that an effect may change (``road_wheel_angle``, ``felt_force``,
``yaw_moment``, each output as ``measured_<signal>``) goes through ``Ports.through`` on its way to what uses
it. So an effect changes all that follows, and several compose in the order in which they are given.

An effect may bring states of its own (a lagging force, a roll angle), inputs (a probe) and outputs. Its
states and inputs are known by name from the beginning; how its states change is asked for once all ports have
passed, so that it may use whatever the model knows by then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import sympy
from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.symbols import symbol

Enters = Literal["A", "G", "T", "Y", "R", "X", "M"]
Known = Mapping[str, Expr]
Change = Callable[[Expr, Known], Expr]


@dataclass(frozen=True, eq=False)
class Effect:
    """A term that a base model may have or lack.

    name : its identifier in code, JSON and reports
    enters : actuator A, linkage G, tyre T, lateral force Y, yaw moment R, longitudinal X, measurement M
    parameters : their names are symbols of the model; the first, its size, at zero is no effect
    changes : port -> (value of the port, all that is known there by name) -> changed value
    needs : signals of the log without which it cannot be told
    given : parameters that it takes as known, fixed at what the vehicle file says, else at ``typical``
    states : name -> (all that is known after the ports) -> its derivative to time; they begin at zero unless
        ``begins`` names an output of the model that they begin at
    inputs : names of the inputs that it adds
    outputs : name -> (all that is known after the ports) -> value
    equation : what it does, to be typeset; meaning : of the equation and its size, in one sentence
    """

    name: str
    enters: Enters
    parameters: tuple[Parameter, ...]
    changes: Mapping[str, Change]
    needs: tuple[str, ...] = ()
    given: tuple[Parameter, ...] = ()
    states: Mapping[str, Callable[[Known], Expr]] = field(default_factory=dict)
    begins: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()
    outputs: Mapping[str, Callable[[Known], Expr]] = field(default_factory=dict)
    equation: sympy.Basic | None = None
    meaning: str = ""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that are not given, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order, those that are given last."""
        return tuple(parameter.name for parameter in (*self.parameters, *self.given))


ON_CURVE = "slip angle on a curve"


def on_curve(known: Known, axle: str, slip: Expr) -> Expr:
    """Static force of an axle [N] at another slip angle [rad], its load that at rest."""
    return known[f"{axle}_curve"].xreplace({symbol(ON_CURVE): slip})


class Ports:
    """The values of a model that is being built, each after the effects that enter there.

    known : states, inputs and parameters by name, to begin with
    intermediates : name -> expression, of every port that is more than a name; what follows uses the name
    inputs : names of the inputs that the effects add
    """

    def __init__(self, known: Known, effects: Sequence[Effect]) -> None:
        added = [name for effect in effects for name in (*effect.states, *effect.inputs)]
        self.known = {**known, **known_symbols(added)}
        self.intermediates: dict[str, Expr] = {}
        self.inputs = tuple(name for effect in effects for name in effect.inputs)
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

    def states(self) -> dict[str, Expr]:
        """Derivatives of the states that the effects add; asked for after all ports have passed."""
        return {
            name: derivative(self.known)
            for effect in self._effects
            for name, derivative in effect.states.items()
        }

    def outputs(self) -> dict[str, Expr]:
        """What the effects let be read of the model beside its own outputs; asked for last."""
        return {name: value(self.known) for effect in self._effects for name, value in effect.outputs.items()}

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
