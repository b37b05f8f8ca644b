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
slow vehicle. Nothing is shifted: only what the settings state as a latency is taken out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.signals.motion import Motion
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]

RATE = 5.0  # [1/s] of the comparison; what is faster than 0.35 of it is filtered out
LEAST_SPEED = 3.0  # [m/s]
FEWEST = 25
CERTAIN = 0.8
PER_AXLE_DISTANCE = (1.0, 12.0)  # [m] wheelbase, where it is not known
KMH = 3.6
FACTORS = (
    (57.29578, "degrees taken as radians"),
    (9.80665, "g taken as m/s², or the reverse"),
    (KMH, "km/h taken as m/s"),
)
FACTOR_TOLERANCE = 1.25
FIX = "check unit and sign (left positive; invert: true turns it)"
POSSIBLE_SIDEWAYS = (0.2, 5.0)
LATE_DOUBTED, LATE_REFUSED = 0.03, 0.1  # [s]

POSITION = ("position_x", "position_y")
MAY_BE_LATE = ("yaw_rate", "lateral_acceleration", "position")

Verdict = Literal["fine", "warning", "refused"]


@dataclass(frozen=True)
class Finding:
    """What the comparison of two signals gives.

    check : what was compared
    verdict : "refused" where one of them is certainly wrong
    signals : what should not be used, or is doubted; empty where all is well
    ratio : measured over expected; correlation : of the two; for an angle ``ratio`` is the difference [rad]
    text : one line, with the measured and the needed value and what to do
    """

    check: str
    verdict: Verdict
    signals: tuple[str, ...]
    ratio: float
    correlation: float
    text: str


@dataclass(frozen=True)
class _Pair:
    """Ratio and correlation of two series."""

    ratio: float
    correlation: float

    @property
    def certain(self) -> bool:
        return abs(self.correlation) > CERTAIN

    def off(self, low: float, high: float) -> bool:
        """Whether the ratio is certainly no number between these, as far as the correlation tells."""
        return self.certain and not low <= self.ratio <= high


@dataclass(frozen=True)
class _Scene:
    """The signals of a run on one grid, where the vehicle moves; NaN elsewhere."""

    series: Mapping[str, Array]
    wheelbase: float | None
    arm: float | None  # from the IMU forward to the point of the lateral velocity [m]

    def get(self, *names: str) -> list[Array] | None:
        found = [self.series[name] for name in names if name in self.series]
        return found if len(found) == len(names) else None


def check_plausibility(run: Run, steering: Signal, speed: Signal) -> list[Finding]:
    """Compare the signals of a run that must agree.

    Parameters
    ----------
    steering : road-wheel angle [rad]; speed : [m/s], forward positive

    Returns
    -------
    one finding for each pair that the run holds and excites enough to tell (a correlation above 0.8)
    """
    scene = _scene(run, steering, speed)
    moving = _translation(scene)
    if "speed" in refused(moving):
        return moving
    return [*_turning(scene), *moving, *_lateral_velocity(scene), *_late(run)]


def refused(findings: list[Finding]) -> dict[str, str]:
    """Signal -> why it is not to be used."""
    return {name: each.text for each in findings if each.verdict == "refused" for name in each.signals}


def _scene(run: Run, steering: Signal, speed: Signal) -> _Scene:
    names = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
    signals = {name: run.signals[name] for name in names if name in run.signals and not run.signals[name].raw}
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
    return _Scene(series, wheelbase, _arm(run.vehicle, signals.get("lateral_velocity")))


def _arm(vehicle: Vehicle | None, lateral_velocity: Signal | None) -> float | None:
    """How far the point of the lateral velocity is before the IMU [m], None where that is not known."""
    if vehicle is None or lateral_velocity is None or lateral_velocity.at is None:
        return None
    imu = vehicle.imu_position[0] if vehicle.imu_position else 0.0
    if lateral_velocity.at == "cg":
        return -imu
    return None if vehicle.cg_to_rear_axle is None else -vehicle.cg_to_rear_axle - imu


