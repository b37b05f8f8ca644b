"""A steering actuator with play, a limited rate and a dead zone, integrated in small steps in plain Python.

Shares nothing with ``ident``: Runge-Kutta steps between the instants at which something is sent or sampled.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truck:
    """Gain, dead time L, lags T1 and T2 [s], limit of the rate, play, dead zone."""

    gain: float = 1.0
    dead_time: float = 0.1
    first: float = 0.2
    second: float = 0.08
    rate: float = inf
    play: float = 0.0
    dead_zone: float = 0.0

    def answer(
        self,
        sent: Array,
        requests: Array,
        times: Array,
        *,
        start: tuple[float, float] = (0.0, 0.0),
        steps: int = 8,
        before: float = 0.0,
    ) -> Array:
        """(n,) angle at the sensor, from angle and rate at the first time.

        before : angle that the actuator was asked for before the first request
        """
        acts = [t + self.dead_time for t in sent.tolist()]
        targets = [before, *(self._target(u) for u in requests.tolist())]
        y, x = start[0], start[0] + self.second * start[1]
        z = y
        seen = {float(times[0]): z}
        instants = sorted({*acts, *times.tolist()})
        instants = [t for t in instants if times[0] <= t <= times[-1]]
        for begin, end in pairwise(instants):
            target = targets[bisect_right(acts, begin)]
            step = (end - begin) / steps
            for _ in range(steps):
                x, y = self._stepped(x, y, target, step)
                z = min(max(z, y - self.play / 2), y + self.play / 2)
            seen[end] = z
        return np.array([seen[t] for t in times.tolist()])

    def _target(self, request: float) -> float:
        size = max(abs(request) - self.dead_zone, 0.0)
        return self.gain * (size if request > 0 else -size)

    def _slope(self, x: float, y: float, target: float) -> tuple[float, float]:
        rate = (x - y) / self.second
        return (target - x) / self.first, min(max(rate, -self.rate), self.rate)

    def _stepped(self, x: float, y: float, target: float, h: float) -> tuple[float, float]:
        x1, y1 = self._slope(x, y, target)
        x2, y2 = self._slope(x + h / 2 * x1, y + h / 2 * y1, target)
        x3, y3 = self._slope(x + h / 2 * x2, y + h / 2 * y2, target)
        x4, y4 = self._slope(x + h * x3, y + h * y3, target)
        return x + h / 6 * (x1 + 2 * x2 + 2 * x3 + x4), y + h / 6 * (y1 + 2 * y2 + 2 * y3 + y4)
