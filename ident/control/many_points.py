"""A model and its exact derivatives at many points at once, in one call of compiled code.

``Engine.jacobians`` does the same by NumPy, whose overhead on the 40 to 80 points of a horizon is most of its
time; here the generated function for one point is called in a loop.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from ident.dynamics.engine import Engine

Array = NDArray[np.float64]

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_STACK = types.Array(types.float64, 3, "C")
_PLACES = types.Array(types.int64, 2, "C")
_FUNCTION = types.FunctionType(types.none(_ROW, _ROW, _ROW, _ROW, _ROW))


@numba.njit(
    types.none(_FUNCTION, _TABLE, _TABLE, _ROW, _PLACES, _TABLE, _STACK, _STACK),
    cache=True,
    error_model="numpy",
)
def _at_points(
    function: Any, x: Array, u: Array, p: Array, places: Any, rates: Array, A: Array, B: Array
) -> None:
    """Fill rates, A and B; ``places`` has a row (0 for A, 1 for B or -1, row, column) for each entry."""
    entries = np.empty(places.shape[0] + 1)
    for k in range(x.shape[0]):
        function(x[k], u[k], p, rates[k], entries)
        for e in range(places.shape[0]):
            if places[e, 0] == 0:
                A[k, places[e, 1], places[e, 2]] = entries[e]
            elif places[e, 0] == 1:
                B[k, places[e, 1], places[e, 2]] = entries[e]


class ManyPoints:
    """The rates of a model and their derivatives to states and inputs, at many points."""

    def __init__(self, engine: Engine) -> None:
        self._function = engine.module.rates_and_jacobian
        self._sizes = len(engine.states), len(engine.inputs), len(engine.parameters)
        kinds = {"x": 0, "u": 1, "p": -1}
        entries = engine.module.RATE_ENTRIES
        rows = [(place, *entry) for kind, place in kinds.items() for entry in entries[kind]]
        self._places = np.array(rows, dtype=np.int64).reshape(-1, 3)

    def jacobians(self, x: Array, u: Array, p: Array) -> tuple[Array, Array, Array]:
        """Rates (N, nx), A = ∂f/∂x (N, nx, nx) and B = ∂f/∂u (N, nx, nu).

        x : (N, nx); u : (N, nu); p : (np,)

        Raises
        ------
        ValueError
            If the shapes do not fit: compiled code does not look at bounds.
        """
        count, (nx, nu, size) = x.shape[0], self._sizes
        if x.shape != (count, nx) or u.shape != (count, nu) or p.shape != (size,):
            raise ValueError(f"shapes {x.shape}, {u.shape}, {p.shape}: need (N, {nx}), (N, {nu}), ({size},)")
        rates, A, B = np.empty((count, nx)), np.zeros((count, nx, nx)), np.zeros((count, nx, nu))
        x, u, p = (np.require(part, dtype=np.float64, requirements=["C", "W"]) for part in (x, u, p))
        _at_points(self._function, x, u, p, self._places, rates, A, B)
        return rates, A, B