def _compare(measured: Array, expected: Array, least: float) -> _Pair | None:
    """Ratio of two series, None where both vary by less than ``least`` (a standard deviation)."""
    both = np.isfinite(measured) & np.isfinite(expected)
    if np.count_nonzero(both) < FEWEST:
        return None
    x, y = expected[both], measured[both]
    wide, high = float(np.std(x)), float(np.std(y))
    if max(wide, high) < least or min(wide, high) == 0:
        return None
    correlation = float(np.corrcoef(x, y)[0, 1])
    return _Pair(float(np.copysign(high / wide, correlation)), correlation)


# --- turning: who of four disagrees ---------------------------------------------------------------


def _turning(scene: _Scene) -> list[Finding]:
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


def _turning_pairs(scene: _Scene, rate: Array) -> dict[str, _Pair | None]:
    """Each of the others over what the yaw rate makes expect."""
    pairs: dict[str, _Pair | None] = {}
    driven = scene.get("road_wheel_angle", "speed")
    if driven is not None:
        kinematic = np.where(_gentle(driven[1] * rate), rate * (scene.wheelbase or 1.0), np.nan)
        pairs["road_wheel_angle"] = _compare(driven[1] * driven[0], kinematic, 0.02)
    heading = scene.get("yaw_rate", "heading_rate")
    if heading is not None:
        pairs["heading"] = _compare(heading[1], heading[0], 0.005)
    across = scene.get("lateral_acceleration", "speed")
    if across is not None:
        pairs["lateral_acceleration"] = _compare(across[0], across[1] * rate, 0.1)
    return pairs


def _gentle(acceleration: Array) -> NDArray[np.bool_]:
    """Where the tyres slip little, or at least less than half of the time."""
    size = np.abs(acceleration)
    known = np.isfinite(size)
    return np.asarray(size <= max(2.0, float(np.median(size[known])) if known.any() else 0.0))


def _range_of(name: str, scene: _Scene) -> tuple[float, float]:
    """Between which ratios a signal is possible: steering less by oversteer, more by understeer."""
    if name == "road_wheel_angle":
        return (0.4, 4.0) if scene.wheelbase else (0.4 * PER_AXLE_DISTANCE[0], 4.0 * PER_AXLE_DISTANCE[1])
    return (0.5, 2.0)


WANTED = {
    "road_wheel_angle": "speed times road_wheel_angle over the wheelbase times the yaw rate",
    "heading": "derivative of the heading over the yaw rate",
    "lateral_acceleration": "lateral acceleration over speed times yaw rate",
}


def _fine(name: str, subject: str, pair: _Pair, scene: _Scene) -> Finding:
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


def _all_disagree(subject: str, wrong: Mapping[str, _Pair]) -> Finding:
    name = "heading" if "heading" in wrong else next(iter(wrong))
    pair = wrong[name]
    others = ", ".join(wrong)
    text = (
        f"{subject} disagrees with {others}: they are {_times(pair.ratio)} what it says"
        f"{_meaning(pair.ratio)}: {FIX} of {subject} in channels.yaml"
    )
    return Finding(WANTED[name], "refused", (subject,), pair.ratio, pair.correlation, text)


def _speed_of_turning(steering: _Pair, acceleration: _Pair) -> Finding | None:
    """Steering and lateral acceleration are off by a factor and its inverse: it is the speed between them."""
    ratio = float(np.sqrt(abs(steering.ratio / acceleration.ratio)))
    if steering.ratio * acceleration.ratio < 0 or not 0.4 < steering.ratio * acceleration.ratio < 2.5:
        return None
    text = (
        f"the speed is about {ratio:.2g} times what yaw rate, steering and lateral acceleration need"
        f"{_meaning(ratio)}: check its unit in channels.yaml"
    )
    return Finding("speed of turning", "refused", ("speed",), ratio, acceleration.correlation, text)


