"""What the logs become: runs of named signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.results import LogFile, Refusal, RunHealth
from ident.vehicle import ReferencePoint, Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Signal:
    """One signal of a run.

    time : (n,) rising, since the start of the run [s]
    values : (n,) finite, in ``unit`` (SI); headings are unwrapped
    arrival : (n,) when the recorder received it, on the same clock [s], None where that is its time
    raw : whether the values are counts, refused in a fit
    at : the point of the vehicle that it refers to, None where that is not said
    """

    name: str
    time: Array
    values: Array
    unit: str
    arrival: Array | None = None
    raw: bool = False
    at: ReferencePoint | None = None


@dataclass(frozen=True)
class Run:
    """One run: its signals by their names in the glossary; time zero is ``start_ns`` [ns since 1970]."""

    name: str
    start_ns: int
    duration: float
    signals: Mapping[str, Signal]
    vehicle: Vehicle | None
    health: RunHealth


@dataclass(frozen=True)
class LoadedLogs:
    """All runs that could be read, and those that could not, with the reason."""

    runs: list[Run]
    unreadable: list[Refusal]
    files: list[LogFile]
    warnings: list[str]
