"""Small runs with known motion: a circle, and the simulated truck with something done to its signals."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from generator.motion_sets import motion_set, noise_free
from generator.truth import load_truth
from truck_runs import run_of, vehicle_of

from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.experiments.motion import MotionRun, MotionSettings, motion_run
from ident.signals.derivative import slope
from ident.signals.health import signal_health
from ident.signals.signal import Run, Signal

TRUTH = load_truth().planar
BODY = Body(TRUTH.body.mass, TRUTH.body.cg_to_front_axle, TRUTH.body.cg_to_rear_axle)
Change = Callable[[np.ndarray, np.ndarray], np.ndarray]


@cache
def truck_run(name: str = "planar/planar_a", *, noisy: bool = True, seed: int = 1) -> Run:
    """A run of a simulated truck, in memory; signals with a steering wheel, never a request."""
    truth = load_truth()
    made = motion_set(name, truth if noisy else noise_free(truth), seed)
    vehicle = vehicle_of(truth.planar if "planar" in name else truth.truck)
    return run_of(name, made, vehicle)


def with_signals(run: Run, **signals: Signal | None) -> Run:
    """The run with these signals in place of its own; None takes one out."""
    kept = {**run.signals, **signals}
    return replace(run, signals={name: signal for name, signal in kept.items() if signal is not None})


def changed(run: Run, **changes: Change) -> Run:
    """The run with values f(time, values) of these signals."""
    made = {
        name: replace(run.signals[name], values=change(run.signals[name].time, run.signals[name].values))
        for name, change in changes.items()
    }
    return with_signals(run, **made)


def derived_yaw_rate(run: Run) -> Run:
    """The run with a yaw rate that is the derivative of its heading, as a channel map may say."""
    heading = run.signals["heading"]
    time, values = slope(heading.time, heading.values)
    health = signal_health("yaw_rate", "rad/s", "derivative of heading", values, 0)
    made = with_signals(run, yaw_rate=Signal("yaw_rate", time, values, "rad/s"))
    return replace(made, health=replace(made.health, signals={**made.health.signals, "yaw_rate": health}))


def at_times(signal: Signal, keep: np.ndarray) -> Signal:
    """The samples of a signal that are kept."""
    return replace(signal, time=signal.time[keep], values=signal.values[keep])


def records(name: str = "planar/planar_a", *, noisy: bool = True, run: int = 0) -> list[MotionRecord]:
    """Whole stretches of a run."""
    found = motion_run(truck_run(name, noisy=noisy), settings=MotionSettings(window=1e9))
    assert isinstance(found, MotionRun)
    return [
        MotionRecord(
            run,
            window.times,
            window.road_wheel_angle,
            window.speed,
            {each.signal: Samples(each.times, each.values) for each in window.measurements.values()},
            found.reference_x,
            found.imu,
        )
        for window in found.windows
    ]


def without(given: Sequence[MotionRecord], *names: str) -> list[MotionRecord]:
    """The windows without these signals."""
    return [
        replace(one, measured={name: each for name, each in one.measured.items() if name not in names})
        for one in given
    ]
