"""What every result holds: estimates, refusals, provenance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

SCHEMA_VERSION = "1"

Status = Literal["identified", "weak", "not_identifiable"]


@dataclass(frozen=True)
class Estimate:
    """A value with its standard error and its 95 % interval.

    value : the estimate, None where the data cannot give one
    std : standard error
    low, high : ends of the 95 % interval, None where there is none
    reason : why the status is not ``identified``
    """

    value: float | None
    std: float | None
    low: float | None
    high: float | None
    unit: str
    status: Status = "identified"
    reason: str | None = None


@dataclass(frozen=True)
class Refusal:
    """A question that the data cannot answer."""

    what: str
    reason: str


@dataclass(frozen=True)
class LogFile:
    """One file that was read."""

    path: str
    sha256: str
    bytes: int


@dataclass(frozen=True)
class Provenance:
    """What an output was made from; two runs are equal but for ``date``.

    files : the logs, with paths relative to the LOGS argument
    applied : which channel map, vehicle file and recipe were used, for each run
    command : the command that makes this output again
    """

    version: str
    command: str
    seed: int
    date: str
    files: list[LogFile] = field(default_factory=list)
    applied: dict[str, str] = field(default_factory=dict)