def _one_disagrees(name: str, subject: str, pair: _Pair, others_agree: bool) -> Finding:
    culprit = name if others_agree else f"{name} or {subject}"
    text = (
        f"{WANTED[name]} is {pair.ratio:.3g} (correlation {pair.correlation:.2f}), need about 1"
        f"{_meaning(pair.ratio, name)}: {FIX} of {culprit} in channels.yaml"
    )
    signals = (name,) if others_agree else (name, subject)
    return Finding(WANTED[name], "refused", signals, pair.ratio, pair.correlation, text)


def _times(ratio: float) -> str:
    return "opposite to" if -2 < ratio < -0.5 else f"{ratio:.3g} times"


def _meaning(ratio: float, name: str = "") -> str:
    """What a factor looks like, in words."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else np.inf
    if size < 2 and ratio < 0:
        return ", the sign is turned"
    known = [what for factor, what in FACTORS if factor / FACTOR_TOLERANCE < size < factor * FACTOR_TOLERANCE]
    if name == "road_wheel_angle" and 8 < ratio < 35:
        known = ["a steering-wheel angle taken as that of the road wheel, or a wrong steering ratio"]
    turned = ", and the sign is turned" if ratio < 0 else ""
    return f", as of {known[0]}{turned}" if known else turned


# --- moving ---------------------------------------------------------------------------------------


def _translation(scene: _Scene) -> list[Finding]:
    """Position against speed, heading and yaw rate."""
    found = scene.get("position_x_rate", "position_y_rate", "speed")
    if found is None:
        return []
    east, north, speed = found
    over_ground = np.hypot(east, north)
    both = np.isfinite(over_ground) & np.isfinite(speed)
    if np.count_nonzero(both) < FEWEST:
        return []
    ratio = float(np.median(over_ground[both] / speed[both]))
    first = _speed_finding(ratio)
    if first.verdict == "refused":
        return [first]
    return [first, *_course(scene, np.arctan2(north, east), both)]


def _speed_finding(ratio: float) -> Finding:
    check = "speed of the position over the speed"
    text = f"{check} is {ratio:.4g}, expected 1"
    if 0.7 < ratio < 1.4:
        verdict: Verdict = "fine" if abs(ratio - 1) < 0.03 else "warning"
        doubted = () if verdict == "fine" else ("speed", *POSITION)
        hint = "" if verdict == "fine" else ": tyre radius, or the scale of the position?"
        return Finding(check, verdict, doubted, ratio, 1.0, text + hint)
    if abs(max(ratio, 1 / ratio) / KMH - 1) < 0.05:
        hint = f"{_meaning(ratio)}: check the unit of the speed in channels.yaml"
        return Finding(check, "refused", ("speed",), ratio, 1.0, text + hint)
    hint = ": check the unit of the position in channels.yaml"
    return Finding(check, "refused", POSITION, ratio, 1.0, text + hint)


def _course(scene: _Scene, course: Array, both: NDArray[np.bool_]) -> list[Finding]:
    """Course against heading: turning the same way, and the same direction where little slips."""
    found = scene.get("heading", "speed", "heading_rate")
    if found is None:
        return []
    heading, speed, rate = found
    use = both & np.isfinite(heading) & np.isfinite(rate)
    straight = use & (np.abs(speed * rate) < max(1.0, float(np.nanmedian(np.abs(speed * rate)))))
    if np.count_nonzero(straight) < FEWEST:
        return []
    same, turned = (_concentration(course[use] - sign * heading[use]) for sign in (1, -1))
    mean = _direction(course[straight] - heading[straight])
    return [_course_finding(same, turned, mean)]


def _concentration(angles: Array) -> float:
    return float(np.abs(np.mean(np.exp(1j * angles))))


def _direction(angles: Array) -> float:
    return float(np.angle(np.sum(np.exp(1j * angles))))


def _course_finding(same: float, turned: float, mean: float) -> Finding:
    check = "course of the position minus heading, where little slips"
    if turned > same + 0.1 and same < 0.95:
        text = (
            f"the course of the position turns against the heading (concentration {same:.2f}, mirrored "
            f"{turned:.2f}): x and y are exchanged or one has the wrong sign: check them in channels.yaml"
        )
        return Finding(check, "refused", POSITION, mean, same, text)
    text = f"{check} is {mean:.3f} rad, expected 0"
    if abs(mean) > 0.35:
        hint = ": count the heading from x counterclockwise, or exchange x and y in channels.yaml"
        return Finding(check, "refused", POSITION, mean, same, text + hint)
    if abs(mean) > 0.02:
        hint = ": the heading's zero, the antenna's place or a late position; it looks like a slip angle"
        return Finding(check, "warning", ("heading", *POSITION), mean, same, text + hint)
    return Finding(check, "fine", (), mean, same, text)


def _lateral_velocity(scene: _Scene) -> list[Finding]:
    for what, pair in (_sideways_by_position(scene), _sideways_by_acceleration(scene)):
        if pair is None or not pair.certain:
            continue
        check = f"lateral velocity over {what}"
        text = f"{check} is {pair.ratio:.3g} (correlation {pair.correlation:.2f}), expected about 1"
        if not pair.off(*POSSIBLE_SIDEWAYS):
            return [Finding(check, "fine", (), pair.ratio, pair.correlation, text)]
        hint = f"{_meaning(pair.ratio)}: {FIX} of it in channels.yaml"
        return [Finding(check, "refused", ("lateral_velocity",), pair.ratio, pair.correlation, text + hint)]
    return []


def _sideways_by_position(scene: _Scene) -> tuple[str, _Pair | None]:
    """Both less what follows v r and v: a late position looks like v r, a turned sensor like v."""
    what = "velocity of the position across the heading"
    found = scene.get(
        "lateral_velocity", "position_x_rate", "position_y_rate", "heading", "speed", "heading_rate"
    )
    if found is None:
        return what, None
    measured, east, north, heading, speed, rate = found
    across = north * np.cos(heading) - east * np.sin(heading)
    known = np.isfinite(measured + across + speed * rate)
    if np.count_nonzero(known) < FEWEST:
        return what, None
    others = np.column_stack([np.ones(len(speed)), speed, speed * rate])[known]
    return what, _compare(_beside(measured[known], others), _beside(across[known], others), 0.03)


def _beside(values: Array, others: Array) -> Array:
    """What ``others`` (n, k) do not explain of values (n,)."""
    return np.asarray(values - others @ np.linalg.lstsq(others, values, rcond=None)[0])


def _sideways_by_acceleration(scene: _Scene) -> tuple[str, _Pair | None]:
    what = "what lateral acceleration and yaw rate make of it"
    names = ("lateral_velocity_rate", "lateral_acceleration", "speed", "yaw_rate", "yaw_rate_rate")
    found = scene.get(*names)
    if found is None or scene.arm is None:
        return what, None
    measured, across, speed, rate, turning = found
    return what, _compare(measured, across - speed * rate + scene.arm * turning, 0.1)


def _late(run: Run) -> list[Finding]:
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
        verdict: Verdict = "refused" if abs(delay) > LATE_REFUSED else "warning"
        text = (
            f"{each.signal} is {abs(delay):.2f} s {'late' if delay > 0 else 'early'} against "
            f"{each.reference}, need less than {LATE_REFUSED:g} s: state it as align.latency in the recipe"
            f"{_instead(each.signal)}"
        )
        findings.append(Finding(f"delay of {each.signal}", verdict, names, delay, 1.0, text))
    return findings


def _instead(signal: str) -> str:
    return ", or map yaw_rate as {derivative_of: heading}" if signal == "yaw_rate" else ""
