"""How much two runs of the same drive differ: what no model can predict.

Two records of different runs repeat each other if, moved in time so that the road-wheel angles differ least,
they overlap for ``OVERLAP`` seconds and half of the shorter one, and over all of the overlap

    rms of the difference of the angles  <= ``ALIKE`` of their standard deviation,
    rms of the difference of the speeds  <= ``SPEED``,

where the angle moves by ``MOVES`` (a standard deviation) at least. The difference of their outputs is then
the noise of both, of the sensors and of the drive (wind, road, driver): its rms over sqrt 2 is that of one.
What the small difference of the inputs does is in it. Headings and positions are compared from a common
start: the second path is turned and moved so that the means over the first ``START`` seconds agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate, correlation_lags

from ident.estimation.vehicle_records import MotionRecord, Samples

Array = NDArray[np.float64]

OVERLAP = 10.0  # [s]
ALIKE = 0.05
SPEED = 0.3  # [m/s]
MOVES = 0.005  # [rad]
START = 0.5  # [s]
COARSE = 0.05  # [s] of the first search
FEWEST = 20
POSE = ("heading", "position_x", "position_y")


@dataclass(frozen=True)
class Repeat:
    """Two records that repeat each other.

    lag : time in ``other`` less that in ``one`` [s]; begin, end : of the overlap, in the time of ``one`` [s]
    """

    one: MotionRecord
    other: MotionRecord
    lag: float
    begin: float
    end: float


def repeat_noise(records: Sequence[MotionRecord], names: Sequence[str]) -> dict[str, float]:
    """Root mean square of what differs between repeated runs, over sqrt 2, for each signal.

    Parameters
    ----------
    names : of the runs, by the index that the records carry; records of one name are never compared

    Returns
    -------
    Empty where no run is repeated.
    """
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for repeat in find_repeats(records, names):
        for name, difference in _differences(repeat).items():
            squares[name] = squares.get(name, 0.0) + float(difference @ difference)
            counts[name] = counts.get(name, 0) + difference.size
    return {name: float(np.sqrt(squares[name] / counts[name] / 2)) for name in sorted(squares)}


def find_repeats(records: Sequence[MotionRecord], names: Sequence[str]) -> list[Repeat]:
    """All pairs of records that repeat each other."""
    pairs = [
        (one, other)
        for one, other in combinations(records, 2)
        if names[one.run] != names[other.run] and min(_length(one), _length(other)) >= OVERLAP
    ]
    return [found for one, other in pairs if (found := _repeat(one, other)) is not None]


def _length(record: MotionRecord) -> float:
    return float(record.times[-1] - record.times[0])


def _repeat(one: MotionRecord, other: MotionRecord) -> Repeat | None:
    least = max(OVERLAP, 0.5 * min(_length(one), _length(other)))
    coarse = _coarse_lag(one, other, least)
    found = minimize_scalar(
        lambda lag: _difference_of_angles(one, other, lag),
        bounds=(coarse - COARSE, coarse + COARSE),
        method="bounded",
        options={"xatol": 1e-4},
    )
    lag = float(found.x)
    times = _overlap(one, other, lag)
    if times.size < FEWEST or times[-1] - times[0] < least - 2 * COARSE:
        return None
    moves = float(np.std(np.interp(times, one.times, one.road_wheel_angle)))
    speeds = np.interp(times, one.times, one.speed) - np.interp(times + lag, other.times, other.speed)
    if moves < MOVES or np.sqrt(np.mean(speeds**2)) > SPEED or float(found.fun) > ALIKE * moves:
        return None
    return Repeat(one, other, lag, float(times[0]), float(times[-1]))


def _coarse_lag(one: MotionRecord, other: MotionRecord, least: float) -> float:
    """Lag at which the angles differ least, relative to their size, by their correlation [s]."""
    first, second = (
        np.interp(np.arange(r.times[0], r.times[-1], COARSE), r.times, r.road_wheel_angle)
        for r in (one, other)
    )
    ones = np.ones(first.size), np.ones(second.size)
    overlap = correlate(ones[1], ones[0])
    energy = correlate(second**2, ones[0]) + correlate(ones[1], first**2)
    apart = (energy - 2 * correlate(second, first)) / np.maximum(energy, 1e-12)
    apart[overlap * COARSE < least - COARSE] = np.inf
    shift = correlation_lags(second.size, first.size)[int(np.argmin(apart))]
    return float(other.times[0] - one.times[0] + shift * COARSE)


def _overlap(one: MotionRecord, other: MotionRecord, lag: float) -> Array:
    """Grid points of ``one`` at which ``other`` is known as well."""
    inside = (one.times + lag >= other.times[0]) & (one.times + lag <= other.times[-1])
    return np.asarray(one.times[inside])


def _difference_of_angles(one: MotionRecord, other: MotionRecord, lag: float) -> float:
    times = _overlap(one, other, lag)
    if times.size < FEWEST:
        return np.inf
    there = np.interp(times + lag, other.times, other.road_wheel_angle)
    own = np.interp(times, one.times, one.road_wheel_angle)
    return float(np.sqrt(np.mean((own - there) ** 2)))


def _differences(repeat: Repeat) -> dict[str, Array]:
    """Signal -> (n,) difference at the samples of the first record."""
    first, second = repeat.one.measured, repeat.other.measured
    made = {}
    for name in sorted(set(first) & set(second) - set(POSE)):
        pair = _side_by_side(first[name], second[name], repeat)
        if pair is not None:
            made[name] = pair[0] - pair[1]
    return made | _pose_differences(first, second, repeat)


def _side_by_side(one: Samples, other: Samples, repeat: Repeat) -> tuple[Array, Array, Array] | None:
    """Both at the samples of the first within the overlap, and their times; None where they are too few."""
    inside = (one.times >= repeat.begin) & (one.times <= repeat.end)
    times = one.times[inside]
    if times.size < FEWEST or other.times.size < FEWEST:
        return None
    return one.values[inside], np.interp(times + repeat.lag, other.times, other.values), times


def _pose_differences(
    first: Mapping[str, Samples], second: Mapping[str, Samples], repeat: Repeat
) -> dict[str, Array]:
    if "heading" not in first or "heading" not in second:
        return {}
    heading = _side_by_side(first["heading"], second["heading"], repeat)
    if heading is None:
        return {}
    turn = _at_start(heading[0] - heading[1], heading[2])
    made = {"heading": heading[0] - heading[1] - turn}
    pairs = {
        name: _side_by_side(first[name], second[name], repeat)
        for name in POSE[1:]
        if name in first and name in second
    }
    x, y = (pairs.get(name) for name in POSE[1:])
    if x is None or y is None or x[0].size != y[0].size:
        return made
    turned = (
        np.cos(turn) * x[1] - np.sin(turn) * y[1],
        np.sin(turn) * x[1] + np.cos(turn) * y[1],
    )
    for name, pair, there in zip(POSE[1:], (x, y), turned, strict=True):
        difference = pair[0] - there
        made[name] = difference - _at_start(difference, pair[2])
    return made


def _at_start(values: Array, times: Array) -> float:
    return float(np.mean(values[times <= times[0] + START]))
