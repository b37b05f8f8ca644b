"""How late one series is against another that measures the same thing, with an honest standard error.

Model: y(t) = g x(t - tau) + c + e(t), with noise of any colour on y and on x. The delay tau maximises the
cross-correlation of the two series in the band where they are coherent, after a search over all lags; x is
shifted by cubic interpolation, samples are weighted after Huber against jumps. At the maximum the score
sum w e dx/dt is zero; its spread, over blocks longer than the colour of the noise, divided by its slope
sum w (dy/dt)(dx/dt), is the standard error of tau whatever the spectra are (the sandwich, or cluster-robust,
covariance; Student's t with blocks - 3 degrees of
freedom, for gain, offset and delay). Noise on x moves g, not tau.

A correlation counts only if it is larger than what two independent series with the same spectra would reach
at some lag (Bartlett's effective number of samples).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.signal import correlate, csd, firwin, kaiserord, oaconvolve, welch
from scipy.stats import norm, t

from ident.results import Estimate, Status

Array = NDArray[np.float64]

MAX_LAG = 2.5
MIN_SECONDS = 6.0
MIN_BLOCKS = 6
MIN_CORRELATION = 0.4
BLOCK = 4.0
MOST_BLOCKS = 60
MOST_SECONDS = 1200.0
FALSE_ALARM = 0.002  # nominal; about 1 % on generated data, of which the two attempts have a share
WEAK_STD = 0.025
HUBER = 1.5
CLIP = 1.5
COHERENT = 0.3
LOWEST, HIGHEST = 0.3, 0.35
SEGMENT = 10.0
TREND = 10.0


@dataclass(frozen=True)
class Piece:
    """A stretch without gaps of both series on the same uniform grid, (n,) each."""

    late: Array
    reference: Array


def estimate_delay(pieces: list[Piece], rate: float) -> Estimate:
    """How much later ``late`` is than ``reference`` [s].

    Parameters
    ----------
    pieces : stretches of the two series, band-limited to below 0.4 of the rate
    rate : of their grid [1/s]
    """
    margin = int(np.ceil(MAX_LAG * rate))
    pieces = [piece for piece in pieces if len(piece.late) > 2 * margin + rate]
    seconds = sum(len(piece.late) - 2 * margin for piece in pieces) / rate
    if seconds < MIN_SECONDS - 2 * MAX_LAG:
        return _none(f"only {seconds:.1f} s in common")
    pieces = _clipped(_some(pieces, rate))
    found = _estimate(pieces, rate, margin)
    if found.value is None:  # a slow trend fits at any lag: look at what is left without it
        found = _estimate([_without_trend(piece, rate) for piece in pieces], rate, margin)
    return found


def _estimate(pieces: list[Piece], rate: float, margin: int) -> Estimate:
    lag, _ = _search(pieces, margin)
    pieces = _band_limited(pieces, lag, rate)
    lag, correlation = _search(pieces, margin)
    needed = max(MIN_CORRELATION, _chance(pieces, margin))
    if correlation < -needed:
        return _none(f"the signs are opposite: correlation {correlation:.2f}")
    if correlation < needed:
        return _none(f"too little common motion: correlation {correlation:.2f}, need {needed:.2f}")
    if abs(lag) >= margin - 1:
        return _none(f"the best lag is beyond the {MAX_LAG:g} s searched")
    delay, std, blocks = _fit(pieces, lag / rate, rate, margin)
    if blocks < MIN_BLOCKS:
        return _none(f"only {blocks} blocks of independent noise, need {MIN_BLOCKS}: drive longer")
    half = float(t.ppf(0.975, blocks - 3)) * std
    reason = f"the standard error is above {WEAK_STD * 1e3:.0f} ms" if std > WEAK_STD else None
    status: Status = "weak" if reason else "identified"
    return Estimate(delay, std, delay - half, delay + half, "s", status, reason)


def _some(pieces: list[Piece], rate: float) -> list[Piece]:
    """Of a long drive, minutes spread evenly over it: no more is needed, and the time is bounded."""
    total = sum(len(piece.late) for piece in pieces) / rate
    if total <= MOST_SECONDS:
        return pieces
    minute = round(60 * rate)
    minutes = [
        Piece(piece.late[start : start + minute], piece.reference[start : start + minute])
        for piece in pieces
        for start in range(0, len(piece.late) - minute + 1, minute)
    ]
    return minutes[:: int(np.ceil(total / MOST_SECONDS))] or pieces


def _none(reason: str) -> Estimate:
    return Estimate(None, None, None, None, "s", "not_identifiable", reason)


def _clipped(pieces: list[Piece]) -> list[Piece]:
    """Centre both series of each piece and cut jumps at 1.5 times the 99 % point of all."""
    centred = [Piece(p.late - np.median(p.late), p.reference - np.median(p.reference)) for p in pieces]
    late = CLIP * np.percentile(np.abs(np.concatenate([p.late for p in centred])), 99)
    reference = CLIP * np.percentile(np.abs(np.concatenate([p.reference for p in centred])), 99)
    return [Piece(np.clip(p.late, -late, late), np.clip(p.reference, -reference, reference)) for p in centred]


def _band_limited(pieces: list[Piece], lag: int, rate: float) -> list[Piece]:
    """Low-pass both series to where they are coherent at this lag, without delay."""
    edge = _coherent_up_to(pieces, lag, rate)
    if edge >= HIGHEST * rate:
        return pieces
    count, beta = kaiserord(50.0, edge / rate)
    taps = firwin(count + 1 - count % 2, 1.25 * edge, window=("kaiser", beta), fs=rate)
    return [Piece(_filtered(piece.late, taps), _filtered(piece.reference, taps)) for piece in pieces]


def _filtered(series: Array, taps: Array) -> Array:
    padded = np.pad(series, len(taps) // 2, mode="reflect", reflect_type="odd")
    return np.asarray(oaconvolve(padded, taps, mode="valid"))


def _coherent_up_to(pieces: list[Piece], lag: int, rate: float) -> float:
    """Return the frequency [Hz] above which the squared coherence stays below ``COHERENT``."""
    longest = max(len(piece.late) for piece in pieces)
    size = min(round(SEGMENT * rate), longest // 4)
    spectra = [_spectra(_moved(piece, lag), size, rate) for piece in pieces if len(piece.late) > 2 * size]
    if not spectra:
        return LOWEST
    frequency = spectra[0][0]
    cross, late, reference = (np.sum([spectrum[i] for spectrum in spectra], axis=0) for i in (1, 2, 3))
    coherence = np.abs(cross) ** 2 / np.maximum(np.abs(late * reference), 1e-300)
    smooth = np.convolve(coherence, np.full(3, 1 / 3), mode="same")
    high = np.flatnonzero(smooth[1:] < COHERENT)
    low = np.flatnonzero(smooth[1:] >= COHERENT)
    after = high[high > low[0]] if len(low) else high
    return max(LOWEST, float(frequency[1 + after[0]])) if len(after) else HIGHEST * rate


def _moved(piece: Piece, lag: int) -> Piece:
    """The two series with the late one moved earlier by ``lag`` samples."""
    n = len(piece.late)
    return Piece(piece.late[max(lag, 0) : n + min(lag, 0)], piece.reference[max(-lag, 0) : n - max(lag, 0)])


def _spectra(piece: Piece, size: int, rate: float) -> tuple[Array, NDArray[np.complex128], Array, Array]:
    frequency, cross = csd(piece.late, piece.reference, rate, nperseg=size)
    _, late = welch(piece.late, rate, nperseg=size)
    _, reference = welch(piece.reference, rate, nperseg=size)
    weight = len(piece.late)
    return frequency, cross * weight, late * weight, reference * weight


def _without_trend(piece: Piece, rate: float) -> Piece:
    """Both series without what is slower than ``TREND`` (a Hann-weighted moving mean)."""
    window = np.hanning(2 * round(TREND * rate / 2) + 3)
    window /= window.sum()
    return Piece(
        piece.late - _filtered(piece.late, window), piece.reference - _filtered(piece.reference, window)
    )


def _search(pieces: list[Piece], margin: int) -> tuple[int, float]:
    """Lag [samples] of the correlation that is largest in size, and that correlation."""
    products = np.zeros(2 * margin + 1)
    energy = np.zeros(2 * margin + 1)
    late_energy = 0.0
    for piece in pieces:
        late = piece.late[margin:-margin] - piece.late[margin:-margin].mean()
        products += correlate(piece.reference, late, mode="valid")[::-1]
        energy += correlate(piece.reference**2, np.ones_like(late), mode="valid")[::-1]
        late_energy += float(late @ late)
    correlation = products / np.sqrt(np.maximum(energy * late_energy, 1e-300))
    best = int(np.argmax(np.abs(correlation)))
    return best - margin, float(correlation[best])


def _chance(pieces: list[Piece], margin: int) -> float:
    """Correlation that two independent series like these exceed at some lag once in 1 / FALSE_ALARM."""
    samples = sum(len(piece.late) for piece in pieces)
    joined = [np.concatenate([piece.late for piece in pieces]), np.concatenate([p.reference for p in pieces])]
    late, reference = (_autocorrelation(series, min(4 * margin, samples - 1)) for series in joined)
    colour = 1 + 2 * float(np.sum(late[1:] * reference[1:]))
    effective = max(samples / max(colour, 1.0), 4.0)
    lags = max((2 * margin + 1) * effective / samples, 1.0)
    return float(np.tanh(norm.isf(FALSE_ALARM / 2 / lags) / np.sqrt(max(effective - 3, 1.0))))


def _autocorrelation(series: Array, lags: int) -> Array:
    """Autocorrelation at lags 0 ... ``lags``."""
    centred = series - series.mean()
    size = 1 << int(2 * len(centred) - 1).bit_length()
    power = np.abs(np.fft.rfft(centred, size)) ** 2
    found = np.fft.irfft(power, size)[: lags + 1]
    return np.asarray(found / found[0], dtype=np.float64) if found[0] > 0 else np.zeros(lags + 1)


# --- the fit --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Series:
    """A piece ready to be shifted: spline of the reference on its own samples, and the late samples used."""

    spline: CubicSpline
    index: Array
    late: Array
    part: NDArray[np.intp]


def _fit(pieces: list[Piece], start: float, rate: float, margin: int) -> tuple[float, float, int]:
    """Return delay [s], its standard error [s] and the number of blocks."""
    series = [
        _Series(
            CubicSpline(np.arange(len(p.reference)), p.reference),
            np.arange(margin, len(p.late) - margin, dtype=np.float64),
            p.late[margin:-margin],
            np.full(len(p.late) - 2 * margin, number),
        )
        for number, p in enumerate(pieces)
    ]
    late = np.concatenate([s.late for s in series])
    part = np.concatenate([s.part for s in series])
    weights = np.ones_like(late)
    delay = start * rate
    for _ in range(4):
        delay = _minimum(series, late, part, weights, delay)
        residual = _residual(_shifted(series, delay, 0), late, part, weights)
        scale = 1.4826 * float(np.median(np.abs(residual)))
        weights = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
    motion = _shifted(series, delay, 1)
    change = np.concatenate([CubicSpline(s.index, s.late)(s.index, 1) for s in series])
    std, blocks = _sandwich(weights * residual * motion, float((weights * change) @ motion), part, rate)
    return delay / rate, std / rate, blocks


def _shifted(series: list[_Series], delay: float, order: int) -> Array:
    return np.concatenate([s.spline(s.index - delay, order) for s in series])


def _centred(values: Array, part: NDArray[np.intp], weights: Array) -> Array:
    """Take the weighted mean of each piece out of values (n,)."""
    means = np.bincount(part, weights * values) / np.bincount(part, weights)
    return np.asarray(values - means[part])


def _residual(shifted: Array, late: Array, part: NDArray[np.intp], weights: Array) -> Array:
    """Residual (n,) of the best gain and offsets for this shift."""
    y, x = _centred(late, part, weights), _centred(shifted, part, weights)
    gain = float((weights * x) @ y) / max(float((weights * x) @ x), 1e-300)
    return np.asarray(y - x * gain)


def _minimum(
    series: list[_Series], late: Array, part: NDArray[np.intp], weights: Array, start: float
) -> float:
    def cost(delay: float) -> float:
        residual = _residual(_shifted(series, delay, 0), late, part, weights)
        return float((weights * residual) @ residual)

    found = minimize_scalar(
        cost, bounds=(start - 1.5, start + 1.5), method="bounded", options={"xatol": 1e-5}
    )
    return float(found.x)


def _sandwich(scores: Array, curvature: float, part: NDArray[np.intp], rate: float) -> tuple[float, int]:
    """Return the standard error of the delay [samples] and the number of blocks it comes from."""
    length = max(BLOCK, 5 * _memory(scores) / rate, len(scores) / rate / MOST_BLOCKS)
    count = np.maximum(np.round(np.bincount(part) / rate / length).astype(int), 1)
    sums = np.concatenate(
        [
            [block.sum() for block in np.array_split(scores[part == number], blocks)]
            for number, blocks in enumerate(count.tolist())
        ]
    )
    n = len(sums)
    return float(np.sqrt(n / max(n - 3, 1) * np.sum(sums**2)) / max(curvature, 1e-300)), n


def _memory(scores: Array) -> float:
    """Correlation time of the scores [samples]: where their autocorrelation has fallen below 0.1."""
    found = _autocorrelation(scores, len(scores) // 4)
    below = np.flatnonzero(found < 0.1)
    return float(below[0]) if len(below) else float(len(found))
