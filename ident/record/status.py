"""How a recording goes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Tally:
    """What was recorded of a topic.

    lost : samples that DDS knows to be lost; of best-effort writers it knows none
    rate : of the last second [1/s]
    best_effort : whether one of its writers does not send again what was lost on the way
    """

    topic: str
    kind: str
    messages: int = 0
    bytes: int = 0
    lost: int = 0
    rate: float = 0.0
    best_effort: bool = False


@dataclass(frozen=True)
class Status:
    """How a recording goes.

    seconds : since it began [s]
    refused : (topic, type, why)
    """

    seconds: float
    topics: list[Tally]
    refused: list[tuple[str, str, str]]
    bytes: int

    @property
    def messages(self) -> int:
        """Of all topics."""
        return sum(tally.messages for tally in self.topics)

    @property
    def lost(self) -> int:
        """Of all topics."""
        return sum(tally.lost for tally in self.topics)
