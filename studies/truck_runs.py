"""The simulated truck's runs as `ident` sees them, without a log file between: for studies and tests.

Stamps and values come from ``generator.motion_sets``; nothing is added, and nothing of the truth is passed on
but what a vehicle file says.
"""

from __future__ import annotations

from generator.motion_sets import MotionSet
from generator.truth import Planar, TwoTrack
from numpy.typing import NDArray

from ident.glossary import SIGNALS
from ident.results import RunHealth
from ident.signals.health import signal_health
from ident.signals.run import AT_REFERENCE_POINT
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle


def vehicle_of(truck: Planar | TwoTrack) -> Vehicle:
    """Return what the vehicle file of the sample logs says: all but the yaw inertia and the tyres."""
    body = truck.body
    return Vehicle(
        mass=body.mass,
        cg_to_front_axle=body.cg_to_front_axle,
        cg_to_rear_axle=body.cg_to_rear_axle,
        track=body.track,
        cg_height=body.cg_height,
        steering_ratio=truck.steering_ratio,
        reference_point="rear_axle",
        imu_position=truck.imu_position,
    )


def run_of(name: str, motion: MotionSet, vehicle: Vehicle) -> Run:
    """Return the run that a log with these signals becomes."""
    signals = {signal: _signal(signal, samples.time, samples.values) for signal, samples in motion.items()}
    duration = max(float(samples.time[-1]) for samples in motion.values())
    health = RunHealth(
        name=name,
        format="memory",
        start="",
        duration=duration,
        channels="as made",
        vehicle="as made",
        topics=[],
        signals={
            one.name: signal_health(one.name, one.unit, "memory", one.values, 0) for one in signals.values()
        },
        missing=[],
    )
    return Run(name, 0, duration, signals, vehicle, health)


def _signal(name: str, time: NDArray, values: NDArray) -> Signal:
    at = "rear_axle" if name in AT_REFERENCE_POINT else None
    return Signal(name=name, time=time, values=values, unit=SIGNALS[name].unit, at=at)
