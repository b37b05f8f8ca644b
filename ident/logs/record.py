"""What a log gives: topics, damage, and columns of numbers.

Times are integers in nanoseconds; values are float64, whatever the message held.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ident.logs.payloads import Payloads
from ident.results import Damage

if TYPE_CHECKING:
    from ident.logs.schema import Schema

Times = NDArray[np.int64]
Values = NDArray[np.float64]


class FieldError(ValueError):
    """A field does not exist in a topic, is not a number, or the topic cannot be decoded."""


@dataclass(frozen=True)
class Topic:
    """A topic of a log and how many messages of it can be read."""

    name: str
    type: str
    messages: int


@dataclass(frozen=True)
class Columns:
    """Numbers of one topic, one entry a message, in the order of the file.

    log_time : (n,) when the recorder received the message [ns]
    header_stamp : (n,) when the sender stamped it [ns]; where the type holds no stamp, when the sender
        published it; None where the log does not say that either
    values : field -> (n,) values; what a message does not hold (a short sequence) is NaN
    damage : messages that could not be decoded; they are left out of all columns
    """

    log_time: Times
    header_stamp: Times | None
    values: Mapping[str, Values]
    damage: Sequence[Damage] = ()


@dataclass
class Channel:
    """One stream of messages inside a storage file.

    definition : text of the message definition, empty where the file holds none
    definition_format : "ros2msg", "ros1msg", "omgidl" or "ros2idl", empty where the file holds none
    encoding : of the messages: "cdr", "ros1" or "json"
    schema : the definition, where the file holds it in another form than text
    """

    topic: str
    type: str
    encoding: str = "cdr"
    definition: str = ""
    definition_format: str = ""
    schema: Schema | None = None


@dataclass
class Stored:
    """Raw messages of one topic in one file.

    times : (n,) log times [ns]
    data : n messages, None where one is lost; ``Payloads`` where they lie in one block
    published : (n,) when the sender published them [ns], None where the recorder did not keep it
    """

    times: Times
    data: Sequence[bytes | None] = field(default_factory=list)
    published: Times | None = None


def join_stored(parts: Sequence[Stored]) -> Stored:
    """Put messages of one topic one behind the other."""
    times = np.concatenate([np.empty(0, np.int64), *(part.times for part in parts)])
    published = [part.times if part.published is None else part.published for part in parts]
    kept = any(part.published is not None for part in parts)
    blocks = [Payloads.of(part.data) for part in parts]
    sizes = np.concatenate([np.empty(0, np.int64), *(each.sizes for each in blocks)])
    block = np.concatenate([np.empty(0, np.uint8), *(each.block for each in blocks)])
    return Stored(times, Payloads(block, sizes), np.concatenate(published) if kept else None)


class Storage(Protocol):
    """One file of messages; opening it has found its channels; ``format`` is its kind.

    damage : what is known to be lost; all of it is known after ``check``
    """

    format: str
    files: list[Path]
    channels: list[Channel]

    @property
    def damage(self) -> Sequence[Damage]:
        """What is known to be lost."""
        ...

    def count(self, channel: Channel) -> int:
        """How many messages of a channel there are, as far as is known."""
        ...

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order of the file."""
        ...

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order of the file."""
        ...

    def pieces(self, channels: Sequence[Channel]) -> Iterator[tuple[Channel, Stored]]:
        """Read the messages of several channels, each in the order of the file, bit by bit where it can."""
        ...

    def check(self) -> None:
        """Look at every part of the file that was not looked at yet."""
        ...

    def close(self) -> None:
        """Remove what was unpacked for reading."""
        ...


class ChannelByChannel(ABC):
    """For storages that know all damage once they are open, and read one channel after the other."""

    @abstractmethod
    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order of the file."""

    def count(self, channel: Channel) -> int:
        """How many messages of a channel there are."""
        return len(self.times(channel))

    @abstractmethod
    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order of the file."""

    def pieces(self, channels: Sequence[Channel]) -> Iterator[tuple[Channel, Stored]]:
        """Read the messages of several channels, each in the order of the file."""
        return ((channel, self.messages(channel)) for channel in channels)

    def check(self) -> None:  # noqa: B027 (no part is left to look at)
        """Do nothing: opening has looked at everything."""


class Log(Protocol):
    """A run's log, whatever its format.

    path : the folder or (first) file; files : every file that was read
    format : "mcap", "rosbag2 mcap", "rosbag2 sqlite3", ...
    topics : what can be read, as far as is known
    damage : what is known to be missing in the files, one entry a defect

    Parts of a file that nothing needs are not unpacked, so that damage in them is known, and taken off the
    topics and times, only after ``check``; damage in what was read is known after that.
    """

    path: Path
    format: str
    files: list[Path]

    @property
    def topics(self) -> list[Topic]:
        """Topics, in the order of their names."""
        ...

    @property
    def damage(self) -> list[Damage]:
        """What is known to be missing."""
        ...

    def times(self, topic: str) -> Times:
        """Log times of all messages of a topic [ns], in the order of the files."""
        ...

    def fields(self, topic: str) -> dict[str, str]:
        """Return the paths of all numbers in a message of this topic, with their types."""
        ...

    def expand(self, topic: str, name: str) -> list[str]:
        """Return the numbers that a field stands for; ``FieldError`` where it does not exist."""
        ...

    def columns(self, topic: str, fields: Sequence[str]) -> Columns:
        """Decode the topic once and return these fields; ``FieldError`` where one does not exist."""
        ...

    def read(self, wanted: Mapping[str, Sequence[str]]) -> dict[str, Columns]:
        """Read fields of several topics, in one pass where the format allows it."""
        ...

    def check(self) -> None:
        """Look at every part of the files, so that all damage is known."""
        ...

    def close(self) -> None:
        """Remove what was unpacked for reading."""
        ...
