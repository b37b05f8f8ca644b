"""A campaign of runs by a truck with injected effects, in memory: driven once, measured as often as wanted.

    driven = drive_campaign([typical("tyre_relaxation")], seed=3)
    runs = measured(driven, seed=3)                            # what the logs would hold
    runs = campaign([typical("tyre_relaxation")], seed=3)      # both at once

The sensors are those of the sample logs without their constant errors: a bias is an effect here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .driving import Speed
from .injected import Injected, parameters_of
from .injected_actuator import play, wheel_angle
from .injected_motion import INPUTS, simulate_truck
from .injected_sensors import DEVICES, LATERAL, Reading, channel_with, reads
from .manoeuvres import CAMPAIGN, Manoeuvre
from .motion import IMU, MARGIN
from .motion_sets import SOURCES, MotionSet, Samples, channel_of, sensors_of
from .sensors import generator, measure, schedule, seconds
from .steering import REQUEST
from .truth import AxleTyre, Planar, Truth, load_truth
from .vehicle import STEP

Array = NDArray[np.float64]
Which = Literal["another"] | None

REQUEST_SIGNAL = "steering_wheel_request"
LEAD = 2.0  # [s] simulated before the recording
SENT_BEFORE = 1.0  # [s] that commands are sent before that
REQUEST_RATE = 100.0  # [1/s]
APART = 100.0  # [s] between the starts of two runs
YARD = 50.0  # [m] around the origin of the map, where all runs begin
GUST_COLOUR = (1.2, 0.3)  # [s] two lags of the wind
GUST_ARM = 0.7  # [m] forward of the centre of gravity
LATER_RUNS = 4  # the payload changes before this one


@dataclass(frozen=True)
class Drive:
    """A campaign as it was driven.

    truth : of the truck and its sensors; injected : what is wrong with it
    runs : run -> signal -> stamps and what the sensor would read there without noise
    """

    truth: Truth
    injected: tuple[Injected, ...]
    runs: dict[str, MotionSet]


def campaign(
    injected: Sequence[Injected],
    seed: int,
    *,
    truck: Which = None,
    gusts: float = 0.0,
    mirrored: bool = False,
    rate: float = 100.0,
    dropped: float = 0.0,
    runs: Iterable[str] | None = None,
) -> dict[str, MotionSet]:
    """Drive a campaign and measure it; see :func:`drive_campaign` and :func:`measured`."""
    driven = drive_campaign(injected, seed, truck=truck, gusts=gusts, runs=runs)
    return measured(driven, seed, rate=rate, mirrored=mirrored, dropped=dropped)


def drive_campaign(
    injected: Sequence[Injected],
    seed: int,
    *,
    truck: Which | Truth = None,
    gusts: float = 0.0,
    runs: Iterable[str] | None = None,
) -> Drive:
    """Drive the runs of a campaign.

    Parameters
    ----------
    injected : what is wrong with the truck
    seed : of stamps, corrections and gusts, and of "another" truck
    truck : the planar truck of the sample logs; "another" drawn by the seed; or a truth of one's own
    gusts : standard deviation of a coloured side force without steady part [N]
    runs : names of ``CAMPAIGN``, all where None
    """
    truth = truck if isinstance(truck, Truth) else truth_of(truck, seed)
    order = list(CAMPAIGN)
    names = order if runs is None else [name for name in order if name in set(runs)]
    made = {}
    for name in names:
        plan = CAMPAIGN[name]
        driven = drive_run(plan, name, order.index(name), truth, injected, seed, gusts)
        made[name] = _sampled(driven, truth, plan.duration, seed, name)
    return Drive(truth, tuple(injected), made)


def measured(
    driven: Drive, seed: int, *, rate: float = 100.0, mirrored: bool = False, dropped: float = 0.0
) -> dict[str, MotionSet]:
    """Measure a campaign: for each seed other noise.

    Parameters
    ----------
    rate : that faster sensors are thinned to [1/s]; the request stays as it was sent
    mirrored : left and right exchanged, noise included
    dropped : share of the messages that the logs lack
    """
    return {
        name: {
            signal: _as_logged(_thinned(samples, signal, rate), mirrored and signal in LATERAL)
            for signal, samples in _lossy(_noisy(true, driven, seed, name), seed, name, dropped).items()
        }
        for name, true in driven.runs.items()
    }


def noise_floor(driven: Drive, runs: dict[str, MotionSet]) -> dict[str, float]:
    """Root mean square of measured minus true, signal by signal, over all runs.

    driven : without gusts, where those are no part of what a model can know; runs : ``measured`` of it or of
        the same drive with gusts, on the same stamps
    """
    made = {}
    for signal in SOURCES:
        errors = [runs[name][signal].values - true[signal].values for name, true in driven.runs.items()]
        made[signal] = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    return made


def truth_of(truck: Which, seed: int) -> Truth:
    """Return the truck of the sample logs, or another one: mass, inertia, CG, tyres, steering."""
    truth = load_truth()
    request = replace(truth.steering.request, rate=REQUEST_RATE)
    truth = replace(truth, steering=replace(truth.steering, request=request))
    if truck is None:
        return truth
    random = generator(seed, "another truck")
    old, steering = truth.planar.body, truth.steering.actuator
    mass, shift = round(random.uniform(0.7, 1.5), 3), round(random.uniform(-0.15, 0.15), 2)
    body = replace(
        old,
        mass=round(old.mass * mass),
        yaw_inertia=old.yaw_inertia * mass * random.uniform(0.85, 1.2),
        cg_to_front_axle=round(old.cg_to_front_axle + shift, 2),
        cg_to_rear_axle=round(old.cg_to_rear_axle - shift, 2),
    )
    planar = replace(
        truth.planar,
        steering_ratio=round(truth.planar.steering_ratio * random.uniform(0.8, 1.2), 1),
        body=body,
        front=_another_tyre(truth.planar.front, mass, random),
        rear=_another_tyre(truth.planar.rear, mass * random.uniform(1.0, 1.2), random),
    )
    actuator = replace(
        steering,
        gain=random.uniform(0.95, 1.05),
        dead_time=random.uniform(0.05, 0.15),
        time_constant_1=random.uniform(0.15, 0.35),
        time_constant_2=random.uniform(0.04, 0.1),
    )
    return replace(truth, planar=planar, steering=replace(truth.steering, actuator=actuator))


def _another_tyre(tyre: AxleTyre, load: float, random: np.random.Generator) -> AxleTyre:
    stiffness = random.uniform(0.85, 1.2)
    return replace(tyre, stiffness=tyre.stiffness * stiffness, peak=tyre.peak * load)


# --- one run ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Driven:
    """One run as it was driven.

    sent_time, sent : every command [s], [rad], also those before the recording
    readings : what each sensor would read, at any time
    """

    sent_time: Array
    sent: Array
    readings: dict[str, Reading]


def drive_run(
    plan: Manoeuvre,
    name: str,
    number: int,
    truth: Truth,
    injected: Sequence[Injected],
    seed: int,
    gusts: float = 0.0,
) -> Driven:
    """Drive one run, the ``number``-th of its campaign; its name and the seed give its random numbers."""
    speed, random = plan.speed(), generator(seed, name)
    pose = np.array([*random.uniform(-YARD, YARD, 2), random.uniform(-np.pi, np.pi)])
    command = plan.ask(truth.planar, speed, random)
    stamps = schedule(
        truth.steering.request, -LEAD - SENT_BEFORE, plan.duration, generator(seed, name, REQUEST)
    )
    sent_time = seconds(stamps)
    sent = command(sent_time)
    grid = -LEAD + STEP / 2.0 * np.arange(2 * round((LEAD + plan.duration + MARGIN) / STEP) + 1)
    deaf = generator(seed, name, "deaf")
    wheel = wheel_angle(truth.steering.actuator, injected, sent_time, sent, grid, speed, deaf)
    truck = _loaded(truth.planar, injected, number)
    wind = gusts * _gusts(grid, generator(seed, name, "gusts"))
    inputs = _inputs(truth.planar, injected, grid, wheel, speed, wind, APART * number)
    motion = simulate_truck(truck, injected, grid, inputs, pose)
    readings = reads(_mounted(truck, truth.planar), injected, motion, grid, wheel)
    return Driven(sent_time, sent, readings)


def _sampled(driven: Driven, truth: Truth, duration: float, seed: int, name: str) -> MotionSet:
    """The commands of the recording, and what every sensor would read at its stamps."""
    logged = driven.sent_time >= 0.0
    stamps = {
        topic: seconds(schedule(sensor, 0.0, duration, generator(seed, name, topic)))
        for topic, sensor in sensors_of(truth).items()
    }
    return {REQUEST_SIGNAL: Samples(driven.sent_time[logged], driven.sent[logged])} | {
        signal: Samples(stamps[topic], driven.readings[signal](stamps[topic]))
        for signal, (topic, _) in SOURCES.items()
    }


def _inputs(
    truck: Planar,
    injected: Sequence[Injected],
    grid: Array,
    wheel: Array,
    speed: Speed,
    wind: Array,
    began: float,
) -> Array:
    """(n, INPUTS) what drives the truck at every half step; ``began`` is the run's start [s]."""
    clock = began + grid
    road = _linkage(truck, injected, wheel, clock)
    drag = parameters_of(injected, "dragging_brake")
    moment = GUST_ARM * wind + (drag["moment"] * (clock >= drag["time"]) if drag else 0.0)
    grip, stiffness = np.ones_like(grid), np.ones_like(grid)
    if change := parameters_of(injected, "friction_change"):
        grip = np.where(clock >= change["time"], change["factor"], 1.0)
    if drift := parameters_of(injected, "tyre_stiffness_drift"):
        stiffness = stiffness + drift["loss"] * np.expm1(-np.maximum(clock, 0.0) / drift["time_constant"])
    if faster := parameters_of(injected, "stiffness_with_speed"):
        stiffness = stiffness * (1.0 + faster["slope"] * (speed(grid) - 10.0) / 10.0)
    columns = [road, np.gradient(road, grid), speed(grid), speed.rate(grid), wind, moment, grip, stiffness]
    made = np.column_stack(columns)
    if made.shape[1] != INPUTS:
        raise ValueError("the inputs do not fit the equations of motion")
    return made


