"""Whether the signals of a run describe one vehicle: sign, unit and axes, before anything is fitted.

Signals that must agree are compared below about 2 Hz while the vehicle moves:

    yaw rate               v δ/L                   turns with the road wheels (2.2), less for understeer
    derivative of heading  yaw rate                counted counterclockwise
    lateral acceleration   v r                     (less v̇_y, small at low frequency)
    speed of the position  v
    course of the position heading                 on average, where the slip is small; turns the same way
    lateral velocity       velocity of the position across the heading; else its derivative a_y - v r

Each pair gives a ratio (of standard deviations, with the sign of the correlation), a correlation and, where
it is clearly wrong, what to change. Of the four signals that tell the turning the yaw rate is compared with
each of the others: who disagrees alone is wrong; if all disagree the yaw rate is. If there is only one other,
nothing tells which of the two is wrong.

A signal that is later than the others by 0.1 s for certain is not used either: a late yaw rate looks like a
slow vehicle. Who looks for lags in the fit itself keeps it (``refuse_late``). Nothing is shifted: only what
the settings state as a latency is taken out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.experiments.comparison import (
    FEWEST,
    FIX,
    POSITION,
    Finding,
    Pair,
    Scene,
    Verdict,
    compare,
    meaning,
    refused,
)
from ident.experiments.plausible_place import lateral_velocity, translation
from ident.signals.motion import Motion
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]

RATE = 5.0  # [1/s] of the comparison; what is faster than 0.35 of it is filtered out
LEAST_SPEED = 3.0  # [m/s]
PER_AXLE_DISTANCE = (1.0, 12.0)  # [m] wheelbase, where it is not known
LATE_DOUBTED, LATE_REFUSED = 0.03, 0.1  # [s]

MAY_BE_LATE = ("yaw_rate", "lateral_acceleration", "position")


def check_plausibility(
    run: Run, steering: Signal, speed: Signal, *, refuse_late: bool = True
) -> list[Finding]:
    """Compare the signals of a run that must agree.

    Parameters
    ----------
    steering : road-wheel angle [rad]; speed : [m/s], forward positive
    refuse_late : False: a late signal is doubted, however late it is

    Returns
    -------
    one finding for each pair that the run holds and excites enough to tell (a correlation above 0.8)
    """
    scene = _scene(run, steering, speed)
    moving = translation(scene)
    if "speed" in refused(moving):
        return moving
    findings = [*_turning(scene), *moving, *lateral_velocity(scene), *_late(run, refuse_late=refuse_late)]
    return [_with_derivative(each) for each in findings] if yaw_rate_is_derived(run) else findings


def yaw_rate_is_derived(run: Run) -> bool:
    """Whether the yaw rate was not measured but is the derivative of the heading."""
    health = run.health.signals.get("yaw_rate")
    return health is not None and health.source.startswith("derivative")


def _with_derivative(finding: Finding) -> Finding:
    """A heading that is wrong has a wrong derivative."""
    if "heading" not in finding.signals:
        return finding
    return replace(finding, signals=(*finding.signals, "yaw_rate"))


def _scene(run: Run, steering: Signal, speed: Signal) -> Scene:
    names = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
    signals = {name: run.signals[name] for name in names if name in run.signals and not run.signals[name].raw}
    if yaw_rate_is_derived(run):
        signals.pop("yaw_rate", None)
    signals |= {"road_wheel_angle": steering, "speed": speed}
    motion = Motion({name: signal for name, signal in signals.items() if len(signal.time) > FEWEST})
    last = max(float(signal.time[-1]) for signal in signals.values() if len(signal.time))
    grid = np.arange(0.0, last, 1 / RATE)
    series = {name: motion.at(name, grid, RATE) for name in motion.signals}
    for name in ("heading", "yaw_rate", "position_x", "position_y", "lateral_velocity"):
        if name in motion.signals:
            series[f"{name}_rate"] = motion.derivative(name, grid, RATE)
    moving = np.nan_to_num(series.get("speed", np.zeros(len(grid)))) > LEAST_SPEED
    series = {name: np.where(moving, values, np.nan) for name, values in series.items()}
    wheelbase = run.vehicle.wheelbase if run.vehicle else None
    return Scene(series, wheelbase, _arm(run.vehicle, signals.get("lateral_velocity")))


def _arm(vehicle: Vehicle | None, lateral_velocity: Signal | None) -> float | None:
    """How far the point of the lateral velocity is before the IMU [m], None where that is not known."""
    if vehicle is None or lateral_velocity is None or lateral_velocity.at is None:
        return None
    imu = vehicle.imu_position[0] if vehicle.imu_position else 0.0
    if lateral_velocity.at == "cg":
        return -imu
    return None if vehicle.cg_to_rear_axle is None else -vehicle.cg_to_rear_axle - imu


# --- turning: who of four disagrees ---------------------------------------------------------------


def _turning(scene: Scene) -> list[Finding]:
    """Yaw rate against steering, heading and lateral acceleration."""
    rate = scene.get("yaw_rate")
    if rate is None:
        rate = scene.get("heading_rate")
    if rate is None:
        return []
    pairs = {name: pair for name, pair in _turning_pairs(scene, rate[0]).items() if pair is not None}
    wrong = {name: pair for name, pair in pairs.items() if pair.off(*_range_of(name, scene))}
    right = [name for name, pair in pairs.items() if pair.certain and name not in wrong]
    subject = "yaw_rate" if "yaw_rate" in scene.series else "heading"
    findings = [_fine(name, subject, pairs[name], scene) for name in right]
    if len(wrong) > 1 and not right:
        return [*findings, _all_disagree(subject, wrong)]
    if right == ["heading"] and set(wrong) == {"road_wheel_angle", "lateral_acceleration"}:
        found = _speed_of_turning(wrong["road_wheel_angle"], wrong["lateral_acceleration"])
        if found is not None:
            return [*findings, found]
    return [*findings, *(_one_disagrees(name, subject, pair, bool(right)) for name, pair in wrong.items())]


def _turning_pairs(scene: Scene, rate: Array) -> dict[str, Pair | None]:
    """Each of the others over what the yaw rate makes expect."""
    pairs: dict[str, Pair | None] = {}
    driven = scene.get("road_wheel_angle", "speed")
    if driven is not None:
        kinematic = np.where(_gentle(driven[1] * rate), rate * (scene.wheelbase or 1.0), np.nan)
        pairs["road_wheel_angle"] = compare(driven[1] * driven[0], kinematic, 0.02)
    heading = scene.get("yaw_rate", "heading_rate")
    if heading is not None:
        pairs["heading"] = compare(heading[1], heading[0], 0.005)
    across = scene.get("lateral_acceleration", "speed")
    if across is not None:
        pairs["lateral_acceleration"] = compare(across[0], across[1] * rate, 0.1)
    return pairs


def _gentle(acceleration: Array) -> NDArray[np.bool_]:
    """Where the tyres slip little, or at least less than half of the time."""
    size = np.abs(acceleration)
    known = np.isfinite(size)
    return np.asarray(size <= max(2.0, float(np.median(size[known])) if known.any() else 0.0))


def _range_of(name: str, scene: Scene) -> tuple[float, float]:
    """Between which ratios a signal is possible: steering less by oversteer, more by understeer."""
    if name == "road_wheel_angle":
        return (0.4, 4.0) if scene.wheelbase else (0.4 * PER_AXLE_DISTANCE[0], 4.0 * PER_AXLE_DISTANCE[1])
    return (0.5, 2.0)


WANTED = {
    "road_wheel_angle": "speed times road_wheel_angle over the wheelbase times the yaw rate",
    "heading": "derivative of the heading over the yaw rate",
    "lateral_acceleration": "lateral acceleration over speed times yaw rate",
}


def _fine(name: str, subject: str, pair: Pair, scene: Scene) -> Finding:
    low, high = (0.7, 2.0) if name == "road_wheel_angle" else (0.85, 1.18)
    doubtful = not low <= pair.ratio <= high
    if name == "road_wheel_angle" and scene.wheelbase is None:
        doubtful = False
    text = f"{WANTED[name]} is {pair.ratio:.3g} (correlation {pair.correlation:.2f}), expected about 1"
    if doubtful and name == "road_wheel_angle":
        text += ": check the steering ratio and the distances of the axles in vehicle.yaml"
    elif doubtful:
        text += f": check the scale of {name} and {subject}"
    signals = (name,) if doubtful else ()
    return Finding(
        WANTED[name], "warning" if doubtful else "fine", signals, pair.ratio, pair.correlation, text
    )


def _all_disagree(subject: str, wrong: Mapping[str, Pair]) -> Finding:
    name = "heading" if "heading" in wrong else next(iter(wrong))
    pair = wrong[name]
    others = ", ".join(wrong)
    text = (
        f"{subject} disagrees with {others}: they are {_times(pair.ratio)} what it says"
        f"{meaning(pair.ratio)}: {FIX} of {subject} in channels.yaml"
    )
    return Finding(WANTED[name], "refused", (subject,), pair.ratio, pair.correlation, text)


def _speed_of_turning(steering: Pair, acceleration: Pair) -> Finding | None:
    """Steering and lateral acceleration are off by a factor and its inverse: it is the speed between them."""
    ratio = float(np.sqrt(abs(steering.ratio / acceleration.ratio)))
    if steering.ratio * acceleration.ratio < 0 or not 0.4 < steering.ratio * acceleration.ratio < 2.5:
        return None
    text = (
        f"the speed is about {ratio:.2g} times what yaw rate, steering and lateral acceleration need"
        f"{meaning(ratio)}: check its unit in channels.yaml"
    )
    return Finding("speed of turning", "refused", ("speed",), ratio, acceleration.correlation, text)


def _one_disagrees(name: str, subject: str, pair: Pair, others_agree: bool) -> Finding:
    culprit = name if others_agree else f"{name} or {subject}"
    text = (
        f"{WANTED[name]} is {pair.ratio:.3g} (correlation {pair.correlation:.2f}), need about 1"
        f"{meaning(pair.ratio, name)}: {FIX} of {culprit} in channels.yaml"
    )
    signals = (name,) if others_agree else (name, subject)
    return Finding(WANTED[name], "refused", signals, pair.ratio, pair.correlation, text)


def _times(ratio: float) -> str:
    return "opposite to" if -2 < ratio < -0.5 else f"{ratio:.3g} times"


def _late(run: Run, *, refuse_late: bool) -> list[Finding]:
    """Signals that are late for certain."""
    findings = []
    for each in run.health.latencies:
        delay, std = each.delay.value, each.delay.std
        names = POSITION if each.signal == "position" else (each.signal,)
        if (
            delay is None
            or std is None
            or each.delay.status != "identified"
            or each.signal not in MAY_BE_LATE
        ):
            continue
        if abs(delay) < max(LATE_DOUBTED, 5 * std):
            continue
        late = refuse_late and abs(delay) > LATE_REFUSED
        verdict: Verdict = "refused" if late else "warning"
        limit = LATE_REFUSED if late else LATE_DOUBTED
        text = (
            f"{each.signal} is {abs(delay):.2f} s {'late' if delay > 0 else 'early'} against "
            f"{each.reference}, need less than {limit:g} s: state it as align.latency in the recipe"
            f"{_instead(each.signal)}"
        )
        findings.append(Finding(f"delay of {each.signal}", verdict, names, delay, 1.0, text))
    return findings


def _instead(signal: str) -> str:
    return ", or map yaw_rate as {derivative_of: heading}" if signal == "yaw_rate" else ""
