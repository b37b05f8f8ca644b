"""Results of ``ident info``: what is in the logs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ident.results.common import Estimate, Provenance, Refusal


@dataclass(frozen=True)
class Damage:
    """What a log has lost: ``what`` says it in one line; a count is None where nothing tells it."""

    what: str
    messages_lost: int | None = None
    seconds_lost: float | None = None
    bytes_lost: int | None = None

    def __post_init__(self) -> None:
        """Put on one line what may quote the log."""
        object.__setattr__(self, "what", " ".join(self.what.split()))


@dataclass(frozen=True)
class Gap:
    """A stretch without samples: from ``start`` [s since the start of the run], ``seconds`` long."""

    start: float
    seconds: float


@dataclass(frozen=True)
class TopicHealth:
    """How one topic was recorded.

    rate : median rate [1/s], None below three messages
    jitter : spread (half of the 16-84 % range) of the period, in parts of the period
    gaps : stretches without messages longer than 1.5 periods
    lost : messages missing in those gaps, at the median rate, None where there is no steady rate
    out_of_order, repeated_stamps : messages stamped before, or the same as, their predecessor
    arrival_delay, arrival_delay_p95 : log time minus header stamp, median and 95 % point [s]
    """

    name: str
    type: str
    messages: int
    rate: float | None
    jitter: float | None
    gaps: list[Gap]
    lost: int | None
    stamp: Literal["header", "log"]
    out_of_order: int = 0
    repeated_stamps: int = 0
    arrival_delay: float | None = None
    arrival_delay_p95: float | None = None


@dataclass(frozen=True)
class SignalHealth:
    """One signal of the glossary as it was found in a run.

    source : "topic.field" or what it is derived from
    resolution : smallest step between different values, where the signal is quantised
    repeated : share of samples equal to the one before
    not_finite : samples that are NaN or infinite, left out
    """

    name: str
    unit: str
    source: str
    samples: int
    low: float | None
    high: float | None
    resolution: float | None
    repeated: float
    not_finite: int


@dataclass(frozen=True)
class Latency:
    """How late ``signal`` is against ``reference`` [s]; reported, never removed unasked."""

    signal: str
    reference: str
    delay: Estimate


@dataclass(frozen=True)
class RunHealth:
    """What a run holds and what is wrong with it."""

    name: str
    format: str
    start: str
    duration: float
    channels: str
    vehicle: str
    topics: list[TopicHealth]
    signals: dict[str, SignalHealth]
    missing: list[str]
    latencies: list[Latency] = field(default_factory=list)
    clocks: list[str] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)


@dataclass(frozen=True)
class InfoResult:
    """`ident info`: what is in the logs."""

    schema_version: str
    provenance: Provenance
    runs: list[RunHealth]
    unreadable: list[Refusal]
    warnings: list[str]
