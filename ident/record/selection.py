"""Which topics are recorded, and the names that they get in the log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase


def log_name(topic: str, kind: str) -> str:
    """Return the name of a topic in the log: ROS 2's ``rt/chatter`` is ``/chatter``; others stay."""
    return topic.removeprefix("rt") if topic.startswith("rt/") and "::dds_::" in kind else topic


@dataclass(frozen=True)
class Selection:
    """Names or globs of topics, as DDS or ROS 2 writes them.

    wanted : what is recorded; empty: all topics
    unwanted : what is left out of that
    """

    wanted: Sequence[str] = ()
    unwanted: Sequence[str] = ()

    def takes(self, topic: str, kind: str) -> bool:
        """Whether a topic of this type is recorded."""
        names = {topic, log_name(topic, kind)}
        return (not self.wanted or _any(self.wanted, names)) and not _any(self.unwanted, names)

    def missing(self, topics: Sequence[tuple[str, str]]) -> list[str]:
        """Return what is wanted and is none of these (topic, type)."""
        names = [{topic, log_name(topic, kind)} for topic, kind in topics]
        return [each for each in self.wanted if not any(_any([each], name) for name in names)]


def _any(patterns: Sequence[str], names: set[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns for name in names)
