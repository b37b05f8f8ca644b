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
