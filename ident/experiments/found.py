"""What an experiment is: a part of the request that a method can use.

``begin`` and ``end`` are indices into the commands of a stretch; ``end`` is exclusive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Found:
    """An experiment within a stretch.

    start, end : [s since the start of the run]; ``end`` is when the next change begins
    start_uncertainty : how much earlier than ``start`` the change may have been [s]
    level_before, level_after : request before and after a step or pulse [rad]; before is None where the
        stretch begins with the step
    hold_before : how long the request was constant before the step [s]
    amplitude : of a step or pulse (signed) or of a sine [rad]; frequency : of a sine [rad/s]
    rejected : why it is no sine, where it looked like one
    """

    kind: Literal["step", "pulse", "sine", "other"]
    begin: int
    end: int
    start: float
    end_time: float
    amplitude: float
    level_before: float | None = None
    level_after: float | None = None
    hold_before: float = 0.0
    start_uncertainty: float = 0.0
    frequency: float | None = None
    rejected: str | None = None
