r"""Gain and phase of the steering from sines and from broadband requests.

The request u is held between its messages, so what drives the actuator is a staircase. Its fundamental is
not the sine that was asked for: it is smaller by sinc(w T / 2) and late by half a period. Here U is the
fundamental of the staircase itself, by exact integrals over each held value, and G(jw) = Y / U is that of the
continuous actuator, which can be laid on the transfer function.

What is fitted is not the measured angle y but r = y - (response of the identified model to the staircase):

.. math:: \hat G(j\omega) = G_m(j\omega) + C / U,

with C the amplitude of r at w. For a linear actuator this is the same number as a fit of y alone, but the
transient after the start, the images of the staircase about multiples of its rate, jitter of the messages
and the lag between the windows of y and u are subtracted instead of leaking in: whatever of them is left is
of the order of the *error* of the model. Nothing of the answer at w is taken from the model: where it is
wrong there, C is large. A second advantage is precision: to wait five total lags until the transient is gone
(2.3 s) would leave out a third of a sine of 12 cycles at 10 rad/s. Only the dead time is left out, and two
columns with the free response of the model take up what is left of the initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.second_order import free_response, held_response
from ident.errors import NotIdentifiable
from ident.estimation.noise import Linearised, NoiseShape
from ident.estimation.noise_fit import fit_autoregression, fit_continuous_ar1

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

HIGHEST_HARMONIC = 3
HARMONIC_LIMIT = 0.8  # of the Nyquist frequency of the measurement
SHORTEST = 0.9  # cycles that are left in the measured angle
FEWEST_ROWS = 3.0  # samples a fitted column
DRIFT = 3.0  # standard errors from which a drift is believed
JITTER_LIMIT = 0.2  # of the period, beyond which noise is modelled in continuous time
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Plant:
    """G(s) = K exp(-L s) / (a2 s² + a1 s + 1) (2.25).

    gain : K [-]; dead_time : L [s]; sum_of_lags : a1 [s]; product_of_lags : a2 [s²]
    """

    gain: float
    dead_time: float
    sum_of_lags: float
    product_of_lags: float

    def response(self, frequency: Array | float) -> ComplexArray:
        """G(jw) at frequencies [rad/s]."""
        s = 1j * np.asarray(frequency, dtype=np.float64)
        lags = 1 + self.sum_of_lags * s + self.product_of_lags * s**2
        return np.asarray(self.gain * np.exp(-self.dead_time * s) / lags, dtype=np.complex128)

    def phase(self, frequency: Array | float) -> Array:
        """Phase of G(jw) [rad], continuous from zero at zero frequency."""
        w = np.asarray(frequency, dtype=np.float64)
        lags = np.arctan2(self.sum_of_lags * w, 1 - self.product_of_lags * w**2)
        return np.asarray(-self.dead_time * w - lags, dtype=np.float64)

    @property
    def total_lag(self) -> float:
        """L + a1 [s]."""
        return self.dead_time + self.sum_of_lags

    def simulate(self, record: Excerpt, times: Array) -> Array:
        """Response to the held command at ``times`` from rest at the first measured angle there [rad]."""
        return held_response(
            self.dead_time,
            self.sum_of_lags,
            self.product_of_lags,
            record.command_times,
            self.gain * record.command_values,
            times,
            initial_angle=float(np.interp(times[0], record.times, record.measured)),
            initial_rate=0.0,
        )[:, 0]


@dataclass(frozen=True)
class Excerpt:
    """An experiment within an uninterrupted stretch of request and measured angle.

    command_times, command_values : (m,) held command of the whole stretch [s], [rad]
    times, measured : (n,) measured angle of the whole stretch [s], [rad]
    starts : indices of ``times`` after an interruption of the measurement, the first is 0
    begin, end : of the experiment in the command [s]
    """

    command_times: Array
    command_values: Array
    times: Array
    measured: Array
    starts: NDArray[np.intp]
    begin: float
    end: float

    def answer(self, begin: float, end: float) -> Excerpt:
        """Keep only the measured samples within [begin, end) [s]."""
        low, high = (int(i) for i in np.searchsorted(self.times, [begin, end]))
        inner = self.starts[(self.starts > low) & (self.starts < high)] - low
        return replace(
            self,
            times=self.times[low:high],
            measured=self.measured[low:high],
            starts=np.concatenate([[0], inner]).astype(np.intp),
        )


@dataclass(frozen=True)
class Response:
    """The measured response at one frequency.

    frequency : [rad/s]; gain [-] and phase [rad] with their standard errors; phase is continuous over
        frequency: the one nearest to the model's
    harmonics : order -> (amplitude over that of the fundamental [-], standard error); without those too
        fast for the measurement
    coherence : share of the measured power that the request explains linearly, None for a sine
    """

    frequency: float
    gain: float
    gain_std: float
    phase: float
    phase_std: float
    harmonics: dict[int, tuple[float, float]]
    coherence: float | None = None


@dataclass(frozen=True)
class SineFit:
    """A sine ready to be solved once the colour of its noise is known.

    record : what is left after the model is subtracted, with the columns of the fit as its local ones
    held : fundamental of the held command, u = Re(U exp(j w (t - middle))) [rad]
    middle : time at which phases are zero [s]
    orders : harmonics in the columns, the fundamental first
    """

    record: Linearised
    frequency: float
    held: complex
    middle: float
    orders: tuple[int, ...]


def held_fundamental(
    command_times: Array,
    command_values: Array,
    frequency: float,
    window: tuple[float, float],
    middle: float = 0.0,
) -> complex:
    """U of the held command, u = Re(U exp(j w (t - middle))) + offset + harmonics, least squares over time.

    Parameters
    ----------
    command_times, command_values : (m,) times from which each value is held [s], [rad]
    window : from and to [s]; the first value also holds before its time, the last one after it
    """
    low, high = window
    inside = (command_times > low) & (command_times < high)
    edges = np.concatenate([[low], command_times[inside], [high]])
    index = np.searchsorted(command_times, edges[:-1], side="right") - 1
    values = command_values[np.maximum(index, 0)]
    edges -= middle
    orders = np.arange(-HIGHEST_HARMONIC, HIGHEST_HARMONIC + 1)
    sums = [np.diff(_integral(order * frequency, edges)) @ values for order in -orders]
    ends = np.array([low, high]) - middle
    gram = [[np.diff(_integral((k - i) * frequency, ends))[0] for k in orders] for i in orders]
    amplitudes = np.linalg.solve(np.asarray(gram), np.asarray(sums))
    return complex(2 * amplitudes[HIGHEST_HARMONIC + 1])


def _integral(frequency: float, t: Array) -> ComplexArray:
    """Antiderivative of exp(j w t)."""
    if frequency == 0:
        return t.astype(np.complex128)
    return np.asarray(np.exp(1j * frequency * t) / (1j * frequency), dtype=np.complex128)


def prepare_sine(record: Excerpt, frequency: float, plant: Plant) -> SineFit:
    """Subtract the model's response and lay out the columns: offset, drift, free response, harmonics.

    Raises
    ------
    NotIdentifiable
        If less than SHORTEST cycles of the answer are in the log, or too few samples.
    """
    known_from = float(record.command_times[0])
    window = max(record.begin, known_from) + plant.dead_time, record.end + plant.dead_time
    part = record.answer(*window)
    orders = tuple(range(1, HIGHEST_HARMONIC + 1))
    cycles = (part.times[-1] - part.times[0]) * frequency / (2 * np.pi) if part.times.size else 0.0
    if cycles < SHORTEST or part.times.size < FEWEST_ROWS * (4 + 2 * len(orders)):
        raise NotIdentifiable(
            f"{cycles:.2f} cycles in {part.times.size} samples of the answer, one cycle in "
            f"{FEWEST_ROWS * (4 + 2 * len(orders)):.0f} samples needed: record the sine to its end"
        )
    nyquist = np.pi / float(np.median(np.diff(part.times)))
    orders = tuple(order for order in orders if order * frequency < HARMONIC_LIMIT * nyquist)
    if not orders:
        raise NotIdentifiable(
            f"{frequency:.3g} rad/s is too fast for a measurement every {1e3 * np.pi / nyquist:.0f} ms: "
            f"at most {HARMONIC_LIMIT * nyquist:.3g} rad/s"
        )
    middle = float(part.times[0] + part.times[-1]) / 2
    return SineFit(
        record=_linearised(part, plant, frequency, orders, middle),
        frequency=frequency,
        held=held_fundamental(
            record.command_times,
            record.command_values,
            frequency,
            (float(part.times[0]) - plant.dead_time, float(part.times[-1]) - plant.dead_time),
            middle,
        ),
        middle=middle,
        orders=orders,
    )


def _linearised(
    part: Excerpt, plant: Plant, frequency: float, orders: Sequence[int], middle: float
) -> Linearised:
    times = part.times
    free = free_response(plant.sum_of_lags, plant.product_of_lags, times - times[0])
    waves = []
    for order in orders:
        phase = order * frequency * (times - middle)
        waves += [np.cos(phase), np.sin(phase)]
    drift = 2 * (times - middle) / (times[-1] - times[0])
    columns = np.column_stack([*waves, np.ones_like(times), *free, drift])
    columns /= np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny)
    return Linearised(
        times=times,
        residual=part.measured - plant.simulate(part, times),
        shared=np.zeros((times.size, 0)),
        local=columns,
        starts=part.starts,
        prior=np.full(columns.shape[1], np.inf),
        prior_residual=np.zeros(columns.shape[1]),
    )


def sine_noise(fits: Sequence[SineFit], jitter: float, like: NoiseShape | None = None) -> NoiseShape:
    """Colour of the noise that all sines leave together, by restricted likelihood.

    It is identified from what the sines themselves leave and not taken from the fit of the model, so that the
    standard errors do not depend on whether the model is right.

    Parameters
    ----------
    jitter : spread of the sampling period in parts of it
    like : an autoregression whose order is right and whose coefficients are a start, which saves the search
    """
    records = [fit.record for fit in fits]
    return fit_continuous_ar1(records) if jitter > JITTER_LIMIT else fit_autoregression(records, like)


def fit_sine(fit: SineFit, plant: Plant, shape: NoiseShape) -> Response:
    """Gain, phase and harmonics by least squares, weighted by the inverse covariance of the noise.

    The size of the noise is that of this sine's own residual. Standard errors of gain and phase are those of
    the radial and the tangential part of G (delta method), which holds while the gain is several of them.

    Parameters
    ----------
    plant : the same as in :func:`prepare_sine`
    shape : colour of the noise
    """
    white = shape.whiten(np.column_stack([fit.record.local, fit.record.residual]), fit.record)
    solution, covariance = _least_squares(white[:, :-1], white[:, -1])
    if abs(solution[-1]) < DRIFT * np.sqrt(covariance[-1, -1]):
        solution, covariance = _least_squares(white[:, :-2], white[:, -1])
    model = complex(plant.response(fit.frequency))
    correction = complex(solution[0], -solution[1]) / fit.held
    answer = model + correction
    # C = c - j s; the part along the answer changes the gain, the part across it the phase.
    along = np.array([1.0, -1j]) / (answer * fit.held)
    radial, tangential = along.real, along.imag
    error = covariance[:2, :2]
    fundamental = abs(answer * fit.held)
    harmonics = {
        order: (
            float(np.hypot(solution[2 * i], solution[2 * i + 1]) / fundamental),
            float(np.sqrt(np.trace(covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]) / 2) / fundamental),
        )
        for i, order in enumerate(fit.orders)
        if order > 1
    }
    return Response(
        frequency=fit.frequency,
        gain=abs(answer),
        gain_std=abs(answer) * float(np.sqrt(radial @ error @ radial)),
        phase=float(plant.phase(fit.frequency)) + float(np.angle(answer / model)),
        phase_std=float(np.sqrt(tangential @ error @ tangential)),
        harmonics=harmonics,
    )


def _least_squares(columns: Array, values: Array) -> tuple[Array, Array]:
    """Solution and its covariance, the size of the noise from the residual."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    left, size, right = np.linalg.svd(columns / scale, full_matrices=False)
    kept = size > RANK_TOLERANCE * size[0]
    inverse = (right[kept].T / size[kept]) / scale[:, None]
    on_columns = left[:, kept].T @ values
    rest = float(values @ values - on_columns @ on_columns)
    variance = max(rest, 0.0) / max(1, values.size - int(kept.sum()))
    return inverse @ on_columns, variance * inverse @ inverse.T
