"""ASAM MDF 4 -> SAMPLES: a channel group is a topic, its channels of numbers are the fields (asammdf reads).

Times are those of the group's own time channel, counted from the start that the file states [ns since 1970
in UTC; a file that states local time without its zone is taken as UTC]. Conversions of the file are applied;
an enumeration (a conversion to nothing but text) keeps its integers, and a value of a scaled channel that
stands for a text ("signal not available") is missing, as is one whose invalidation bit is set. The unit of a
channel stands behind its type: ``float64 [deg/s]``. Channels of text, bytes, arrays and structures are no
fields; groups without a channel of times are left out and told.

A file that its recorder did not close is completed in a temporary copy. A file is read with positioned reads
and never written. asammdf (the extra ``mdf``) is imported when the first such file is opened.
"""

from __future__ import annotations

import contextlib
import gc
import io
import logging
import re
import shutil
import struct
import sys
import tempfile
import traceback
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from ident.errors import UnusableLog
from ident.logs.record import Columns, FieldError, Times, Topic, Values
from ident.results import Damage
from ident.yaml_file import nearest

if TYPE_CHECKING:
    from asammdf import MDF

MAGIC, UNFINISHED = b"MDF ", b"UnFinMF "
SUFFIXES = (".mf4", ".MF4")
KIND = "mdf"
EARLIEST = "4.00"
NEEDED = "is an MDF file, which asammdf reads: install it with pip install 'ident[mdf]'"
# What DDS calls enums, MDF calls conversions: numbers of blocks and types in ASAM MDF 4.1, 6.16 to 6.18.
NUMBERS = range(6)
FIXED_LENGTH, VIRTUAL = 0, 6
WITHOUT_BYTES = {3, VIRTUAL}  # virtual channels of times among them
TIME = 1
TO_TEXT = {7, 8}
FROM_TEXT = {9, 10}
FORMULA, BITFIELD = 3, 11
ALL_INVALID, MAY_BE_INVALID = 1, 2
COUNTERS_UNKNOWN = 0x01
_FORMULA = re.compile(
    r"(?:\s|[\d.+\-*/()^,]|[eE](?=[+-]?\d)|X1?\b|(?:a?(?:sin|cos|tan)h?|exp|log10|log|ln|abs|sqrt|pow)(?=\s*\())*"
)
_LONGEST_FORMULA = 1000
_Found = TypeVar("_Found")


