"""Which clock the samples of each topic are on, and which stamps are not to be believed.

The sender's header stamp is used where a message has one, else the recorder's log time. All topics of a run
are brought to one clock: the one that most topics are stamped with. A topic stamped by another clock (more
than ``SAME_CLOCK`` apart) falls back to its log time; a stamp that far from its topic's usual delay is
no stamp, and its message is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.logs import Columns
from ident.results import Damage

SAME_CLOCK = 60 * 10**9


@dataclass(frozen=True)
class TopicTimes:
    """Times of the messages of one topic.

    stamps : (n,) on the clock of the run [ns], in the order of the file
    keep : (n,) False where the stamp is not to be believed
    arrival : (n,) log times on the clock of the run [ns]
    kind : what the stamps come from
    """

    stamps: NDArray[np.int64]
    keep: NDArray[np.bool_]
    arrival: NDArray[np.int64]
    kind: Literal["header", "log"]


@dataclass(frozen=True)
class Clock:
    """The clock of a run: ``offset`` is log time minus header stamp where these are two clocks [ns]."""

    offset: int
    header_topics: frozenset[str]
    notes: tuple[str, ...] = ()


def choose_clock(columns: Mapping[str, Columns]) -> Clock:
    """Find the clock that most topics are stamped with, and the topics that are on it."""
    delays = {topic: delay for topic, read in columns.items() if (delay := _usual_delay(read)) is not None}
    if not delays:
        return Clock(0, frozenset())
    agreeing = {
        topic: [other for other in delays if abs(delays[other] - delay) <= SAME_CLOCK]
        for topic, delay in delays.items()
    }
    best = min(delays, key=lambda topic: (-len(agreeing[topic]), abs(delays[topic])))
    members = frozenset(agreeing[best])
    offset = int(np.median([delays[topic] for topic in members]))
    notes = [
        f"{topic}: header stamps are {-delay / 1e9:+.1f} s from the log time, another clock than that of "
        f"the other topics: log time used"
        for topic, delay in delays.items()
        if topic not in members
    ]
    if abs(offset) <= SAME_CLOCK:
        return Clock(0, members, tuple(notes))
    notes.append(
        f"header stamps are {-offset / 1e9:+.1f} s from the log times: the run is on the stamps' clock"
    )
    return Clock(offset, members, tuple(notes))


def _usual_delay(columns: Columns) -> int | None:
    """Median of log time minus header stamp [ns], None where there is no stamp or it is always zero."""
    if columns.header_stamp is None:
        return None
    stamped = columns.header_stamp != 0
    if not stamped.any():
        return None
    return int(np.median(columns.log_time[stamped] - columns.header_stamp[stamped]))


def topic_times(
    topic: str, columns: Columns, clock: Clock, wanted: Literal["header", "log"]
) -> tuple[TopicTimes, list[Damage]]:
    """Times of a topic on the clock of its run, and what had to be left out."""
    arrival = columns.log_time - clock.offset
    usable = np.ones(len(arrival), dtype=np.bool_)
    if wanted == "log" or columns.header_stamp is None or topic not in clock.header_topics:
        return TopicTimes(arrival, usable, arrival, "log"), []
    stamps = columns.header_stamp
    delay = columns.log_time - stamps
    usual = np.median(delay[stamps != 0])
    keep = (np.abs(delay - usual) <= SAME_CLOCK) & (stamps != 0)
    wrong = int(np.count_nonzero(~keep))
    text = f"{topic}: stamped 0 or more than {SAME_CLOCK / 1e9:.0f} s off, left out"
    return TopicTimes(stamps, keep, arrival, "header"), [Damage(text, wrong)] if wrong else []
