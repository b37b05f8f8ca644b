"""How the quantities of the tyre stage are named wherever a person reads them, and in which units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from ident.glossary import AXLES, SIGNALS
from ident.results import Estimate, TyreFit, TyreKind, TyresResult

KINDS: dict[TyreKind, str] = {
    "linear": "linear",
    "piecewise_linear": "piecewise linear",
    "magic_formula": "Magic Formula",
    "brush": "brush",
    "pac2002": "PAC2002",
}

FORMULAS: dict[TyreKind, str] = {
    "linear": "F = Cα α",
    "piecewise_linear": "F = Cα α up to αₘₐₓ, then Cα αₘₐₓ (2.24)",
    "magic_formula": "F = D sin(C atan(B α − E (B α − atan(B α)))) with B = Cα/(C D) (2.7)",
    "brush": "F = Cα tan α (1 − |z| + z²/3) with z = Cα tan α/(3 D), ±D where |z| ≥ 1",
    "pac2002": "PAC2002 of the property file at the load of the axle at rest, with scaling factors; "
    "1 leaves its curve as it is",
}


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is shown."""

    symbol: str
    name: str
    meaning: str


PARAMETERS = {
    "cornering_stiffness": Parameter(
        "Cα", "cornering stiffness", "slope of the axle's force over its slip angle at small slip"
    ),
    "saturation_slip": Parameter("αₘₐₓ", "saturation slip", "slip angle beyond which the force stays"),
    "peak_force": Parameter("D", "peak force", "largest lateral force of the axle"),
    "shape": Parameter("C", "shape", "how far the force falls beyond its peak: D sin(C π/2) is its end"),
    "curvature": Parameter("E", "curvature", "how sharply the force bends before its peak"),
    "LKY": Parameter("LKY", "stiffness factor LKY", "scales the cornering stiffness of the property file"),
    "LMUY": Parameter(
        "LMUY", "friction factor LMUY", "scales the lateral peak friction of the property file"
    ),
    "LCY": Parameter("LCY", "shape factor LCY", "scales how far the force falls beyond its peak"),
    "LEY": Parameter("LEY", "curvature factor LEY", "scales how sharply the force bends before its peak"),
    "stiffness_factor": Parameter("B", "stiffness factor", "Cα/(C D), of the slip angle inside the formula"),
    "yaw_inertia": Parameter("Iz", "yaw inertia", "about the centre of gravity"),
    "steering_offset": Parameter(
        "δ₀", "steering offset", "what the road wheels are off from where they should be"
    ),
    "understeer_gradient": Parameter(
        "Kᵤₛ",
        "understeer gradient",
        "m/L (lr/Cα,f − lf/Cα,r): steering angle more per lateral acceleration; negative for oversteer",
    ),
    "characteristic_speed": Parameter(
        "vch", "characteristic speed", "√(L/Kᵤₛ): where the yaw-rate gain is largest; understeer only"
    ),
}

DISPLAYED = {
    "N/rad": (1e-3, "kN/rad"),
    "N": (1e-3, "kN"),
    "rad s^2/m": (1e3, "mrad/(m/s²)"),
    "rad/(m/s^2)": (1e3, "mrad/(m/s²)"),
    "rad": (1e3, "mrad"),
    "rad/s": (1e3, "mrad/s"),
}
"""SI unit -> factor and unit of what is shown."""
ANGULAR, LARGE_ANGLE = ("rad", "rad/s"), 1.0  # from which on a parameter stays in its unit

ERRORS = (
    *("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"),
    *("position_along", "position_across", "position_x", "position_y"),
)
"""What errors are told of, in this order; the position may be compared along and across the path."""

SHORT_SIGNALS = {
    "lateral_acceleration": "lat. acceleration",
    "lateral_velocity": "lat. velocity",
    "longitudinal_velocity": "long. velocity",
    "road_wheel_angle": "road-wheel angle",
    "position_along": "along path",
    "position_across": "across path",
    "position_x": "x",
    "position_y": "y",
}


def parameter(name: str) -> Parameter:
    """Describe a parameter by its name, with or without its axle before it."""
    bare = name.rpartition(".")[2]
    return PARAMETERS.get(bare, Parameter(bare, bare.replace("_", " "), ""))


def full_name(name: str) -> str:
    """Name "front.cornering_stiffness" for a reader."""
    axle = name.partition(".")[0]
    return f"{axle} {parameter(name).name}" if axle in AXLES else parameter(name).name


def short_name(name: str) -> str:
    """Name "front.cornering_stiffness" where there is little room."""
    axle = name.partition(".")[0]
    return f"{axle} {parameter(name).symbol}" if axle in AXLES else parameter(name).symbol


def displayed(estimate: Estimate) -> Estimate:
    """Give an estimate in the unit in which it is shown."""
    factor, unit = DISPLAYED.get(estimate.unit, (1.0, estimate.unit))
    if estimate.unit in ANGULAR and abs(estimate.value or 0.0) >= LARGE_ANGLE:
        factor, unit = 1.0, estimate.unit
    value, std, low, high = (
        None if part is None else part * factor
        for part in (estimate.value, estimate.std, estimate.low, estimate.high)
    )
    return replace(estimate, value=value, std=std, low=low, high=high, unit=unit)


def signal_unit(signal: str) -> tuple[float, str]:
    """Give the factor and the unit in which errors of a signal are shown."""
    unit = SIGNALS[signal].unit if signal in SIGNALS else "m" if signal.startswith("position_") else "1"
    return DISPLAYED.get(unit, (1.0, unit.replace("^2", "²")))


def signal_head(signal: str) -> str:
    """Head a column of errors of a signal."""
    return f"{SHORT_SIGNALS.get(signal, signal.replace('_', ' '))} [{signal_unit(signal)[1]}]"


def in_order(signals: Iterable[str]) -> list[str]:
    """Put signals into the order in which their errors are told."""
    found = dict.fromkeys(signals)
    return [name for name in ERRORS if name in found] + [name for name in found if name not in ERRORS]


def chosen_fit(result: TyresResult) -> TyreFit:
    """Give the fit that goes on.

    Raises
    ------
    ValueError
        If the chosen kind is not among the fits.
    """
    for fit in result.fits:
        if fit.kind == result.chosen:
            return fit
    raise ValueError(f"chosen is {result.chosen}, but there are fits of {[fit.kind for fit in result.fits]}")


def estimates(fit: TyreFit) -> dict[str, Estimate]:
    """Give every parameter of a fit by its full name, in the order in which they are shown."""
    front = {f"front.{name}": estimate for name, estimate in fit.front.items()}
    rear = {f"rear.{name}": estimate for name, estimate in fit.rear.items()}
    return {**front, **rear, "yaw_inertia": fit.yaw_inertia}
