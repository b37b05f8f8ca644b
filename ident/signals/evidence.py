"""What the data say about a guess: units, signs, and whether signals fit each other.

Each check regresses one signal on what it should be equal or proportional to, y = k x + c; k says the unit
(57.3 where degrees were taken for radians) and the sign, the correlation how far to believe it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.signals.motion import HIGHEST_RATE, Motion
from ident.signals.signal import Run

Array = NDArray[np.float64]

BELIEVED = 0.7
SAME = 1.25
GENTLE = 3.0
MOVING = 1.0
WORST_PLACE = 0.3
WORST_CONDITION = 1e12
MIN_SAMPLES = 50
DEGREES = 180 / np.pi
ANGLE_UNITS = {1.0: "rad", DEGREES: "deg"}
RATE_UNITS = {1.0: "rad/s", DEGREES: "deg/s"}
SPEED_UNITS = {1.0: "m/s", 3.6: "km/h", 2.23694: "mph"}
ACCELERATION_UNITS = {1.0: "m/s^2", 1 / 9.80665: "g_0"}


@dataclass(frozen=True)
class Line:
    """y = k x + c over ``samples`` samples."""

    k: float
    correlation: float
    samples: int


@dataclass(frozen=True)
class Finding:
    """What a check says of a signal.

    unit : the unit that the signal seems to have, None where it cannot be told
    weight : correlation; the run with the largest decides
    value : what the check measures besides (a length, a ratio)
    """

    signal: str
    text: str
    weight: float
    unit: str | None = None
    value: float | None = None


def findings(runs: list[Run]) -> dict[str, list[Finding]]:
    """All findings on these runs, of each check the one of the run that shows it best, by signal."""
    best: dict[tuple[str, str], Finding] = {}
    motions = [Motion({name: s for name, s in run.signals.items() if not s.raw}) for run in runs]
    for run, motion in zip(runs, motions, strict=True):
        for name, check in CHECKS.items():
            for found in check(motion):
                key = (name, found.signal)
                if key not in best or found.weight > best[key].weight:
                    best[key] = Finding(
                        found.signal, f"{found.text} ({run.name})", found.weight, found.unit, found.value
                    )
    by_signal: dict[str, list[Finding]] = {}
    point = _reference_point(motions)
    for found in [*best.values(), *([point] if point else [])]:
        by_signal.setdefault(found.signal, []).append(found)
    return by_signal


def regress(y: Array, x: Array) -> Line | None:
    """Fit y = k x + c where both are finite, None below 50 samples or without any motion."""
    use = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(use) < MIN_SAMPLES:
        return None
    x, y = x[use] - x[use].mean(), y[use] - y[use].mean()
    x_x, y_y, x_y = float(x @ x), float(y @ y), float(x @ y)
    if x_x <= 0 or y_y <= 0:
        return None
    return Line(x_y / x_x, x_y / np.sqrt(x_x * y_y), len(x))


def _against(signal: str, line: Line | None, other: str, units: dict[float, str]) -> Iterator[Finding]:
    """Say whether a signal is what it should equal, or that in another unit, or reversed."""
    if line is None:
        return
    text = f"{line.k:.3g} times {other}, correlation {line.correlation:.3f}"
    if abs(line.correlation) < BELIEVED:
        yield Finding(signal, f"tells nothing: {text}", abs(line.correlation))
        return
    unit = next((unit for k, unit in units.items() if 1 / SAME < abs(line.k) / k < SAME), None)
    sign = ", SIGN REVERSED" if line.k < 0 else ""
    yield Finding(signal, f"{text}{sign}", abs(line.correlation), unit)


def _yaw_rate(motion: Motion) -> Iterator[Finding]:
    if motion.has("yaw_rate", "heading"):
        grid, rate = motion.grid("yaw_rate", "heading")
        line = regress(motion.at("yaw_rate", grid, rate), motion.derivative("heading", grid, rate))
        yield from _against("yaw_rate", line, "the derivative of the heading", RATE_UNITS)


def _speed(motion: Motion) -> Iterator[Finding]:
    for name in ("speed", "longitudinal_velocity"):
        if motion.has(name, "position_x", "position_y"):
            grid, rate = motion.grid(name, "position_x", "position_y")
            over_ground = np.hypot(
                motion.derivative("position_x", grid, rate), motion.derivative("position_y", grid, rate)
            )
            line = regress(motion.at(name, grid, rate), over_ground)
            yield from _against(name, line, "the speed of the position", SPEED_UNITS)


def _lateral_acceleration(motion: Motion) -> Iterator[Finding]:
    names = ("lateral_acceleration", "speed", "yaw_rate")
    if motion.has(*names):
        grid, rate = motion.grid(*names)
        late, speed, yaw_rate = (motion.at(name, grid, rate) for name in names)
        line = regress(late, speed * yaw_rate)
        yield from _against("lateral_acceleration", line, "speed x yaw rate", ACCELERATION_UNITS)


def _steering(motion: Motion) -> Iterator[Finding]:
    """Speed x angle / yaw rate is the wheelbase, times the steering ratio for the steering wheel."""
    for name in ("steering_wheel_angle", "road_wheel_angle", "road_wheel_angle_left"):
        if not motion.has(name, "speed", "yaw_rate"):
            continue
        grid, rate = motion.grid(name, "speed", "yaw_rate")
        angle, speed, yaw_rate = (motion.at(each, grid, rate) for each in (name, "speed", "yaw_rate"))
        gentle = (np.abs(speed * yaw_rate) < GENTLE) & (speed > MOVING)
        line = regress(np.where(gentle, yaw_rate, np.nan), speed * angle)
        if line is None or line.k == 0:
            continue
        yield _length(name, 1 / line.k, line.correlation)


def _length(name: str, length: float, correlation: float) -> Finding:
    if abs(correlation) < BELIEVED:
        text = f"tells nothing: correlation with yaw rate / speed {correlation:.3f}"
        return Finding(name, text, abs(correlation))
    what = "steering ratio x wheelbase" if name.startswith("steering") else "wheelbase"
    longest = 400.0 if name.startswith("steering") else 15.0
    degrees = abs(length) > longest
    metres = abs(length) / (DEGREES if degrees else 1.0)
    sign = ", SIGN REVERSED" if length < 0 else ""
    text = (
        f"{what} {metres:.3g} m from the yaw rate below {GENTLE:g} m/s², correlation {correlation:.3f}{sign}"
    )
    return Finding(name, text, abs(correlation), "deg" if degrees else "rad", metres)


def _request(motion: Motion) -> Iterator[Finding]:
    for kind in ("steering_wheel", "road_wheel"):
        names = (f"{kind}_request", f"{kind}_angle")
        if not motion.has(*names):
            continue
        grid, rate = motion.grid(*names)
        request, angle = (motion.at(name, grid, rate) for name in names)
        lines = [
            (lag, line)
            for lag in range(min(round(rate), len(grid) // 2))
            if (line := regress(angle[lag:], request[: len(request) - lag])) is not None
        ]
        if lines:
            lag, line = max(lines, key=lambda each: each[1].correlation)
            text = f"the angle {lag / rate:.2f} s later is {line.k:.3g} times it"
            text += f", correlation {line.correlation:.3f}"
            yield Finding(names[0], text, line.correlation, None, line.k)


def _ratio(motion: Motion) -> Iterator[Finding]:
    names = ("steering_wheel_angle", "road_wheel_angle")
    if not motion.has(*names):
        names = ("steering_wheel_angle", "road_wheel_angle_left")
    if motion.has(*names):
        grid, rate = motion.grid(*names)
        line = regress(motion.at(names[0], grid, rate), motion.at(names[1], grid, rate))
        if line is not None and line.correlation > BELIEVED:
            text = f"{line.k:.3g} times {names[1]}, correlation {line.correlation:.3f}"
            yield Finding("steering_wheel_angle", text, line.correlation, None, line.k)


def _reference_point(motions: list[Motion]) -> Finding | None:
    """Fit v_y = x r - c v² r + offset to gentle driving in all runs: the point is x before the rear axle."""
    tables = [table for motion in motions if (table := _gentle(motion)) is not None]
    if not tables:
        return None
    lateral = np.concatenate([table[:, 0] for table in tables])
    columns = np.concatenate([table[:, 1:] for table in tables])
    normal = columns.T @ columns
    if len(lateral) < MIN_SAMPLES or np.linalg.cond(normal) > WORST_CONDITION:
        return None
    fitted = np.linalg.solve(normal, columns.T @ lateral)
    left = lateral - columns @ fitted
    # The residual is coloured: one independent sample a second is counted.
    std = float(np.sqrt(np.mean(left**2) * HIGHEST_RATE * np.linalg.inv(normal)[0, 0]))
    if std > WORST_PLACE:
        return None
    text = f"its point lies {fitted[0]:+.2f} ± {2 * std:.2f} m before the rear axle, from v_y / yaw rate"
    return Finding("lateral_velocity", text, 1.0, None, float(fitted[0]))


def _gentle(motion: Motion) -> Array | None:
    """Columns v_y, r, v² r, centred, where the lateral acceleration is low; None where they are not there."""
    names = ("lateral_velocity", "speed", "yaw_rate")
    if not motion.has(*names):
        return None
    grid, rate = motion.grid(*names)
    lateral, speed, yaw_rate = (motion.at(name, grid, rate) for name in names)
    use = np.isfinite(lateral) & (speed > MOVING) & (np.abs(speed * yaw_rate) < GENTLE)
    table = np.column_stack([lateral, yaw_rate, speed**2 * yaw_rate])[use]
    return table - table.mean(axis=0) if len(table) else None


CHECKS: dict[str, Callable[[Motion], Iterator[Finding]]] = {
    "yaw_rate": _yaw_rate,
    "speed": _speed,
    "lateral_acceleration": _lateral_acceleration,
    "steering": _steering,
    "request": _request,
    "ratio": _ratio,
}
