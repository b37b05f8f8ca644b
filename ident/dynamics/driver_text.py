"""The text of the two drivers of a generated module: classical Runge-Kutta (RK4) over many segments.

``simulate`` gives states and outputs. ``sensitivities`` gives in addition the exact derivative of what RK4
computes, to the initial states and to parameters: in each stage dS = A S + G, with A = ∂f/∂x and
G = ∂f/∂p + ∂f/∂u du/dθ at that stage. The stages' Jacobians do not depend on S, so a step first runs the
four stages of the states and keeps their Jacobians, and then carries each column of S through the four
stages in registers; only entries that are not identically zero are written out. Columns of S lie side by
side at a fixed stride, so that a compiler can see that rows do not overlap and treats several at once.
"""

from __future__ import annotations

from ident.dynamics.derivation import Block, Derived
from ident.dynamics.system import System

LANES = 4  # columns are counted in multiples of this
UPSTREAM = 16  # columns kept for parameters of signal blocks upstream, which the model does not have
STAGES = (0, 1, 2, 3)

SIMULATE = '''@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], int64[::1], float64[:, ::1],"
    " float64[::1], int64[::1], int64, int64, float64[:, ::1], float64[:, ::1])",
    **OPTIONS,
)
def simulate(
    starts, inputs, steps, offsets, parameters, runs, substeps, first, last, states, measured,
):
    """Fill ``states`` and ``measured`` of the segments from ``first`` to before ``last``.

    ``runs`` is 1 for an input that runs linearly, 0 for a held one.
    """
    x, z, k, total = np.empty({nx}), np.empty({nx}), np.empty({nx}), np.empty({nx})
    u, v, slope, y = np.empty({nu}), np.empty({nu}), np.empty({nu}), np.empty({ny})
    for segment in range(first, last):
        p = parameters[min(segment, parameters.shape[0] - 1)]
        for i in range({nx}):
            x[i] = starts[segment, i]
        for at in range(offsets[segment], offsets[segment + 1]):
            for m in range({nu}):
                u[m] = inputs[at, m]
            outputs(x, u, p, y)
            for i in range({nx}):
                states[at, i] = x[i]
            for o in range({ny}):
                measured[at, o] = y[o]
            if at + 1 == offsets[segment + 1]:
                break
            count = substeps[at]
            h = steps[at] / count
            for m in range({nu}):
                slope[m] = runs[m] * (inputs[at + 1, m] - u[m]) / count
            for part in range(count):
                for m in range({nu}):
                    v[m] = u[m] + part * slope[m]
                rates(x, v, p, k)
                for i in range({nx}):
                    total[i] = k[i]
                    z[i] = x[i] + 0.5 * h * k[i]
                for m in range({nu}):
                    v[m] = u[m] + (part + 0.5) * slope[m]
                rates(z, v, p, k)
                for i in range({nx}):
                    total[i] += 2.0 * k[i]
                    z[i] = x[i] + 0.5 * h * k[i]
                rates(z, v, p, k)
                for i in range({nx}):
                    total[i] += 2.0 * k[i]
                    z[i] = x[i] + h * k[i]
                for m in range({nu}):
                    v[m] = u[m] + (part + 1) * slope[m]
                rates(z, v, p, k)
                for i in range({nx}):
                    x[i] += h / 6.0 * (total[i] + k[i])
'''

