"""The eight runs of a campaign that shows what may be wrong with a truck, as speeds and steering requests.

Requests are functions of time [s] in radians of the steering wheel; a run rolls straight on before time zero.
What is asked for depends on the truck alone, not on what is wrong with it: nobody corrects the outcome.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .commands import Command
from .driving import Speed, drivers_wheel, smooth_step, steady_wheel_angle
from .truth import Planar

Array = NDArray[np.float64]
Ask = Callable[[Planar, Speed, np.random.Generator], Command]

BRISK = 2.0  # [rad/s] of the wheel that a sweep asks for at most
HOLD = 1.6  # [s] of a step
WANDER = 0.012  # [rad] of the wheel on a straight


@dataclass(frozen=True)
class Manoeuvre:
    """One run.

    duration : [s]
    speeds : (time [s], speed [m/s]) that the speed goes through, smoothly
    ask : from truck and speed to the request
    """

    duration: float
    speeds: tuple[tuple[float, float], ...]
    ask: Ask

    def speed(self) -> Speed:
        """Return the speed at any time; constant before the first and after the last point."""
        time, value = (list(one) for one in zip(*self.speeds, strict=True))
        time = [time[0] - 20.0, time[0] - 10.0, *time, time[-1] + 10.0, time[-1] + 20.0]
        value = [value[0], value[0], *value, value[-1], value[-1]]
        return Speed(PchipInterpolator(time, value))


def part_of(plan: Manoeuvre, begin: float, end: float) -> Manoeuvre:
    """Return a part of a run as a run of its own."""

    def ask(truck: Planar, _speed: Speed, random: np.random.Generator) -> Command:
        whole = plan.ask(truck, plan.speed(), random)
        return lambda time: whole(time + begin)

    return Manoeuvre(end - begin, tuple((time - begin, value) for time, value in plan.speeds), ask)


def _held(levels: Sequence[tuple[float, float]]) -> Callable[[Array], Array]:
    """Levels (from time on [s], value [rad]), each until the next; nothing before the first."""
    begins, values = np.array([one[0] for one in levels]), np.array([0.0, *(one[1] for one in levels)])
    return lambda time: values[np.searchsorted(begins, time, side="right")]


def _eased(levels: Sequence[tuple[float, float]], per: float) -> Callable[[Array], Array]:
    """The same, each reached smoothly within ``per`` seconds for every radian of change, 0.4 s at least."""
    values = [0.0, *(value for _, value in levels)]

    def request(time: Array) -> Array:
        made = np.zeros_like(time)
        for (begin, _), (old, new) in zip(levels, pairwise(values), strict=True):
            made = made + (new - old) * smooth_step((time - begin) / max(0.4, per * abs(new - old)))
        return made

    return request


def _there_and_back(truck: Planar, _speed: Speed, random: np.random.Generator) -> Command:
    """Straight, about turn, straight again."""
    phases, rates = random.uniform(0.0, 2.0 * np.pi, 4), random.uniform(0.4, 2.0, 4)
    wheelbase = truck.body.cg_to_front_axle + truck.body.cg_to_rear_axle
    turn = truck.steering_ratio * np.arctan(0.0639 * wheelbase)
    bend = _eased([(17.5, turn), (27.35, 0.0)], 0.7)

    def request(time: Array) -> Array:
        waves = np.sin(np.outer(time, rates) + phases).sum(axis=1) / np.sqrt(2.0)
        return bend(time) + WANDER * smooth_step(time / 4.0) * waves

    return request


def _slow_circles(truck: Planar, _speed: Speed, _random: np.random.Generator) -> Command:
    """Five angles to the left, then to the right."""
    angles = truck.steering_ratio * np.array([0.06, 0.12, 0.18, 0.24, 0.3])
    begins = np.array([1.0, 5.0, 9.0, 13.0, 17.0, 22.0, 29.5, 33.5, 37.5, 41.5])
    levels = list(zip(begins, [*angles, *-angles], strict=True))
    return _eased(levels, 0.8)


def _sweep(time: Array, begin: float, duration: float, low: float, high: float, level: float) -> Array:
    """A sine whose frequency [Hz] rises evenly on a logarithmic scale; no faster than ``BRISK``."""
    t = np.clip(time - begin, 0.0, duration)
    growth = np.log(high / low) / duration
    phase = 2.0 * np.pi * low * np.expm1(growth * t) / growth
    amplitude = np.minimum(level, BRISK / (2.0 * np.pi * low * np.exp(growth * t)))
    edges = smooth_step(t / 0.8) * smooth_step((duration - t) / 0.8)
    return edges * amplitude * np.sin(phase)


def _sweeps(*parts: tuple[float, float, float, float]) -> Ask:
    """Sweeps, each (begin [s], duration [s], speed [m/s], lateral acceleration at low frequency [m/s²])."""

    def ask(truck: Planar, _speed: Speed, _random: np.random.Generator) -> Command:
        levels = [float(steady_wheel_angle(truck, np.array([a]), np.array([v]))[0]) for _, _, v, a in parts]
        return lambda time: sum(
            (
                _sweep(time, begin, length, 0.12, 1.8, level)
                for (begin, length, _, _), level in zip(parts, levels, strict=True)
            ),
            start=np.zeros_like(time),
        )

    return ask


def _ramps(truck: Planar, speed: Speed, _random: np.random.Generator) -> Command:
    """Slowly into the bend until 0.35 g, to the left and to the right."""

    def request(time: Array) -> Array:
        left = np.clip((time - 1.0) / 13.0, 0.0, 1.0) * smooth_step((18.5 - time) / 2.5)
        right = np.clip((time - 20.0) / 13.0, 0.0, 1.0) * smooth_step((38.0 - time) / 2.5)
        return steady_wheel_angle(truck, 3.43 * (left - right), np.maximum(speed(time), 1.0))

    return request


def _weave(truck: Planar, speed: Speed, _random: np.random.Generator) -> Command:
    """Left and right of the middle at 0.2 Hz, gently, then more."""

    def request(time: Array) -> Array:
        size = 0.45 * smooth_step(time / 2.0) + 1.1 * smooth_step((time - 20.0) / 3.0)
        wave = size * np.sin(2.0 * np.pi * 0.2 * time) * smooth_step((40.0 - time) / 2.0)
        return steady_wheel_angle(truck, wave, speed(time))

    return request


def _steps(_truck: Planar, _speed: Speed, _random: np.random.Generator) -> Command:
    """Steps of three sizes, small ones of rising size, and a slow triangle."""
    sizes = [1.0, 0.0, -1.0, 0.0, 2.2, 0.0, -2.2, 0.0, 4.0, 0.0, -4.0, 0.0]
    stairs = [0.03, -0.03, 0.06, -0.06, 0.1, -0.1, 0.16, -0.16, 0.25, -0.25, 0.0]
    large = [(1.0 + HOLD * k, size) for k, size in enumerate(sizes)]
    small = [(21.0 + 0.9 * k, size) for k, size in enumerate(stairs)]
    levels = _held([*large, *small])

    def request(time: Array) -> Array:
        phase = np.clip((time - 32.0) / 10.0, 0.0, 1.0)
        triangle = np.interp(phase % 1.0, [0.0, 0.25, 0.75, 1.0], [0.0, 0.5, -0.5, 0.0])
        return levels(time) + triangle

    return request


def _free(truck: Planar, speed: Speed, random: np.random.Generator) -> Command:
    """What a driver has in mind, bends and lane changes to 3 m/s²."""
    wheel = drivers_wheel(truck, 3.0, speed, 40.0, random)
    return lambda time: np.where(time > 0.0, wheel(np.maximum(time, 0.0)), 0.0)


CAMPAIGN: dict[str, Manoeuvre] = {
    "there_and_back": Manoeuvre(
        47.0,
        (
            *((0.0, 0.0), (6.5, 0.0), (11.0, 9.0), (14.5, 9.0)),
            *((17.5, 5.0), (31.5, 5.0), (36.5, 14.0), (47.0, 14.0)),
        ),
        _there_and_back,
    ),
    "slow_circles": Manoeuvre(46.0, ((0.0, 2.2), (15.0, 2.8), (30.0, 2.3), (46.0, 2.7)), _slow_circles),
    "sweep_slow": Manoeuvre(
        40.0,
        ((0.0, 5.0), (19.0, 5.0), (22.0, 10.0), (40.0, 10.0)),
        _sweeps((0.5, 18.5, 5.0, 0.9), (22.0, 17.5, 10.0, 1.8)),
    ),
    "sweep_fast": Manoeuvre(
        40.0,
        ((0.0, 15.0), (19.0, 15.0), (22.0, 12.0), (40.0, 12.0)),
        _sweeps((0.5, 18.5, 15.0, 2.0), (22.0, 17.5, 12.0, 2.0)),
    ),
    "ramp_steer": Manoeuvre(40.0, ((0.0, 13.0), (20.0, 13.0), (24.0, 11.0), (40.0, 11.0)), _ramps),
    "weave": Manoeuvre(40.0, ((0.0, 14.0), (40.0, 13.5)), _weave),
    "steps": Manoeuvre(42.0, ((0.0, 3.2), (20.0, 3.0), (42.0, 3.4)), _steps),
    "free": Manoeuvre(40.0, ((0.0, 7.0), (12.0, 13.5), (24.0, 9.0), (33.0, 12.5), (40.0, 11.0)), _free),
}
