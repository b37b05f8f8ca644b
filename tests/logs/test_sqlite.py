"""rosbag2's SQLite files, whole and damaged."""

import hashlib
import shutil
import sqlite3

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_files import ANGLE, START, angles, plain, write_bag

from ident.errors import UnusableLog
from ident.logs import FieldError, open_log, sqlite
from ident.logs.sqlite import SqliteStorage

TOPIC = "/vehicle/steering_wheel"
COUNT = 2000


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag") / "run", angles(COUNT), sqlite=True) / "run.db3"


def read(path):
    log = open_log(path)
    return log, log.columns(TOPIC, ["angle"])


def assert_true(columns):
    assert np.allclose(columns.values["angle"], (columns.log_time - START) / 1e9, rtol=0, atol=1e-9)


def test_reads_every_message(whole):
    log, columns = read(whole)
    assert (log.format, log.damage, columns.damage) == ("rosbag2 sqlite3", [], [])
    assert [(topic.name, topic.type, topic.messages) for topic in log.topics] == [(TOPIC, ANGLE, COUNT)]
    assert_true(columns)


def test_a_file_cut_at_60_percent_gives_most_of_60_percent(whole, tmp_path):
    path = tmp_path / "cut.db3"
    data = whole.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    log, columns = read(path)
    assert 0.5 * COUNT < len(columns.log_time) < 0.9 * COUNT
    assert_true(columns)
    cut, rows = log.damage
    assert f"cut off at byte {path.stat().st_size}" in cut.what
    assert cut.bytes_lost == len(data) - path.stat().st_size
    assert "rows that cannot be read" in rows.what


def test_a_damaged_page_loses_its_rows_and_says_how_many(whole, tmp_path):
    path = tmp_path / "page.db3"
    data = bytearray(whole.read_bytes())
    leaves = [place for place in range(4096, len(data), 4096) if data[place] == 0x0D]
    middle = leaves[len(leaves) // 2]
    data[middle : middle + 64] = b"\xff" * 64
    path.write_bytes(bytes(data))
    log, columns = read(path)
    lost = COUNT - len(columns.log_time)
    assert 0 < lost < 100
    assert_true(columns)
    assert log.damage[0].messages_lost == lost


def test_rows_in_a_write_ahead_log_are_read_and_nothing_is_changed(tmp_path):
    folder = tmp_path / "live"
    folder.mkdir()
    database = sqlite3.connect(folder / "live.db3")
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.execute("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr')")
    rows = [
        (1, START + k, plain("/x", "std_msgs/msg/Float64", START + k, data=float(k)).data) for k in range(800)
    ]
    insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
    database.executemany(insert, rows[:500])
    database.commit()
    database.execute("PRAGMA wal_checkpoint(FULL)")
    database.executemany(insert, rows[500:])
    database.commit()
    left = tmp_path / "left"
    shutil.copytree(folder, left)
    database.close()
    before = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in left.iterdir()}

    log = open_log(left / "live.db3")
    columns = log.columns("/x", ["data"])
    log.close()
    assert np.array_equal(columns.values["data"], np.arange(800.0))
    assert {path.name for path in log.files} == {"live.db3", "live.db3-wal"}
    after = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in left.iterdir()}
    assert before == after


def test_a_bag_of_humble_without_definitions_uses_the_known_ones(tmp_path):
    path = tmp_path / "old.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.execute(
        "INSERT INTO topics VALUES (7, '/s', 'autoware_auto_vehicle_msgs/msg/SteeringReport', 'cdr')"
    )
    data = b"\x00\x01\x00\x00" + np.array([5, 6], "<i4").tobytes() + np.array([0.25], "<f4").tobytes()
    database.execute("INSERT INTO messages VALUES (1, 7, ?, ?)", (5 * 10**9 + 7, data))
    database.commit()
    database.close()
    columns = open_log(path).columns("/s", ["steering_tire_angle"])
    assert columns.values["steering_tire_angle"].tolist() == [0.25]
    assert columns.header_stamp.tolist() == [5 * 10**9 + 6]


def test_hostile_columns_are_taken_as_what_they_should_be(tmp_path):
    path = tmp_path / "odd.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.execute(
        "INSERT INTO topics VALUES (1, '/x''; DROP TABLE topics; --', 'std_msgs/msg/Float64', 'cdr')"
    )
    database.executemany(
        "INSERT INTO messages VALUES (?, ?, ?, ?)",
        [(1, 1, "17", "text"), (2, "1", 18, None), (3, 1, None, b"\x00\x01\x00\x00" + b"\x00" * 8)],
    )
    database.commit()
    database.close()
    log = open_log(path)
    (topic,) = log.topics
    columns = log.columns(topic.name, ["data"])
    assert topic.messages == 2  # the third has no time
    assert len(columns.log_time) == 0
    assert columns.damage[0].messages_lost == 2


