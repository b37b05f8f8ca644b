"""Steering actuators made without `ident`: their response by superposition, records of it, and the bound.

The response is a sum of step responses in partial fractions (or damped waves), written for complex
arguments, so that its derivative to anything is exact by one complex step. ``ActuatorRecord`` is a mere
container. The bound is that of Cramér and Rao, with the exact covariance matrix of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from generator.truth import Actuator
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, toeplitz

from ident.estimation.actuator_likelihood import ActuatorRecord

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TINY = 1e-30
LONG_AGO = -1e9


def free(a1: complex, a2: complex, t: Complex) -> tuple[Complex, Complex]:
    """Response to an initial angle of one and to an initial rate of one."""
    decay, distance = a1 / (2 * a2), (a1 / (2 * a2)) ** 2 - 1 / a2
    if np.real(distance) > 0:
        root = np.sqrt(distance)
        slow, fast = np.exp((root - decay) * t), np.exp((-root - decay) * t)
        by_rate = (slow - fast) / (2 * root)
        return (slow + fast) / 2 + decay * by_rate, by_rate
    wave = np.sqrt(-distance)
    by_rate = np.exp(-decay * t) * np.sin(wave * t) / wave
    return np.exp(-decay * t) * np.cos(wave * t) + decay * by_rate, by_rate


def modelled(record: ActuatorRecord, shared: Complex | Array, local: Complex | Array) -> Complex:
    """(n,) angle for (K, L, a1, rho, biases) and (angle, rate, ahead, shift, lost commands)."""
    gain, dead_time, a1, ratio = shared[:4]
    angle, rate, ahead, shift = local[:4]
    a2 = ratio * a1**2
    times = np.concatenate([[LONG_AGO], record.command_times]).astype(np.complex128)
    values = np.concatenate([[0.0], gain * record.command_values]).astype(np.complex128)
    times[1] += shift
    values[0] = angle + ahead
    values[1 + record.lost] = local[4:]
    now = record.times.astype(np.complex128)
    acting = int(np.flatnonzero((times + dead_time).real <= now[0].real)[-1])
    by_angle, by_rate = free(a1, a2, now - now[0])
    y = values[acting] + (angle - values[acting]) * by_angle + rate * by_rate
    for k in range(acting + 1, times.size):
        change = values[k] - values[k - 1]
        if change == 0:
            continue
        since = now - times[k] - dead_time
        after = since.real > 0
        y[after] += change * (1 - free(a1, a2, since[after])[0])
    return y + shared[4 + record.run]


def derivatives(record: ActuatorRecord, shared: Array, local: Array) -> tuple[Array, Array]:
    """(n, s) to the shared and (n, l) to the local parameters, by complex steps."""

    def column(which: int, index: int) -> Array:
        both = [np.asarray(shared, dtype=np.complex128), np.asarray(local, dtype=np.complex128)]
        both[which] = both[which].copy()
        both[which][index] += 1j * TINY
        return modelled(record, *both).imag / TINY

    return tuple(  # type: ignore[return-value]
        np.column_stack([column(which, index) for index in range(len(values))])
        for which, values in enumerate((shared, local))
    )


def parameters(actuator: Actuator, bias: float = 0.0) -> Array:
    """(K, L, a1, rho, bias) of an actuator."""
    a1 = (actuator.time_constant_1 + actuator.time_constant_2).real
    a2 = (actuator.time_constant_1 * actuator.time_constant_2).real
    return np.array([actuator.gain, actuator.dead_time, a1, a2 / a1**2, bias])


def time_constant_map(actuator: Actuator) -> Array:
    """(4, 4) derivative of (K, L, a1, rho) to (K, L, T1, T2)."""
    T1, T2 = actuator.time_constant_1, actuator.time_constant_2
    total = T1 + T2
    to = np.eye(4)
    to[2, 2:] = 1.0
    to[3, 2:] = T2 * (T2 - T1) / total**3, T1 * (T1 - T2) / total**3
    return to


def bound(record: ActuatorRecord, actuator: Actuator, covariance: Array, local: Array | None = None) -> Array:
    """(4, 4) smallest covariance of (K, L, T1, T2).

    covariance : (n, n) of the noise
    local : the true local parameters where they and a bias are estimated too; None: both are known
    """
    own = np.zeros(4) if local is None else local
    shared, by_local = derivatives(record, parameters(actuator), own)
    columns = shared[:, :4] @ time_constant_map(actuator)
    prior = np.zeros(0)
    if local is not None:
        columns = np.column_stack([columns, shared[:, 4], by_local])
        prior = np.array([np.inf, record.rest_rate, record.rest_rate / 2, record.start_uncertainty])
        prior = np.concatenate([prior, np.full(local.size - 4, np.inf)])
    information = columns.T @ cho_solve(cho_factor(covariance), columns)
    information[-prior.size :, -prior.size :] += np.diag(1 / prior**2) if prior.size else 0.0
    return np.linalg.inv(information)[:4, :4]


def ar1_covariance(count: int, std: float, correlation: float) -> Array:
    """(n, n) of stationary noise of standard deviation ``std`` with the correlation of neighbours."""
    return toeplitz(std**2 * correlation ** np.arange(count))


def ar1_noise(count: int, std: float, correlation: float, random: np.random.Generator) -> Array:
    """Stationary AR(1) noise of standard deviation ``std``."""
    if correlation == 0:
        return std * random.standard_normal(count)
    noise = np.empty(count)
    noise[0] = std * random.standard_normal()
    innovations = std * np.sqrt(1 - correlation**2) * random.standard_normal(count)
    for k in range(1, count):
        noise[k] = correlation * noise[k - 1] + innovations[k]
    return noise


@dataclass(frozen=True)
class Test:
    """A request and when it is sent and answered: times [s], values [rad]."""

    __test__ = False

    command_times: Array
    command_values: Array
    times: Array
    rest_rate: float = 0.2

    def record(self, actuator: Actuator, noise: Array, *, bias: float = 0.0, run: int = 0) -> ActuatorRecord:
        """What a log of it holds."""
        empty = ActuatorRecord(
            run=0,
            command_times=self.command_times,
            command_values=self.command_values,
            times=self.times,
            measured=np.zeros_like(self.times),
            starts=np.zeros(1, dtype=np.intp),
            start_uncertainty=float(np.median(np.diff(self.command_times))) / np.sqrt(3),
            rest_rate=self.rest_rate,
        )
        answer = modelled(empty, parameters(actuator, bias), np.zeros(4)).real + noise
        return ActuatorRecord(**{**vars(empty), "measured": answer, "run": run})


def pulses(
    random: np.random.Generator,
    *,
    rate: float = 50.0,
    on: float = 2.5,
    off: float = 2.0,
    sizes: tuple[float, ...] = (1.0,),
    before: float = 0.5,
) -> Test:
    """Pulses whose commands and samples have phases of their own."""
    duration = before + len(sizes) * (on + off)
    sent = np.arange(random.uniform(0, 1 / rate), duration, 1 / rate)
    place = (sent - before) / (on + off)
    index = np.floor(place).astype(int)
    inside = (index >= 0) & ((place - index) * (on + off) < on)
    values = np.where(inside, np.asarray(sizes)[np.clip(index, 0, len(sizes) - 1)], 0.0)
    return Test(sent, values, np.arange(sent[0] + random.uniform(0, 1 / rate), duration, 1 / rate))


def sines(
    random: np.random.Generator, frequencies: tuple[float, ...], *, rate: float = 50.0, duration: float = 6.0
) -> Test:
    """Sines of unit amplitude with pauses between them."""
    total = 1.0 + len(frequencies) * (duration + 1.0)
    sent = np.arange(random.uniform(0, 1 / rate), total, 1 / rate)
    values = np.zeros_like(sent)
    for number, frequency in enumerate(frequencies):
        since = sent - 1.0 - number * (duration + 1.0)
        inside = (since >= 0) & (since < duration)
        values[inside] = np.sin(frequency * since[inside])
    return Test(sent, values, np.arange(sent[0] + random.uniform(0, 1 / rate), total, 1 / rate))
