"""What a file has lost, added up by kind of defect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from ident.results import Damage

Number = TypeVar("Number", int, float)


@dataclass
class Loss:
    """One defect at byte (or row) ``place``; a count is None where nothing tells it."""

    what: str
    place: int
    messages: int | None = None
    seconds: float | None = None
    bytes: int | None = None
    detail: str = ""


def summarise(file: str, losses: list[Loss], unit: str = "byte") -> list[Damage]:
    """Add up the losses of one file: one entry a kind of defect, in order of appearance."""
    return [_sum(file, [loss for loss in losses if loss.what == what], unit) for what in _kinds(losses)]


def _kinds(losses: list[Loss]) -> list[str]:
    return list(dict.fromkeys(loss.what for loss in losses))


def _sum(file: str, losses: list[Loss], unit: str) -> Damage:
    first = losses[0]
    times = f"{len(losses)} times " if len(losses) > 1 else ""
    where = f", {'first ' if times else ''}at {unit} {first.place}"
    detail = f" ({first.detail})" if first.detail else ""
    return Damage(
        f"{file}: {times}{first.what}{detail}{where}",
        _total([loss.messages for loss in losses]),
        _total([loss.seconds for loss in losses]),
        _total([loss.bytes for loss in losses]),
    )


def _total(counts: Sequence[Number | None]) -> Number | None:
    known = [count for count in counts if count is not None]
    return sum(known[1:], known[0]) if known and len(known) == len(counts) else None
