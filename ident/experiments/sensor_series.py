"""RUN -> SENSOR SERIES: the signals of a run on one fine grid, and a kernel that smooths and differentiates.

Two sensors of the same motion are compared after the same smoothing: with a kernel k of length W,

    smoothed    (k * f)(t)
    derivative  (k * df/dt)(t) = (dk/dt * f)(t)

so that a derivative is never taken of noise and both sides have the same gain at every frequency (weak form;
Shinbrot 1957). k is the Hann window, half power at 0.72/W [Hz].

Between samples a cubic runs through them, with the slope between both neighbours at each (Catmull and Rom
1974), so that samples of 20 a second lose nothing of what moves at 1 Hz. Gaps and jumps stay gaps; no kernel
reaches across one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import oaconvolve

from ident.experiments.held_samples import without_held
from ident.experiments.motion_inputs import road_wheel_input, speed_input
from ident.experiments.motion_samples import Reference, measured_signals
from ident.signals.alignment import longest_bridge, low_pass, parts
from ident.signals.signal import Run, Signal

Array = NDArray[np.float64]
Series = NDArray[np.inexact[Any]]

RATE = 50.0  # [1/s] of the grid
MAX_GAP = 0.25  # [s]
LEAST_SPEED = 2.0  # [m/s]
LEAST_RATE = 4.0  # [1/s] of a signal that is compared
LEAST_SAMPLES = 50
SPEEDS = ("speed", "longitudinal_velocity")
STEERING = ("road_wheel_angle", "steering_wheel_angle")
BOTH_WHEELS = ("road_wheel_angle_left", "road_wheel_angle_right")


@dataclass(frozen=True)
class SensorSeries:
    """The signals of a run on one grid.

    time : (n,) uniform, since the start of the run [s]
    values : signal -> (n,), not smoothed, NaN where unknown
    speed_source : which of the speeds is the better one, None where there is none
    arm : how far the IMU is before the point of the lateral velocity [m], None where that is not known
    point_known : whether position and lateral velocity are of a point that was stated
    imu_y : how far the IMU is left of the CG [m]
    sources : signal -> "topic.field"
    """

    name: str
    time: Array
    values: Mapping[str, Array]
    speed_source: str | None
    arm: float | None
    point_known: bool
    imu_y: float
    sources: Mapping[str, str]

    def has(self, *names: str) -> bool:
        """Whether all of these are there."""
        return all(name in self.values for name in names)

    @property
    def has_turning(self) -> bool:
        """Whether anything tells how it turns."""
        return self.has("heading") or self.has("yaw_rate")

    @property
    def speed(self) -> Array:
        """(n,) the better speed, NaN where it is unknown or below ``LEAST_SPEED``."""
        if self.speed_source is None:
            return np.full(self.time.size, np.nan)
        values = self.values[self.speed_source]
        return np.where(np.nan_to_num(values) >= LEAST_SPEED, values, np.nan)


def sensor_series(run: Run) -> SensorSeries:
    """Signals of a run that may be compared; needs neither a vehicle file nor a measured steering."""
    grid = np.arange(int(np.floor(run.duration * RATE)) + 1) / RATE
    speed, steering = speed_input(run), road_wheel_input(run)
    velocity, angle = (
        np.full(grid.size, np.nan) if isinstance(one, str) else one.at(grid, RATE, MAX_GAP)
        for one in (speed, steering)
    )
    moves = 0.0 if isinstance(speed, str) else LEAST_SPEED  # without a speed, all of it counts as moving
    reference = Reference(grid, angle, velocity, run.vehicle, moves, RATE, MAX_GAP)
    measured = measured_signals(run, {}, reference)
    signals = {signal.name: signal for signal in measured.signals if _usable(signal)}
    for name in (*SPEEDS, *STEERING, *BOTH_WHEELS):
        if name in run.signals and _usable(run.signals[name]):
            signals[name], _ = without_held(run.signals[name], rest_counts=True)
    values = {name: on_grid(signal, grid) for name, signal in signals.items()}
    if STEERING[0] not in values and all(name in values for name in BOTH_WHEELS):
        values[STEERING[0]] = (values[BOTH_WHEELS[0]] + values[BOTH_WHEELS[1]]) / 2
    _cut(values, grid, measured.cuts)
    place = run.vehicle.imu_position if run.vehicle else None
    known = place is not None and measured.reference_known
    source = None if isinstance(speed, str) else speed.signals[0].name
    return SensorSeries(
        run.name,
        grid,
        values,
        source if source in values else None,
        place[0] - measured.reference_x if place is not None and known else None,
        measured.reference_known,
        place[1] if place is not None else 0.0,
        {name: health.source for name, health in run.health.signals.items()},
    )


def _usable(signal: Signal) -> bool:
    if signal.raw or len(signal.time) < LEAST_SAMPLES:
        return False
    return 1 / float(np.median(np.diff(signal.time))) >= LEAST_RATE


def on_grid(signal: Signal, grid: Array) -> Array:
    """Values (m,) of a signal at the instants of a uniform grid, NaN in its gaps and outside."""
    limit = longest_bridge(signal, MAX_GAP)
    values = low_pass(signal.time, signal.values, RATE, limit)
    found = np.full(grid.size, np.nan)
    for part in parts(signal.time, limit):
        time = signal.time[part]
        if len(time) < 3:
            continue
        first, last = np.searchsorted(grid, [time[0], time[-1] + 1e-9])
        slopes = np.gradient(values[part])
        slopes[1:-1] = (values[part][2:] - values[part][:-2]) / (time[2:] - time[:-2])
        slopes[[0, -1]] /= np.diff(time)[[0, -1]]
        found[first:last] = CubicHermiteSpline(time, values[part], slopes)(grid[first:last])
    return found


def _cut(values: dict[str, Array], grid: Array, cuts: Array) -> None:
    """Make nothing known between the two sides of each jump."""
    for after, before in cuts:
        first = min(int(np.searchsorted(grid, after)), grid.size - 1)
        last = max(int(np.searchsorted(grid, before)), first + 1)
        for name, series in values.items():
            if name not in {*SPEEDS, *STEERING, *BOTH_WHEELS}:
                series[first:last] = np.nan


# --- the kernel -----------------------------------------------------------------------------------


def smoothed(series: Series, width: float) -> Series:
    """Return k * f of series (n,) on the grid, k of ``width`` [s]; NaN where it reaches the unknown."""
    kernel, _ = _kernels(width)
    return _convolved(series, kernel)


def rate_of(series: Series, width: float) -> Series:
    """Return k * df/dt of series (n,) on the grid, k of ``width`` [s]."""
    _, kernel = _kernels(width)
    return _convolved(series, kernel)


def _kernels(width: float) -> tuple[Array, Array]:
    """Return k, and dk/dt with the gain that a ramp needs; both sum over samples."""
    half = round(width * RATE / 2)
    phase = np.pi * np.arange(-half, half + 1) / half
    k = 1 + np.cos(phase)
    change = -np.sin(phase)
    ramp = -np.arange(-half, half + 1) / RATE
    return k / k.sum(), change / float(change @ ramp)


def _convolved(series: Series, kernel: Array) -> Series:
    if series.size < kernel.size:
        return np.full_like(series, np.nan)
    unknown = ~np.isfinite(series)
    known = np.where(unknown, 0, series)
    centre = known[~unknown].mean() if not unknown.all() else 0.0
    total = oaconvolve(np.where(unknown, 0, known - centre), kernel, mode="same")
    total = total + centre * kernel.sum()
    reached = oaconvolve(unknown.astype(np.float64), np.ones(kernel.size), mode="same") > 0.5
    half = kernel.size // 2
    reached[:half] = reached[series.size - half :] = True
    return np.where(reached, np.nan, total)
