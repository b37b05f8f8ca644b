"""PATH -> LOG: what a file is, is decided by its first bytes, then by its name."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ident.errors import UnusableLog
from ident.logs import mdf, ros1, sqlite_file
from ident.logs.bag import StoredLog, in_sequence, open_rosbag2, storage_files
from ident.logs.compression import ZSTD_MAGIC, decompress_file
from ident.logs.find import TABLES
from ident.logs.mcap import McapStorage
from ident.logs.mcap_records import MAGIC as MCAP_MAGIC
from ident.logs.record import Channel, Log, Storage, Stored, Times
from ident.logs.ros1 import Ros1Storage
from ident.logs.sqlite_kinds import open_sqlite
from ident.results import Damage

PARQUET_MAGIC = b"PAR1"
READERS: dict[bytes, Callable[[Path], Storage]] = {
    MCAP_MAGIC: McapStorage,
    sqlite_file.MAGIC: open_sqlite,
    ros1.ANY_MAGIC: Ros1Storage,
}


def open_log(path: Path, files: Sequence[Path] = ()) -> Log:
    """Open a rosbag2 folder, a single file, or the consecutive ``files`` of one recorder.

    Raises
    ------
    UnusableLog
        If nothing in it can be read; the message says why.
    """
    try:
        if is_table(path):
            return _open_table(path)
        if is_mdf(path):
            return mdf.MdfLog(path)
        if path.is_dir():
            return open_rosbag2(path, open_storage)
        if len(files) > 1:
            return _open_sequence(path, files)
        storage = open_storage(path)
        return StoredLog(path, storage.format, [storage])
    except OSError as error:
        raise UnusableLog(f"{path}: cannot be read: {error.strerror or error}") from error


def open_storage(path: Path) -> Storage:
    """Open one file of messages.

    Raises
    ------
    UnusableLog
        If it is empty, not a log, or of a format that is not read.
    """
    head = first_bytes(path)
    if not head:
        raise UnusableLog(f"{path}: is empty (0 bytes)")
    for magic, reader in READERS.items():
        if head.startswith(magic):
            return reader(path)
    if head.startswith(ZSTD_MAGIC):
        return _open_compressed(path)
    known = "MCAP, rosbag2, ROS 1, SQLite of eProsima or RTI, MDF 4, CSV or Parquet"
    raise UnusableLog(f"{path}: is no log (first bytes {head[:8].hex(' ')}), need {known}")


def is_table(path: Path) -> bool:
    """Whether a file is a CSV or Parquet file, by its name or its first bytes."""
    if not path.is_file() or not path.stat().st_size:
        return False
    return path.name.lower().endswith(TABLES) or first_bytes(path).startswith(PARQUET_MAGIC)


def _open_table(path: Path) -> Log:
    from ident.logs.table import TableLog  # noqa: PLC0415 (pandas takes a second to load, other logs need none)

    return TableLog(path)


def is_mdf(path: Path) -> bool:
    """Whether a file is an ASAM MDF file, by its first bytes."""
    return path.is_file() and first_bytes(path).startswith((mdf.MAGIC, mdf.UNFINISHED))


def first_bytes(path: Path) -> bytes:
    """Read as many bytes as tell the format."""
    with path.open("rb") as file:
        return file.read(16)


def _open_sequence(path: Path, files: Sequence[Path]) -> Log:
    storages: list[Storage] = []
    damage: list[Damage] = []
    for file in sorted(files, key=in_sequence):
        try:
            storages.append(open_storage(file))
        except UnusableLog as error:
            damage.append(Damage(str(error), bytes_lost=file.stat().st_size))
    if not storages:
        raise UnusableLog(damage[0].what)
    log = StoredLog(path, storages[0].format, storages)
    log.problems = damage
    return log


def _open_compressed(path: Path) -> Storage:
    """Unpack a file that the recorder compressed as a whole, and read what comes out."""
    folder = Path(tempfile.mkdtemp(prefix="ident-"))
    try:
        unpacked = folder / path.name.removesuffix(".zstd")
        stopped = decompress_file(path, unpacked)
        storage = open_storage(unpacked)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    problems = [Damage(f"{path.name}: its compression is damaged ({stopped})")] if stopped else []
    return _UnpackedFile(path, storage, problems, folder)


class _UnpackedFile:
    """What was read of a file that was unpacked into a temporary folder (see ``Storage``)."""

    def __init__(self, path: Path, storage: Storage, problems: list[Damage], folder: Path) -> None:
        self.format = storage.format
        self.files = [path]
        self.channels = storage.channels
        self._storage = storage
        self._problems = problems
        self._remove = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)

    @property
    def damage(self) -> list[Damage]:
        """What is known to be lost."""
        return [*self._problems, *self._storage.damage]

    def count(self, channel: Channel) -> int:
        """How many messages of a channel there are, as far as is known."""
        return self._storage.count(channel)

    def times(self, channel: Channel) -> Times:
        """Log times of a channel [ns], in the order of the file."""
        return self._storage.times(channel)

    def messages(self, channel: Channel) -> Stored:
        """Read the messages of a channel, in the order of the file."""
        return self._storage.messages(channel)

    def pieces(self, channels: Sequence[Channel]) -> Iterator[tuple[Channel, Stored]]:
        """Read the messages of several channels, each in the order of the file, bit by bit."""
        return self._storage.pieces(channels)

    def check(self) -> None:
        """Look at every part of the file that was not looked at yet."""
        self._storage.check()

    def close(self) -> None:
        """Remove what was unpacked."""
        self._storage.close()
        self._remove()


__all__ = ["first_bytes", "open_log", "open_storage", "storage_files"]
