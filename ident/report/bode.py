"""The numbers of a Bode plot, gathered from a stored result: points, the model's curve, the limit.

Gains are in dB, 20 log10; phases in rad. A whisker or band is the 95 % interval of the logarithm of the gain,
and of the phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.results import FrequencyCurve, FrequencyPoint, SteeringResult

Array = NDArray[np.float64]

NORMAL_95 = 1.96
DECIBEL = 20 / np.log(10)
HALF_POWER = float(20 * np.log10(2**-0.5))
LEAST_GAIN = 1e-9


@dataclass(frozen=True)
class Marks:
    """Values over frequency with their 95 % intervals, one array each, (n,).

    labels : the run of each
    """

    frequency: Array
    value: Array
    low: Array
    high: Array
    labels: list[str]


@dataclass(frozen=True)
class Bode:
    """Everything that is drawn.

    gain, phase : method -> measured points [dB], [rad]
    gain_off, phase_off : method -> measured over modelled [%], measured minus modelled [mrad]
    curve_gain, curve_phase : the model [dB], [rad], None without one
    curve_gain_off, curve_phase_off : the model's own interval about zero [%], [mrad]
    dc, limit : the model's DC gain and 1/sqrt 2 of it [dB], None without a gain
    """

    gain: dict[str, Marks]
    phase: dict[str, Marks]
    gain_off: dict[str, Marks]
    phase_off: dict[str, Marks]
    curve_gain: Marks | None
    curve_phase: Marks | None
    curve_gain_off: Marks | None
    curve_phase_off: Marks | None
    dc: float | None
    limit: float | None


def gather(result: SteeringResult) -> Bode:
    """Arrange the frequency response of a result for drawing."""
    methods = [name for name in ("sine", "h1") if any(p.method == name for p in result.frequency_response)]
    by_method = {name: [p for p in result.frequency_response if p.method == name] for name in methods}
    curve = result.model_response
    drawn = _curves(curve) if curve else (None, None, None, None)
    gain = result.model.gain.value
    dc = float(20 * np.log10(gain)) if gain and gain > 0 else None
    off = by_method if curve else {}
    return Bode(
        gain={name: _gain(points) for name, points in by_method.items()},
        phase={name: _phase(points) for name, points in by_method.items()},
        gain_off={name: _gain_off(points, curve) for name, points in off.items() if curve},
        phase_off={name: _phase_off(points, curve) for name, points in off.items() if curve},
        curve_gain=drawn[0],
        curve_phase=drawn[1],
        curve_gain_off=drawn[2],
        curve_phase_off=drawn[3],
        dc=dc,
        limit=None if dc is None else dc + HALF_POWER,
    )


def harmonics(points: Sequence[FrequencyPoint], order: int) -> Marks:
    """Amplitude of a harmonic over that of the fundamental, with its 95 % interval [%]."""
    known = [
        (p, value, std)
        for p in points
        for value, std in [_harmonic(p, order)]
        if value is not None and std is not None
    ]
    value = np.array([100 * value for _, value, _ in known])
    half = np.array([100 * NORMAL_95 * std for _, _, std in known])
    frequency = np.array([p.frequency for p, _, _ in known])
    return Marks(frequency, value, np.maximum(value - half, 0), value + half, [p.run for p, _, _ in known])


def noise_level(points: Sequence[FrequencyPoint], order: int) -> Marks:
    """95 % point of what noise alone would give of a harmonic [%], and zero as its lower end.

    The amplitude of two normal parts of standard deviation s has the distribution of Rayleigh.
    """
    known = [(p, std) for p in points for _, std in [_harmonic(p, order)] if std is not None]
    known.sort(key=lambda pair: pair[0].frequency)
    level = np.array([100 * std * np.sqrt(-2 * np.log(0.05)) for _, std in known])
    frequency = np.array([p.frequency for p, _ in known])
    return Marks(frequency, level, np.zeros(level.size), level, [p.run for p, _ in known])


def significant_harmonics(points: Sequence[FrequencyPoint]) -> int:
    """Count the harmonics above three times the 95 % point of noise."""
    found = 0
    for order in (2, 3):
        for p in points:
            value, std = _harmonic(p, order)
            found += value is not None and std is not None and value > 3 * std * np.sqrt(-2 * np.log(0.05))
    return found


def coherence(points: Sequence[FrequencyPoint]) -> Marks:
    """Share of the power that is *not* explained, 1 - coherence, of the broadband parts."""
    known = [(p, p.coherence) for p in points if p.coherence is not None]
    value = np.array([max(1 - coherent, 1e-12) for _, coherent in known])
    frequency = np.array([p.frequency for p, _ in known])
    return Marks(frequency, value, value, value, [p.run for p, _ in known])


def _harmonic(point: FrequencyPoint, order: int) -> tuple[float | None, float | None]:
    if order == 2:
        return point.harmonic_2, point.harmonic_2_std
    return point.harmonic_3, point.harmonic_3_std


def _columns(points: Sequence[FrequencyPoint]) -> tuple[Array, Array, Array, Array, Array]:
    rows = [(p.frequency, max(p.gain, LEAST_GAIN), p.gain_std, p.phase, p.phase_std) for p in points]
    columns = np.array(rows, dtype=np.float64).reshape(-1, 5).T
    return columns[0], columns[1], columns[2], columns[3], columns[4]


def _gain(points: Sequence[FrequencyPoint]) -> Marks:
    frequency, gain, std, _, _ = _columns(points)
    value, half = DECIBEL * np.log(gain), DECIBEL * NORMAL_95 * std / gain
    return Marks(frequency, value, value - half, value + half, [p.run for p in points])


def _phase(points: Sequence[FrequencyPoint]) -> Marks:
    frequency, _, _, value, std = _columns(points)
    return Marks(frequency, value, value - NORMAL_95 * std, value + NORMAL_95 * std, [p.run for p in points])


def _gain_off(points: Sequence[FrequencyPoint], curve: FrequencyCurve) -> Marks:
    frequency, gain, std, _, _ = _columns(points)
    model = np.exp(_at(frequency, curve, np.log(np.maximum(curve.gain, LEAST_GAIN))))
    value, half = 100 * (gain / model - 1), 100 * NORMAL_95 * std / model
    return Marks(frequency, value, value - half, value + half, [p.run for p in points])


def _phase_off(points: Sequence[FrequencyPoint], curve: FrequencyCurve) -> Marks:
    frequency, _, _, phase, std = _columns(points)
    value = 1e3 * (phase - _at(frequency, curve, np.array(curve.phase)))
    half = 1e3 * NORMAL_95 * std
    return Marks(frequency, value, value - half, value + half, [p.run for p in points])


def _at(frequency: Array, curve: FrequencyCurve, values: Array) -> Array:
    """Read the curve at frequencies between its own, by a cubic through its values over ln w."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 -- only a page with a Bode plot needs it

    return np.asarray(CubicSpline(np.log(curve.frequency), values)(np.log(frequency)), dtype=np.float64)


def _curves(curve: FrequencyCurve) -> tuple[Marks, Marks, Marks, Marks]:
    frequency, gain = np.array(curve.frequency), np.maximum(curve.gain, LEAST_GAIN)
    relative = NORMAL_95 * np.array(curve.gain_std) / gain
    phase, half = np.array(curve.phase), NORMAL_95 * np.array(curve.phase_std)
    level, none = DECIBEL * np.log(gain), np.zeros(gain.size)
    wide = DECIBEL * relative
    return (
        Marks(frequency, level, level - wide, level + wide, []),
        Marks(frequency, phase, phase - half, phase + half, []),
        Marks(frequency, none, -100 * relative, 100 * relative, []),
        Marks(frequency, none, -1e3 * half, 1e3 * half, []),
    )
