"""Scale, bias and lag of the sensors of all runs together, each with what keeps the data from telling it.

A quantity is fitted together with the others of its sensor; one that the runs do not excite is taken as
perfect (scale one, lag zero) and the rest is fitted without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ident.experiments.sensor_comparisons import (
    accelerometer,
    gyro,
    pose,
    rests,
    speed_by_position,
    speed_by_velocity,
    steering_zero,
    with_headings,
)
from ident.experiments.sensor_fit import FEWEST_BLOCKS, Comparison, SensorFit, fit_sensor, is_instrument
from ident.experiments.sensor_series import RATE, SPEEDS, SensorSeries
from ident.signals.health import resolution

Array = NDArray[np.float64]

RELATED = 0.7  # correlation of a sensor with what is expected of it, below which its scale is not asked
LAG_TOLD, SCALE_TOLD, TURN_TOLD = 0.1, 0.15, 0.02  # standard errors above which the rest is fitted without
REST_BLOCK, FEWEST_REST_BLOCKS = 1.0, 3  # [s]

OF_POSITION = ("position_x", "position_y")
ACROSS = ("lateral_acceleration", "speed", "heading or yaw_rate", "lateral_velocity")


@dataclass(frozen=True)
class Answer:
    """One quantity of one sensor, as the data tell it.

    key : "yaw_rate scale"; signals : that take part, the sensor first
    value, std, freedom : of the quantity, None where it cannot be told, with ``why_not``
    apart : how far the truth may be to either side of the value beside the standard error
    note : what was assumed for it
    """

    key: str
    signals: tuple[str, ...]
    value: float | None
    std: float | None = None
    freedom: float = 1.0
    apart: float = 0.0
    why_not: str | None = None
    note: str | None = None

    def p_value(self, expected: float) -> float | None:
        """Of the hypothesis that the value is what it should be."""
        if self.value is None or not self.std:
            return None
        off = max(abs(self.value - expected) - self.apart, 0.0)
        return float(2 * student.sf(off / self.std, self.freedom))

    def interval(self) -> tuple[float, float] | None:
        """95 % interval."""
        if self.value is None or self.std is None:
            return None
        half = self.apart + float(student.ppf(0.975, self.freedom)) * self.std
        return self.value - half, self.value + half


def answers(runs: Sequence[SensorSeries]) -> list[Answer]:
    """Everything that the sensors of these runs tell about each other."""
    return [
        *_yaw_rate(runs),
        *_speeds(runs),
        *lateral_acceleration(runs),
        *_pose(runs),
        *_at_rest(runs),
        *_steering_zero(runs),
    ]


def _made(
    runs: Sequence[SensorSeries], make: Callable[[SensorSeries], Comparison | None]
) -> list[tuple[SensorSeries, Comparison]]:
    """Comparisons of the runs that have what is compared."""
    return [(run, made) for run in runs if (made := make(run)) is not None]


# --- yaw rate and lateral acceleration: scale, bias and lag ---------------------------------------


def _yaw_rate(runs: Sequence[SensorSeries]) -> list[Answer]:
    made = [comparison for _, comparison in _made(runs, gyro)]
    names = ("yaw_rate", "heading")
    if not made:
        return _no("no run holds a measured yaw rate and a heading", names, "scale", "bias", "lag")
    return _three(made, names, 0.005, "rad/s")


def lateral_acceleration(runs: Sequence[SensorSeries]) -> list[Answer]:
    """Scale, bias and lag of the accelerometer."""
    pairs = _made(runs, accelerometer)
    if not pairs:
        return _no(
            "no run holds a lateral acceleration, a speed and a yaw rate or heading",
            ACROSS[:1],
            "scale",
            "bias",
            "lag",
        )
    headed = with_headings(pairs)
    made = headed or [comparison for _, comparison in pairs]
    with_velocity = all(run.has("lateral_velocity") for run, _ in pairs)
    names = ACROSS if with_velocity else ACROSS[:3]
    found = _three(made, names, 0.1, "m/s²")
    if not headed:
        note = "the headings are alike: a bank of the road looks the same"
        found = [replace(one, note=note) if one.key.endswith("bias") else one for one in found]
    if not with_velocity:
        why = "no lateral velocity: the growth of the side slip looks like a lag"
        found = [replace(one, value=None, why_not=why) if one.key.endswith("lag") else one for one in found]
    return found


def _three(made: list[Comparison], names: tuple[str, ...], least: float, unit: str) -> list[Answer]:
    """Scale, bias and lag of the first signal; columns: what is expected, one, what else there may be."""
    scale, bias, lag = (f"{names[0]} {what}" for what in ("scale", "bias", "lag"))
    spread = float(np.nanstd(np.concatenate([one.columns[:, 0] for one in made])))
    if spread < least:
        why = f"what is compared varies by {spread:.2g} {unit}, need {least:g} {unit}: drive curves"
        return [
            Answer(scale, names, None, why_not=why),
            _bias(bias, names, made),
            Answer(lag, names, None, why_not=why),
        ]
    fit = _fit(made)
    related = abs(fit.correlation) > RELATED
    told = fit.lag if related and np.isfinite(fit.std[-1]) else None
    answer_lag = Answer(lag, names, told, fit.std[-1], fit.freedom[-1], why_not=_why(fit, related=related))
    if not fit.std[-1] < LAG_TOLD:
        fit = _fit(made, with_lag=False)
    if not related or not fit.std[0] < SCALE_TOLD:
        return [_of(fit, 0, scale, names, related=related), _bias(bias, names, made), answer_lag]
    return [_of(fit, 0, scale, names), _of(fit, 1, bias, names), answer_lag]


def _fit(made: list[Comparison], *, with_lag: bool = True) -> SensorFit:
    if is_instrument(made, 0):
        return fit_sensor(made, with_lag=with_lag)
    own = [replace(one, instruments=one.columns) for one in made]
    return fit_sensor(own, with_lag=with_lag, reverse=0)


def _bias(key: str, names: tuple[str, ...], made: list[Comparison]) -> Answer:
    """Bias of a sensor whose scale is taken as right and which is in time."""
    fixed = [
        replace(one, fixed=one.columns[:, 0], columns=one.columns[:, 1:], instruments=one.columns[:, 1:])
        for one in made
    ]
    return replace(
        _of(fit_sensor(fixed, with_lag=False), 0, key, names), note="its scale and time taken as right"
    )


def _of(fit: SensorFit, column: int, key: str, names: tuple[str, ...], *, related: bool = True) -> Answer:
    std = float(fit.std[column])
    if not related or not np.isfinite(std):
        return Answer(key, names, None, why_not=_why(fit, related=related))
    return Answer(
        key,
        names,
        float(fit.coefficients[column]),
        std,
        float(fit.freedom[column]),
        float(fit.apart[column]),
        note="not the same in all runs" if fit.uneven[column] else None,
    )


def _why(fit: SensorFit, *, related: bool = True) -> str | None:
    """Why a fit tells nothing, None where it does."""
    if fit.blocks < FEWEST_BLOCKS:
        return (
            f"{fit.seconds:.0f} s hold {fit.blocks} blocks of independent noise, need {FEWEST_BLOCKS}: "
            "drive longer"
        )
    if not related:
        return f"correlation {fit.correlation:.2f} with what is expected, need {RELATED:g}: drive more curves"
    return None if np.isfinite(fit.std).all() else "the runs do not vary enough to tell it from the rest"


# --- speed and position ---------------------------------------------------------------------------


def _speeds(runs: Sequence[SensorSeries]) -> list[Answer]:
    """Scale and lag of each speed, against the position where there is one."""
    found: list[Answer] = []
    for name in SPEEDS:
        alike = [run for run in runs if name == SPEEDS[0] or not _same_source(run)]
        made = [pair for run in alike if (pair := speed_by_position(run, name)) is not None]
        if made:
            found += _scale_and_lag(made, (name, *OF_POSITION))
    if any(one.signals[0] == SPEEDS[0] for one in found):
        return found
    made = [pair for _, pair in _made(runs, speed_by_velocity)]
    if made:
        return [*_scale_and_lag(made, SPEEDS), *found]
    why = "no run holds a speed and a position, nor a second speed"
    return found or _no(why, SPEEDS[:1], "scale", "lag")


def _same_source(run: SensorSeries) -> bool:
    first, second = (run.sources.get(name) for name in SPEEDS)
    return run.has(*SPEEDS) and first == second


def _scale_and_lag(made: list[Comparison], names: tuple[str, ...]) -> list[Answer]:
    width = min(one.columns.shape[1] for one in made)
    made = [replace(one, columns=one.columns[:, :width], instruments=one.columns[:, :width]) for one in made]
    fit = fit_sensor(made)
    lag = Answer(f"{names[0]} lag", names, fit.lag, fit.std[-1], fit.freedom[-1])
    if not fit.std[-1] < LAG_TOLD:
        why = "the speed varies too little to tell a lag: accelerate and brake"
        lag = Answer(f"{names[0]} lag", names, None, why_not=why)
        fit = fit_sensor(made, with_lag=False)
    return [_of(fit, 0, f"{names[0]} scale", names), lag]


def _pose(runs: Sequence[SensorSeries]) -> list[Answer]:
    """Lag of the position, direction of the heading, bias and lag of the lateral velocity."""
    alike = [run for run in runs if run.has("lateral_velocity")]
    used = alike or list(runs)
    made = [pair for _, pair in _made(used, lambda run: pose(run, with_bias=bool(alike)))]
    names = ("position", "speed", "heading", *(("lateral_velocity",) if alike else ()))
    if not made:
        why = "no run holds a position, a speed and a heading"
        return [*_no(why, names[:1], "lag"), *_no(why, ("heading",), "direction")]
    width = min(one.columns.shape[1] for one in made)
    made = [one for one in made if one.columns.shape[1] == width]
    fit = fit_sensor(made)
    lag = Answer("position lag", names, fit.lag if np.isfinite(fit.std[-1]) else None, fit.std[-1])
    lag = replace(lag, freedom=float(fit.freedom[-1]), why_not=_why(fit))
    direction = ("heading", "position", *names[3:])
    if not alike:
        return [lag, _of(fit, 1, "heading direction", direction)]
    across = ("lateral_velocity", "position", "heading")
    later = _of(fit, 2, "lateral_velocity lag", across)
    if fit.std[1] < TURN_TOLD:
        bias = _of(fit, 3, "lateral_velocity bias", across)
        bias = replace(bias, value=None if bias.value is None else -bias.value)
        return [lag, _of(fit, 1, "heading direction", direction), bias, later]
    return [lag, *_direction_alone(alike, direction, across), later]


def _direction_alone(
    runs: list[SensorSeries], direction: tuple[str, ...], across: tuple[str, ...]
) -> list[Answer]:
    """Direction where the speed varies too little to tell it from a bias of the lateral velocity."""
    made = [pair for _, pair in _made(runs, lambda run: pose(run, with_bias=False))]
    width = min(one.columns.shape[1] for one in made)
    fit = fit_sensor([one for one in made if one.columns.shape[1] == width])
    why = "the speed varies too little to tell it from a turned heading: drive at two speeds"
    note = "the speed varies little: a bias of the lateral velocity looks the same"
    return [
        replace(_of(fit, 1, "heading direction", direction), note=note),
        Answer("lateral_velocity bias", across, None, why_not=why),
    ]


# --- standstill, steering -------------------------------------------------------------------------


def _at_rest(runs: Sequence[SensorSeries]) -> list[Answer]:
    found = []
    for name in ("yaw_rate", "lateral_acceleration"):
        parts = [run.values[name][part] for run in runs if name in run.values for part in rests(run)]
        parts = [part[np.isfinite(part)] for part in parts]
        parts = [part for part in parts if part.size >= FEWEST_REST_BLOCKS * REST_BLOCK * RATE]
        key = f"{name} at rest"
        if parts:
            found.append(_mean_at_rest(key, name, parts))
        else:
            why = "no standstill of 5 s or longer: stand still for a minute"
            found.append(Answer(key, (name, "speed"), None, why_not=why))
    return found


def _mean_at_rest(key: str, name: str, parts: list[Array]) -> Answer:
    """Mean over all rests; error from blocks of ``REST_BLOCK``, or from rest to rest where that is larger."""
    blocks = [
        block.mean() for part in parts for block in np.array_split(part, int(part.size / RATE / REST_BLOCK))
    ]
    every = np.concatenate(parts)
    std, freedom = float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))), len(blocks) - 1.0
    means = np.array([part.mean() for part in parts])
    if len(means) > 2 and np.std(means, ddof=1) / np.sqrt(len(means)) > std:
        std, freedom = float(np.std(means, ddof=1) / np.sqrt(len(means))), len(means) - 1.0
    step = resolution(every) or 0.0
    quantised = step / np.sqrt(12) if np.std(every) < step / 2 else 0.0
    count = f"{len(parts)} standstill{'s' if len(parts) > 1 else ''}"
    note = f"noise {np.std(every):.2g}, {count}, {every.size / RATE:.0f} s"
    value = float(np.mean(every))
    return Answer(key, (name, "speed"), value, max(std, 1e-12), freedom, quantised, note=note)


def _steering_zero(runs: Sequence[SensorSeries]) -> list[Answer]:
    pairs = [pair for run in runs if (pair := steering_zero(run)) is not None]
    if not pairs:
        return _no(
            "no run holds a steering angle and a heading or yaw rate", ("steering_wheel_angle",), "zero"
        )
    name = pairs[0][0]
    fit = fit_sensor([made for other, made in pairs if other == name], with_lag=False)
    found = _of(replace(fit, std=fit.std[:-1]), 0, f"{name} zero", (name, "speed", "heading or yaw_rate"))
    return [found]


def _no(why: str, names: tuple[str, ...], *what: str) -> list[Answer]:
    return [Answer(f"{names[0]} {one}", names, None, why_not=why) for one in what]