def _linkage(truck: Planar, injected: Sequence[Injected], wheel: Array, clock: Array) -> Array:
    """Road-wheel angle [rad] behind the sensor of the steering wheel, without what the tyres do to it."""
    loose = (parameters_of(injected, "steering_linkage_play") or {}).get("width", 0.0)
    road = play(wheel / truck.steering_ratio, loose)
    if curve := parameters_of(injected, "steering_ratio_nonlinearity"):
        road = road + curve["quadratic"] * road**2 + curve["cubic"] * road**3
    if beside := parameters_of(injected, "steering_offset"):
        road = road + beside["angle"]
    if slipped := parameters_of(injected, "loosened_linkage"):
        road = road + slipped["angle"] * (clock >= slipped["time"])
    return road


def _loaded(truck: Planar, injected: Sequence[Injected], number: int) -> Planar:
    """Return the truck with the load of a run."""
    change = parameters_of(injected, "payload_change")
    if not change or number < LATER_RUNS:
        return truck
    body = truck.body
    return replace(
        truck,
        body=replace(
            body,
            mass=body.mass + change["mass"],
            yaw_inertia=body.yaw_inertia + change["yaw_inertia"],
            cg_to_front_axle=body.cg_to_front_axle - change["cg_shift"],
            cg_to_rear_axle=body.cg_to_rear_axle + change["cg_shift"],
        ),
    )


