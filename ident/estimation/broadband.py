r"""Gain, phase and coherence from a chirp or any other broadband request: the H1 estimate.

Both signals are put on one even grid as means over each interval: the held command by its exact integral,
the measured angle by that of a cubic spline through its samples, so that the smoothing is the same on both
sides and drops out of the ratio. As with sines the response of the identified model is subtracted first and

.. math:: H_1(\omega) = G_m(\omega) + S_{ur} / S_{uu},

so that leakage, the lag between the signals and the change of G within a band, the usual bias of spectral
ratios, act only on the error of the model. Spectra are those of seven sine tapers over the whole record
(Riedel and Sidorenko 1995, doi:10.1109/78.365298), which unlike overlapping segments are independent of each
other; bands of a tenth of a decade collect further independent bins where the record is long enough. With
n_d spectra in a band and coherence g² (Bendat and Piersol, Random Data, chapter 9)

.. math:: std(|H|)/|H| = std(arg H) = \sqrt{(1 - g^2) / (2 n_d g^2)},

where 1 - g² is freed of the one degree of freedom that H itself has taken.

A band is as wide as a taper's main lobe at least, 8 over the length of the record in Hz; what is found is
told of the mean frequency of the request's power within it.

Bias: noise in the request would lower H1; a logged command has none. Where a controller computes the request
from the measured angle, noise comes back in the request and draws H1 towards the negative inverse of the
controller by about 1 - g²; bands of low coherence are left out, the others keep that much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ident.dynamics.second_order import free_response
from ident.errors import NotIdentifiable
from ident.estimation.frequency_response import Excerpt, Plant, Response

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TAPERS = 7
BINS = TAPERS + 1  # width of a taper's main lobe: spectra so many bins apart are independent
BANDS_PER_DECADE = 10
SHORTEST_LAGS = 20.0  # length of a record over the total lag
SHORTEST = 10.0  # [s]
HIGHEST = 0.5  # of the Nyquist frequency of command and measurement
LEAST_COHERENCE = 0.5
CHANCE = 1e-3  # probability of the coherence of unrelated signals passing
LEAST_POWER = 1e-3  # of the request in a band, over that in the strongest: weaker ones are leakage of it


@dataclass(frozen=True)
class _Spectra:
    """Taper spectra of request u and rest r, (tapers, bins) each, at ``frequency`` (bins,) [rad/s].

    power : (bins,) of the request about each bin; centre : (bins,) where in the bin it lies [rad/s]
    """

    frequency: Array
    request: ComplexArray
    rest: ComplexArray
    power: Array
    centre: Array


def h1(record: Excerpt, plant: Plant) -> list[Response]:
    """Response in every band in which the request has power and the measured angle follows it.

    Parameters
    ----------
    record : of at least SHORTEST s and SHORTEST_LAGS total lags; of an interrupted one the longest piece
    plant : the identified model, which is subtracted and added again

    Raises
    ------
    NotIdentifiable
        If the record is too short, or nowhere follows the request.
    """
    part = _longest_piece(record.answer(record.begin + plant.total_lag, record.end + plant.dead_time))
    length = float(part.times[-1] - part.times[0]) if part.times.size > 1 else 0.0
    needed = max(SHORTEST, SHORTEST_LAGS * plant.total_lag)
    if length < needed:
        raise NotIdentifiable(
            f"{length:.1f} s in a row, {needed:.0f} s needed for a spectrum: drive a chirp of a minute"
        )
    spectra = _spectra(part, plant)
    strongest = max((_power(spectra, band) for band in _bands(spectra.frequency)), default=0.0)
    found = [
        _response(spectra, band, plant)
        for band in _bands(spectra.frequency)
        if _power(spectra, band) > LEAST_POWER * strongest
    ]
    kept = [one for one in found if one is not None]
    if not kept:
        raise NotIdentifiable(
            f"nowhere is the coherence of request and measured angle {LEAST_COHERENCE}: drive it larger"
        )
    return kept


def _longest_piece(record: Excerpt) -> Excerpt:
    if record.times.size == 0:
        return record
    edges = np.append(record.starts, record.times.size)
    longest = int(np.argmax(np.diff(edges)))
    low, high = int(edges[longest]), int(edges[longest + 1]) - 1
    return record.answer(float(record.times[low]), float(np.nextafter(record.times[high], np.inf)))


def _spectra(part: Excerpt, plant: Plant) -> _Spectra:
    """Tapered spectra of the request, later by the total lag, and of what the model leaves."""
    times = part.times
    period = float(np.median(np.diff(times)))
    count = int((times[-1] - times[0]) / period)
    edges = times[0] + period * np.arange(count + 1)
    rest = _without_start(times, part.measured - plant.simulate(part, times), plant)
    rest_mean = np.diff(CubicSpline(times, rest).antiderivative()(edges)) / period
    request = np.diff(_held_integral(part, edges - plant.total_lag)) / period
    index = np.arange(1, count + 1) * np.pi / (count + 1)
    tapers = np.sqrt(2 / (count + 1)) * np.sin(np.outer(np.arange(1, TAPERS + 1), index))
    usable = HIGHEST * np.pi / max(period, float(np.median(np.diff(part.command_times))))
    bins = np.arange(BINS // 2, count // 2, BINS)
    bins = bins[2 * np.pi * bins / (count * period) < usable]
    spectra = [np.fft.rfft(tapers * (x - x.mean())) for x in (request, rest_mean)]
    resolution = 2 * np.pi / (count * period)
    near = bins[:, None] + np.arange(-BINS // 2, BINS // 2)
    fine = (
        np.abs(np.fft.rfft(request - request.mean()))[near] ** 2
    )  # weights all times alike, as the sum does
    power = fine.sum(axis=1)
    return _Spectra(
        frequency=np.asarray(resolution * bins, dtype=np.float64),
        request=spectra[0][:, bins],
        rest=spectra[1][:, bins],
        power=power,
        centre=resolution * (fine * near).sum(axis=1) / np.maximum(power, np.finfo(float).tiny),
    )


def _without_start(times: Array, rest: Array, plant: Plant) -> Array:
    """Remove the free response to an initial state that the model did not know."""
    free = free_response(plant.sum_of_lags, plant.product_of_lags, times - times[0])
    columns = np.column_stack([np.ones_like(times), *free])
    columns /= np.maximum(np.abs(columns).max(axis=0), np.finfo(float).tiny)
    return np.asarray(rest - columns @ np.linalg.lstsq(columns, rest, rcond=None)[0], dtype=np.float64)


def _held_integral(part: Excerpt, at: Array) -> Array:
    """Integral of the held command from its first message [rad s]."""
    times, values = part.command_times, part.command_values
    whole = np.concatenate([[0.0], np.cumsum(np.diff(times) * values[:-1])])
    index = np.maximum(np.searchsorted(times, at, side="right") - 1, 0)
    return np.asarray(whole[index] + values[index] * (at - times[index]), dtype=np.float64)


def _bands(frequency: Array) -> list[NDArray[np.intp]]:
    """Indices of the bins of each band, at least one a band."""
    number = np.floor(BANDS_PER_DECADE * np.log10(np.maximum(frequency, 1e-12))).astype(int)
    return [np.flatnonzero(number == one) for one in np.unique(number)]


def _power(spectra: _Spectra, band: NDArray[np.intp]) -> float:
    return float(np.mean(np.abs(spectra.request[:, band]) ** 2))


def _response(spectra: _Spectra, band: NDArray[np.intp], plant: Plant) -> Response | None:
    """H1 of one band, None where the coherence is too low."""
    request, rest = spectra.request[:, band].ravel(), spectra.rest[:, band].ravel()
    count = request.size
    power = np.abs(request) ** 2
    frequency = float(np.average(spectra.centre[band], weights=spectra.power[band]))
    correction = complex(np.vdot(request, rest) / power.sum())
    noise = float(np.sum(np.abs(rest - correction * request) ** 2)) / (count - 1)
    model = complex(plant.response(frequency))
    answer = model + correction * np.exp(-1j * frequency * plant.total_lag)
    signal = abs(answer) ** 2 * float(power.sum())
    coherence = signal / (signal + count * noise)
    if coherence < max(LEAST_COHERENCE, 1 - CHANCE ** (1 / (count - 1))):
        return None
    relative = float(np.sqrt((1 - coherence) / (2 * count * coherence)))
    return Response(
        frequency=frequency,
        gain=abs(answer),
        gain_std=abs(answer) * relative,
        phase=float(plant.phase(frequency)) + float(np.angle(answer / model)),
        phase_std=relative,
        harmonics={},
        coherence=coherence,
    )
