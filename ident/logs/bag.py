"""A log made of one or more storage files, and what rosbag2's metadata.yaml says about them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import BadRecipe, UnusableLog
from ident.logs.chunks import IndexLied
from ident.logs.compression import ZSTD_MAGIC, decompress_message
from ident.logs.payloads import Payloads
from ident.logs.record import Columns, FieldError, Storage, Stored, Times, Topic
from ident.logs.topics import Part, RecordedTopic, gather_topics, tell_types
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
        self._topics = gather_topics(storages, _some)

    @property
    def topics(self) -> list[Topic]:
        """Topics, in the order of their names, and what of them can be read, as far as is known."""
        found = [self._topics[name] for name in sorted(self._topics)]
        return [Topic(each.name, each.type, each.count()) for each in found]

    @property
    def damage(self) -> list[Damage]:
        """What is known to be missing in the files."""
        found = [damage for storage in self._storages for damage in storage.damage]
        told = [damage for topic in self._topics.values() for damage in topic.told()]
        return [
            *self.problems,
            *found,
            *tell_types(self._topics),
            *told,
            *_compare_counts(self, self.metadata),
        ]

    @property
    def recorded(self) -> dict[str, int]:
        """Messages that can be read of each name under which any were recorded."""
        counts: Counter[str] = Counter()
        for topic in self._topics.values():
            counts[topic.recorded] += topic.count()
        return dict(counts)

    def check(self) -> None:
        """Look at every part of the files, so that all damage is known."""
        for storage in self._storages:
            storage.check()

    def times(self, topic: str) -> Times:
        """Log times of all messages of a topic [ns], in the order of the files."""
        return self._topic(topic).times()

    def fields(self, topic: str) -> dict[str, str]:
        """Return the paths of all numbers in a message of this topic, with their types."""
        return self._topic(topic).fields()

    def expand(self, topic: str, name: str) -> list[str]:
        """Return the numbers that a field stands for; ``FieldError`` where it does not exist."""
        return self._topic(topic).expand(name)

    def columns(self, topic: str, fields: Sequence[str]) -> Columns:
        """Decode the topic once and return these fields; ``FieldError`` where one does not exist."""
        return self.read({topic: fields})[topic]

    def read(self, wanted: Mapping[str, Sequence[str]]) -> dict[str, Columns]:
        """Read fields of several topics in one pass; ``FieldError`` where one does not exist."""
        topics = {name: self._topic(name) for name in wanted}
        for name, fields in wanted.items():
            for field in fields:
                topics[name].expand(field)
        found: dict[str, list[tuple[Storage, Columns]]] = {name: [] for name in wanted}
        for storage in self._storages:
            for name, columns in _read_one(storage, topics, wanted):
                found[name].append((storage, columns))
        return {name: topics[name].joined(found[name], fields) for name, fields in wanted.items()}

    def close(self) -> None:
        """Remove what was unpacked for reading."""
        for storage in self._storages:
            storage.close()

    def _topic(self, name: str) -> RecordedTopic:
        if name not in self._topics:
            raise FieldError(f"no topic {name!r}, {nearest(name, self._topics)}")
        return self._topics[name]


def _read_one(
    storage: Storage, topics: Mapping[str, RecordedTopic], wanted: Mapping[str, Sequence[str]]
) -> list[tuple[str, Columns]]:
    """Decode what one file holds, bit by bit; once more from its beginning if its index was wrong."""
    owners = {
        id(channel): (name, channel)
        for name, topic in topics.items()
        for channel in topic.channels_of(storage)
        if topic.useful(channel, wanted[name])
    }

    def read() -> list[tuple[str, Columns]]:
        found = []
        for channel, stored in storage.pieces([channel for _, channel in owners.values()]):
            name, _ = owners[id(channel)]
            found.append((name, topics[name].columns(channel, _unpacked(stored), wanted[name])))
        return found

    if not owners:
        return []
    try:
        return read()
    except IndexLied:
        return read()


def _some(parts: Sequence[Part]) -> Stored:
    """Messages of these channels: all, or where there are many the first."""
    for storage, channel in parts:
        try:
            found = next((stored for _, stored in storage.pieces([channel]) if len(stored.data)), None)
        except IndexLied:
            found = next((stored for _, stored in storage.pieces([channel]) if len(stored.data)), None)
        if found is not None:
            return _unpacked(found)
    return Stored(np.empty(0, np.int64))


def _unpacked(stored: Stored) -> Stored:
    """Unpack messages that the recorder compressed on their own; CDR never begins like that."""
    payloads = Payloads.of(stored.data)
    packed = payloads.begin_with(ZSTD_MAGIC)
    if not packed.any():
        return replace(stored, data=payloads)
    pairs = zip(payloads, packed.tolist(), strict=True)
    data = [decompress_message(data) if data is not None and is_packed else data for data, is_packed in pairs]
    return replace(stored, data=data)


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
    read = log.recorded
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
