"""Where the tyre fit starts: values read off the data, no guess asked of the user.

1. Both stiffnesses and the yaw inertia by least squares where the tyres slip little (they enter linearly),
   with an offset in each balance:

       m a_y = C_f α_f cos δ + C_r α_r + c_1
       I_z ṙ = l_f C_f α_f cos δ - l_r C_r α_r + c_2

2. What these leave unphysical (too little was driven) is a usual value instead: of the stiffness, with the
   understeer gradient K of the steady parts, δ - L r/v = δ_0 + K a_y, K = m/L (l_r/C_f - l_f/C_r); of the
   yaw inertia m l_f l_r.
3. A curve of the kind of tyre through medians of the points of the force inversion, with its stiffness and
   its peak free; a peak below the largest force seen, or far beyond the load, is not believed.
4. Other values around it, because a fit of several parameters may have several minima.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ident.dynamics.tyres import TYRES, axle_force
from ident.estimation.force_inversion import ForcePoints, points_of
from ident.estimation.smooth_motion import (
    FEWEST,
    TYPICAL_COEFFICIENT,
    SmoothMotion,
    gentle,
    smooth_motion,
    usual_inertia,
)
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord
from ident.glossary import AXLES

Array = NDArray[np.float64]

COEFFICIENTS = (2.0, 40.0)  # [1/rad] possible cornering stiffness over load
INERTIAS = (0.3, 3.0)  # possible yaw inertia over m l_f l_r
FRICTION = 0.8  # usual peak force over load
OFFSET = 0.05  # [rad] largest steering offset that is believed
STEADY = 0.05  # [rad/s²] yaw acceleration below which the motion is steady
BINS = 30
SHAPE, CURVATURE = 1.35, -0.5
VARIANTS = ((1.0, 1.0), (1.4, 1.0), (0.7, 1.0), (1.0, 1.5), (0.85, 1.25))  # on stiffness, on peak and inertia


@dataclass(frozen=True)
class LinearStart:
    """What gentle driving tells.

    stiffness : axle -> cornering stiffness [N/rad]; yaw_inertia [kg m²]
    understeer_gradient : K [rad s²/m], steering_offset : what is to be added to the road-wheel angle [rad];
        None where no steady part tells them
    from_data : names of the values that are no usual ones
    """

    stiffness: Mapping[str, float]
    yaw_inertia: float
    understeer_gradient: float | None
    steering_offset: float | None
    from_data: tuple[str, ...]


def tyre_starts(kind: str, records: Sequence[MotionRecord], body: Body) -> list[dict[str, float]]:
    """Starting values for one kind of tyres, the best first.

    Returns
    -------
    a list of {"front.cornering_stiffness": ..., ..., "yaw_inertia": ..., "steering_offset": ...}
    """
    motions = smooth_motion(records, body)
    linear = linear_start(motions, body)
    points = points_of(motions, body, linear.yaw_inertia)
    axles = {axle: AXLE_STARTS[kind](axle, points, linear, body) for axle in AXLES}
    first = _assembled(axles, linear)
    varied = [_varied(first, stiffness, peak) for stiffness, peak in VARIANTS]
    usual = {axle: _usual(kind, axle, points, linear, body) for axle in AXLES}
    return [*varied, _assembled(usual, linear)]


def _assembled(axles: Mapping[str, Mapping[str, float]], linear: LinearStart) -> dict[str, float]:
    named = {f"{axle}.{name}": value for axle, values in axles.items() for name, value in values.items()}
    return {
        **named,
        "yaw_inertia": linear.yaw_inertia,
        "steering_offset": linear.steering_offset or 0.0,
    }


def _varied(start: Mapping[str, float], stiffness: float, peak: float) -> dict[str, float]:
    factors = {
        "cornering_stiffness": stiffness,
        "peak_force": peak,
        "saturation_slip": peak,
        "yaw_inertia": peak,
    }
    return {name: value * factors.get(name.rpartition(".")[2], 1.0) for name, value in start.items()}


# --- the linear range -----------------------------------------------------------------------------


def linear_start(motions: Sequence[SmoothMotion], body: Body) -> LinearStart:
    """Stiffness of both axles and yaw inertia from gentle driving, usual values where it does not tell."""
    gradient, offset = understeer(motions, body)
    inertia = usual_inertia(body)
    points = points_of(motions, body, inertia)
    use = points.valid & np.concatenate([np.zeros(0, dtype=np.bool_), *gentle(motions)])
    solved = _balances(points, use, body) if np.count_nonzero(use) >= FEWEST else {}
    found = {name: value for name, value in solved.items() if _possible(name, value, body)}
    if body.yaw_inertia is None and "yaw_inertia" in found:
        inertia = found["yaw_inertia"]
    if not set(AXLES) <= set(found):
        found = {name: value for name, value in found.items() if name == "yaw_inertia"}
    known = {axle: found[axle] for axle in AXLES if axle in found}
    stiffness = known or _usual_stiffness(body, gradient)
    return LinearStart(stiffness, inertia, gradient, offset, tuple(found))


def _possible(name: str, value: float, body: Body) -> bool:
    if name in AXLES:
        low, high = COEFFICIENTS
        return low < value / body.load(name) < high
    low, high = INERTIAS
    return low < value / (body.mass * body.cg_to_front_axle * body.cg_to_rear_axle) < high


def _balances(points: ForcePoints, use: NDArray[np.bool_], body: Body) -> dict[str, float]:
    """Least squares of force and moment balance together; the moment is divided by L to weigh alike."""
    front, rear = points.front_slip_angle[use], points.rear_slip_angle[use]
    turning, across = points.yaw_acceleration[use], points.lateral_acceleration[use]
    front = front * points.cosine[use]
    length, one, none = body.wheelbase, np.ones(front.size), np.zeros(front.size)
    force = np.column_stack([front, rear, none, one, none])
    share = (body.cg_to_front_axle / length, body.cg_to_rear_axle / length)
    moment = np.column_stack([share[0] * front, -share[1] * rear, -turning / length, none, one])
    right = np.concatenate([body.mass * across, none])
    if body.yaw_inertia is not None:
        right[front.size :] = body.yaw_inertia * turning / length
        moment[:, 2] = 0.0
    matrix = np.concatenate([force, moment])
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
    return {"front": float(solution[0]), "rear": float(solution[1]), "yaw_inertia": float(solution[2])}


def understeer(motions: Sequence[SmoothMotion], body: Body) -> tuple[float | None, float | None]:
    """Understeer gradient K [rad s²/m] and steering offset -δ_0 [rad], None where nothing is steady."""
    columns = [
        (
            motion.road_wheel_angle - body.wheelbase * motion.yaw_rate / motion.speed,
            motion.lateral_acceleration,
            use & (np.abs(motion.yaw_acceleration) < STEADY),
        )
        for motion, use in zip(motions, gentle(motions), strict=True)
    ]
    if not columns:
        return None, None
    angle, across, use = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    if np.count_nonzero(use) < FEWEST or np.std(across[use]) < 0.1:
        return None, None
    gradient, level = np.polyfit(across[use], angle[use], 1)
    return float(gradient), float(np.clip(-level, -OFFSET, OFFSET))


def _usual_stiffness(body: Body, gradient: float | None) -> dict[str, float]:
    """Usual stiffness of the rear axle; of the front axle what the understeer gradient makes of it."""
    rear = TYPICAL_COEFFICIENT * body.load("rear")
    front = TYPICAL_COEFFICIENT * body.load("front")
    if gradient is not None:
        compliance = (
            gradient * body.wheelbase / body.mass + body.cg_to_front_axle / rear
        ) / body.cg_to_rear_axle
        if compliance > 0 and _possible("front", 1 / compliance, body):
            front = 1 / compliance
    return {"front": front, "rear": rear}


# --- curves ---------------------------------------------------------------------------------------


def _largest_force(axle: str, points: ForcePoints) -> float:
    force = np.abs(points.force(axle)[points.valid])
    return float(np.quantile(force, 0.995)) if force.size else 0.0


def _usual(kind: str, axle: str, points: ForcePoints, linear: LinearStart, body: Body) -> dict[str, float]:
    """Parameters of a kind with the stiffness found and a usual peak."""
    stiffness = linear.stiffness[axle]
    peak = max(FRICTION * body.load(axle), 1.15 * _largest_force(axle, points))
    known = {
        "cornering_stiffness": stiffness,
        "peak_force": peak,
        "saturation_slip": peak / stiffness,
        "shape": SHAPE,
        "curvature": CURVATURE,
    }
    return {name: known[name] for name in TYRES[kind].names}


def _fitted(kind: str) -> Callable[[str, ForcePoints, LinearStart, Body], dict[str, float]]:
    def start(axle: str, points: ForcePoints, linear: LinearStart, body: Body) -> dict[str, float]:
        usual = _usual(kind, axle, points, linear, body)
        slip, force, spread = binned(points, axle)
        if slip.size < BINS // 2:
            return usual
        fitted = _curve(kind, slip, force, spread, usual)
        if not _believable(fitted, usual, axle, points, body):
            return usual
        if "saturation_slip" in fitted:  # beyond what was driven nothing tells it: not further than needed
            seen = 2.0 * float(np.max(np.abs(slip)))
            fitted["saturation_slip"] = min(fitted["saturation_slip"], seen)
        return fitted

    return start


def binned(points: ForcePoints, axle: str) -> tuple[Array, Array, Array]:
    """Median slip angle [rad] and force [N] in bins of slip angle, and the spread of the medians [N]."""
    use = points.valid
    slip, force = points.slip_angle(axle)[use], points.force(axle)[use]
    if slip.size < FEWEST:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    low, high = (float(end) for end in np.quantile(slip, [0.002, 0.998]))
    edges = np.linspace(low, high, BINS + 1)
    which = np.digitize(slip, edges) - 1
    rows = [
        (float(np.median(slip[own])), float(np.median(force[own])), float(np.std(force[own])))
        for own in (which == k for k in range(BINS))
        if np.count_nonzero(own) >= 10
    ]
    found = np.array(rows).reshape(-1, 3)
    return found[:, 0], found[:, 1], found[:, 2]


def _curve(
    kind: str, slip: Array, force: Array, spread: Array, start: Mapping[str, float]
) -> dict[str, float]:
    """Curve through bins, free to move along both axes (offsets of steering and accelerometer).

    Shape and curvature stay: from points that end before the peak they are known only jointly with it.
    """
    free = [name for name in start if name not in ("shape", "curvature")]
    size = np.array([start[name] for name in free])
    weight = 1 / (spread + 0.02 * np.max(np.abs(force)))
    reach = float(np.ptp(force))

    def values(x: Array) -> dict[str, float]:
        return {**start, **dict(zip(free, (x[:-2] * size).tolist(), strict=True))}

    def residual(x: Array) -> Array:
        modelled = axle_force(kind, slip + 0.01 * float(x[-2]), values(x))[0] + float(x[-1]) * reach
        return np.asarray((modelled - force) * weight)

    begin = np.append(np.ones(size.size), [0.0, 0.0])
    low, high = np.append(0.1 * begin[:-2], [-5.0, -0.5]), np.append(10.0 * begin[:-2], [5.0, 0.5])
    return values(least_squares(residual, begin, bounds=(low, high), loss="soft_l1").x)


def _believable(
    values: Mapping[str, float],
    usual: Mapping[str, float],
    axle: str,
    points: ForcePoints,
    body: Body,
) -> bool:
    """Whether the stiffness is near that of gentle driving, and the peak not below what was seen."""
    stiffness = values["cornering_stiffness"]
    near = 0.4 < stiffness / usual["cornering_stiffness"] < 2.5
    peak = values.get("peak_force", stiffness * values.get("saturation_slip", np.inf))
    return (
        near
        and _possible(axle, stiffness, body)
        and 0.9 * _largest_force(axle, points) < peak < (5 * body.load(axle))
    )


def _linear(axle: str, points: ForcePoints, linear: LinearStart, body: Body) -> dict[str, float]:
    return _usual("linear", axle, points, linear, body)


AXLE_STARTS: dict[str, Callable[[str, ForcePoints, LinearStart, Body], dict[str, float]]] = {
    kind: _linear if kind == "linear" else _fitted(kind) for kind in TYRES
}