def _mounted(loaded: Planar, empty: Planar) -> Planar:
    """The inertial unit stays where it is when the centre of gravity moves."""
    shift = empty.body.cg_to_front_axle - loaded.body.cg_to_front_axle
    x, y, z = empty.imu_position
    return replace(loaded, imu_position=(x - shift, y, z))


def _gusts(grid: Array, random: np.random.Generator) -> Array:
    """Coloured noise with mean zero and standard deviation one over the run."""
    made, step = random.standard_normal(len(grid)), float(grid[1] - grid[0])
    for lag in GUST_COLOUR:
        keep = np.exp(-step / lag)
        made = lfilter([1.0 - keep], [1.0, -keep], made)
    made = made - np.mean(made)
    return made / np.std(made)


# --- measuring -------------------------------------------------------------------------------------


def _noisy(true: MotionSet, driven: Drive, seed: int, name: str) -> MotionSet:
    made = {REQUEST_SIGNAL: true[REQUEST_SIGNAL]}
    shaken = parameters_of(driven.injected, "clock_drift")
    for signal in SOURCES:
        samples, random = true[signal], generator(seed, name, signal)
        channel = channel_with(channel_of(driven.truth, signal), signal, driven.injected)
        values = measure(channel, samples.values, random)
        if signal == "speed":
            values = np.where(samples.values > 0.0, values, 0.0)
        time = samples.time
        if shaken and shaken["jitter"] > 0.0 and signal in DEVICES["imu"]:
            late = generator(seed, name, IMU, "clock").exponential(shaken["jitter"], len(time))
            time = np.maximum.accumulate(time + late)
        made[signal] = Samples(time, values)
    return made


def _lossy(runs: MotionSet, seed: int, name: str, dropped: float) -> MotionSet:
    if dropped <= 0.0:
        return runs
    made = {}
    for signal, samples in runs.items():
        device = SOURCES[signal][0] if signal in SOURCES else signal
        keep = generator(seed, name, device, "dropped").random(len(samples.time)) >= dropped
        made[signal] = Samples(samples.time[keep], samples.values[keep])
    return made


def _thinned(samples: Samples, signal: str, rate: float) -> Samples:
    own = 1.0 / float(np.median(np.diff(samples.time)))
    step = 1 if signal == REQUEST_SIGNAL else max(1, round(own / rate))
    return Samples(samples.time[::step], samples.values[::step])


def _as_logged(samples: Samples, turned: bool) -> Samples:
    return Samples(samples.time, -samples.values) if turned else samples
