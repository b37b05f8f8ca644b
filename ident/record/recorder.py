"""Record topics of a DDS domain until told to stop: discover, ask for types, take, write.

One thread takes and writes; asking for types happens in others, for an answer may take seconds. The log time
of a message is when it was taken from the reader (about a millisecond after it came), its publish time the
writer's own stamp. A topic is recorded from the moment at which its type is known; writers that join later
are found as they are announced.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import IdentError, UnusableLog
from ident.record.cyclone import Domain, Offer, Sample, Source, Told
from ident.record.log_file import LogFile
from ident.record.selection import Selection, log_name
from ident.record.status import Status, Tally
from ident.record.type_text import UntoldType

FLUSH_EVERY = 1.0
PATIENCE = 5.0
_LONGEST_WAIT = 0.1
_ASKING = 4


@dataclass(frozen=True)
class Request:
    """What to record where; ``duration`` [s], None: until told to stop."""

    domain: int
    out: Path
    selection: Selection
    duration: float | None = None
    overwrite: bool = False


@dataclass(frozen=True)
class Watch:
    """How a recording is followed: whether it shall stop, each second how it goes, and what happens."""

    stop: Callable[[], bool]
    show: Callable[[Status], None]
    note: Callable[[str], None]


def record(request: Request, watch: Watch) -> Status:
    """Record until the duration is over or ``watch.stop`` says so.

    Raises
    ------
    UsageError
        If the file exists or cannot be made, the domain cannot be joined, or the disk takes no more.
    UnusableLog
        If nothing was recorded, saying which topics there were; then there is no file either.
    """
    with Domain(request.domain) as domain, LogFile(request.out, overwrite=request.overwrite) as log:
        recording = _Recording(request, watch, domain, log)
        with ThreadPoolExecutor(_ASKING, "types") as pool:
            try:
                recording.run(pool)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
        status = recording.finish()
    if not status.messages:
        if request.out.is_file() and not request.out.is_symlink():
            request.out.unlink()
        raise UnusableLog(recording.nothing())
    return status


@dataclass
class _Group:
    """Writers that one reader reads; None while their type is asked for, or where they are refused."""

    offer: Offer
    source: Source | None = None
    channel: int = 0
    tally: Tally | None = None


@dataclass
class _Recording:
    request: Request
    watch: Watch
    domain: Domain
    log: LogFile
    _groups: dict[tuple[str, str, bytes, str], _Group] = field(default_factory=dict)
    _owners: dict[int, _Group] = field(default_factory=dict)
    _asked: list[tuple[_Group, Future[Told]]] = field(default_factory=list)
    _channels: dict[tuple[str, str, str], tuple[int, Tally]] = field(default_factory=dict)
    _by_source: dict[int, _Group] = field(default_factory=dict)
    _refused: list[tuple[str, str, str]] = field(default_factory=list)
    _others: dict[tuple[str, str], None] = field(default_factory=dict)
    _begun: float = field(default_factory=time.monotonic)
    _flushed: float = field(default_factory=time.monotonic)
    _counted: dict[int, int] = field(default_factory=dict)

    def run(self, pool: ThreadPoolExecutor) -> None:
        """Go on until told to stop."""
        end = None if self.request.duration is None else self._begun + self.request.duration
        while not self.watch.stop():
            now = time.monotonic()
            if end is not None and now >= end:
                return
            left = self._flushed + FLUSH_EVERY - now
            if left <= 0:
                self._flush()
                left = FLUSH_EVERY
            longest = _LONGEST_WAIT / 10 if self._asked else _LONGEST_WAIT
            sources = self.domain.wait(max(min(left, longest, left if end is None else end - now), 0.0))
            self._discover(pool)
            for source in sources:
                self._take(source, pool)

    def finish(self) -> Status:
        """Take what has arrived by now, and write what is known of the whole."""
        for source in self.domain.wait(0.0):
            self._take(source, None)
        self._flush()
        return self._status()

    def nothing(self) -> str:
        """Say why there is no message."""
        problems = [f"{topic} ({kind}): {why}" for topic, kind, why in self._refused]
        seen = [(group.offer.topic, group.offer.kind) for group in self._groups.values()]
        problems += [f"{name}: no writer seen" for name in self.request.selection.missing(seen)]
        problems += [f"{each.topic}: its writer sent nothing" for each in self._status().topics]
        others = ", ".join(topic for topic, _ in self._others) or "none"
        told = "; ".join(problems) or "no writer seen"
        return f"nothing was recorded in domain {self.request.domain}: {told}; other topics there: {others}"

    # --- writers ----------------------------------------------------------------------------------

    def _discover(self, pool: ThreadPoolExecutor | None) -> None:
        """Sort new writers into groups, ask for the types of new groups, and open those that were told."""
        for offer in self.domain.offers() if pool is not None else ():
            if not self.request.selection.takes(offer.topic, offer.kind):
                self._others[offer.topic, offer.kind] = None
                continue
            group = self._groups.get(offer.group)
            if group is None and pool is not None:
                group = self._groups[offer.group] = _Group(offer)
                self._asked.append((group, pool.submit(self.domain.type_of, offer, PATIENCE)))
            if group is not None:
                self._owners[offer.handle] = group
        for group, told in [each for each in self._asked if each[1].done()]:
            self._asked.remove((group, told))
            try:
                self._open(group, told.result())
            except UntoldType as error:
                self._refuse(group, str(error))

    def _open(self, group: _Group, told: Told) -> None:
        offer = group.offer
        source = self.domain.open(offer, told)
        name = log_name(offer.topic, offer.kind)
        key = (name, told.name, told.idl)
        if key not in self._channels:
            more = {
                "dds_topic": offer.topic,
                "dds_type": offer.kind,
                "dds_qos": offer.quality,
            }
            channel = self.log.channel(name, told.name, told.idl, more)
            self._channels[key] = channel, Tally(name, told.name)
            self.watch.note(f"recording {name} ({told.name})")
        group.channel, group.tally = self._channels[key]
        group.tally.best_effort |= offer.best_effort
        group.source = source
        self._by_source[id(source)] = group

    def _refuse(self, group: _Group, why: str) -> None:
        """Say that a group is not recorded; the same once for all kinds of offer."""
        told = (log_name(group.offer.topic, group.offer.kind), group.offer.kind, why)
        if told not in self._refused:
            self._refused.append(told)
            self.watch.note(f"refused {told[0]} ({told[1]}): {why}")

    # --- samples ----------------------------------------------------------------------------------

    def _take(self, source: Source, pool: ThreadPoolExecutor | None) -> None:
        samples = source.take()
        received = time.time_ns()
        group = self._by_source[id(source)]
        for sample in samples:
            if sample.writer not in self._owners:
                self._discover(pool)
            if self._owners.get(sample.writer, group) is group:
                self._write(group, sample, received)

    def _write(self, group: _Group, sample: Sample, received: int) -> None:
        tally = group.tally
        if tally is None:
            raise IdentError(f"{group.offer.topic} is read before it was opened")
        self.log.write(group.channel, sample.data, received=received, sent=sample.sent, number=tally.messages)
        tally.messages += 1
        tally.bytes += len(sample.data)

    def _flush(self) -> None:
        """Count, write, and show how it goes."""
        now = time.monotonic()
        passed = max(now - self._flushed, 1e-3)
        self._flushed = now
        for channel, tally in self._channels.values():
            groups = [each for each in self._by_source.values() if each.channel == channel]
            tally.lost = sum(each.source.lost() for each in groups if each.source is not None)
            tally.rate = (tally.messages - self._counted.get(channel, 0)) / passed
            self._counted[channel] = tally.messages
        self.log.flush(self._known())
        self.watch.show(self._status())

    def _known(self) -> dict[str, str]:
        """Return what the metadata of the file say."""
        tallies = [tally for _, tally in self._channels.values()]
        lost = {tally.topic: tally.lost for tally in tallies if tally.lost}
        uncounted = sorted({tally.topic for tally in tallies if tally.best_effort})
        refused = [{"topic": topic, "type": kind, "reason": why} for topic, kind, why in self._refused]
        return {
            "domain": str(self.request.domain),
            "samples_lost": json.dumps(lost),
            "losses_not_counted": json.dumps(uncounted),
            "writers_refused": json.dumps(refused),
        }

    def _status(self) -> Status:
        seconds = time.monotonic() - self._begun
        return Status(seconds, [tally for _, tally in self._channels.values()], self._refused, self.log.bytes)