class MdfLog:
    """One MDF 4 file (see ``ident.logs.record.Log``)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [path]
        self.damage: list[Damage] = []
        self._file: BinaryIO = path.open("rb")
        try:
            self.format = f"mdf {self._version()}"
            self._mdf = self._open()
        except BaseException:
            self._file.close()
            raise
        self._end = weakref.finalize(self, _close, self._mdf, self._file)
        self._start = int(self._mdf.header.abs_time)
        self._groups: dict[str, int] = {}
        self._fields: dict[str, dict[str, int]] = {}
        self._times: dict[str, Times] = {}
        self._timed: dict[str, NDArray[np.bool_]] = {}
        self._list_groups()
        if not any(topic.messages for topic in self.topics):
            self.close()
            raise UnusableLog(
                f"{path}: no channel group with times and numbers among {len(self._mdf.groups)}"
            )

    @property
    def topics(self) -> list[Topic]:
        """Topics, in the order of their names; how many samples one has is exact once it was read."""
        return [
            Topic(name, KIND, len(self._times[name]) if name in self._times else self._cycles(group))
            for name, group in sorted(self._groups.items())
        ]

    def times(self, topic: str) -> Times:
        """Times of all samples of a group [ns]."""
        group = self._group(topic)
        if topic not in self._times:
            self._within_record(topic, group, self._mdf.masters_db[group])
            read = self._guarded(lambda: self._mdf.get_master(group))
            seconds = np.asarray(read, dtype=np.float64)
            self._times[topic] = self._start + self._finite(topic, seconds)
            lost = self._cycles(group) - len(seconds)
            if lost > 0:
                text = f"{self.path.name}: {topic} states more samples than its data hold"
                self.damage.append(Damage(text, lost))
        return self._times[topic]

    def fields(self, topic: str) -> dict[str, str]:
        """Return the names of the channels of numbers, with their types and units."""
        group = self._group(topic)
        channels = self._mdf.groups[group].channels
        return {name: _type_text(channels[index]) for name, index in self._fields[topic].items()}

    def expand(self, topic: str, name: str) -> list[str]:
        """Check that ``name`` is a channel of numbers; ``FieldError`` where it is not."""
        self._group(topic)
        if name not in self._fields[topic]:
            known = self._fields[topic]
            raise FieldError(f"{topic} has no channel of numbers {name!r}, {nearest(name, known)}")
        return [name]

    def columns(self, topic: str, fields: Sequence[str]) -> Columns:
        """Read these channels; ``FieldError`` where one does not exist or cannot be read."""
        names = [self.expand(topic, name)[0] for name in fields]
        times = self.times(topic)
        timed = self._timed[topic]
        values = {name: self._values(topic, name, len(timed))[timed] for name in names}
        return Columns(times, None, values)

    def read(self, wanted: Mapping[str, Sequence[str]]) -> dict[str, Columns]:
        """Read channels of several groups."""
        return {topic: self.columns(topic, fields) for topic, fields in wanted.items()}

    def check(self) -> None:
        """Read every group once, so that what cannot be read is told."""
        for topic in list(self._groups):
            try:
                self.times(topic)
            except FieldError as error:
                self.damage.append(Damage(f"{topic}: {error}", self._cycles(self._groups[topic])))

    def close(self) -> None:
        """Close the file, and remove the temporary copy, if one was made."""
        self._end()

    # --- opening ----------------------------------------------------------------------------------

    def _version(self) -> str:
        """Version of the format; ``UnusableLog`` where it is not read."""
        head = self._file.read(64)
        version = head[8:16].decode("latin-1").strip(" \0")
        if version < EARLIEST:
            raise UnusableLog(f"{self.path}: MDF version {version or '?'}, need {EARLIEST} or later")
        return version

    def _open(self) -> MDF:
        """Open the file; of one that was not closed, or ends early, a copy in which that is mended."""
        self._file.seek(0)
        head = self._file.read(64)
        if head.startswith(UNFINISHED) or any(head[60:64]):
            self._take_copy()
            found = self._guarded(lambda: _opened(self._file, self.path))
            self.damage.append(
                Damage(f"{self.path.name}: was not closed by its recorder, completed in a copy")
            )
            return found
        try:
            return self._guarded(lambda: _opened(self._file, self.path))
        except CannotRead as error:
            self._take_copy()
            stated = mend(self._file)
            try:
                found = self._guarded(lambda: _opened(self._file, self.path))
            except UnusableLog:
                raise error from None
            lost = stated - sum(int(group.channel_group.cycles_nr) for group in found.groups)
            text = f"{self.path.name}: ends early ({error.reason}), samples of its groups are missing"
            self.damage.append(Damage(text, max(lost, 0)))
            return found

    def _take_copy(self) -> None:
        """Go on with a temporary copy of the file, that may be written."""
        copy = tempfile.TemporaryFile(prefix="ident-")  # noqa: SIM115 closed with the log
        with self._file:
            self._file.seek(0)
            shutil.copyfileobj(self._file, copy)
        copy.seek(0)
        self._file = copy

    def _list_groups(self) -> None:
        masters = self._mdf.masters_db
        for index, group in enumerate(self._mdf.groups):
            name = _told_apart(_topic_name(group, index), self._groups)
            master = masters.get(index)
            if master is None or group.channels[master].sync_type != TIME:
                if self._cycles(index):
                    text = f"{self.path.name}: channel group {name[1:]!r} has no channel of times"
                    self.damage.append(Damage(text, self._cycles(index)))
                continue
            self._groups[name] = index
            self._fields[name] = {}
            for number, channel in enumerate(group.channels):
                if number != master and not group.channel_dependencies[number] and _is_number(channel):
                    self._fields[name][_told_apart(channel.name, self._fields[name])] = number

    def _cycles(self, group: int) -> int:
        return int(self._mdf.groups[group].channel_group.cycles_nr)

    # --- reading ----------------------------------------------------------------------------------

    def _group(self, topic: str) -> int:
        if topic not in self._groups:
            raise FieldError(f"no topic {topic!r}, {nearest(topic, self._groups)}")
        return self._groups[topic]

    def _values(self, topic: str, name: str, count: int) -> Values:
        """Values of a channel, NaN where one is invalid or stands for a text."""
        group, index = self._group(topic), self._fields[topic][name]
        channel = self._mdf.groups[group].channels[index]
        _check_formulas(channel.conversion, f"{topic}, {name}")
        self._within_record(topic, group, index)
        raw = _is_enumeration(channel.conversion)
        signal = self._guarded(
            lambda: self._mdf.get(group=group, index=index, raw=raw, ignore_invalidation_bits=True)
        )
        values = _floats(signal.samples)
        if values.shape != (count,):
            raise FieldError(f"{topic}, {name}: has values of shape {values.shape}, need ({count},)")
        if signal.invalidation_bits is not None:
            values[np.asarray(signal.invalidation_bits, dtype=np.bool_)] = np.nan
        if channel.flags & ALL_INVALID:
            values[:] = np.nan
        return values

    def _within_record(self, topic: str, group: int, index: int) -> None:
        """Refuse a channel that lies outside its records: compiled parts of asammdf do not look.

        Raises
        ------
        FieldError
            If its bytes, or its invalidation bit, are beyond the end of a record.
        """
        channel, record = self._mdf.groups[group].channels[index], self._mdf.groups[group].channel_group
        size, bits = record.samples_byte_nr, 8 * record.invalidation_bytes_nr
        end = channel.byte_offset + -(-(channel.bit_offset + channel.bit_count) // 8)
        beyond = channel.channel_type not in WITHOUT_BYTES and end > size
        if beyond or (channel.flags & MAY_BE_INVALID and channel.pos_invalidation_bit >= bits):
            raise FieldError(f"{topic}, {channel.name}: lies outside its records of {size} bytes")

    def _finite(self, topic: str, seconds: NDArray[np.float64]) -> Times:
        """Times [ns] since the start, of the samples that have one; ``FieldError`` where few have."""
        good = np.abs(seconds) < 1 << 33
        wrong = len(good) - int(np.count_nonzero(good))
        if 2 * wrong > len(good):
            raise FieldError(f"{topic}: {wrong} of its {len(seconds)} times are no times in seconds")
        if wrong:
            first = int(np.flatnonzero(~good)[0])
            text = f"{topic}: samples whose time is none, first at row {first + 1}"
            self.damage.append(Damage(f"{self.path.name}: {text}", wrong))
        self._timed[topic] = good
        return np.round(seconds[good] * 1e9).astype(np.int64)

    def _guarded(self, read: Callable[[], _Found]) -> _Found:
        """Do what asammdf may fail at with any error, and may print about."""
        with _silent():
            try:
                return read()
            except UnusableLog:
                raise
            except Exception as error:  # noqa: BLE001 a damaged file raises anything in asammdf
                failed = CannotRead(self.path, error)
                traceback.clear_frames(error.__traceback__)
            gc.collect(1)  # what it left half made ends here, in silence
        raise failed


class CannotRead(UnusableLog, FieldError):
    """asammdf cannot read a file, or a part of it."""

    def __init__(self, path: Path, error: Exception) -> None:
        self.reason = " ".join(str(error).split()).partition(". ")[0][:160] or type(error).__name__
        super().__init__(f"{path}: MDF file that cannot be read ({self.reason})")


def _opened(file: BinaryIO, path: Path) -> MDF:
    try:
        from asammdf import MDF  # noqa: PLC0415 an extra, and slow to import
    except ImportError as error:
        raise UnusableLog(f"{path}: {NEEDED}") from error
    return MDF(file)


def mend(file: BinaryIO) -> int:
    """Mark a file that ends early as one that was not closed, and keep its blocks of data inside it.

    Only data that lie in one block behind the description of the file can be kept, as loggers write them.

    Returns
    -------
    stated : how many samples its groups state, those that are lost among them
    """
    size = file.seek(0, io.SEEK_END)
    stated, seen = 0, set[int]()
    group = _number(file, 64 + 24, size)
    while group and group not in seen:
        seen.add(group)
        channels, data = _number(file, group + 32, size), _number(file, group + 40, size)
        stated += _number(file, channels + 80, size)
        length = _number(file, data + 8, size)
        if data + 24 > size:
            _write_number(file, group + 40, 0, size)
        elif data + length > size:
            _write_number(file, data + 8, size - data, size)
        group = _number(file, group + 24, size)
    file.seek(0)
    file.write(UNFINISHED)
    file.seek(60)
    file.write(struct.pack("<H", COUNTERS_UNKNOWN))
    return stated


def _number(file: BinaryIO, place: int, size: int) -> int:
    """Read a number of 8 bytes, 0 where the file has none there."""
    if place + 8 > size:
        return 0
    file.seek(place)
    return int.from_bytes(file.read(8), "little")


def _write_number(file: BinaryIO, place: int, value: int, size: int) -> None:
    if place + 8 <= size:
        file.seek(place)
        file.write(value.to_bytes(8, "little"))


def _close(mdf: MDF, file: BinaryIO) -> None:
    with _silent():
        mdf.close()
    file.close()


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep asammdf from printing, logging and failing at its end: what matters is raised."""
    logger = logging.getLogger("asammdf")
    before, hook = logger.disabled, sys.unraisablehook
    logger.disabled = True
    sys.unraisablehook = lambda _: None
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        logger.disabled = before
        sys.unraisablehook = hook