def made_by_hand(path, messages, encoding="UTF-8"):
    """A bag of Float64 on /x: (row, time, data)."""
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA encoding = '{encoding}'")
    database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.execute("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr')")
    database.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", messages)
    database.commit()
    database.close()
    return path


def float64(value):
    return b"\x00\x01\x00\x00" + np.float64(value).tobytes()


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le"])
def test_messages_of_any_bytes_and_sizes_come_out_as_they_went_in(tmp_path, encoding):
    """Bytes that are no text, zeros, none at all, and sizes that differ, in steps of the row numbers."""
    random = np.random.default_rng(5)
    sizes = [*random.integers(0, 40, 3000).tolist(), 0, 70_000, 1]
    messages = [random.integers(0, 256, size, np.uint8).tobytes() for size in sizes]
    rows = [(7 * k + 1, k, data) for k, data in enumerate(messages)]
    storage = SqliteStorage(made_by_hand(tmp_path / "x.db3", rows, encoding))
    (channel,) = storage.channels
    found = storage.messages(channel)
    assert list(found.data) == messages
    assert found.times.tolist() == list(range(len(messages)))
    assert storage.count(channel) == len(messages)


def test_a_topic_that_is_listed_twice_is_counted_once(tmp_path):
    path = tmp_path / "x.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics (id, name, type, serialization_format)")
    database.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    database.executemany("INSERT INTO topics VALUES (1, '/x', 'std_msgs/msg/Float64', 'cdr')", [(), ()])
    database.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", [(k, k, float64(k)) for k in range(4)])
    database.commit()
    database.close()
    log = open_log(path)
    assert [topic.messages for topic in log.topics] == [len(log.times("/x"))] == [4]
    assert log.columns("/x", ["data"]).values["data"].tolist() == [0, 1, 2, 3]


def test_a_message_without_data_costs_no_other_and_little_time(tmp_path, monkeypatch):
    alone = []
    read = sqlite._read_data
    monkeypatch.setattr(sqlite, "_read_data", lambda *args: alone.append(args[1]) or read(*args))
    rows = [(k + 1, k, None if k in {700, 9000} else float64(k)) for k in range(12_000)]
    log = open_log(made_by_hand(tmp_path / "x.db3", rows))
    columns = log.columns("/x", ["data"])
    assert columns.values["data"].tolist() == [k for k in range(12_000) if k not in {700, 9000}]
    assert columns.damage[0].messages_lost == 2
    assert 2 <= len(alone) < 1000


def test_times_and_topics_that_are_text_or_too_large_are_read_as_before(tmp_path):
    times = ["17", 1 << 62, 18.9, "9" * 30, "x", -5]
    rows = [(k - 2, time, float64(k)) for k, time in enumerate(times)]
    log = open_log(made_by_hand(tmp_path / "x.db3", rows))
    assert log.times("/x").tolist() == [17, 1 << 62, 18, (1 << 63) - 1, 0, -5]
    assert log.columns("/x", ["data"]).values["data"].tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("numbers", ["5,6", "6,5", "5,5", "5,x", "5,6,7"])
def test_rows_that_a_damaged_file_gives_again_or_backwards_are_not_taken_together(numbers):
    class Damaged:
        def execute(self, *_):
            return self

        def fetchone(self):
            return numbers, "1,1", "1,1"

    assert sqlite._all_rows(Damaged()) is None


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("CREATE TABLE other (x)", "not a rosbag2 file"),
        ("CREATE TABLE Messages (data_cdr, log_time)", "not a DDS recording that can be read"),
        ("CREATE TABLE topics (id, name, type, serialization_format)", "no such table: messages"),
    ],
)
def test_says_what_another_sqlite_file_is(tmp_path, statement, reason):
    path = tmp_path / "other.db3"
    database = sqlite3.connect(path)
    database.execute(statement)
    database.close()
    with pytest.raises(UnusableLog, match=reason):
        open_log(path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(part=st.floats(0, 1), zeros=st.floats(0, 1), size=st.integers(0, 9000))
def test_no_damage_stops_the_reader(tmp_path, whole, part, zeros, size):
    data = bytearray(whole.read_bytes())
    start = int(zeros * len(data))
    data[start : start + size] = bytes(len(data[start : start + size]))
    path = tmp_path / "x.db3"
    path.write_bytes(bytes(data[: int(part * len(data))]))
    try:
        log = open_log(path)
    except UnusableLog:
        return
    assert sum(topic.messages for topic in log.topics) <= COUNT
    for topic in log.topics:
        try:
            columns = log.columns(topic.name, ["angle"])
        except FieldError:  # the definition, or the name of the type, was hit
            continue
        assert len(columns.log_time) <= topic.messages
