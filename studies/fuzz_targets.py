"""DAMAGED FILES -> WHAT BECOMES OF THEM: everything that can be read of them is read.

What may come out: values, or one of the project's own errors in one line. Anything else is a defect, also a
loss below zero, columns of different lengths, a message in several lines, or a change of the file itself.
"""

from __future__ import annotations

import base64
import hashlib
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from log_corpus import definition_of

from ident.errors import IdentError
from ident.logs import Columns, FieldError, Log, find_runs, open_log
from ident.logs.decode import BinaryDecoder
from ident.logs.record import Channel, Stored
from ident.logs.type_object import read_type_objects
from ident.results import Damage
from ident.signals.channel_map import read_channel_map

MOST_FIELDS = 30
OWN = (IdentError, FieldError)


class BrokenPromise(AssertionError):
    """What came out contradicts itself."""


def check(*, holds: bool, what: str) -> None:
    """Say ``what`` where it does not hold."""
    if not holds:
        raise BrokenPromise(what)


def outcome(kind: str, files: Mapping[str, bytes], folder: Path) -> str:
    """Read damaged files in an empty ``folder``: "read", "damaged" or "refused".

    Raises
    ------
    Exception
        Anything that is not the project's own: a defect.
    """
    try:
        if kind == "definitions":
            return _definition(files)
        if kind == "cdr":
            return _message(files)
        for name, data in files.items():
            (folder / name).write_bytes(data)
        if kind == "channels":
            read_channel_map(folder / "channels.yaml")
            return "read"
        return _log(kind, files, folder)
    except OWN as error:
        check(holds=bool(str(error)), what="an error without a word")
        return "refused"


def _log(kind: str, files: Mapping[str, bytes], folder: Path) -> str:
    path = folder / next(iter(files))
    whole = kind == "folder" and "metadata.yaml" in files
    runs = find_runs([folder]) if whole else []
    log = open_log(runs[0].path, runs[0].files) if whole else open_log(path)
    try:
        damage = read_whole(log)
    finally:
        log.close()
    left = {each.name: hashlib.sha256(each.read_bytes()).digest() for each in folder.iterdir()}
    check(holds=not list(Path(tempfile.gettempdir()).glob("ident-*")), what="a temporary folder is left")
    check(
        holds=left == {name: hashlib.sha256(data).digest() for name, data in files.items()},
        what=f"the files are not what they were: {sorted(left)}",
    )
    return "damaged" if damage else "read"


def read_whole(log: Log) -> list[Damage]:
    """Read all fields of all topics, before and after a check of the whole file; return all damage."""
    first = _read(log)
    log.check()
    second = _read(log)
    damage = list(log.damage)
    for topic in log.topics:
        times = log.times(topic.name)
        check(holds=len(times) == topic.messages, what=f"{topic}: {len(times)} times")
        found = second[topic.name]
        if topic.name in first:
            check(holds=_same(first[topic.name], found), what=f"{topic}: other values after a check")
        if isinstance(found, str):
            damage.append(Damage(found))
            continue
        damage += found.damage
        lost = sum(each.messages_lost or 0 for each in found.damage)
        count = len(found.log_time)
        check(holds=count + lost == topic.messages, what=f"{topic}: {count} decoded, {lost} lost")
        stamps = found.header_stamp
        check(holds=stamps is None or len(stamps) == count, what=f"{topic}: stamps")
        check(holds=all(len(each) == count for each in found.values.values()), what=f"{topic}: values")
        kinds = {each.dtype for each in found.values.values()}
        check(holds=kinds <= {np.dtype(np.float64)}, what=f"{topic}: {kinds}")
    for each in damage:
        counts = [each.messages_lost, each.seconds_lost, each.bytes_lost]
        check(holds=all(n is None or 0 <= n < float("inf") for n in counts), what=f"{each}")
        check(holds=bool(each.what) and "\n" not in each.what, what=f"not one line: {each}")
    return damage


def _read(log: Log) -> dict[str, Columns | str]:
    """Columns of all topics, read in one pass; why there are none of one that cannot be decoded."""
    wanted: dict[str, list[str]] = {}
    found: dict[str, Columns | str] = {}
    for topic in log.topics:
        try:
            wanted[topic.name] = list(log.fields(topic.name))[:MOST_FIELDS]
        except FieldError as error:
            found[topic.name] = str(error)
    return {**found, **log.read(wanted)}


def _same(one: Columns | str, other: Columns | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    stamps = (one.header_stamp, other.header_stamp)
    return (
        np.array_equal(one.log_time, other.log_time)
        and (stamps[0] is None) == (stamps[1] is None)
        and (stamps[0] is None or np.array_equal(stamps[0], stamps[1]))
        and list(one.values) == list(other.values)
        and all(np.array_equal(one.values[name], other.values[name], equal_nan=True) for name in one.values)
    )


def _definition(files: Mapping[str, bytes]) -> str:
    ((language, data),) = files.items()
    text = data.decode("utf-8", "replace")
    if language == "idl":
        names = ("truck::State", "Wheel_final", "Wheel_appendable", "Wheel_mutable")
        kind = next((name for name in names if name.rpartition(":")[2] in text), names[0])
        BinaryDecoder(Channel("/x", kind, "cdr", text, "omgidl")).fields()
    elif language == "type object":
        hashed = base64.b64encode(b"\xf2" + bytes(14)).decode()
        rows = [("truck::Angle", hashed, base64.b64encode(data).decode())]
        schema = read_type_objects(rows).schema("truck::Angle").check()
        BinaryDecoder(Channel("/x", "truck::Angle", "cdr", "", "", schema)).fields()
    else:
        encoding = "ros1" if language == "ros1msg" else "cdr"
        BinaryDecoder(Channel("/x", "truck_msgs/msg/State", encoding, text, language)).fields()
    return "read"


def _message(files: Mapping[str, bytes]) -> str:
    """Decode a message alone, and among sound ones, all as one column."""
    ((name, data),) = files.items()
    language, text = definition_of(name)
    decoder = BinaryDecoder(Channel("/x", name, "cdr", text, language))
    fields = list(decoder.fields())[:MOST_FIELDS]
    stored = Stored(np.zeros(3, np.int64), [data, data, data[:-1]])
    columns = decoder.columns(stored, fields)
    lost = sum(each.messages_lost or 0 for each in columns.damage)
    check(holds=len(columns.log_time) + lost == 3, what=f"{len(columns.log_time)} read, {lost} lost of 3")
    return "damaged" if columns.damage else "read"