SENSITIVITIES = '''RATE_PLACES = np.array({rate_places}, dtype=np.int64)
OUTPUT_PLACES = np.array({output_places}, dtype=np.int64)
OUTPUT_INPUT_PLACES = np.array({output_input_places}, dtype=np.int64)
OUTPUT_BEGINS = np.array({output_begins}, dtype=np.int64)
OUTPUT_STATES = np.array({output_states}, dtype=np.int64)


@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], int64[::1], float64[:, ::1],"
    " float64[::1], int64[::1], int64, int64, int64[::1], float64[:, :, ::1], int64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[:, :, ::1])",
    **OPTIONS,
)
def sensitivities(
    starts, inputs, steps, offsets, parameters, runs, substeps, first, last,
    active, chain, rows, states, measured, derivatives,
):
    """Fill also ``derivatives`` at (rows[output], grid point, initial state or active parameter).

    ``chain`` holds du/dθ at every grid point, or has no rows; an output whose row is negative is left out.
    """
    x, z, k, total = np.empty({nx}), np.empty({nx}), np.empty({nx}), np.empty({nx})
    u, v, slope, y = np.empty({nu}), np.empty({nu}), np.empty({nu}), np.empty({ny})
    j0, j1, j2, j3 = np.zeros({nj}), np.zeros({nj}), np.zeros({nj}), np.zeros({nj})
    jy = np.zeros({njy})
    columns = {nx} + active.size
    chained = chain.shape[0] > 0
    s = np.empty({nx} * {stride})
    g0, g1, g2, g3 = np.zeros({gathered}), np.zeros({gathered}), np.zeros({gathered}), np.zeros({gathered})
    for segment in range(first, last):
        p = parameters[min(segment, parameters.shape[0] - 1)]
        s[:] = 0.0
        for i in range({nx}):
            x[i] = starts[segment, i]
            s[i * {stride} + i] = 1.0
        for at in range(offsets[segment], offsets[segment + 1]):
            for m in range({nu}):
                u[m] = inputs[at, m]
            outputs_and_jacobian(x, u, p, y, jy)
            for i in range({nx}):
                states[at, i] = x[i]
            for o in range({ny}):
                measured[at, o] = y[o]
            for o in range({ny}):
                row = rows[o]
                if row < 0:
                    continue
                for c in range(columns):
                    derivatives[row, at, c] = 0.0
                for e in range(OUTPUT_BEGINS[o], OUTPUT_BEGINS[o + 1]):
                    w = jy[OUTPUT_STATES[e, 0]]
                    column = OUTPUT_STATES[e, 1] * {stride}
                    for c in range(columns):
                        derivatives[row, at, c] += w * s[column + c]
                for a in range(active.size):
                    derivatives[row, at, {nx} + a] += jy[OUTPUT_PLACES[o, active[a]]]
                if chained:
                    for m in range({nu}):
                        w = jy[OUTPUT_INPUT_PLACES[o, m]]
                        for a in range(active.size):
                            derivatives[row, at, {nx} + a] += w * chain[at, m, a]
            if at + 1 == offsets[segment + 1]:
                break
            count = substeps[at]
            h = steps[at] / count
            for m in range({nu}):
                slope[m] = runs[m] * (inputs[at + 1, m] - u[m]) / count
            for part in range(count):
                for m in range({nu}):
                    v[m] = u[m] + part * slope[m]
                rates_and_jacobian(x, v, p, k, j0)
                for i in range({nx}):
                    total[i] = k[i]
                    z[i] = x[i] + 0.5 * h * k[i]
                for m in range({nu}):
                    v[m] = u[m] + (part + 0.5) * slope[m]
                rates_and_jacobian(z, v, p, k, j1)
                for i in range({nx}):
                    total[i] += 2.0 * k[i]
                    z[i] = x[i] + 0.5 * h * k[i]
                rates_and_jacobian(z, v, p, k, j2)
                for i in range({nx}):
                    total[i] += 2.0 * k[i]
                    z[i] = x[i] + h * k[i]
                for m in range({nu}):
                    v[m] = u[m] + (part + 1) * slope[m]
                rates_and_jacobian(z, v, p, k, j3)
                for i in range({nx}):
                    x[i] += h / 6.0 * (total[i] + k[i])
                for a in range(active.size):
{gather}
                if chained:
                    begin, middle, end = part / count, (part + 0.5) / count, (part + 1.0) / count
                    for a in range(active.size):
{chain}
                for c in range(columns):
{columns}
'''


def simulate(system: System) -> str:
    """Text of the driver without derivatives."""
    nx, nu, ny = len(system.states), len(system.inputs), len(system.outputs)
    return SIMULATE.format(nx=nx, nu=nu, ny=ny)