def _topic_name(group: Any, index: int) -> str:
    """Name of a group as a topic: what acquired it, else its number."""
    text = re.sub(r"[^\w./-]+", "_", str(group.channel_group.acq_name or "").strip()).strip("_/")
    return f"/{text or f'group_{index}'}"


def _told_apart(name: str, known: Mapping[str, object]) -> str:
    """Return a name that is not known yet: ``name``, ``name_2``, ..."""
    found, number = name, 1
    while found in known:
        number += 1
        found = f"{name}_{number}"
    return found


def _is_number(channel: Any) -> bool:
    conversion = channel.conversion
    from_text = conversion is not None and conversion.conversion_type in FROM_TEXT | {BITFIELD}
    return channel.data_type in NUMBERS and channel.channel_type in {FIXED_LENGTH, VIRTUAL} and not from_text


def _type_text(channel: Any) -> str:
    """Type and unit of a channel; one of a single bit is a flag."""
    unit = channel.unit or (channel.conversion.unit if channel.conversion is not None else "")
    if channel.bit_count == 1 and channel.conversion is None:
        return "bool"
    return f"float64 [{unit}]" if unit else "float64"


def _references(conversion: Any) -> list[Any]:
    return [each for each in (conversion.referenced_blocks or {}).values() if each is not None]


def _is_enumeration(conversion: Any) -> bool:
    """Whether a conversion gives nothing but text."""
    if conversion is None or conversion.conversion_type not in TO_TEXT:
        return False
    return all(isinstance(each, bytes) for each in _references(conversion))


def _check_formulas(conversion: Any, where: str, depth: int = 0) -> None:
    """Refuse a conversion by a formula that is more than arithmetic: it would be evaluated."""
    if conversion is None or isinstance(conversion, bytes):
        return
    if conversion.conversion_type == FORMULA:
        formula = str(conversion.formula)
        if len(formula) > _LONGEST_FORMULA or not _FORMULA.fullmatch(formula):
            raise FieldError(f"{where}: its conversion {formula[:60]!r} is no formula of X that is read")
    if conversion.conversion_type in TO_TEXT and depth < 8:
        for each in _references(conversion):
            _check_formulas(each, where, depth + 1)


def _floats(samples: NDArray[Any]) -> Values:
    """Values as float64, NaN for what is text."""
    if samples.dtype.kind in "iufb":
        return samples.astype(np.float64)
    return np.array([_float(each) for each in samples.tolist()], dtype=np.float64)


def _float(value: object) -> float:
    return float(value) if isinstance(value, (bool, int, float)) else np.nan
