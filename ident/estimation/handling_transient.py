r"""Figures of transient driving in the style of ISO 14793, from any motion of the centre of gravity.

**Gain and phase** of yaw rate and lateral acceleration to road-wheel angle, about a frequency f_0: the lines
of the discrete Fourier transforms of all stretches within ``half`` of f_0 fit (local polynomial method,
Pintelon and Schoukens, System Identification, 2nd ed., section 7.2)

.. math:: Y_k = (a + b x_k) U_k + (c_i + d_i x_k) + E_k, \qquad x_k = (f_k - f_0)/half,

where a is the response at f_0, b lets it change over the band and c, d of each stretch take up the motion
that it begins and ends with. This is the H1 estimate, S_uy/S_uu, without its leakage. The standard errors
are those of circular complex noise, of the size that is left. The coherence is the share of what is not
motion at the ends that the steering explains. Noise of the measured steering lowers |a| by at most
1 - coherence. A response that is curved over the band is wrong by its mean curvature, about 1 % for the
lateral acceleration of a heavy truck.

**Response time**: from the instant of half of a step of the road-wheel angle to that of 90 % of the change of
the yaw rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ident.estimation.handling import CLASS, Drive, Figure, estimate, unknown

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

FREQUENCIES = (0.2, 0.5, 1.0)  # [Hz]
LEAST_HALF, HALF = 0.15, 0.2  # [Hz], of the frequency
STRETCH = 20.0  # [s] at least, at most twice that
FEWEST_LINES = 4
FEWEST_FREEDOM = 3
GOOD, POOR = 0.9, 0.7  # coherence
GOOD_STD, POOR_STD = 0.1, 0.3  # relative
DELAY_AT = 0.5  # [Hz]
MOST_MISSING = 0.06  # share of a stretch

SMALLEST_STEP = 0.01  # [rad]
STEP_SECONDS = 0.6  # [s] that a step may take
BEFORE, AFTER = 0.8, 1.5  # [s] in which the angle stays
STAYS = 0.15  # of the step
SETTLING = 0.7  # [s] after the step from which the yaw rate is the new one
RISEN = 0.9


@dataclass(frozen=True)
class Response:
    """Response of a motion to the road-wheel angle at one frequency.

    gain, phase [rad] : with their standard errors; coherence [-]; freedom : degrees of freedom
    reason : why it is not to be used, None where it is
    influence : (n,) what each line adds to the error, relative to the response: gain real, phase imaginary
    """

    gain: float
    gain_std: float
    phase: float
    phase_std: float
    coherence: float
    freedom: int
    reason: str | None = None
    influence: ComplexArray = field(default_factory=lambda: np.zeros(0, dtype=np.complex128))

    def estimates(self, unit: str) -> tuple[Figure, Figure]:
        """Gain and phase."""
        if self.reason is not None:
            return unknown(unit, self.reason), unknown("rad", self.reason)
        gain = estimate(self.gain, self.gain_std, unit, self.freedom)
        gain = replace(gain, influence=self.gain * self.influence.real)
        phase = estimate(self.phase, self.phase_std, "rad", self.freedom)
        phase = replace(phase, influence=self.influence.imag)
        if self.gain_std > GOOD_STD * self.gain or self.coherence < GOOD:
            why = f"the coherence is {self.coherence:.2f}, wanted {GOOD:g}"
            return _weak(gain, why), _weak(phase, why)
        return gain, replace(phase, status="identified", reason=None)


def _weak(one: Figure, why: str) -> Figure:
    return replace(one, status="weak", reason=why)


def stretches(given: Sequence[Drive]) -> dict[float, list[tuple[Drive, slice]]]:
    """Class of speed [m/s] -> parts of ``STRETCH`` to twice that driven at about this speed without gaps."""
    made: dict[float, list[tuple[Drive, slice]]] = {}
    for drive in given:
        points = drive.speed.size
        count = int(points * drive.period / STRETCH)
        edges = np.linspace(0, points, count + 1).astype(int) if count else np.zeros(0, dtype=int)
        for first, last in pairwise(edges.tolist()):
            part = slice(first, last)
            mean = float(np.mean(drive.speed[part]))
            if np.mean(~drive.valid[part]) <= MOST_MISSING:
                made.setdefault(CLASS * max(1, round(mean / CLASS)), []).append((drive, part))
    return made


def response(parts: Sequence[tuple[Drive, slice]], signal: str, frequency: float) -> Response:
    """Response of ``yaw_rate`` or ``lateral_acceleration`` about a frequency [Hz]."""
    half = max(LEAST_HALF, HALF * frequency)
    steering, motion = [], []
    freedom = -2
    for drive, part in parts:
        u, y, x = _lines(drive, part, signal, frequency, half)
        if x.size < FEWEST_LINES:
            continue
        ends = np.column_stack([np.ones(x.size), x])
        steering.append(_beside(np.column_stack([u, u * x]), ends))
        motion.append(_beside(y, ends))
        freedom += x.size - 2
    if freedom < FEWEST_FREEDOM:
        return _nothing(
            f"{max(0, freedom)} degrees of freedom at {frequency:g} Hz, need {FEWEST_FREEDOM}: drive for a "
            f"minute in one go, with sines or lane changes of {frequency:g} Hz"
        )
    return _solved(np.concatenate(steering), np.concatenate(motion), freedom, frequency)


def _lines(
    drive: Drive, part: slice, signal: str, frequency: float, half: float
) -> tuple[ComplexArray, ComplexArray, Array]:
    """Lines of steering and motion near a frequency, and where they lie in the band, -1 to 1."""
    angle, values = drive.road_wheel_angle[part], getattr(drive, signal)[part]
    step = 1 / (angle.size * drive.period)
    number = np.arange(int(np.ceil((frequency - half) / step)), int((frequency + half) / step) + 1)
    number = number[(number > 0) & (number < angle.size // 2)]
    size = np.sqrt(angle.size)
    spectra = [np.fft.rfft(one - one.mean())[number] / size for one in (angle, values)]
    return spectra[0], spectra[1], np.asarray((number * step - frequency) / half, dtype=np.float64)


def _beside(values: ComplexArray, others: Array) -> ComplexArray:
    """What ``others`` do not explain."""
    return np.asarray(values - others @ (np.linalg.pinv(others) @ values))


def _solved(columns: ComplexArray, values: ComplexArray, freedom: int, frequency: float) -> Response:
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    inverse = np.linalg.pinv(columns / scale)
    solution = inverse @ values
    left = values - columns / scale @ solution
    rest = float(np.sum(np.abs(left) ** 2))
    whole = float(np.sum(np.abs(values) ** 2))
    answer = complex(solution[0] / scale[0])
    noise = rest / freedom * float(np.sum(np.abs(inverse[0]) ** 2)) / scale[0] ** 2
    std = float(np.sqrt(noise / 2))
    gain = abs(answer)
    coherence = 1 - rest / whole if whole > 0 else 0.0
    reason = None
    if coherence < POOR or std > POOR_STD * gain:
        reason = (
            f"the steering explains {100 * coherence:.0f} % of the motion at {frequency:g} Hz (gain ± "
            f"{100 * std / max(gain, 1e-300):.0f} %), need {100 * POOR:.0f} % and ± {100 * POOR_STD:.0f} %: "
            f"drive sines or lane changes of {frequency:g} Hz"
        )
    relative = std / max(gain, 1e-300)
    influence = inverse[0] * left / scale[0] / (answer or 1.0) * np.sqrt(values.size / freedom)
    return Response(gain, std, float(np.angle(answer)), relative, coherence, 2 * freedom, reason, influence)


def _nothing(reason: str) -> Response:
    return Response(0.0, np.inf, 0.0, np.inf, 0.0, 1, reason)


def equivalent_delay(one: Response) -> Figure:
    """Delay [s] that has the phase of the yaw rate at ``DELAY_AT``."""
    if one.reason is not None:
        return unknown("s", one.reason)
    turn = 2 * np.pi * DELAY_AT
    made = estimate(-one.phase / turn, one.phase_std / turn, "s", one.freedom)
    made = replace(made, influence=-one.influence.imag / turn)
    if one.coherence < GOOD:
        return _weak(made, f"the coherence is {one.coherence:.2f}, wanted {GOOD:g}")
    return made


# --- steps ----------------------------------------------------------------------------------------


def find_steps(drive: Drive) -> list[int]:
    """Grid points in the middle of steps of the road-wheel angle: it stays, changes quickly, stays."""
    angle, period = drive.road_wheel_angle, drive.period
    back, ahead, half = (round(s / period) for s in (BEFORE, AFTER, STEP_SECONDS / 2))
    if angle.size < back + ahead + 2 * half + 2:
        return []
    middle = np.arange(back + half, angle.size - ahead - half)
    change = np.zeros(angle.size)
    change[middle] = angle[middle + half] - angle[middle - half]
    spread_before, spread_after = np.full(angle.size, np.inf), np.full(angle.size, np.inf)
    spread_before[middle] = _range_about(angle, back)[middle - half - back // 2]
    spread_after[middle] = _range_about(angle, ahead)[middle + half + ahead // 2]
    size = np.abs(change)
    calm = (spread_before <= STAYS * size) & (spread_after <= STAYS * size) & (size >= SMALLEST_STEP)
    largest = size == maximum_filter1d(size, 2 * half + 1)
    found: list[int] = []
    for at in np.flatnonzero(calm & largest):
        if not found or at - found[-1] > half:
            found.append(int(at))
    return [at for at in found if drive.valid[at - back : at + ahead].mean() > 1 - MOST_MISSING]


def _range_about(values: Array, points: int) -> Array:
    return np.asarray(maximum_filter1d(values, points) - minimum_filter1d(values, points))


def response_time(given: Sequence[Drive], steps: Sequence[Sequence[int]]) -> Figure:
    """Mean response time of the yaw rate to steps [s]; its error from their spread, or from the noise.

    Parameters
    ----------
    steps : of each drive the middle of its steps, of :func:`find_steps`
    """
    found = [
        each
        for drive, own in zip(given, steps, strict=True)
        for at in own
        if (each := _time_of(drive, at)) is not None
    ]
    if not found:
        return unknown("s", "the yaw rate does not settle at a new value after the steps")
    times, noise = np.array(found).T
    own = float(np.sqrt(np.mean(noise**2) / times.size))
    if times.size < 3:
        return estimate(float(times.mean()), own, "s", 20)
    spread = float(np.std(times, ddof=1) / np.sqrt(times.size))
    return estimate(float(times.mean()), max(spread, own), "s", times.size - 1)


def _time_of(drive: Drive, at: int) -> tuple[float, float] | None:
    """Response time of one step and its standard error [s]; None where the yaw rate does not follow it."""
    back, half, ahead, settling = (
        round(s / drive.period) for s in (BEFORE, STEP_SECONDS / 2, AFTER, SETTLING)
    )
    before, after = slice(at - half - back, at - half), slice(at + half + settling, at + half + ahead)
    begins = _crossing(drive.road_wheel_angle, before, after, 0.5, at - half)
    ends = _crossing(drive.yaw_rate, before, after, RISEN, at - half)
    if begins is None or ends is None:
        return None
    rate = drive.yaw_rate
    change = abs(float(rate[after].mean() - rate[before].mean()))
    noise = float(np.hypot(np.std(rate[before]), np.std(rate[after])))
    slope = abs(float(np.gradient(rate, drive.period)[round(ends)]))
    if change < 3 * noise or slope <= 0:
        return None
    return (ends - begins) * drive.period, noise / np.sqrt(2) / slope


def _crossing(values: Array, before: slice, after: slice, share: float, begin: int) -> float | None:
    """Grid point, with its fraction, at which values first reach a share of their change."""
    low, high = float(values[before].mean()), float(values[after].mean())
    if high == low:
        return None
    risen = (values[begin : after.stop] - low) / (high - low)
    beyond = np.flatnonzero(risen >= share)
    if not beyond.size or beyond[0] == 0:
        return None
    k = int(beyond[0])
    return begin + k - 1 + float((share - risen[k - 1]) / (risen[k] - risen[k - 1]))
