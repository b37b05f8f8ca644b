"""What the sensors of a simulated truck read: late, biased, scaled, and noisy from a seed.

Noise is that of ``model.yaml``: an autoregression y_k = Σ a_i y_(k-i) + e_k at the sensor's own sample
period, of which the controller gets the latest sample, or a continuous-time AR(1). It begins from its
stationary distribution, by being let run in. Noise along and across the truck turns with its heading.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ident.control.controllers.controller import Measured
from ident.errors import BadRecipe
from ident.model_file import SignalNoise

Array = NDArray[np.float64]

SIGNALS = tuple(name for name in Measured.__dataclass_fields__ if name != "time")
AROUND = ("position_along", "position_across")
CALLED = {  # names in logs -> in ``Measured``
    "speed": "longitudinal_velocity",
    "steering_wheel_angle": "steering_angle",
    "road_wheel_angle": "steering_angle",
    "steering_wheel_rate": "steering_rate",
}
NOT_SEEN = ("lateral_acceleration", "roll_angle", "roll_rate")  # no controller of the bench reads them
COLOUR = 0.2  # [s] in which the noise of a sensor has forgotten its past; what lasts longer a model lacks
RUN_IN = 50  # samples before the first that is used, in units of the order of the autoregression


@dataclass(frozen=True)
class Sensors:
    """How each signal of ``Measured`` is read: y(t - latency) (1 + scale) + bias + noise.

    noise : signal, or position_along, position_across -> its noise
    bias, scale, latency : signal -> in its unit, [-], [s]
    """

    noise: Mapping[str, SignalNoise] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    latency: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, given in (("bias", self.bias), ("scale", self.scale), ("latency", self.latency)):
            if unknown := sorted(set(given) - set(SIGNALS)):
                raise BadRecipe(f"{what} of {', '.join(unknown)}: no such sensor, need one of {SIGNALS}")
        if unknown := sorted(set(self.noise) - {*SIGNALS, *AROUND}):
            raise BadRecipe(f"noise of {', '.join(unknown)}: no such sensor, need one of {SIGNALS + AROUND}")
        for name, late in self.latency.items():
            if late < 0:
                raise BadRecipe(f"latency of {name} is {late:g} s, need 0 s or more: it cannot be simulated")


def seen(name: str) -> str | None:
    """Signal of ``Measured`` that a signal of a log is, None where no controller sees it.

    Raises
    ------
    BadRecipe
        If the name is neither.
    """
    called = CALLED.get(name, name)
    if called in (*SIGNALS, *AROUND):
        return called
    if called in NOT_SEEN:
        return None
    raise BadRecipe(f"{name}: no sensor of the bench, need one of {', '.join((*SIGNALS, *AROUND))}")


def noise_of(noise: Mapping[str, SignalNoise]) -> dict[str, SignalNoise]:
    """The noise of a model file by the names of ``Measured``; what no controller sees is left out."""
    named = {seen(name): one for name, one in noise.items()}
    return {name: one for name, one in named.items() if name is not None}


def std_within(noise: SignalNoise, seconds: float) -> float:
    """Standard deviation of what a noise does within so many seconds that its past does not tell.

    Of a noise of a sensor that is all of it after a few correlation times; of a residual that holds what a
    model lacks, what is slower is left out.
    """
    if not noise.ar or noise.sample_period is None:
        return noise.std
    samples = max(1, round(seconds / noise.sample_period))
    answer = lfilter([1.0], [1.0, *(-a for a in noise.ar)], np.eye(1, samples)[0])
    return noise.std * float(np.sqrt(np.sum(answer**2)))


class NoiseSource:
    """The noise of one signal over one run; asked for at rising times.

    A draw depends on seed, signal and time alone, not on how often it is asked for where the noise is an
    autoregression at a sample period.
    """

    def __init__(self, name: str, noise: SignalNoise, seed: int) -> None:
        self._noise = noise
        self._random = np.random.default_rng([seed, crc32(name.encode())])
        self._ar = np.array(noise.ar)
        self._past = np.zeros(len(noise.ar))
        self._place = -1
        self._value = 0.0
        self._time: float | None = None
        if noise.correlation_time is None:
            for _ in range(RUN_IN * len(noise.ar)):
                self._next()

    def at(self, time: float) -> float:
        """Noise of the latest sample at a time since the start [s]; a new one each time without a period."""
        if self._noise.correlation_time is not None:
            return self._continuous(time, self._noise.correlation_time)
        period = self._noise.sample_period
        place = self._place + 1 if period is None else math.floor(time / period * (1 + 1e-12))
        while self._place < place:
            self._place += 1
            self._value = self._next()
        return self._value

    def _next(self) -> float:
        value = float(self._ar @ self._past) + self._noise.std * self._random.standard_normal()
        if self._past.size:
            self._past = np.concatenate([[value], self._past[:-1]])
        return value

    def _continuous(self, time: float, correlation_time: float) -> float:
        kept = 0.0 if self._time is None else math.exp(-(time - self._time) / correlation_time)
        new = math.sqrt(1 - kept**2) * self._noise.std * self._random.standard_normal()
        self._value, self._time = kept * self._value + new, time
        return self._value


class Reading:
    """The sensors over one run."""

    def __init__(self, sensors: Sensors, seed: int) -> None:
        self._sensors = sensors
        self._noise = {name: NoiseSource(name, one, seed) for name, one in sensors.noise.items()}
        self.longest = max(sensors.latency.values(), default=0.0)

    def of(self, time: float, times: Array, truth: Mapping[str, Array]) -> Measured:
        """What is read at a time.

        time : [s]; times : (n,) rising, the last of them now; truth : signal -> (n,)
        """
        read = {name: self._one(name, time, times, truth[name]) for name in SIGNALS}
        for name, along in zip(AROUND, (0.0, math.pi / 2), strict=True):
            if name in self._noise:
                size, heading = self._noise[name].at(time), float(truth["heading"][-1]) + along
                read["position_x"] += size * math.cos(heading)
                read["position_y"] += size * math.sin(heading)
        return Measured(time=time, **read)

    def _one(self, name: str, time: float, times: Array, values: Array) -> float:
        late = self._sensors.latency.get(name, 0.0)
        value = float(values[-1]) if late == 0 else float(np.interp(time - late, times, values))
        value = value * (1 + self._sensors.scale.get(name, 0.0)) + self._sensors.bias.get(name, 0.0)
        return value + (self._noise[name].at(time) if name in self._noise else 0.0)


def joined(first: Sensors, others: Iterable[Sensors]) -> Sensors:
    """Biases and latencies added, scales multiplied; noise of the later one where both have it."""
    noise, bias, scale, latency = (
        dict(first.noise),
        dict(first.bias),
        dict(first.scale),
        dict(first.latency),
    )
    for other in others:
        noise |= other.noise
        for name, value in other.bias.items():
            bias[name] = bias.get(name, 0.0) + value
        for name, value in other.latency.items():
            latency[name] = latency.get(name, 0.0) + value
        for name, value in other.scale.items():
            scale[name] = (1 + scale.get(name, 0.0)) * (1 + value) - 1
    return Sensors(noise, bias, scale, latency)
