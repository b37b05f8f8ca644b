"""ROS 1 bags, whole and damaged."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from ident.errors import UnusableLog
from ident.logs import open_log

TYPES = get_typestore(Stores.ROS1_NOETIC)
KIND = "geometry_msgs/msg/PointStamped"
START = 1_700_000_000 * 10**9
COUNT = 3000
COMPRESSIONS = pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])


def write(path, compression="none", count=COUNT):
    writer = Writer(path)
    writer.chunk_threshold = 8192
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        connection = writer.add_connection("/point", KIND, typestore=TYPES)
        for k in range(count):
            t = START + k * 10_000_000
            stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=t // 10**9, nanosec=t % 10**9)
            header = TYPES.types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="map")
            point = TYPES.types["geometry_msgs/msg/Point"](x=float(k), y=-float(k), z=0.5)
            message = TYPES.types[KIND](header=header, point=point)
            writer.write(connection, t, TYPES.serialize_ros1(message, KIND))
    return path


def assert_true(columns):
    """Every value that was read is the one that was written at that time."""
    k = (columns.log_time - START) // 10_000_000
    np.testing.assert_array_equal(columns.header_stamp, columns.log_time)
    np.testing.assert_array_equal(columns.values["point.x"], k)
    np.testing.assert_array_equal(columns.values["header.seq"], k)


def read(path):
    log = open_log(path)
    return log, log.columns("/point", ["point.x", "header.seq"])


@COMPRESSIONS
def test_reads_every_message(tmp_path, compression):
    log, columns = read(write(tmp_path / "a.bag", compression))
    assert (log.format, log.damage, columns.damage) == ("ros1", [], [])
    assert len(columns.log_time) == COUNT
    assert_true(columns)


@COMPRESSIONS
def test_a_bag_cut_at_60_percent_gives_its_beginning(tmp_path, compression):
    path = write(tmp_path / "a.bag", compression)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    log, columns = read(path)
    assert 0.5 * COUNT < len(columns.log_time) < 0.75 * COUNT
    assert_true(columns)
    assert any("cut off" in item.what or "no records" in item.what for item in log.damage)


def test_a_bag_without_its_index_is_read_and_told(tmp_path):
    path = write(tmp_path / "a.bag")
    data = bytearray(path.read_bytes())
    place = data.find(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", data, place)
    struct.pack_into("<Q", data, place, 0)
    path.write_bytes(data[:index])
    log, columns = read(path)
    assert len(columns.log_time) == COUNT
    assert [item.what for item in log.damage] == ["a.bag: has no index, the recorder did not close it"]


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_of_a_damaged_chunk_its_index_says_how_many_messages_are_lost(tmp_path, compression):
    path = write(tmp_path / "a.bag", compression)
    data = bytearray(path.read_bytes())
    place = data.find(b"op=\x05", len(data) // 2) + 60
    data[place : place + 40] = bytes(40)
    path.write_bytes(data)
    log, columns = read(path)
    (item,) = log.damage
    assert "damaged chunk" in item.what
    assert item.messages_lost + len(columns.log_time) == COUNT
    assert 0 < item.messages_lost < COUNT
    assert_true(columns)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1), size=st.integers(1, 5000), cut=st.floats(0, 1))
def test_no_damage_stops_the_reader(tmp_path, place, size, cut):
    whole = tmp_path / "whole.bag"
    if not whole.exists():
        write(whole, "lz4", 500)
    data = bytearray(whole.read_bytes())
    start = int(place * len(data))
    data[start : start + size] = b"\xff" * len(data[start : start + size])
    path = tmp_path / "x.bag"
    path.write_bytes(data[: max(int(cut * len(data)), 1)])
    try:
        log = open_log(path)
    except UnusableLog as error:
        assert "\n" not in str(error)  # noqa: PT017
        return
    for topic in log.topics:
        log.columns(topic.name, [])


# --- chunks without an index ----------------------------------------------------------------------


def record(fields, data=b""):
    """A record: header fields in this order, then its data."""
    head = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value for name, value in fields
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def float64_message(k, order=0, more=()):
    """Message number k of connection k % 3, its header fields in one of several orders."""
    time = struct.pack("<II", START // 10**9, k)
    fields = [(b"conn", struct.pack("<I", k % 3)), (b"op", b"\x02"), (b"time", time), *more]
    return record(fields[order:] + fields[:order], struct.pack("<d", k))


def bare_bag(path, contents, compression=b"none"):
    """A bag of one chunk, without an index, that was not closed; three connections of Float64."""
    kind = [
        (b"type", b"std_msgs/Float64"),
        (b"md5sum", b"0" * 32),
        (b"message_definition", b"float64 data\n"),
    ]
    connections = [
        record(
            [(b"conn", struct.pack("<I", n)), (b"op", b"\x07"), (b"topic", b"/x%d" % n)],
            record([(b"topic", b"/x%d" % n), *kind])[4:-4],
        )
        for n in range(3)
    ]
    data = b"".join([*connections, *contents])
    fields = [(b"compression", compression), (b"op", b"\x05"), (b"size", struct.pack("<I", len(data)))]
    none = struct.pack("<Q", 0)
    head = record([(b"index_pos", none), (b"op", b"\x03")], bytes(100))
    path.write_bytes(b"#ROSBAG V2.0\n" + head + record(fields, data))
    return path


def values_by_time(path):
    log = open_log(path)
    found = {}
    for topic in log.topics:
        columns = log.columns(topic.name, ["data"])
        assert topic.messages == len(columns.log_time)
        times = (columns.log_time - START).tolist()
        assert times == sorted(times)
        found.update(
            zip(
                times,
                zip([topic.name] * len(times), columns.values["data"].tolist(), strict=True),
                strict=True,
            )
        )
    return found, log


def expected(numbers):
    return {k: (f"/x{k % 3}", float(k)) for k in numbers}


def test_messages_whose_headers_are_alike_are_found_without_an_index(tmp_path):
    found, _ = values_by_time(bare_bag(tmp_path / "a.bag", [float64_message(k) for k in range(300)]))
    assert found == expected(range(300))


def test_messages_with_headers_of_any_order_and_more_fields_are_found_without_an_index(tmp_path):
    more = [(), ((b"note", b"=x"),), ((b"trap", b"\x09\0\0\0conn=\x07\0\0\0"),)]
    contents = [float64_message(k, k // 7 % 3, more[k // 5 % 3]) for k in range(300)]
    found, log = values_by_time(bare_bag(tmp_path / "a.bag", contents))
    assert found == expected(range(300))
    assert [each.what for each in log.damage] == ["a.bag: has no index, the recorder did not close it"]


@pytest.mark.parametrize(
    "bad", [b"\xff" * 50, bytes(50), record([(b"op", b"\x09")]), record([(b"conn", b"")])]
)
def test_what_comes_before_bytes_that_are_no_records_is_read_and_they_are_told(tmp_path, bad):
    contents = [float64_message(k) for k in range(200)]
    found, log = values_by_time(bare_bag(tmp_path / "a.bag", [*contents[:120], bad, *contents[120:]]))
    assert found == expected(range(120))
    assert "bytes in a chunk that are no records" in log.damage[0].what
    assert log.damage[0].bytes_lost == len(bad) + sum(map(len, contents[120:]))


def test_a_message_without_a_time_among_others_costs_itself(tmp_path):
    odd = record([(b"conn", b"\1\0\0\0"), (b"op", b"\x02"), (b"tame", bytes(8))], bytes(8))
    contents = [float64_message(k) for k in range(200)]
    assert len(odd) == len(contents[0])
    found, log = values_by_time(bare_bag(tmp_path / "a.bag", [odd, *contents[:90], odd, *contents[90:]]))
    assert found == expected(range(200))
    assert log.damage[0].what.startswith("a.bag: 2 times unreadable record in a chunk")
