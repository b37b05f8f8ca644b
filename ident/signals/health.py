"""How well a topic was recorded and what a signal's values look like; nothing here changes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ident.results import Gap, SignalHealth, TopicHealth
from ident.signals.stamps import TopicTimes

GAP_PERIODS = 1.5
STEADY = 0.2
UNSTEADY_GAP_PERIODS = 5.0
MOST_GAPS = 200
MIN_CHANGES = 30
MIN_LEVELS = 5


def topic_health(name: str, kind: str, times: TopicTimes, zero: int) -> TopicHealth:
    """Rate, jitter, gaps and delays of a topic's stamps.

    Notes
    -----
    A gap is longer than 1.5 median periods; where the period is not steady (its spread is above 20 %) only
    what is longer than 5, and then no lost messages are counted. Of more than 200 gaps the longest 200 are
    listed.
    """
    stamps = times.stamps[times.keep]
    ordered = np.sort(stamps)
    steps = np.diff(ordered)
    steps = steps[steps > 0] / 1e9
    period = float(np.median(steps)) if len(steps) >= 2 else None
    jitter = _spread(steps) / period if period else None
    steady = jitter is not None and jitter <= STEADY
    gaps, lost = _gaps(ordered, zero, period, steady=steady)
    delay = (times.arrival - times.stamps)[times.keep] / 1e9 if times.kind == "header" else np.empty(0)
    return TopicHealth(
        name=name,
        type=kind,
        messages=len(times.stamps),
        rate=1.0 / period if period else None,
        jitter=jitter,
        gaps=gaps,
        lost=lost if steady else None,
        stamp=times.kind,
        out_of_order=int(np.count_nonzero(np.diff(stamps) < 0)),
        repeated_stamps=int(np.count_nonzero(np.diff(ordered) == 0)),
        arrival_delay=float(np.median(delay)) if len(delay) else None,
        arrival_delay_p95=float(np.percentile(delay, 95)) if len(delay) else None,
    )


def _spread(values: NDArray[np.float64]) -> float:
    low, high = np.percentile(values, [16, 84])
    return float(high - low) / 2


def _gaps(
    ordered: NDArray[np.int64], zero: int, period: float | None, *, steady: bool
) -> tuple[list[Gap], int]:
    if period is None:
        return [], 0
    steps = np.diff(ordered) / 1e9
    long = np.flatnonzero(steps > (GAP_PERIODS if steady else UNSTEADY_GAP_PERIODS) * period)
    lost = int(np.sum(np.round(steps[long] / period) - 1))
    longest = np.sort(long[np.argsort(-steps[long], kind="stable")[:MOST_GAPS]])
    return [Gap(float(ordered[i] - zero) / 1e9, float(steps[i])) for i in longest], lost


def signal_health(
    name: str, unit: str, source: str, values: NDArray[np.float64], not_finite: int
) -> SignalHealth:
    """Range, resolution and repetitions of a signal's values (n,), all finite."""
    return SignalHealth(
        name=name,
        unit=unit,
        source=source,
        samples=len(values),
        low=float(values.min()) if len(values) else None,
        high=float(values.max()) if len(values) else None,
        resolution=resolution(values),
        repeated=float(np.mean(np.diff(values) == 0)) if len(values) > 1 else 0.0,
        not_finite=not_finite,
    )


def resolution(values: NDArray[np.float64]) -> float | None:
    """Quantisation step of a signal, None where it has none that shows.

    Notes
    -----
    The step is the smallest distance of two different values that is no rounding error, refined by least
    squares; it counts if all distances are multiples of it within 2 %. A signal with few levels or few
    changes (a command of three amplitudes) tells no resolution.
    """
    levels = np.unique(values)
    span = float(np.ptp(levels)) if len(levels) else 0.0
    distances = np.diff(levels)
    distances = distances[distances > 1e-6 * span]
    if len(distances) + 1 < MIN_LEVELS or np.count_nonzero(np.diff(values)) < MIN_CHANGES:
        return None
    step = float(distances.min())
    for _ in range(2):
        multiples = np.round(distances / step)
        step = float(distances @ multiples / (multiples @ multiples))
    off = np.abs(distances / step - multiples)
    if np.mean(off < 0.02) < 0.98 or span / step > 1e5:
        return None
    return step
