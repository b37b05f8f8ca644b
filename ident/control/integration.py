"""Classical Runge-Kutta method (RK4) for a compiled model whose inputs are known between the grid points too.

``Engine.simulate`` lets an input run linearly over a step, as samples of a log do. On the bench steering and
speed are known exactly at every time, so each step is given its inputs at its beginning, middle and end, and
order 4 is kept.
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
_FUNCTION = types.FunctionType(types.none(_ROW, _ROW, _ROW, _ROW))


@numba.njit(
    types.none(_FUNCTION, _FUNCTION, _ROW, _TABLE, _ROW, _ROW, _TABLE, _TABLE),
    cache=True,
    error_model="numpy",
)
def _march(
    rates: Any, outputs: Any, start: Array, u: Array, steps: Array, p: Array, states: Array, measured: Array
) -> None:
    """Fill ``states`` and ``measured``; rows 2i, 2i + 1, 2i + 2 of ``u`` are those of step i."""
    size = start.size
    x, z, k, total = start.copy(), np.empty(size), np.empty(size), np.empty(size)
    states[0] = x
    outputs(x, u[0], p, measured[0])
    for at in range(steps.size):
        h = steps[at]
        rates(x, u[2 * at], p, k)
        for i in range(size):
            total[i] = k[i]
            z[i] = x[i] + 0.5 * h * k[i]
        rates(z, u[2 * at + 1], p, k)
        for i in range(size):
            total[i] += 2.0 * k[i]
            z[i] = x[i] + 0.5 * h * k[i]
        rates(z, u[2 * at + 1], p, k)
        for i in range(size):
            total[i] += 2.0 * k[i]
            z[i] = x[i] + h * k[i]
        rates(z, u[2 * at + 2], p, k)
        for i in range(size):
            x[i] += h / 6.0 * (total[i] + k[i])
        states[at + 1] = x
        outputs(x, u[2 * at + 2], p, measured[at + 1])


def march(
    engine: Engine, start: Array, inputs: Array, steps: Array, parameters: Array
) -> tuple[Array, Array]:
    """Simulate a model over steps whose inputs are given at beginning, middle and end.

    Parameters
    ----------
    start : (nx,) state
    inputs : (2 n + 1, nu) at the points and the middles of the grid
    steps : (n,) [s]
    parameters : (np,)

    Returns
    -------
    states : (n + 1, nx)
    outputs : (n + 1, ny)

    Raises
    ------
    ValueError
        If the shapes do not fit: compiled code does not look at bounds.
    """
    count, size = steps.size, len(engine.states)
    shapes = (start.shape, inputs.shape, parameters.shape)
    wanted = ((size,), (2 * count + 1, len(engine.inputs)), (len(engine.parameters),))
    if shapes != wanted:
        raise ValueError(f"{engine.name}: start, inputs and parameters have shapes {shapes}, need {wanted}")
    states, measured = np.empty((count + 1, size)), np.empty((count + 1, len(engine.outputs)))
    module = engine.module
    x, u, h, p = (np.ascontiguousarray(part, dtype=np.float64) for part in (start, inputs, steps, parameters))
    _march(module.rates, module.outputs, x, u, h, p, states, measured)
    return states, measured
