"""What drives the vehicle model in a run: the angle of the road wheels and the speed, from the best signals.

The road-wheel angle is the measured one; else the mean of the left and the right wheel (the two differ by the
Ackermann geometry, the bicycle has one wheel); else the steering-wheel angle through the ratio, a table
(steering wheel, road wheel) that goes on beyond its ends with its end slopes. A request is never used. The
speed is the velocity along x (the same at every point of the x axis), else the speed of the wheels.

The first of these is taken that covers nearly as much of the run, at nearly as high a rate, as the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.experiments.held_samples import without_held
from ident.signals.alignment import longest_bridge, sample
from ident.signals.signal import Run, Signal

Array = NDArray[np.float64]
Table = Sequence[Sequence[float]]

ROAD_WHEEL: tuple[tuple[str, ...], ...] = (
    ("road_wheel_angle",),
    ("road_wheel_angle_left", "road_wheel_angle_right"),
)
STEERING_WHEEL = ("steering_wheel_angle",)
SPEED: tuple[tuple[str, ...], ...] = (("longitudinal_velocity",), ("speed",))
COVERS, FAST_ENOUGH, ALWAYS_FAST = 0.9, 0.4, 20.0


@dataclass(frozen=True)
class Input:
    """One input of the model.

    signals : of which the mean is taken
    table : through which the mean goes, None: as it is
    source : what it is, for the reader
    notes : what was left out of the signals
    """

    signals: tuple[Signal, ...]
    source: str
    table: Table | None = None
    notes: tuple[str, ...] = ()

    def at(self, grid: Array, rate: float, max_gap: float) -> Array:
        """Value at the instants of a uniform grid (m,) of this rate, NaN where there is none."""
        mean = np.mean([sample(signal, grid, rate, max_gap) for signal in self.signals], axis=0)
        return mean if self.table is None else through_table(mean, self.table)


def road_wheel_input(run: Run, ratio: Table | None = None) -> Input | str:
    """Road-wheel angle of a run, or why there is none.

    Parameters
    ----------
    ratio : [[steering wheel, road wheel], ...] [rad], rising; None: that of the vehicle file
    """
    choices = [names for names in ROAD_WHEEL if _usable(run, names)]
    table = ratio or _table_of(run)
    if table and _usable(run, STEERING_WHEEL):
        choices.append(STEERING_WHEEL)
    if not choices:
        return _why_no_steering(run, with_table=bool(table))
    chosen = _best(run, choices)
    source = " and ".join(chosen)
    if chosen == STEERING_WHEEL:
        given = "the ratio found" if ratio else "the ratio of the vehicle file"
        return _input(run, chosen, f"{source} through {given}", table)
    return _input(run, chosen, source if len(chosen) == 1 else f"mean of {source}", None)


def speed_input(run: Run) -> Input | str:
    """Speed of a run, or why there is none."""
    choices = [names for names in SPEED if _usable(run, names)]
    if not choices:
        raw = [name for names in SPEED for name in names if name in run.signals]
        problem = f"{raw[0]} is a raw count" if raw else "no speed and no longitudinal_velocity"
        return f"{problem}: name its topic and unit in channels.yaml"
    chosen = _best(run, choices)
    return _input(run, chosen, chosen[0], None)


def through_table(values: Array, table: Table) -> Array:
    """Piecewise-linear map of values (n,), beyond the ends with the slope of the last two rows."""
    x, y = (np.asarray(column, dtype=np.float64) for column in zip(*table, strict=True))
    low, high = (y[1] - y[0]) / (x[1] - x[0]), (y[-1] - y[-2]) / (x[-1] - x[-2])
    inside = np.interp(values, x, y)
    below, above = np.minimum(values - x[0], 0.0), np.maximum(values - x[-1], 0.0)
    return np.asarray(inside + low * below + high * above)


def _usable(run: Run, names: Sequence[str]) -> bool:
    return all(name in run.signals and not run.signals[name].raw for name in names) and all(
        len(run.signals[name].time) > 2 for name in names
    )


def _table_of(run: Run) -> Table | None:
    ratio = run.vehicle.steering_ratio if run.vehicle else None
    return [[-ratio, -1.0], [ratio, 1.0]] if isinstance(ratio, int | float) else ratio


def _why_no_steering(run: Run, *, with_table: bool) -> str:
    names = [name for group in (*ROAD_WHEEL, STEERING_WHEEL) for name in group]
    raw = [name for name in names if name in run.signals and run.signals[name].raw]
    if raw:
        return f"{raw[0]} is a raw count: give its unit in channels.yaml"
    if "steering_wheel_angle" in run.signals and not with_table:
        return "steering_wheel_angle without a steering ratio: state steering_ratio in vehicle.yaml"
    return "no measured steering: name the topic of road_wheel_angle or steering_wheel_angle in channels.yaml"


def _best(run: Run, choices: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    cover = [min(_cover(run.signals[name])[0] for name in names) for names in choices]
    rate = [min(_cover(run.signals[name])[1] for name in names) for names in choices]
    for names, seconds, per_second in zip(choices, cover, rate, strict=True):
        fast = per_second >= min(ALWAYS_FAST, FAST_ENOUGH * max(rate))
        if seconds >= COVERS * max(cover) and fast:
            return names
    return choices[int(np.argmax(cover))]


def _cover(signal: Signal) -> tuple[float, float]:
    """Seconds without a gap, and samples a second in them."""
    steps = np.diff(signal.time)
    bridged = steps[steps <= longest_bridge(signal, 0.2)]
    seconds = float(np.sum(bridged))
    return seconds, len(bridged) / seconds if seconds > 0 else 0.0


def _input(run: Run, names: Sequence[str], source: str, table: Table | None) -> Input:
    signals, notes = [], []
    for name in names:
        signal, note = without_held(run.signals[name], rest_counts=True)
        signals.append(signal)
        notes += [note] if note else []
    return Input(tuple(signals), source, table, tuple(notes))
