"""MCAP files, whole and damaged: what can be read is read, and what is lost is said."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_files import ANGLE, START, angles, plain, write_mcap
from mcap.writer import CompressionType

from ident.errors import UnusableLog
from ident.logs import FieldError, open_log

TOPIC = "/vehicle/steering_wheel"
COUNT = 1000
KINDS = pytest.mark.parametrize("compression", list(CompressionType), ids=lambda kind: kind.name.lower())


def read(path):
    log = open_log(path)
    columns = log.columns(TOPIC, ["angle"])
    return log, columns


def assert_true(columns):
    """Every value that was read is the one that was written at that time."""
    assert np.array_equal(columns.header_stamp, columns.log_time)
    assert np.allclose(columns.values["angle"], (columns.log_time - START) / 1e9, rtol=0, atol=1e-9)
    assert np.all(np.diff(columns.log_time) > 0)


def damaged(tmp_path, source, data):
    path = tmp_path / f"damaged_{source.name}"
    path.write_bytes(data)
    return path


@KINDS
def test_reads_every_message(tmp_path, compression):
    log, columns = read(write_mcap(tmp_path / "a.mcap", angles(COUNT), compression=compression))
    assert (log.format, log.damage, columns.damage) == ("mcap", [], [])
    assert [(topic.name, topic.type, topic.messages) for topic in log.topics] == [(TOPIC, ANGLE, COUNT)]
    assert len(columns.log_time) == COUNT
    assert_true(columns)


def test_reads_messages_outside_chunks(tmp_path):
    log, columns = read(write_mcap(tmp_path / "a.mcap", angles(COUNT), chunks=False))
    assert log.damage == []
    assert len(columns.log_time) == COUNT
    assert_true(columns)


@KINDS
def test_a_file_cut_at_60_percent_gives_60_percent(tmp_path, compression):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT), compression=compression)
    data = whole.read_bytes()
    log, columns = read(damaged(tmp_path, whole, data[: len(data) * 6 // 10]))
    # The index at the end takes some bytes, so that 60 % of the bytes hold a little more of the messages.
    assert 0.55 * COUNT < len(columns.log_time) < 0.7 * COUNT
    assert_true(columns)
    assert any("no footer" in item.what for item in log.damage)
    assert any("cut off" in item.what or "no records" in item.what for item in log.damage)


@KINDS
def test_the_beginning_of_a_chunk_that_is_cut_off_is_read(tmp_path, compression):
    count = 6000  # 400 kB: compressed in blocks of 64 or 128 kB, which are read whole or not at all
    whole = write_mcap(tmp_path / "a.mcap", angles(count), compression=compression, chunk_size=1 << 20)
    data = whole.read_bytes()
    ((offset, length),) = chunk_places(data)
    log, columns = read(damaged(tmp_path, whole, data[: offset + length * 8 // 10]))
    assert 0.4 * count < len(columns.log_time) < 0.85 * count
    assert_true(columns)
    lost = next(item for item in log.damage if "cut off" in item.what or "no records" in item.what)
    if compression is not CompressionType.NONE:
        assert lost.seconds_lost == pytest.approx((count - len(columns.log_time)) / 100, abs=0.02)


@KINDS
def test_a_missing_footer_loses_nothing(tmp_path, compression):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT), compression=compression)
    log, columns = read(damaged(tmp_path, whole, whole.read_bytes()[:-37]))
    assert len(columns.log_time) == COUNT
    assert [item.what for item in log.damage] == [
        "damaged_a.mcap: has no footer, the recorder did not close it"
    ]


def chunk_places(data):
    """(offset, length) of the chunk records of a sound file."""
    found, position = [], 8
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == 0x06:
            found.append((position, length + 9))
        position += length + 9
    return found


@KINDS
def test_a_bit_flipped_in_a_chunk_loses_that_chunk_and_says_how_much(tmp_path, compression):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT), compression=compression)
    data = bytearray(whole.read_bytes())
    offset, length = chunk_places(data)[3]
    data[offset + length // 2] ^= 0x10
    log, columns = read(damaged(tmp_path, whole, bytes(data)))
    (loss,) = log.damage
    assert "damaged chunk" in loss.what
    assert f"at byte {offset}" in loss.what
    assert loss.messages_lost == COUNT - len(columns.log_time) > 0
    assert loss.seconds_lost == pytest.approx((loss.messages_lost - 1) / 100, abs=1e-6)
    assert loss.messages_lost < 100
    assert_true(columns)


@KINDS
@pytest.mark.parametrize("change", ["length", "inserted", "removed"])
def test_finds_the_next_chunk_where_the_records_lose_step(tmp_path, compression, change):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT), compression=compression)
    data = bytearray(whole.read_bytes())
    offset, _ = chunk_places(data)[3]
    if change == "length":
        data[offset + 1 : offset + 9] = struct.pack("<Q", 1 << 40)
    elif change == "inserted":
        data[offset + 20 : offset + 20] = b"\x00" * 7
    else:
        del data[offset + 20 : offset + 27]
    log, columns = read(damaged(tmp_path, whole, bytes(data)))
    assert COUNT - 100 < len(columns.log_time) < COUNT
    assert_true(columns)
    assert sum(item.bytes_lost or 0 for item in log.damage) > 0


def test_channels_defined_in_a_lost_chunk_are_found_in_the_summary(tmp_path):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT))
    data = bytearray(whole.read_bytes())
    offset, length = chunk_places(data)[0]
    data[offset + length // 2] ^= 0x10
    _, columns = read(damaged(tmp_path, whole, bytes(data)))
    assert COUNT - 100 < len(columns.log_time) < COUNT


def test_messages_of_a_channel_that_is_defined_nowhere_are_counted(tmp_path):
    whole = write_mcap(tmp_path / "a.mcap", angles(COUNT))
    data = bytearray(whole.read_bytes())
    places = chunk_places(data)
    data[places[0][0] + places[0][1] // 2] ^= 0x10
    log = open_log(damaged(tmp_path, whole, bytes(data[: sum(places[-1])])))
    assert log.topics == []
    orphans = next(item for item in log.damage if "channel is defined in a lost part" in item.what)
    assert orphans.messages_lost > 0.8 * COUNT


def test_damage_outside_chunks_shows_in_the_crc_of_the_data(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        from mcap.writer import Writer  # noqa: PLC0415 (the only test that needs its options)

        writer = Writer(file, use_chunking=False, enable_data_crcs=True)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/x", "cdr", schema)
        for k in range(100):
            data = plain("/x", "std_msgs/msg/Float64", START + k, data=float(k)).data
            writer.add_message(channel, START + k, data, START + k)
        writer.finish()
    assert open_log(path).damage == []
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    (item,) = open_log(damaged(tmp_path, path, bytes(data))).damage
    assert "CRC of the data does not match" in item.what


def test_a_topic_whose_definition_does_not_parse_costs_only_itself(tmp_path):
    other = [plain("/flag", "std_msgs/msg/Bool", START + k, data=True) for k in range(3)]
    path = write_mcap(
        tmp_path / "a.mcap",
        [*angles(10), *other],
        definitions={"std_msgs/msg/Bool": ("ros2msg", "bool data\n---\n???")},
    )
    log, columns = read(path)
    assert len(columns.log_time) == 10
    with pytest.raises(FieldError, match=r"definition of std_msgs/msg/Bool cannot be read"):
        log.fields("/flag")


def test_says_which_definition_formats_are_not_read(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", angles(10), definitions={ANGLE: ("protobuf", "message A {}")})
    with pytest.raises(FieldError, match="'protobuf' is not read"):
        open_log(path).fields(TOPIC)


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        ("0003", f"is a parameter list, the definition of {ANGLE} does not number its members"),
        ("000b", f"is a parameter list, the definition of {ANGLE} does not number its members"),
        ("0042", "CDR encapsulation 0042 is not known"),
    ],
)
def test_says_which_encapsulation_is_not_read(tmp_path, head, reason):
    messages = angles(10)
    object.__setattr__(messages[4], "data", bytes.fromhex(head) + messages[4].data[2:])
    _, columns = read(write_mcap(tmp_path / "a.mcap", messages))
    assert len(columns.log_time) == 9
    (item,) = columns.damage
    assert item.what == f"{TOPIC}: cannot be decoded: {reason}"
    assert item.messages_lost == 1


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", r"is empty \(0 bytes\)"),
        (b"\x89MCAP9\r\n", "is no log"),
        (b"#ROSBAG V1.2\n", "ROS 1 bag of version 1.2, need 2.0: run 'rosbag fix' on it"),
        (b"hello", "is no log"),
    ],
)
def test_refuses_what_is_no_log_in_one_line(tmp_path, data, reason):
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with pytest.raises(UnusableLog, match=reason) as caught:
        open_log(path)
    assert "\n" not in str(caught.value)


def test_the_magic_alone_is_an_empty_log(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    log = open_log(path)
    assert log.topics == []
    assert "no footer" in log.damage[0].what


@pytest.fixture(scope="module")
def small_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    found = [write_mcap(folder / f"{k.name}.mcap", angles(200), compression=k) for k in CompressionType]
    found.append(write_mcap(folder / "plain.mcap", angles(200), chunks=False))
    return found


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(which=st.integers(0, 3), part=st.floats(0, 1), flips=st.lists(st.floats(0, 1), max_size=4))
def test_no_cut_and_no_flipped_bit_stops_the_reader(tmp_path, small_files, which, part, flips):
    whole = small_files[which].read_bytes()
    data = bytearray(whole[: int(part * len(whole))])
    for place in flips:
        if data:
            data[min(int(place * len(data)), len(data) - 1)] ^= 0x20
    path = tmp_path / "x.mcap"
    path.write_bytes(bytes(data))
    try:
        log = open_log(path)
        total = sum(topic.messages for topic in log.topics)
        columns = [log.columns(topic.name, []) for topic in log.topics if topic.type == ANGLE]
    except UnusableLog:
        return
    except FieldError:  # a definition was hit
        return
    assert total <= 200
    assert all(len(each.log_time) <= total for each in columns)
    if len(whole) - len(data) > 8:  # more than the magic that ends the file
        assert log.damage


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(which=st.integers(0, 3), part=st.floats(0.02, 1))
def test_a_cut_never_changes_a_value(tmp_path, small_files, which, part):
    path = tmp_path / "x.mcap"
    whole = small_files[which].read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    log = open_log(path)
    for topic in log.topics:
        assert_true(log.columns(topic.name, ["angle"]))
