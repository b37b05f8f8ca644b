"""Sines in a held command, one after the other in any order, with or without pauses.

Successive extremes half a period apart and equally far from each other make the core of a sine. A least
squares fit of it, u = c + a sin(w t) + b cos(w t) with w refined, is then extended sample by sample in both
directions for as long as the request stays on it, and accepted if it is one sine over a whole period. The
longest cores come first, so that a pause between two sines does not eat into them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from ident.experiments.found import Found
from ident.experiments.stretches import Stretch

Array = NDArray[np.float64]

SMALLEST_SHARE = 0.02  # of the range of the request: smaller bumps are no extremes
ALIKE = 0.12  # relative difference of half periods and of swings within one sine
OFF_SINE = 0.03  # of the amplitude: largest distance of the request from the sine
FEWEST_PER_CYCLE = 4  # commands
FEWEST_COMMANDS = 8  # in a sine, which has four free numbers
ONE_CYCLE = 0.98
TOO_SHORT = "one needed: drive it longer"
WORTH_TELLING = 0.75  # cycles
TOLD_COMMANDS = 12  # in a rejected sine: of fewer, noise gives many
TOLD_HALVES = 4  # half periods alike in a row, from which it is told why they are no sine
STEADY = 0.03  # of the frequency: largest change within a sine
NOTICED = 0.003  # of the amplitude: a smaller distance from the sine tells no change
EXPLAINED = 3.0  # times smaller is what is left once the frequency may change
LARGEST_SHIFT = 0.25  # of the frequency between the core and the whole
LARGEST_SWING = 0.53  # amplitude over the range of the request; from extreme to extreme a sine has 0.5
REFINEMENTS = 8
EXTENSIONS = 6


@dataclass(frozen=True)
class _Sine:
    frequency: float
    middle: float
    cosine: float
    sine: float

    @property
    def amplitude(self) -> float:
        return float(np.hypot(self.cosine, self.sine))

    def at(self, times: Array) -> Array:
        phase = self.frequency * times
        return self.middle + self.cosine * np.cos(phase) + self.sine * np.sin(phase)


def find_sines(stretch: Stretch, begin: int, end: int) -> list[Found]:
    """Sines among the commands ``begin`` to ``end`` (exclusive), also those rejected, with the reason."""
    part = slice(begin, end)
    times, values = stretch.command_times[part] - stretch.command_times[0], stretch.command_values[part]
    found: list[Found] = []
    taken: list[tuple[int, int]] = [(values.size, values.size)]
    for first, last, halves in sorted(_cores(times, values), key=lambda core: -core[2]):
        room = (
            max((high for _, high in taken if high <= first), default=0),
            min(low for low, _ in taken if low >= first),
        )
        if last >= room[1] or any(low <= first < high for low, high in taken):
            continue
        frequency = np.pi * halves / float(times[last] - times[first])
        low, high, sine = _grown(times, values, (first, last + 1), room, frequency)
        if sine is None:
            continue
        one = _found(stretch, begin + low, begin + high, sine)
        if one.rejected is None or (high - low >= TOLD_COMMANDS and (halves >= TOLD_HALVES or _nearly(one))):
            found.append(one)
            taken.append((low, high))
    return found


def _nearly(one: Found) -> bool:
    """Whether a rejected short wave is worth telling: a clean sine that only ended too early."""
    cycles = (one.end_time - one.start) * (one.frequency or 0.0) / (2 * np.pi)
    return bool(cycles > WORTH_TELLING and (one.rejected or "").endswith(TOO_SHORT))


def _cores(times: Array, values: Array) -> list[tuple[int, int, int]]:
    """(first extreme, last extreme, half periods) wherever half periods and swings are alike.

    A pause to the next sine may by chance be as long as a half period: every core is given without its first
    and without its last extreme too, which are tried where the whole is no sine.
    """
    span = float(np.ptp(values)) if values.size else 0.0
    if span == 0:
        return []
    extremes = np.sort(
        np.concatenate([find_peaks(sign * values, prominence=SMALLEST_SHARE * span)[0] for sign in (1, -1)])
    )
    if extremes.size < 2:
        return []
    halves, swings = np.diff(times[extremes]), np.abs(np.diff(values[extremes]))
    tolerance = 1.5 * float(np.median(np.diff(times)))
    cores, begin = [], 0
    for i in range(1, halves.size + 1):
        if (
            i < halves.size
            and _alike(halves[begin:i], halves[i], tolerance)
            and _alike(swings[begin:i], swings[i], 0)
        ):
            continue
        cores.append((int(extremes[begin]), int(extremes[i]), i - begin))
        if i - begin > 2:
            cores.append((int(extremes[begin]), int(extremes[i - 1]), i - begin - 1))
            cores.append((int(extremes[begin + 1]), int(extremes[i]), i - begin - 1))
        begin = i
    return cores


def _alike(before: Array, new: float, tolerance: float) -> bool:
    usual = float(np.median(before))
    return abs(new - usual) <= ALIKE * usual + tolerance


def _grown(
    times: Array, values: Array, core: tuple[int, int], room: tuple[int, int], frequency: float
) -> tuple[int, int, _Sine | None]:
    """Extend a core over all neighbours that lie on its sine, and fit again until nothing is added."""
    begin, end = core
    sine = _fit(times[begin:end], values[begin:end], frequency)
    for _ in range(EXTENSIONS):
        if sine is None:
            return begin, end, None
        off = np.abs(values - sine.at(times)) > OFF_SINE * sine.amplitude
        left = np.flatnonzero(off[room[0] : begin])
        right = np.flatnonzero(off[end : room[1]])
        new = (
            room[0] + int(left[-1]) + 1 if left.size else room[0],
            end + int(right[0]) if right.size else room[1],
        )
        if new == (begin, end):
            break
        begin, end = new
        sine = _fit(times[begin:end], values[begin:end], sine.frequency)
        if sine is None or not _plausible(sine, frequency, values[begin:end]):
            return begin, end, None
    return begin, end, sine


def _plausible(sine: _Sine, frequency: float, values: Array) -> bool:
    """Whether the fit is still the sine of its core, and no flat piece of a huge slow one."""
    near = abs(sine.frequency - frequency) <= LARGEST_SHIFT * frequency
    return near and sine.amplitude <= LARGEST_SWING * float(np.ptp(values))


def _fit(times: Array, values: Array, frequency: float) -> _Sine | None:
    """Least squares of middle, cosine, sine and frequency (Gauss-Newton in the frequency)."""
    if times.size < FEWEST_PER_CYCLE:
        return None
    guess = frequency
    best: _Sine | None = None
    for _ in range(REFINEMENTS):
        phase = guess * times
        basis = np.column_stack([np.ones_like(times), np.cos(phase), np.sin(phase)])
        linear = np.linalg.lstsq(basis, values, rcond=None)[0]
        slope = times * (linear[2] * np.cos(phase) - linear[1] * np.sin(phase))
        full = np.linalg.lstsq(np.column_stack([basis, slope]), values, rcond=None)[0]
        best = _Sine(float(guess), float(linear[0]), float(linear[1]), float(linear[2]))
        change = float(np.clip(full[3], -0.2 * guess, 0.2 * guess))
        guess += change
        if abs(change) < 1e-12 * guess:
            break
    return best


def _found(stretch: Stretch, begin: int, end: int, sine: _Sine) -> Found:
    times, values = stretch.command_times, stretch.command_values
    start = float(times[begin])
    stop = float(times[end]) if end < times.size else stretch.end
    own = times[begin:end] - times[0]
    return Found(
        kind="sine",
        begin=begin,
        end=end,
        start=start,
        end_time=stop,
        amplitude=sine.amplitude,
        frequency=sine.frequency,
        rejected=_why_not(stop - start, sine, own, values[begin:end]),
    )


def _why_not(duration: float, sine: _Sine, times: Array, values: Array) -> str | None:
    off = _rms(values - sine.at(times))
    cycles = duration * sine.frequency / (2 * np.pi)
    if cycles < ONE_CYCLE:
        return f"{cycles:.2f} cycles of {sine.frequency:.2f} rad/s, {TOO_SHORT}"
    if off > OFF_SINE * sine.amplitude:
        return f"no sine: it leaves {100 * off / sine.amplitude:.0f} % of its amplitude, at most 3 % allowed"
    per_cycle = times.size / cycles
    if per_cycle < FEWEST_PER_CYCLE:
        return f"{per_cycle:.1f} commands a cycle, {FEWEST_PER_CYCLE} needed"
    if times.size < FEWEST_COMMANDS:
        return f"{times.size} commands, {FEWEST_COMMANDS} needed: noise gives such sines too"
    change, left = _change(sine, times, values)
    share = abs(change) / sine.frequency
    if share > STEADY and off > max(NOTICED * sine.amplitude, EXPLAINED * left):
        return f"no sine: its frequency changes by {100 * share:.0f} %, at most 3 % allowed"
    return None


def _change(sine: _Sine, times: Array, values: Array) -> tuple[float, float]:
    """Change of the frequency over a sine [rad/s], and the rms distance left once it may change."""
    phase, since = sine.frequency * times, times - times.mean()
    slope = sine.sine * np.cos(phase) - sine.cosine * np.sin(phase)
    columns = np.column_stack(
        [np.ones_like(times), np.cos(phase), np.sin(phase), since * slope, since**2 * slope]
    )
    linear = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(2 * linear[4] * (times[-1] - times[0])), _rms(values - columns @ linear)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
