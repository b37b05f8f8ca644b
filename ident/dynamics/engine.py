"""Simulation of a model with exact sensitivities, compiled once a model structure and machine.

Integration is the classical Runge-Kutta method of order 4 (RK4) on the grid of the log. Derivatives are those
of what RK4 computes, exact to rounding; there are no finite differences.

One call simulates many segments, each with a start and, where wanted, parameters of its own; it costs
microseconds beside its steps, so draws and candidates over the same inputs are calls of their own. The
compiled code releases the interpreter's lock: calls in several threads run side by side, and the segments of
a long call are shared out over the processor's cores (``OMP_NUM_THREADS`` of them at most, where that is
set).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ident.dynamics.code import module_text
from ident.dynamics.derivation import derive
from ident.dynamics.driver_text import UPSTREAM
from ident.dynamics.model_cache import cached_module
from ident.dynamics.shares import shared_out
from ident.dynamics.system import System

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_engines: dict[str, Engine] = {}


def compiled(system: System) -> Engine:
    """The engine of a model; made once a process, from the disk cache where that holds it."""
    fingerprint = system.fingerprint
    if fingerprint not in _engines:
        _engines[fingerprint] = Engine(system, fingerprint)
    return _engines[fingerprint]


class Engine:
    """One model, ready to be simulated.

    states, inputs, parameters, outputs : names, in the order of every array
    derived : whether the Jacobians were derived by this process, and not taken from the disk cache
    """

    def __init__(self, system: System, fingerprint: str) -> None:
        self.name = system.name
        self.states = tuple(system.states)
        self.inputs = system.inputs
        self.parameters = system.parameters
        self.outputs = tuple(system.outputs)
        self._module, self.derived = cached_module(fingerprint, lambda: module_text(system, derive(system)))

    @property
    def module(self) -> ModuleType:
        """The generated module."""
        return self._module

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameters as a vector, in order.

        Raises
        ------
        ValueError
            If a value is missing or one is given that the model does not have.
        """
        missing = sorted(set(self.parameters) - set(values))
        unknown = sorted(set(values) - set(self.parameters))
        if missing or unknown:
            raise ValueError(f"{self.name}: missing {missing}, unknown {unknown}")
        return np.array([values[name] for name in self.parameters], dtype=np.float64)

    def simulate(
        self,
        starts: ArrayLike,
        inputs: ArrayLike,
        steps: ArrayLike,
        offsets: ArrayLike,
        parameters: ArrayLike,
        *,
        held: Iterable[str] | None = None,
        substeps: ArrayLike | None = None,
    ) -> tuple[Array, Array]:
        """Simulate segments, each from a state of its own.

        Parameters
        ----------
        starts : (s, nx) state at the first grid point of each segment
        inputs : (N, nu) at the grid points of all segments, one segment after another
        steps : (N,) from a grid point to the next [s]; that of a segment's last is ignored
        offsets : (s + 1,) first grid point of each segment, and N
        parameters : (np,) of all segments, or (s, np)
        held : names of the inputs that are held over a step, such as a command; the others run linearly
        substeps : (N,) RK4 steps in each step of the grid; one where None

        Returns
        -------
        states : (N, nx)
        outputs : (N, ny)
        """
        arguments = self._arguments(starts, inputs, steps, offsets, parameters, held, substeps)
        states, outputs = self._results(arguments[1].shape[0])
        shared_out(arguments[3], lambda *ends: self._module.simulate(*arguments, *ends, states, outputs))
        return states, outputs

    def sensitivities(
        self,
        starts: ArrayLike,
        inputs: ArrayLike,
        steps: ArrayLike,
        offsets: ArrayLike,
        parameters: ArrayLike,
        *,
        active: Sequence[str] | Sequence[int],
        held: Iterable[str] | None = None,
        substeps: ArrayLike | None = None,
        input_derivatives: ArrayLike | None = None,
        wanted: Sequence[str] | None = None,
    ) -> tuple[Array, Array, Array]:
        """Simulate, with the derivatives of the outputs.

        Parameters
        ----------
        starts, inputs, steps, offsets, parameters, held, substeps : as in ``simulate``
        active : (na,) parameters, names or indices, to differentiate to. A name that the model does not have
            is a parameter of a signal block upstream: it acts through ``input_derivatives`` alone
        input_derivatives : (N, nu, na) derivatives of the inputs to the active parameters; zero where None
        wanted : names of the outputs whose derivatives are needed; all where None

        Returns
        -------
        states : (N, nx)
        outputs : (N, ny)
        derivatives : (len(wanted), N, nx + na) to the initial states of the segment, then to ``active``
        """
        arguments = self._arguments(starts, inputs, steps, offsets, parameters, held, substeps)
        count = arguments[1].shape[0]
        places = self._active(active, upstream=input_derivatives is not None)
        chain = np.empty((0, len(self.inputs), places.size))
        if input_derivatives is not None:
            chain = _array(input_derivatives, (count, len(self.inputs), places.size), "input_derivatives")
        wanted = self.outputs if wanted is None else wanted
        rows = np.full(len(self.outputs), -1, dtype=np.int64)
        for row, name in enumerate(wanted):
            rows[self.outputs.index(name)] = row
        states, outputs = self._results(count)
        derivatives = np.empty((len(wanted), count, len(self.states) + places.size))
        results = (places, chain, rows, states, outputs, derivatives)
        shared_out(arguments[3], lambda *ends: self._module.sensitivities(*arguments, *ends, *results))
        return states, outputs, derivatives

    def rates(self, x: ArrayLike, u: ArrayLike, p: ArrayLike) -> Array:
        """Derivatives of the states by NumPy, the leading axes broadcast: -> (..., nx).

        x : (..., nx); u : (..., nu); p : (..., np)
        """
        return self._evaluated("array_rates", x, u, p)

    def outputs_of(self, x: ArrayLike, u: ArrayLike, p: ArrayLike) -> Array:
        """Outputs by NumPy, likewise: -> (..., ny)."""
        return self._evaluated("array_outputs", x, u, p)

    def jacobians(self, x: ArrayLike, u: ArrayLike, p: ArrayLike) -> tuple[Array, Array, Array]:
        """A = ∂f/∂x (..., nx, nx), B = ∂f/∂u (..., nx, nu), P = ∂f/∂p (..., nx, np) by NumPy."""
        values = self._evaluated("array_rates_and_jacobian", x, u, p)
        return self._scattered(values, self._module.RATE_ENTRIES, len(self.states))

    def output_jacobians(self, x: ArrayLike, u: ArrayLike, p: ArrayLike) -> tuple[Array, Array, Array]:
        """C = ∂h/∂x (..., ny, nx), D = ∂h/∂u (..., ny, nu), Q = ∂h/∂p (..., ny, np) by NumPy."""
        values = self._evaluated("array_outputs_and_jacobian", x, u, p)
        return self._scattered(values, self._module.OUTPUT_ENTRIES, len(self.outputs))

    def _evaluated(self, function: str, x: ArrayLike, u: ArrayLike, p: ArrayLike) -> Array:
        """What a function of the module returns, side by side on the last axis."""
        arrays = [np.asarray(part, dtype=np.float64) for part in (x, u, p)]
        shape = np.broadcast_shapes(*(part.shape[:-1] for part in arrays))
        with np.errstate(all="ignore"):
            parts = getattr(self._module, function)(*arrays)
        return np.stack([np.broadcast_to(part, shape) for part in parts], axis=-1).astype(np.float64)

    def _scattered(
        self, values: Array, entries: Mapping[str, list[tuple[int, int]]], rows: int
    ) -> tuple[Array, Array, Array]:
        """Full matrices from the entries that are not identically zero, which follow ``rows`` functions."""
        sizes = {"x": len(self.states), "u": len(self.inputs), "p": len(self.parameters)}
        place = rows
        full = []
        for kind, columns in sizes.items():
            matrix = np.zeros((*values.shape[:-1], rows, columns))
            for i, j in entries[kind]:
                matrix[..., i, j] = values[..., place]
                place += 1
            full.append(matrix)
        return full[0], full[1], full[2]

    def _results(self, count: int) -> tuple[Array, Array]:
        return np.empty((count, len(self.states))), np.empty((count, len(self.outputs)))

    def _active(self, active: Sequence[str] | Sequence[int], *, upstream: bool) -> Integers:
        """Places of parameters; the place after the last stands for one upstream."""
        count = len(self.parameters)
        known = {name: place for place, name in enumerate(self.parameters)}
        places = [known.get(a, count) if isinstance(a, str) else int(a) for a in active]
        own = [place for place in places if place != count]
        strange = len(places) - len(own)
        if len(set(active)) != len(places) or any(not 0 <= a < count for a in own):
            raise ValueError(f"{self.name}: active parameters {list(active)} are not all different and known")
        if strange and not upstream:
            raise ValueError(f"{self.name}: {list(active)} are not all parameters of the model")
        if strange > UPSTREAM:
            raise ValueError(f"{self.name}: {strange} parameters upstream, at most {UPSTREAM}")
        return np.array(places, dtype=np.int64)

    def _arguments(
        self,
        starts: ArrayLike,
        inputs: ArrayLike,
        steps: ArrayLike,
        offsets: ArrayLike,
        parameters: ArrayLike,
        held: Iterable[str] | None,
        substeps: ArrayLike | None,
    ) -> tuple[Any, ...]:
        """The arguments of the drivers, checked: compiled code does not look at bounds."""
        bounds = np.require(offsets, dtype=np.int64, requirements=["C", "W"])
        segments = bounds.size - 1
        count = int(bounds[-1]) if segments >= 0 else 0
        if segments < 0 or bounds[0] != 0 or np.any(np.diff(bounds) < 1):
            raise ValueError(f"{self.name}: offsets {bounds} do not begin at 0 and rise")
        values = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        rows = 1 if values.shape[0] == 1 else segments
        parts = np.ones(count, dtype=np.int64) if substeps is None else np.asarray(substeps, dtype=np.int64)
        if parts.shape != (count,) or np.any(parts < 1):
            raise ValueError(f"{self.name}: substeps must be {count} numbers of at least 1")
        return (
            _array(starts, (segments, len(self.states)), "starts"),
            _array(inputs, (count, len(self.inputs)), "inputs"),
            _array(steps, (count,), "steps"),
            bounds,
            _array(values, (rows, len(self.parameters)), "parameters"),
            self._running(held),
            np.require(parts, requirements=["C", "W"]),
        )

    def _running(self, held: Iterable[str] | None) -> Array:
        """1 for an input that runs linearly between grid points, 0 for one that is held."""
        names = set(held or ())
        if unknown := sorted(names - set(self.inputs)):
            raise ValueError(f"{self.name}: {unknown} are no inputs")
        return np.array([0.0 if name in names else 1.0 for name in self.inputs])


def _array(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    found = np.require(values, dtype=np.float64, requirements=["C", "W"])
    if found.shape != shape:
        raise ValueError(f"{name} has shape {found.shape}, need {shape}")
    return found
