"""CHANNELS OF ALL FILES -> TOPICS: what was recorded under one name, one topic for each type.

The type of which a name has most messages is the topic of that name; every other type under the same name is
a topic of its own, ``/name (package/msg/Type)``, so that no two meanings are mixed. Channels of one name and
type are one topic. Where their definitions differ (a message that gained a field), each is decoded by its
own, fields of one name are taken as one, and that is told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.logs.decode import BinaryDecoder, Decoder, make_decoder
from ident.logs.record import Channel, Columns, FieldError, Storage, Stored, Times
from ident.logs.schema import normal
from ident.results import Damage

Part = tuple[Storage, Channel]
Some = Callable[[Sequence[Part]], Stored]


class RecordedTopic:
    """One topic: the channels of one name and type, and what decodes them.

    Parameters
    ----------
    name : by which it is asked for; recorded : under which it was recorded
    parts : its channels, each with the file that holds it
    some : reads some messages of channels, for encodings that have no definition
    """

    def __init__(self, name: str, recorded: str, parts: Sequence[Part], some: Some) -> None:
        self.name = name
        self.recorded = recorded
        self.parts = parts
        self.type = parts[0][1].type
        self._some = some

    def times(self) -> Times:
        """Log times of all messages [ns], in the order of the files."""
        by_file = [
            np.concatenate([storage.times(channel) for channel in self.channels_of(storage)])
            for storage in dict.fromkeys(storage for storage, _ in self.parts)
        ]
        parts = [times[np.argsort(times, kind="stable")] if self._several else times for times in by_file]
        return np.concatenate([np.empty(0, np.int64), *parts])

    def count(self) -> int:
        """How many messages there are."""
        return sum(storage.count(channel) for storage, channel in self.parts)

    def channels_of(self, storage: Storage) -> list[Channel]:
        """Channels that one file holds."""
        return [channel for other, channel in self.parts if other is storage]

    @cached_property
    def _several(self) -> bool:
        """Whether a file holds it in several channels, which only the log times put in an order."""
        return any(len(self.channels_of(storage)) > 1 for storage, _ in self.parts)

    # --- decoding ---------------------------------------------------------------------------------

    def fields(self) -> dict[str, str]:
        """Return the paths of all numbers in its messages, with their types."""
        found: dict[str, str] = {}
        for each in self._readable():
            found = {**each.decoder.fields(), **found}
        return found

    def expand(self, name: str) -> list[str]:
        """Return the numbers that a field stands for; ``FieldError`` where it does not exist."""
        first, *others = self._readable()
        try:
            return first.decoder.expand(name)
        except FieldError:
            for other in others:
                if (found := other.expanded(name)) is not None:
                    return found
            raise

    def columns(self, channel: Channel, stored: Stored, fields: Sequence[str]) -> Columns:
        """Decode messages of one channel; fields that its definition does not have are NaN."""
        of = self._of[id(channel)]
        lacks = of.lacks(self, fields)
        read = of.decoder.columns(stored, [field for field in fields if field not in lacks])
        if not lacks:
            return read
        nothing = np.full(len(read.log_time), np.nan)
        parts = [part for field in fields for part in self.expand(field)]
        return replace(read, values={part: read.values.get(part, nothing) for part in parts})

    def useful(self, channel: Channel, fields: Sequence[str]) -> bool:
        """Whether messages of a channel can be decoded and hold any of these fields."""
        found = self._of.get(id(channel))
        return found is not None and (not fields or len(found.lacks(self, fields)) < len(fields))

    def joined(self, parts: Sequence[tuple[Storage, Columns]], fields: Sequence[str]) -> Columns:
        """Put columns in the order of the files, and add up what could not be decoded."""
        ordered: list[Columns] = [self.columns(self._readable()[0].parts[0][1], _NOTHING, fields)]
        for storage in dict.fromkeys(storage for storage, _ in parts):
            found = _one_behind_the_other([columns for other, columns in parts if other is storage])
            ordered.append(_by_time(found) if self._several else found)
        found = _one_behind_the_other(ordered)
        lost = sum(item.messages_lost or 0 for item in found.damage)
        told = [Damage(f"{self.name}: {found.damage[0].what}", lost)] if found.damage else []
        return replace(found, damage=[*told, *self._left_out(fields)])

    def told(self) -> list[Damage]:
        """Say where messages of several definitions are taken for one topic."""
        if len({_definition(channel) for _, channel in self.parts}) < 2:
            return []
        count = sum(kind.problem is None for kind in self._kinds)
        if count < 2:
            return []
        text = f"recorded with {count} definitions of {self.type}"
        return [Damage(f"{self.name}: {text}: fields of one name are taken as one")]

    def _left_out(self, fields: Sequence[str]) -> list[Damage]:
        """Say how many messages do not hold what is asked for, and why."""
        found = []
        for kind in self._kinds:
            count = sum(storage.count(channel) for storage, channel in kind.parts)
            if kind.problem is not None and count:
                found.append(Damage(f"{self.name}: {kind.problem}", count))
            elif kind.problem is None and count and (lacking := kind.lacks(self, fields)):
                text = f"{count} messages are of a definition of {self.type} without {', '.join(lacking)}"
                found.append(Damage(f"{self.name}: {text}", count if len(lacking) == len(fields) else None))
        return found

    @property
    def is_of_one_kind(self) -> bool:
        """Whether all messages are decoded alike."""
        return len(self._kinds) == 1

    def _readable(self) -> list[_Kind]:
        """Kinds of messages that can be decoded; ``FieldError`` where there is none."""
        found = [kind for kind in self._kinds if kind.problem is None]
        if not found:
            raise FieldError(str(self._kinds[0].problem))
        return found

    @cached_property
    def _of(self) -> dict[int, _Kind]:
        return {id(channel): kind for kind in self._readable() for _, channel in kind.parts}

    @cached_property
    def _kinds(self) -> list[_Kind]:
        """Its channels by what decodes them; one without a definition goes with the first that has one."""
        told: dict[tuple[object, ...], list[Part]] = {}
        for part in self.parts:
            told.setdefault(_definition(part[1]), []).append(part)
        for key in [key for key in told if not any(key[1:])]:
            defined = next((other for other in told if other[0] == key[0] and any(other[1:])), None)
            if defined is not None:
                told[defined] += told.pop(key)
        kinds: list[_Kind] = []
        for parts in told.values():
            new = _Kind.of(parts, self._some)
            same = next((kind for kind in kinds if kind.decodes_like(new)), None)
            if same is None:
                kinds.append(new)
            else:
                same.parts.extend(new.parts)
        return kinds


@dataclass
class _Kind:
    """Channels whose messages are decoded alike, or cannot be for this reason."""

    parts: list[Part]
    found: Decoder | None
    problem: FieldError | None = None

    @classmethod
    def of(cls, parts: list[Part], some: Some) -> _Kind:
        channel = next((channel for _, channel in parts if channel.definition), parts[0][1])
        try:
            return cls(parts, make_decoder(channel, lambda: some(parts)))
        except FieldError as error:
            return cls(parts, None, error)

    @property
    def decoder(self) -> Decoder:
        """What decodes its messages."""
        if self.found is None:
            raise self.problem or FieldError("cannot be decoded")
        return self.found

    def decodes_like(self, other: _Kind) -> bool:
        """Whether two definitions say the same in other words."""
        one, two = self.found, other.found
        return isinstance(one, BinaryDecoder) and isinstance(two, BinaryDecoder) and one.is_like(two)

    def expanded(self, field: str) -> list[str] | None:
        """Return the numbers that a field stands for here, None where it does not exist."""
        try:
            return self.decoder.expand(field)
        except FieldError:
            return None

    def lacks(self, topic: RecordedTopic, fields: Sequence[str]) -> list[str]:
        """Return those of these fields that its messages do not hold."""
        if topic.is_of_one_kind:
            return []
        return [field for field in fields if self.expanded(field) != topic.expand(field)]


_NOTHING = Stored(np.empty(0, np.int64))


def _definition(channel: Channel) -> tuple[object, ...]:
    schema = None if channel.schema is None else id(channel.schema)
    return channel.encoding, channel.definition, schema


def _one_behind_the_other(parts: Sequence[Columns]) -> Columns:
    stamps = [part.log_time if part.header_stamp is None else part.header_stamp for part in parts]
    stamped = any(part.header_stamp is not None for part in parts)
    return Columns(
        np.concatenate([part.log_time for part in parts]),
        np.concatenate(stamps) if stamped else None,
        {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values},
        [item for part in parts for item in part.damage],
    )


def _by_time(columns: Columns) -> Columns:
    order = np.argsort(columns.log_time, kind="stable")
    stamps = None if columns.header_stamp is None else columns.header_stamp[order]
    values = {name: values[order] for name, values in columns.values.items()}
    return Columns(columns.log_time[order], stamps, values, columns.damage)


# --- names ----------------------------------------------------------------------------------------


def gather_topics(storages: Sequence[Storage], some: Some) -> dict[str, RecordedTopic]:
    """Make topics of the channels of all files: one for each name and type."""
    parts: dict[str, dict[str, list[Part]]] = {}
    for storage in storages:
        for channel in storage.channels:
            types = parts.setdefault(channel.topic, {})
            types.setdefault(normal(channel.type), []).append((storage, channel))
    topics: dict[str, RecordedTopic] = {}
    others: list[tuple[str, list[Part]]] = []
    for name, types in parts.items():
        found = list(types.values())
        main, *rest = found if len(found) == 1 else sorted(found, key=_messages, reverse=True)
        topics[name] = RecordedTopic(name, name, main, some)
        others += [(name, each) for each in rest]
    for recorded, each in others:
        name = _unused(f"{recorded} ({normal(each[0][1].type)})", topics)
        topics[name] = RecordedTopic(name, recorded, each, some)
    return topics


def tell_types(topics: dict[str, RecordedTopic]) -> list[Damage]:
    """Say which topics were recorded under the name of another."""
    found = [topic for topic in topics.values() if topic.name != topic.recorded and topic.count()]
    told = [(t.recorded, f"{topics[t.recorded].type} and as {t.type}", t.name) for t in found]
    return [Damage(f"{name}: recorded as {types}, which is read as {own!r}") for name, types, own in told]


def _messages(parts: Sequence[Part]) -> int:
    return sum(storage.count(channel) for storage, channel in parts)


def _unused(name: str, names: dict[str, RecordedTopic]) -> str:
    while name in names:
        name += "'"
    return name
