"""Whether position, heading, speed and lateral velocity of a run describe one motion.

speed of the position            v
course of the position           heading, on average where little slips; it turns the same way
lateral velocity                 velocity of the position across the heading, beside what follows v r and v:
                                 a late position looks like v r, a turned sensor like v
its derivative                   a_y - v r + (x_P - x_IMU) ṙ, where there is no position
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ident.experiments.comparison import (
    FEWEST,
    FIX,
    KMH,
    POSITION,
    Array,
    Finding,
    Pair,
    Scene,
    Verdict,
    compare,
    meaning,
)

POSSIBLE_SIDEWAYS = (0.2, 5.0)


def translation(scene: Scene) -> list[Finding]:
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
        hint = f"{meaning(ratio)}: check the unit of the speed in channels.yaml"
        return Finding(check, "refused", ("speed",), ratio, 1.0, text + hint)
    hint = ": check the unit of the position in channels.yaml"
    return Finding(check, "refused", POSITION, ratio, 1.0, text + hint)


def _course(scene: Scene, course: Array, both: NDArray[np.bool_]) -> list[Finding]:
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


def lateral_velocity(scene: Scene) -> list[Finding]:
    """Lateral velocity against the position, else against lateral acceleration and yaw rate."""
    for what, pair in (_sideways_by_position(scene), _sideways_by_acceleration(scene)):
        if pair is None or not pair.certain:
            continue
        check = f"lateral velocity over {what}"
        text = f"{check} is {pair.ratio:.3g} (correlation {pair.correlation:.2f}), expected about 1"
        if not pair.off(*POSSIBLE_SIDEWAYS):
            return [Finding(check, "fine", (), pair.ratio, pair.correlation, text)]
        hint = f"{meaning(pair.ratio)}: {FIX} of it in channels.yaml"
        return [Finding(check, "refused", ("lateral_velocity",), pair.ratio, pair.correlation, text + hint)]
    return []


def _sideways_by_position(scene: Scene) -> tuple[str, Pair | None]:
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
    return what, compare(_beside(measured[known], others), _beside(across[known], others), 0.03)


def _beside(values: Array, others: Array) -> Array:
    """What ``others`` (n, k) do not explain of values (n,)."""
    return np.asarray(values - others @ np.linalg.lstsq(others, values, rcond=None)[0])


def _sideways_by_acceleration(scene: Scene) -> tuple[str, Pair | None]:
    what = "what lateral acceleration and yaw rate make of it"
    names = ("lateral_velocity_rate", "lateral_acceleration", "speed", "yaw_rate", "yaw_rate_rate")
    found = scene.get(*names)
    if found is None or scene.arm is None:
        return what, None
    measured, across, speed, rate, turning = found
    return what, compare(measured, across - speed * rate + scene.arm * turning, 0.1)
