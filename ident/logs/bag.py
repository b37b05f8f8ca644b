"""A log made of one or more storage files, and what rosbag2's metadata.yaml says about them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ident.errors import BadRecipe, UnusableLog
from ident.logs.chunks import IndexLied
from ident.logs.compression import ZSTD_MAGIC, decompress_message
from ident.logs.decode import Decoder, make_decoder
from ident.logs.payloads import Payloads
from ident.logs.record import Channel, Columns, FieldError, Storage, Stored, Times, Topic
from ident.results import Damage
from ident.yaml_file import nearest, read_yaml

LARGEST_METADATA = 20 << 20


class StoredLog:
    """The messages of a run, from all its files in order (see ``ident.logs.record.Log``)."""

    def __init__(self, path: Path, log_format: str, storages: Sequence[Storage]) -> None:
        self.path = path
        self.format = log_format
        self.problems: list[Damage] = []
        self.metadata: dict[str, object] = {}
        self.files = [file for storage in storages for file in storage.files]
        self._storages = storages
        self._parts: dict[str, list[tuple[Storage, Channel]]] = {}
        for storage in storages:
            for channel in storage.channels:
                self._parts.setdefault(channel.topic, []).append((storage, channel))
        self._others = {topic: self._of_other_types(topic) for topic in self._parts}
        self._decoder = lru_cache(maxsize=None)(self._make_decoder)

    @property
    def topics(self) -> list[Topic]:
        """Topics, in the order of their names, and what of them can be read, as far as is known."""
        return [self._topic(name) for name in sorted(self._parts)]

    @property
    def damage(self) -> list[Damage]:
        """What is known to be missing in the files."""
        found = [damage for storage in self._storages for damage in storage.damage]
        return [*self.problems, *found, *self._two_types(), *_compare_counts(self, self.metadata)]

    def check(self) -> None:
        """Look at every part of the files, so that all damage is known."""
        for storage in self._storages:
            storage.check()

    def times(self, topic: str) -> Times:
        """Log times of all messages of a topic [ns], in the order of the files."""
        parts = [storage.times(channel) for storage, channel in self._parts_of(topic)]
        return np.concatenate([np.empty(0, np.int64), *parts])

    def fields(self, topic: str) -> dict[str, str]:
        """Return the paths of all numbers in a message of this topic, with their types."""
        return self._decoder(topic).fields()

    def expand(self, topic: str, name: str) -> list[str]:
        """Return the numbers that a field stands for; ``FieldError`` where it does not exist."""
        return self._decoder(topic).expand(name)

    def columns(self, topic: str, fields: Sequence[str]) -> Columns:
        """Decode the topic once and return these fields; ``FieldError`` where one does not exist."""
        return self.read({topic: fields})[topic]

    def read(self, wanted: Mapping[str, Sequence[str]]) -> dict[str, Columns]:
        """Read fields of several topics in one pass; ``FieldError`` where one does not exist."""
        found: dict[str, list[Columns]] = {
            topic: [self._decoder(topic).columns(Stored(np.empty(0, np.int64)), fields)]
            for topic, fields in wanted.items()
        }
        for storage in dict.fromkeys(storage for topic in wanted for storage, _ in self._parts[topic]):
            for topic, columns in self._read_one(storage, wanted):
                found[topic].append(columns)
        return {topic: _joined(topic, parts) for topic, parts in found.items()}

    def _read_one(self, storage: Storage, wanted: Mapping[str, Sequence[str]]) -> list[tuple[str, Columns]]:
        """Decode what one file holds, bit by bit; once more from its beginning if its index was wrong."""
        channels = [c for topic in wanted for other, c in self._parts[topic] if other is storage]

        def read() -> list[tuple[str, Columns]]:
            return [
                (
                    channel.topic,
                    self._decoder(channel.topic).columns(_unpacked(stored), wanted[channel.topic]),
                )
                for channel, stored in storage.pieces(channels)
            ]

        try:
            return read()
        except IndexLied:
            return read()

    def close(self) -> None:
        """Remove what was unpacked for reading."""
        for storage in self._storages:
            storage.close()

    def _parts_of(self, topic: str) -> list[tuple[Storage, Channel]]:
        if topic not in self._parts:
            raise FieldError(f"no topic {topic!r}, {nearest(topic, self._parts)}")
        return self._parts[topic]

    def _some(self, topic: str) -> Stored:
        """Messages of a topic: all, or where it has many the first."""
        for storage, channel in self._parts_of(topic):
            try:
                found = next((stored for _, stored in storage.pieces([channel]) if len(stored.data)), None)
            except IndexLied:
                found = next((stored for _, stored in storage.pieces([channel]) if len(stored.data)), None)
            if found is not None:
                return _unpacked(found)
        return Stored(np.empty(0, np.int64))

    def _make_decoder(self, topic: str) -> Decoder:
        channels = [channel for _, channel in self._parts_of(topic)]
        defined = next((channel for channel in channels if channel.definition), channels[0])
        return make_decoder(defined, lambda: self._some(topic))

    def _topic(self, name: str) -> Topic:
        parts = self._parts[name]
        return Topic(name, parts[0][1].type, sum(len(storage.times(channel)) for storage, channel in parts))

    def _of_other_types(self, topic: str) -> list[tuple[Storage, Channel]]:
        """Of a topic that was recorded with two types, keep the first; return the others."""
        parts = self._parts[topic]
        others = [part for part in parts if part[1].type != parts[0][1].type]
        self._parts[topic] = [part for part in parts if part[1].type == parts[0][1].type]
        return others

    def _two_types(self) -> Iterator[Damage]:
        """Messages of the types that are not read."""
        for topic, others in self._others.items():
            lost = sum(len(storage.times(channel)) for storage, channel in others)
            if lost:
                kinds = f"{self._parts[topic][0][1].type} and as {others[0][1].type}"
                yield Damage(f"{topic}: recorded as {kinds}, only the first is read", lost)


def _unpacked(stored: Stored) -> Stored:
    """Unpack messages that the recorder compressed on their own; CDR never begins like that."""
    payloads = Payloads.of(stored.data)
    packed = payloads.begin_with(ZSTD_MAGIC)
    if not packed.any():
        return replace(stored, data=payloads)
    pairs = zip(payloads, packed.tolist(), strict=True)
    data = [decompress_message(data) if data is not None and is_packed else data for data, is_packed in pairs]
    return replace(stored, data=data)


def _joined(topic: str, parts: Sequence[Columns]) -> Columns:
    """Put columns of one topic one behind the other, and add up what could not be decoded."""
    times = np.concatenate([part.log_time for part in parts])
    stamps = [part.log_time if part.header_stamp is None else part.header_stamp for part in parts]
    stamped = any(part.header_stamp is not None for part in parts)
    damage = [item for part in parts for item in part.damage]
    lost = sum(item.messages_lost or 0 for item in damage)
    return Columns(
        times,
        np.concatenate(stamps) if stamped else None,
        {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values},
        [Damage(f"{topic}: {damage[0].what}", lost)] if damage else [],
    )


# --- rosbag2 --------------------------------------------------------------------------------------


def open_rosbag2(folder: Path, open_storage: Callable[[Path], Storage]) -> StoredLog:
    """Open a rosbag2 folder; metadata.yaml is believed only as far as the files bear it out.

    Raises
    ------
    UnusableLog
        If no storage file can be read.
    """
    metadata, problems = _read_metadata(folder / "metadata.yaml")
    storages: list[Storage] = []
    for path in _storage_files(folder, metadata, problems):
        try:
            storages.append(open_storage(path))
        except (UnusableLog, OSError) as error:
            problems.append(Damage(str(error), bytes_lost=_size(path)))
    if not storages:
        reason = problems[-1].what if problems else "it holds no .mcap or .db3 file"
        raise UnusableLog(f"{folder}: nothing can be read: {reason}")
    kinds = dict.fromkeys(storage.format.removeprefix("rosbag2 ") for storage in storages)
    log = StoredLog(folder, f"rosbag2 {' and '.join(kinds)}", storages)
    log.problems, log.metadata = problems, metadata
    return log


def _size(path: Path) -> int | None:
    return path.stat().st_size if path.exists() else None


def _read_metadata(path: Path) -> tuple[dict[str, object], list[Damage]]:
    try:
        if path.stat().st_size > LARGEST_METADATA:
            return {}, [Damage(f"metadata.yaml: {path.stat().st_size} bytes is no metadata, not read")]
        found = read_yaml(path).get("rosbag2_bagfile_information")
    except FileNotFoundError:
        return {}, [Damage("metadata.yaml is missing, the files themselves were read")]
    except (BadRecipe, RecursionError) as error:
        reason = str(error).removeprefix(f"{path}: ")
        return {}, [Damage(f"metadata.yaml: {reason}; the files themselves were read")]
    if not isinstance(found, dict):
        return {}, [Damage("metadata.yaml is not rosbag2's; the files themselves were read")]
    return found, []


def _storage_files(folder: Path, metadata: dict[str, object], problems: list[Damage]) -> list[Path]:
    """List the files that metadata.yaml names and that exist; else those that lie in the folder."""
    listed = metadata.get("relative_file_paths")
    names = [Path(str(name)).name for name in listed] if isinstance(listed, list) else []
    present = storage_files(folder)
    found = []
    for name in names:
        # A name may stand without the suffix of its compression, or with it after unpacking.
        near = [path for path in present if path.name in {name, name + ".zstd", name.removesuffix(".zstd")}]
        found += near[:1]
        if not near:
            problems.append(Damage(f"{name} is listed in metadata.yaml and missing"))
    forgotten = [path for path in present if path not in found and _belongs(path, found)]
    if forgotten and metadata:
        text = ", ".join(path.name for path in forgotten)
        problems.append(Damage(f"{text}: not listed in metadata.yaml, read all the same"))
    return sorted({*found, *forgotten}, key=in_sequence)


def _belongs(path: Path, found: list[Path]) -> bool:
    """Whether a file continues those found: the same name but for its number."""
    return not found or stem_and_number(path)[0] in {stem_and_number(other)[0] for other in found}


def storage_files(folder: Path) -> list[Path]:
    """List the files of a folder that are named like storage files, in the order of their numbers."""
    ends = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
    found = [path for path in folder.iterdir() if path.name.endswith(ends) and not path.name.startswith(".")]
    return sorted((path for path in found if path.is_file()), key=in_sequence)


def stem_and_number(path: Path) -> tuple[str, int | None]:
    """Split ``name_12.mcap`` into its name and its number, None where it carries none."""
    stem = re.sub(r"\.(mcap|db3|bag|bag\.active|db|dat)(\.zstd)?$", "", path.name)
    match = re.fullmatch(r"(.+)_(\d{1,9})", stem)
    return (match[1], int(match[2])) if match else (stem, None)


def in_sequence(path: Path) -> tuple[str, int, str]:
    """Sort key: name_2 before name_10."""
    stem, number = stem_and_number(path)
    return stem, -1 if number is None else number, path.name


def _compare_counts(log: StoredLog, metadata: dict[str, object]) -> list[Damage]:
    """Say where the files hold less than the recorder counted."""
    read = {topic.name: topic.messages for topic in log.topics}
    damage = []
    for name, counted in _counted(metadata).items():
        if counted > read.get(name, 0):
            text = f"{name}: metadata.yaml counts {counted} messages, {read.get(name, 0)} can be read"
            damage.append(Damage(text, counted - read.get(name, 0)))
    missing = _seconds_missing(log, metadata) if damage else 0.0
    if missing > 0:
        text = f"metadata.yaml says that the recording went on for another {missing:.3g} s"
        damage.append(Damage(text, seconds_lost=missing))
    return damage


def _seconds_missing(log: StoredLog, metadata: dict[str, object]) -> float:
    """How long before the end that metadata.yaml states the last message was recorded [s]."""
    start = _number(metadata.get("starting_time"), "nanoseconds_since_epoch")
    duration = _number(metadata.get("duration"), "nanoseconds")
    ends = [int(times.max()) for topic in log.topics if len(times := log.times(topic.name))]
    if start is None or duration is None or not ends:
        return 0.0
    return (start + duration - max(ends)) / 1e9


def _number(entry: object, key: str) -> int | None:
    value = entry.get(key) if isinstance(entry, dict) else None
    return value if isinstance(value, int) else None


def _counted(metadata: dict[str, object]) -> dict[str, int]:
    counts: dict[str, int] = {}
    topics = metadata.get("topics_with_message_count")
    for topic in topics if isinstance(topics, list) else []:
        about = topic.get("topic_metadata") if isinstance(topic, dict) else None
        count = topic.get("message_count") if isinstance(topic, dict) else None
        if isinstance(about, dict) and isinstance(count, int):
            name = str(about.get("name"))
            counts[name] = counts.get(name, 0) + count
    return counts
