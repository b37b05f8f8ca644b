"""Chunks by their index and by walking through them: the same columns, the same damage, little memory."""

import struct
import threading
import tracemalloc
from contextlib import contextmanager

import numpy as np
import pytest
from log_corpus import active
from log_files import ANGLE, START, angles, new, plain, write_mcap
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from ident.logs import chunks, contents, mcap, mcap_records, open_log, ros1, ros1_records

ONE, TWO = "/one", "/two"
COUNT = 300
INDEX, CHUNK, DATA_END = 0x07, 0x06, 0x0F


def both(tmp_path, name="a.mcap", **options):
    """Two channels in turn, 100 Hz each."""
    pairs = zip(angles(COUNT, topic=ONE), angles(COUNT, topic=TWO, value=lambda t: -t), strict=True)
    return write_mcap(tmp_path / name, [each for pair in pairs for each in pair], **options)


def one_after_the_other(tmp_path):
    """A chunk for every message: one of one channel, one of the other, and so on."""
    return both(tmp_path, "turns.mcap", chunk_size=1, compression=CompressionType.NONE)


def ros1_bag(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "a.bag"
    writer = Writer(path)
    writer.chunk_threshold = 4096
    kind = "std_msgs/msg/Float64"
    with writer:
        connections = [writer.add_connection(topic, kind, typestore=store) for topic in (ONE, TWO)]
        for k in range(COUNT):
            for sign, connection in zip((1, -1), connections, strict=True):
                data = store.serialize_ros1(store.types[kind](data=sign * k / 100), kind)
                writer.write(connection, START + k * 10_000_000, data)
    return path


@contextmanager
def walking():
    """No index is used: every chunk is unpacked when the file is opened, and gone through."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (mcap_records, ros1_records):
            patch.setattr(module, "indexed_contents", lambda *_: None)
        for storage in (mcap.McapStorage, ros1.Ros1Storage):
            patch.setattr(storage, "_is_consistent", lambda _: False)
        yield


def everything(path, field="angle"):
    """What is read of a log, and what is known to be lost once all of it was looked at."""
    log = open_log(path)
    wanted = {topic.name: [field] for topic in log.topics}
    read = log.read(wanted)
    times = {topic: log.times(topic).tolist() for topic in wanted}
    columns = {
        topic: (c.log_time.tolist(), c.values[field].tolist(), [d.what for d in c.damage])
        for topic, c in read.items()
    }
    log.check()
    return columns, times, log.damage, [(topic.name, topic.messages) for topic in log.topics]


def assert_the_same_by_walking(path, field="angle"):
    found = everything(path, field)
    with walking():
        assert everything(path, field) == found
    return found


def assert_whole(found):
    columns, times, damage, topics = found
    assert damage == []
    assert topics == [(ONE, COUNT), (TWO, COUNT)]
    for topic, sign in ((ONE, 1), (TWO, -1)):
        expected = START + 10_000_000 * np.arange(COUNT)
        assert columns[topic][0] == times[topic] == expected.tolist()
        assert columns[topic][1] == pytest.approx((sign * np.arange(COUNT) / 100).tolist(), abs=1e-12)


def index_records(data, opcode=INDEX):
    """Place -> content of the records of a kind in an MCAP file."""
    found, position = {}, 8
    while position < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, position)
        if kind == opcode:
            found[position] = data[position + 9 : position + 9 + length]
        position += 9 + length
    return found


def chunk_reads(monkeypatch, storage):
    """List of the chunks that are unpacked from now on."""
    seen, unpack = [], storage._unpack

    def noted(self, source, chunk, target):
        seen.append(chunk.offset)
        return unpack(self, source, chunk, target)

    monkeypatch.setattr(storage, "_unpack", noted)
    return seen


@pytest.mark.parametrize("compression", list(CompressionType), ids=lambda kind: kind.name.lower())
def test_a_sound_file_is_the_same_by_index_and_by_walking(tmp_path, compression):
    assert_whole(assert_the_same_by_walking(both(tmp_path, compression=compression)))


def test_a_sound_bag_is_the_same_by_index_and_by_walking(tmp_path):
    assert_whole(assert_the_same_by_walking(ros1_bag(tmp_path), "data"))


def test_only_chunks_that_hold_what_is_needed_are_unpacked_and_each_once(tmp_path, monkeypatch):
    path = one_after_the_other(tmp_path)
    seen = chunk_reads(monkeypatch, mcap.McapStorage)
    log = open_log(path)
    assert (seen, [topic.messages for topic in log.topics]) == ([], [COUNT, COUNT])
    log.columns(ONE, ["angle"])
    assert len(seen) == len(set(seen)) == COUNT
    log.check()
    assert len(seen) == len(set(seen)) == 2 * COUNT


def test_a_sound_bag_is_opened_without_unpacking_a_chunk(tmp_path, monkeypatch):
    path = ros1_bag(tmp_path)
    seen = chunk_reads(monkeypatch, ros1.Ros1Storage)
    log = open_log(path)
    assert (seen, [topic.messages for topic in log.topics]) == ([], [COUNT, COUNT])
    assert len(log.read({ONE: ["data"], TWO: ["data"]})[ONE].log_time) == COUNT
    assert len(seen) == len(set(seen)) > 5


def test_damage_in_a_chunk_that_nobody_needs_is_told_once_it_is_looked_at(tmp_path):
    path = one_after_the_other(tmp_path)
    data = bytearray(path.read_bytes())
    place = list(index_records(data, CHUNK))[21]
    data[place + 90] ^= 1
    path.write_bytes(data)
    log = open_log(path)
    assert len(log.columns(ONE, ["angle"]).log_time) == COUNT
    assert log.damage == []
    assert len(log.columns(TWO, ["angle"]).log_time) == COUNT - 1
    (item,) = log.damage
    assert (item.messages_lost, f"at byte {place}" in item.what) == (1, True)
    assert len(log.times(TWO)) == COUNT - 1
    again = open_log(path)
    again.check()
    assert again.damage == log.damage
    assert_the_same_by_walking(path)


def test_where_something_is_lost_it_is_told_what_was_not_looked_at(tmp_path):
    path = one_after_the_other(tmp_path)
    data = bytearray(path.read_bytes())
    data[list(index_records(data, CHUNK))[20] + 90] ^= 1
    path.write_bytes(data)
    log = open_log(path)
    log.columns(ONE, ["angle"])
    assert [item.messages_lost for item in log.damage] == [1, None]
    assert f"{COUNT} of {2 * COUNT} chunks hold nothing that is needed" in log.damage[1].what
    log.check()
    assert [item.messages_lost for item in log.damage] == [1]


def lie(path, change):
    """Change the content of the third index record of a file."""
    data = bytearray(path.read_bytes())
    place, content = list(index_records(data).items())[2]
    changed = change(bytearray(content), data)
    assert len(changed) == len(content)
    data[place + 9 : place + 9 + len(content)] = changed
    path.write_bytes(data)


def entry(content, number, place):
    """Make an entry of an index point elsewhere."""
    struct.pack_into("<Q", content, 6 + 16 * number + 8, place)
    return content


LIES = {
    "behind the chunk": lambda content, _: entry(content, 3, 1 << 40),
    "before the chunk": lambda content, _: entry(content, 3, (1 << 64) - 40),
    "inside a message": lambda content, _: entry(content, 3, struct.unpack_from("<Q", content, 62)[0] + 31),
    "twice at one message": lambda content, _: entry(content, 3, struct.unpack_from("<Q", content, 46)[0]),
    "at another time": lambda content, _: content[:6] + struct.pack("<Q", START) + content[14:],
    "of another channel": lambda content, _: struct.pack("<H", 2 - (content[0] == 2)) + content[2:],
    "of a channel that does not exist": lambda content, _: struct.pack("<H", 77) + content[2:],
    "of another chunk": lambda content, data: list(index_records(data).values())[4][: len(content)],
    "with a length that does not fit": lambda content, _: (
        content[:2] + struct.pack("<I", 1 << 31) + content[6:]
    ),
    "not in order": lambda content, _: content[:6] + content[22:38] + content[6:22] + content[38:],
}


@pytest.mark.parametrize("name", LIES)
def test_an_index_that_lies_costs_nothing(tmp_path, name):
    path = both(tmp_path)
    lie(path, LIES[name])
    assert_whole(assert_the_same_by_walking(path))


def test_an_index_that_hides_messages_is_found_out_where_any_other_shows_it(tmp_path):
    """Two chunks change places in the indexes: what one hides, the other claims, and all counts agree."""
    path = one_after_the_other(tmp_path)
    data = bytearray(path.read_bytes())
    first, second = list(index_records(data))[20:22]
    for place in (first, second):
        (number,) = struct.unpack_from("<H", data, place + 9)
        struct.pack_into("<H", data, place + 9, 3 - number)
    path.write_bytes(data)
    for topic, sign in ((ONE, 1), (TWO, -1)):
        log = open_log(path)
        columns = log.columns(topic, ["angle"])
        np.testing.assert_allclose(columns.values["angle"], sign * np.arange(COUNT) / 100, atol=1e-12)
        assert len(log.times(topic)) == COUNT
    assert_whole(assert_the_same_by_walking(path))


def test_a_message_that_reaches_into_the_next_chunk_is_found_out(tmp_path):
    """The last message of a chunk claims the records before the first message of the next chunk as well."""
    path = both(tmp_path, compression=CompressionType.NONE)
    assert_whole(everything(path))
    data = bytearray(path.read_bytes())
    chunks_of = list(index_records(data, CHUNK).items())
    (place, content), index = chunks_of[2], list(index_records(data).items())
    last = max(
        struct.unpack_from("<Q", entries, 6 + 16 * k + 8)[0]
        for where, entries in index
        if place < where < chunks_of[3][0]
        for k in range((len(entries) - 6) // 16)
    )
    begin = place + 9 + 32 + struct.unpack_from("<I", content, 28)[0] + 8 + last
    (length,) = struct.unpack_from("<Q", data, begin + 1)
    struct.pack_into("<Q", data, begin + 1, length + 5)
    struct.pack_into("<I", data, place + 9 + 24, 0)  # no CRC of the chunk
    end = next(iter(index_records(data, DATA_END)))
    struct.pack_into("<I", data, end + 9, 0)  # nor of the file
    path.write_bytes(data)
    columns, *_ = assert_the_same_by_walking(path)
    assert sum(len(read[0]) for read in columns.values()) == 2 * COUNT - 1


def test_whether_a_message_lies_on_both_sides_of_an_edge():
    def found(begins, sizes, edges):
        places = np.array(begins)
        order = {1: (0, len(begins))}
        return contents.crosses(
            contents.Contents(order, places, None, places - 5, places, np.array(sizes)), edges
        )

    assert not found([5, 25], [10, 10], [15])
    assert not found([5, 25], [15, 10], [20])  # ends where the next chunk begins
    assert found([5, 25], [16, 10], [20])
    assert found([25, 5], [10, 16], [20])
    assert not found([25], [10], [20])  # nothing before the edge


def without_end(path):
    """The file as a recorder leaves it that is killed behind a chunk: indexes, but no end."""
    data = path.read_bytes()
    (end,) = index_records(data, DATA_END)
    path.write_bytes(data[:end])
    return path


@pytest.mark.parametrize("compression", list(CompressionType), ids=lambda kind: kind.name.lower())
def test_a_file_without_an_end_is_unpacked_once(tmp_path, monkeypatch, compression):
    path = without_end(both(tmp_path, compression=compression))
    seen = chunk_reads(monkeypatch, mcap.McapStorage)
    columns, times, _, topics = everything(path)
    assert len(seen) == len(set(seen)) > 5
    assert_whole((columns, times, [], topics))


def test_a_bag_without_its_index_is_unpacked_once(tmp_path, monkeypatch):
    path = ros1_bag(tmp_path)
    path.write_bytes(active(path.read_bytes()))
    seen = chunk_reads(monkeypatch, ros1.Ros1Storage)
    columns, times, _, topics = everything(path, "data")
    assert len(seen) == len(set(seen)) > 5
    assert_whole((columns, times, [], topics))


@pytest.mark.parametrize("limit", [0, 12_000, 25_000])
def test_what_is_not_kept_in_memory_is_unpacked_again_in_its_place(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(chunks, "KEPT_BYTES", limit)
    monkeypatch.setattr(chunks, "JOB_BYTES", 5000)
    path = without_end(both(tmp_path))
    seen = chunk_reads(monkeypatch, mcap.McapStorage)
    columns, times, _, topics = everything(path)
    count = len(set(seen))
    assert len(seen) == 2 * count if not limit else count < len(seen) < 2 * count
    assert_whole((columns, times, [], topics))


def test_large_messages_of_a_file_without_an_end_are_not_kept_and_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "SMALL_MESSAGE", 20)
    path = without_end(both(tmp_path))
    storage = mcap.McapStorage(path)
    assert all(not kept.parts for kept in storage._kept)
    columns, times, _, topics = everything(path)
    assert_whole((columns, times, [], topics))


def test_two_indexes_of_one_channel_behind_a_chunk_cost_nothing(tmp_path):
    path = both(tmp_path)
    data = path.read_bytes()
    place, content = list(index_records(data).items())[2]
    size = 9 + len(content)
    path.write_bytes(data[:place] + data[place : place + size] + data[place:])
    assert_whole(assert_the_same_by_walking(path))


def test_a_summary_that_counts_wrongly_costs_nothing(tmp_path):
    path = both(tmp_path)
    data = bytearray(path.read_bytes())
    (place,) = index_records(data, 0x0B)
    struct.pack_into("<Q", data, place + 9 + 46 + 2, 5)
    path.write_bytes(data)
    assert_whole(assert_the_same_by_walking(path))


@pytest.mark.parametrize("what", ["time", "place", "connection", "count"])
def test_an_index_of_a_bag_that_lies_costs_nothing(tmp_path, what):
    path = ros1_bag(tmp_path)
    data = bytearray(path.read_bytes())
    place = data.find(b"op=\x04", len(data) // 2)
    start = data.rfind(b"\x08\x00\x00\x00ver=", 0, place + 60)
    if what in {"connection", "count"}:
        field = b"conn=" if what == "connection" else b"count="
        near = data.find(field, min(start, place) - 60)
        data[near + len(field)] ^= 1
    else:
        entries = data.find(b"\x04\x00\x00\x00op=\x04", min(start, place) - 60)
        end = max(data.find(name, entries - 40) for name in (b"conn=", b"count=", b"ver=", b"op=\x04"))
        first = end + 60
        data[first + (0 if what == "time" else 8)] ^= 1
    path.write_bytes(data)
    assert_the_same_by_walking(path, "data")


@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
def test_a_file_cut_off_is_the_same_by_index_and_by_walking(tmp_path, part):
    for path, field in ((both(tmp_path), "angle"), (ros1_bag(tmp_path), "data")):
        data = path.read_bytes()
        path.write_bytes(data[: int(part * len(data))])
        columns, _, damage, _ = assert_the_same_by_walking(path, field)
        assert 0 < len(columns[ONE][0]) <= COUNT
        assert damage


def test_messages_outside_chunks_stay_in_the_order_of_the_file(tmp_path):
    path = both(tmp_path, chunks=False)
    assert_whole(assert_the_same_by_walking(path))


def test_a_reading_that_is_given_up_leaves_no_thread_and_no_open_file(tmp_path):
    storage = mcap.McapStorage(both(tmp_path))
    pieces = storage.pieces(storage.channels)
    next(pieces)
    pieces.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("unpack")]


@pytest.fixture
def small_steps(monkeypatch):
    """Less at once than is usual, so that small files show what large ones would."""
    monkeypatch.setattr(chunks, "JOB_BYTES", 1 << 20)
    monkeypatch.setattr(chunks, "PIECE_BYTES", 1 << 20)


def test_memory_stays_at_the_columns_and_a_few_chunks(tmp_path, small_steps):
    """Of a file of 30 MB a channel of 30 kB is read: what is held at once is a few chunks of 1 MB."""
    image = b"\x00\x01\x00\x00" + bytes(100_000)
    big = plain("/image", "std_msgs/msg/Float64", START, data=0.0)
    messages = []
    for each in angles(300, topic=ONE):
        large = type(big)("/image", big.kind, each.time, image)
        messages += [each, large]
    path = write_mcap(tmp_path / "a.mcap", messages, chunk_size=1 << 20, compression=CompressionType.NONE)
    assert path.stat().st_size > 29e6
    open_log(both(tmp_path, "warm.mcap")).columns(ONE, ["angle"])
    tracemalloc.start()
    try:
        log = open_log(path)
        assert len(log.columns(ONE, ["angle"]).log_time) == 300
        log.check()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 6 << 20


def test_needed_messages_that_are_large_are_decoded_bit_by_bit(tmp_path, small_steps):
    """Of 40 MB of messages one number each is read: they are never all in memory."""
    kind = "std_msgs/msg/UInt8MultiArray"
    numbers = np.zeros(100_000, np.uint8)
    layout = new("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=7)
    one = plain("/image", kind, START, layout=layout, data=numbers)
    messages = [type(one)("/image", kind, START + k, one.data) for k in range(400)]
    path = write_mcap(tmp_path / "a.mcap", messages, chunk_size=1 << 20, compression=CompressionType.NONE)
    open_log(both(tmp_path, "warm.mcap")).columns(ONE, ["angle"])
    tracemalloc.start()
    try:
        columns = open_log(path).columns("/image", ["layout.data_offset"])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert columns.values["layout.data_offset"].tolist() == [7.0] * 400
    assert peak < 14 << 20


def test_the_type_of_a_channel_is_what_it_was(tmp_path):
    (one, two) = open_log(both(tmp_path)).topics
    assert (one.type, two.type) == (ANGLE, ANGLE)


def test_a_channel_that_is_known_outside_chunks_and_has_no_message_there_costs_nothing(tmp_path):
    storage = ros1.Ros1Storage(ros1_bag(tmp_path))
    for channel in storage.channels:
        before = storage.messages(channel)
        storage._loose = {number: chunks.Loose() for number in storage._numbers[id(channel)]}
        assert storage.messages(channel).times.tolist() == before.times.tolist()
        assert storage.times(channel).size == COUNT