def sensitivities(system: System, derived: Derived) -> str:
    """Text of the driver with derivatives."""
    nx, count = len(system.states), len(system.parameters)
    stride = -(-(nx + count + UPSTREAM) // LANES) * LANES
    rates, outputs = derived.rates_with_jacobian, derived.outputs_with_jacobian
    driven = sorted({row for kind in ("u", "p") for row, _ in rates.entries[kind]})
    return SENSITIVITIES.format(
        nx=nx,
        nu=len(system.inputs),
        ny=len(system.outputs),
        nj=len(rates.jacobian) + 1,
        njy=len(outputs.jacobian) + 1,
        stride=stride,
        gathered=max(1, len(driven)) * stride,
        rate_places=_places(rates, nx, count),
        output_places=_places(outputs, len(system.outputs), count),
        **_output_tables(outputs, len(system.outputs), len(system.inputs)),
        gather=_gather(nx, driven, stride),
        chain=_chain(rates, nx, driven, stride),
        columns=_columns(rates, nx, driven, stride),
    )


def _places(block: Block, rows: int, columns: int) -> list[list[int]]:
    """Place in the flat Jacobian of each (row, parameter); the last place always holds zero.

    The last column is that of parameters upstream.
    """
    zero = len(block.jacobian)
    return [[block.entries["p"].get((i, j), zero) for j in range(columns + 1)] for i in range(rows)]


def _output_tables(outputs: Block, rows: int, inputs: int) -> dict[str, object]:
    """Where in the flat Jacobian of the outputs each entry to a state (place, state) and to an input is."""
    zero = len(outputs.jacobian)
    by_row = sorted((row, place, state) for (row, state), place in outputs.entries["x"].items())
    begins = [sum(row < o for row, _, _ in by_row) for o in range(rows + 1)]
    return {
        "output_begins": begins,
        "output_states": [[place, state] for _, place, state in by_row] or [[zero, 0]],
        "output_input_places": [
            [outputs.entries["u"].get((o, m), zero) for m in range(max(inputs, 1))] for o in range(rows)
        ],
    }


def _gather(nx: int, driven: list[int], stride: int) -> str:
    """What the active parameters do to the states, collected from the flat Jacobians of the four stages."""
    lines = ["j = active[a]"]
    for place, row in enumerate(driven):
        lines.append(f"q = RATE_PLACES[{row}, j]")
        lines += [f"g{stage}[{place * stride + nx} + a] = j{stage}[q]" for stage in STAGES]
    return _indented(lines, 5)


def _chain(rates: Block, nx: int, driven: list[int], stride: int) -> str:
    """What they do through the inputs: ∂f/∂u du/dθ, with du/dθ at the stage's time."""
    lines = []
    for m in sorted({column for _, column in rates.entries["u"]}):
        lines += [f"w = chain[at, {m}, a]", f"d = runs[{m}] * (chain[at + 1, {m}, a] - w)"]
        lines += [
            f"w{s} = w + {t} * d" for s, t in zip(STAGES, ("begin", "middle", "middle", "end"), strict=True)
        ]
        for (row, column), place in rates.entries["u"].items():
            if column == m:
                target = driven.index(row) * stride + nx
                lines += [f"g{s}[{target} + a] += j{s}[{place}] * w{s}" for s in STAGES]
    return _indented(lines or ["pass"], 6)


def _columns(rates: Block, nx: int, driven: list[int], stride: int) -> str:
    """One column of S through the four stages."""
    lines = [f"s{i} = s[{i * stride} + c]" for i in range(nx)]
    for stage in STAGES:
        point = "s" if stage == 0 else "z"
        for i in range(nx):
            terms = [
                f"j{stage}[{place}] * {point}{column}"
                for (row, column), place in rates.entries["x"].items()
                if row == i
            ]
            if i in driven:
                terms.append(f"g{stage}[{driven.index(i) * stride} + c]")
            lines.append(f"k{stage}{i} = {' + '.join(terms) or '0.0'}")
        if stage < 3:
            reach = "h" if stage == 2 else "0.5 * h"
            lines += [f"z{i} = s{i} + {reach} * k{stage}{i}" for i in range(nx)]
    lines += [
        f"s[{i * stride} + c] = s{i} + h / 6.0 * (k0{i} + 2.0 * (k1{i} + k2{i}) + k3{i})" for i in range(nx)
    ]
    return _indented(lines, 5)


def _indented(lines: list[str], depth: int) -> str:
    return "\n".join("    " * depth + line for line in lines)
