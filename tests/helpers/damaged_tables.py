"""The recording of ``damaged_logs`` in formats of tables: DDS recorders' SQLite, CSV, Parquet and MDF.

What a format cannot hold is left out of it: a CSV or Parquet file holds one topic, RTI's names a topic like
its type.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from log_files import ANGLE, START, TYPES
from mdf_writer import Chan, Group, write_mdf

IDL = """
module builtin_interfaces { module msg { @final struct Time { long sec; unsigned long nanosec; }; }; };
module std_msgs { module msg {
  @final struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
module geometry_msgs { module msg {
  @final struct Vector3 { double x; double y; double z; };
  @final struct Twist { geometry_msgs::msg::Vector3 linear; geometry_msgs::msg::Vector3 angular; };
  @final struct TwistStamped { std_msgs::msg::Header header; geometry_msgs::msg::Twist twist; }; }; };
module truck_msgs { module msg {
  @final struct SteeringWheelAngle { std_msgs::msg::Header header; double angle; }; }; };
"""
BESIDE: dict[str, dict[str, bytes]] = {kind: {"types.idl": IDL.encode()} for kind in ("eprosima", "rti")}
ROWS = 100
"""Rows in each row group of a Parquet file."""


def value(each) -> float:
    """The one number that matters of a message."""
    decoded = TYPES.deserialize_cdr(each.data, each.kind)
    return float(decoded.angle if each.kind == ANGLE else decoded.twist.linear.x)


# --- what a format holds --------------------------------------------------------------------------


def _one_topic(messages: Sequence) -> list:
    return [replace(each, topic="/run") for each in messages if each.kind == ANGLE]


def _named_by_type(messages: Sequence) -> list:
    return [replace(each, topic=each.kind.rpartition("/")[2]) for each in messages]


def _named_by_group(messages: Sequence) -> list:
    return [replace(each, topic=f"/{each.kind.rpartition('/')[2]}") for each in messages]


HELD: dict[str, Callable[[Sequence], list]] = {
    "rti": _named_by_type,
    "csv": _one_topic,
    "parquet": _one_topic,
    "parquet checked": _one_topic,
    "mdf": _named_by_group,
}


# --- writers --------------------------------------------------------------------------------------


def write_eprosima(path: Path, messages: Sequence) -> None:
    """The tables of eProsima's Record & Replay, without type objects."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE Types (name TEXT, information TEXT, object TEXT, is_ros2_type TEXT)")
        database.execute(
            "CREATE TABLE Messages (writer_guid TEXT NOT NULL, sequence_number INTEGER NOT NULL, "
            "data_json TEXT, data_cdr BLOB, data_cdr_size INTEGER, topic TEXT, type TEXT, key TEXT, "
            "log_time DATETIME, publish_time DATETIME, PRIMARY KEY(writer_guid, sequence_number))"
        )
        rows = [
            ("guid", k, each.data, len(each.data), each.topic, each.kind, _text(each.time), _text(each.time))
            for k, each in enumerate(messages)
        ]
        database.executemany("INSERT INTO Messages VALUES (?, ?, NULL, ?, ?, ?, ?, '', ?, ?)", rows)
        database.commit()


def _text(time: int) -> str:
    return str(np.datetime64(time, "ns")).replace("T", " ")


def write_rti(path: Path, messages: Sequence) -> None:
    """One table of CDR samples for each topic, as RTI's Recording Service documents them."""
    with closing(sqlite3.connect(path)) as database:
        for topic in dict.fromkeys(each.topic for each in messages):
            database.execute(
                f'CREATE TABLE "{topic}@0" (rti_cdr_sample BLOB, SampleInfo_reception_timestamp INTEGER, '
                "SampleInfo_source_timestamp INTEGER, SampleInfo_valid_data INTEGER)"
            )
        for each in messages:
            row = (each.data, each.time, each.time, 1)
            database.execute(f'INSERT INTO "{each.topic}@0" VALUES (?, ?, ?, ?)', row)
        database.commit()


def write_csv(path: Path, messages: Sequence) -> None:
    """Times [ns] and angles, one line each."""
    path.write_bytes(b"time_ns,angle\n" + b"".join(csv_line(each) for each in messages))


def csv_line(each) -> bytes:
    """The line of a message, with its end."""
    return f"{each.time},{value(each)!r}\n".encode()


def write_parquet(**options) -> Callable[[Path, Sequence], None]:
    """Times [ns] and angles in several row groups."""

    def write(path: Path, messages: Sequence) -> None:
        columns = {"time_ns": [each.time for each in messages], "angle": [value(each) for each in messages]}
        pq.write_table(pa.table(columns), path, row_group_size=ROWS, **options)

    return write


def write_mdf_groups(path: Path, messages: Sequence) -> None:
    """One group for each type, its times since the start [s]."""
    groups = []
    for kind in dict.fromkeys(each.kind for each in messages):
        own = [each for each in messages if each.kind == kind]
        times = np.array([(each.time - START) / 1e9 for each in own])
        values = np.array([value(each) for each in own])
        groups.append(Group(kind.rpartition("/")[2], [Chan("t", times, "s", sync=1), Chan("x", values)]))
    write_mdf(path, groups, START)


WRITERS: dict[str, Callable[[Path, Sequence], None]] = {
    "eprosima": write_eprosima,
    "rti": write_rti,
    "csv": write_csv,
    "parquet": write_parquet(),
    "parquet checked": write_parquet(compression="none", use_dictionary=False, write_page_checksum=True),
    "mdf": write_mdf_groups,
}
NAMES = {
    "eprosima": "run.db", "rti": "run.dat", "csv": "run.csv", "parquet": "run.parquet", "mdf": "run.mf4"
}  # fmt: skip


# --- what is left ---------------------------------------------------------------------------------


def mdf_record(each) -> bytes:
    """Time and value as they lie in the data of a group."""
    return np.array([(each.time - START) / 1e9, value(each)]).tobytes()


def parquet_rows_left(path: Path, whole: bytes, hit: tuple[int, int]) -> list[int]:
    """Rows of a sound Parquet file whose row group was not hit: of a group no column may lack a part."""
    path.write_bytes(whole)
    about = pq.read_metadata(path)
    path.unlink()
    kept: list[int] = []
    first = 0
    for number in range(about.num_row_groups):
        group = about.row_group(number)
        columns = [group.column(k) for k in range(group.num_columns)]
        begins = [c.dictionary_page_offset or c.data_page_offset for c in columns]
        spans = [(b, b + c.total_compressed_size) for b, c in zip(begins, columns, strict=True)]
        if all(hit[1] <= begin or hit[0] >= end for begin, end in spans):
            kept += range(first, first + group.num_rows)
        first += group.num_rows
    return kept
