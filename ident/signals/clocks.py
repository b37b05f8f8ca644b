"""What the header stamps of a run say against its log times: how far apart, drift, jumps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ident.signals.stamps import TopicTimes

Array = NDArray[np.float64]

MIN_MESSAGES = 100
BLOCKS = 20
SMALLEST_DRIFT = 5e-6
SMALLEST_CHANGE = 1e-3
SMALLEST_JUMP = 0.02
HALF_WINDOW = 10
MOST_JUMPS = 3


def clock_notes(times: Mapping[str, TopicTimes], zero: int) -> list[str]:
    """Lines about the clocks of a run whose topics are stamped like this; ``zero`` is its start [ns]."""
    stamped = {topic: each for topic, each in times.items() if each.kind == "header" and each.keep.any()}
    delays = {topic: (each.arrival - each.stamps)[each.keep] / 1e9 for topic, each in stamped.items()}
    notes = list(_usual(list(delays.values())))
    for topic, delay in delays.items():
        when = (stamped[topic].stamps[stamped[topic].keep] - zero) / 1e9
        jumps = _jumps(when, delay)
        notes += [f"{topic}: {jump}" for jump in jumps]
        if not jumps:
            notes += [f"{topic}: {drift}" for drift in _drift(when, delay)]
    return notes


def _usual(delays: list[Array]) -> Iterator[str]:
    if not delays:
        return
    if all(np.all(delay == 0) for delay in delays):
        yield "header stamps equal the log times: transport delays cannot be seen"
        return
    medians = [1e3 * float(np.median(delay)) for delay in delays]
    low, high = min(medians), max(medians)
    ends = list(dict.fromkeys((f"{low:.1f}", f"{high:.1f}")))
    span = f"{' to '.join(ends)} ms"
    topics = f"{len(delays)} topics" if len(delays) > 1 else "1 topic"
    yield f"header stamps are {span} before the log times (medians of {topics})"
    if low < 0:
        yield "messages arrived before they were stamped: sender and recorder are on two clocks"


def _drift(when: Array, delay: Array) -> Iterator[str]:
    """Slope of the delay, from the 10 % points of blocks, which queues disturb least."""
    if len(delay) < MIN_MESSAGES:
        return
    blocks = np.array_split(np.arange(len(delay)), BLOCKS)
    x = np.array([when[block].mean() for block in blocks])
    y = np.array([np.percentile(delay[block], 10) for block in blocks])
    x = x - x.mean()
    slope = float(x @ y / (x @ x)) if x @ x > 0 else 0.0
    residual = y - y.mean() - slope * x
    error = float(np.sqrt(residual @ residual / (BLOCKS - 2) / (x @ x))) if x @ x > 0 else np.inf
    if abs(slope) > max(4 * error, SMALLEST_DRIFT) and abs(slope) * np.ptp(when) > SMALLEST_CHANGE:
        yield f"log time drifts by {1e6 * slope:+.0f} ppm against the header stamps (± {2e6 * error:.0f})"


def _jumps(when: Array, delay: Array) -> list[str]:
    """Lasting steps of the delay: the medians of the samples before and after differ."""
    if len(delay) < MIN_MESSAGES:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(delay, HALF_WINDOW)
    medians = np.median(windows, axis=1)
    step = medians[HALF_WINDOW:] - medians[:-HALF_WINDOW]
    spread = 1.4826 * float(np.median(np.abs(delay - np.median(delay))))
    threshold = max(SMALLEST_JUMP, 8 * spread)
    found: list[str] = []
    candidates = np.flatnonzero(np.abs(step) > threshold)
    while len(candidates) and len(found) < MOST_JUMPS:
        near = candidates[candidates < candidates[0] + 2 * HALF_WINDOW]
        at = near[np.argmax(np.abs(step[near]))]
        if _lasts(delay, at + HALF_WINDOW, step[at]):
            found.append(f"the delay jumps by {1e3 * step[at]:+.0f} ms at {when[at + HALF_WINDOW]:.1f} s")
        candidates = candidates[candidates > near[-1]]
    return found


def _lasts(delay: Array, at: int, step: float) -> bool:
    """Whether what follows for ten windows stays on the other side of the middle."""
    before = np.median(delay[max(at - 10 * HALF_WINDOW, 0) : at])
    after = np.median(delay[at : at + 10 * HALF_WINDOW])
    return bool(abs(after - before) > abs(step) / 2)
