"""Every number of every message is what rosbags' AnyReader reads, whole columns at a time."""

import json
import os
import re
import sqlite3
import struct
import sys
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import normalize_fieldname

from ident.logs import find_runs, open_log

sys.path.insert(0, str(Path(__file__).parent))
from known_reader_errors import SIGNED_OCTETS, UNREADABLE

ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get("IDENT_MEASURED", str(ROOT.parent / "shared" / "measured")))
FORMATS = MEASURED.parent / "formats"
ROS = (".mcap", ".db3", ".bag")
MOST_MESSAGES = 3000


def runs(root):
    if not root.is_dir():
        return [
            pytest.param(
                None, marks=pytest.mark.skip(reason=f"no logs in {root} (IDENT_MEASURED)"), id=root.name
            )
        ]
    found = [run for run in find_runs([root]) if run.path.is_dir() or run.path.suffix in ROS]
    return [pytest.param(run, id=f"{root.name}/{run.name}") for run in found]


def picker(field):
    """Function that picks a field out of a message of rosbags."""
    steps = [
        (normalize_fieldname(name), [int(i) for i in re.findall(r"\d+", indices)])
        for name, indices in re.findall(r"([A-Za-z_]\w*)((?:\[\d+\])*)", field)
    ]
    if not any(indices for _, indices in steps):
        return attrgetter(".".join(name for name, _ in steps))

    def pick(message):
        for name, indices in steps:
            message = getattr(message, name)
            for index in indices:
                message = message[index]
        return message

    return pick


@pytest.mark.parametrize("run", [*runs(ROOT / "sample_logs"), *runs(FORMATS), *runs(MEASURED)])
def test_every_number_of_every_message_is_what_another_reader_reads(run):
    if run.name in UNREADABLE:
        pytest.skip(f"AnyReader {UNREADABLE[run.name]}")
    log = open_log(run.path, run.files)
    compared = 0
    paths = list(run.files) or [run.path]
    with AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for topic in log.topics:
            if topic.messages:
                compared += compare(log, topic, reader, SIGNED_OCTETS.get(run.name, "$"))
    assert compared == sum(topic.messages for topic in log.topics)


def compare(log, topic, reader, octets):
    fields = list(log.fields(topic.name))
    own = log.columns(topic.name, fields)
    chosen = [c for c in reader.connections if c.topic.lstrip("/") == topic.name.lstrip("/")]
    raw = [(c, time, data) for c, time, data in reader.messages(connections=chosen)]
    assert own.damage == []
    assert len(raw) == topic.messages == len(own.log_time)
    order = np.argsort(own.log_time, kind="stable")
    np.testing.assert_array_equal(own.log_time[order], np.sort([time for _, time, _ in raw]))
    step = max(len(raw) // MOST_MESSAGES, 1)
    messages = [reader.deserialize(data, c.msgtype) for c, _, data in raw[::step]]
    for field in fields:
        pick = picker(field)
        expected = np.array([float(pick(message)) for message in messages])
        if re.fullmatch(octets, field):
            assert np.any(expected < 0) or np.all(expected < 128)
            expected %= 256
        np.testing.assert_array_equal(own.values[field][order][::step], expected, err_msg=field)
    return len(raw)


# --- what AnyReader cannot be asked ---------------------------------------------------------------------

needs_formats = pytest.mark.skipif(not FORMATS.is_dir(), reason=f"no logs in {FORMATS} (IDENT_MEASURED)")


def all_numbers(value, prefix=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from all_numbers(inner, f"{prefix}.{key}" if prefix else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from all_numbers(inner, f"{prefix}[{index}]")
    elif isinstance(value, (bool, int, float)):
        yield prefix, float(value)


@needs_formats
@pytest.mark.parametrize("name", ["configuration.db", "ros2_talker.db"])
def test_every_number_of_a_dds_recording_is_what_its_json_says(name):
    path = FORMATS / "eprosima" / name
    database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    query = "SELECT topic, data_json, log_time FROM Messages ORDER BY rowid"
    expected = {}
    for topic, text, time in database.execute(query):
        expected.setdefault(topic.removeprefix("rt"), []).append((dict(all_numbers(json.loads(text))), time))
    database.close()
    log = open_log(path)
    assert log.damage == []
    assert {topic.name: topic.messages for topic in log.topics} == {t: len(m) for t, m in expected.items()}
    for topic, messages in expected.items():
        fields = list(dict.fromkeys(field for numbers, _ in messages for field in numbers))
        columns = log.columns(topic, fields)
        times = np.array([time for _, time in messages], dtype="datetime64[ns]").astype(np.int64)
        np.testing.assert_array_equal(columns.log_time, times)
        for field in fields:
            found = np.array([numbers.get(field, np.nan) for numbers, _ in messages])
            np.testing.assert_array_equal(columns.values[field], found, err_msg=field)


@needs_formats
def test_an_octet_of_idl_is_unsigned_as_the_json_beside_it_says():
    columns = open_log(FORMATS / "eprosima" / "configuration.mcap").columns(
        "configuration_topic", ["data[0]", "data[9]", "data[10]", "index", "message[0]"]
    )
    assert columns.values["data[0]"].tolist() == [170.0] * 10
    assert columns.values["data[9]"].tolist() == [170.0] * 10
    assert np.isnan(columns.values["data[10]"]).all()
    assert columns.values["index"].tolist() == list(range(1, 11))
    assert columns.values["message[0]"].tolist() == [ord("C")] * 10
    late = (columns.log_time - columns.header_stamp) / 1e9  # the publish time stands for a stamp
    assert np.all((late > 0) & (late < 0.1))


@needs_formats
def test_definitions_that_a_dds_recorder_wrote_with_its_own_prefix_are_read():
    log = open_log(FORMATS / "eprosima" / "ros2_talker.mcap")
    columns = log.columns("/rosout", ["level", "line", "stamp.sec", "stamp.nanosec"])
    assert columns.values["level"].tolist() == [20.0] * 10
    assert columns.values["line"].tolist() == [47.0] * 10
    stamps = columns.values["stamp.sec"] * 10**9 + columns.values["stamp.nanosec"]
    assert np.all(np.abs(columns.log_time - stamps) < 1e8)
    gid = log.columns("ros_discovery_info", [f"gid.data[{k}]" for k in range(16)])
    first = [int(gid.values[f"gid.data[{k}]"][0]) for k in range(16)]
    assert bytes(first).hex() == "010feb7d610e06cc00000000000001c1"


@needs_formats
@pytest.mark.parametrize("name", ["rosbag2_py_mcap_talker", "rosbag2_py_sqlite3_talker"])
def test_messages_outside_the_range_that_the_metadata_state_are_read(name):
    log = open_log(FORMATS / "rosbag2" / name)
    assert len(log.times("/rosout")) == len(log.times("/topic")) == 10
    assert len(log.columns("/topic", []).log_time) == 10


@pytest.mark.parametrize("name", ["steering_mcap", "steering_dds"])
def test_every_number_of_the_sample_logs_in_mcap_lies_where_its_layout_says(name):
    """The last double of an angle message is the angle, whatever stands before it."""
    path = ROOT / "sample_logs" / f"{name}.mcap"
    with path.open("rb") as file:
        messages = [m for _, _, m in make_reader(file).iter_messages(topics=["/vehicle/steering_wheel"])]
    columns = open_log(path).columns("/vehicle/steering_wheel", ["angle"])
    assert len(messages) > 3000
    np.testing.assert_array_equal(columns.log_time, [m.log_time for m in messages])
    expected = [struct.unpack("<d", m.data[-8:])[0] for m in messages]
    np.testing.assert_array_equal(columns.values["angle"], expected)


@needs_formats
def test_a_byte_of_ros_2_is_unsigned_as_the_defaults_in_its_definition_say():
    log = open_log(FORMATS / "rosbag2" / "rosbag2_tests_sqlite3_cdr_test")
    values = log.columns("/array_topic", [f"byte_values_default[{k}]" for k in range(3)]).values
    assert [set(column) for column in values.values()] == [{0.0}, {1.0}, {255.0}]


@needs_formats
def test_a_definition_that_does_not_parse_costs_only_its_own_topics():
    log = open_log(FORMATS / "rosbag2" / "rosbag2_tests_mcap_bag_with_topics_and_service_events")
    assert {topic.name: topic.messages for topic in log.topics}["/test_topic1"] == 1
    assert len(log.columns("/test_topic1", []).log_time) == 1


def test_numbers_are_read_as_the_bytes_say():
    """A message written by hand: no library of this format has a part in it."""
    from ident.logs.cdr import read_columns  # noqa: PLC0415
    from ident.logs.idl import idl_schema  # noqa: PLC0415

    schema = idl_schema("T", "struct T { octet a; short b; string s; double c; sequence<octet> d; };")
    little = (
        b"\0\1\0\0" + struct.pack("<BxhI3sxxxxxd", 200, -2, 3, b"ab\0", 1.5) + struct.pack("<I2B", 2, 250, 1)
    )
    big = (
        b"\0\0\0\0" + struct.pack(">BxhI3sxxxxxd", 200, -2, 3, b"ab\0", 1.5) + struct.pack(">I2B", 2, 250, 1)
    )
    wanted = {("a",): "uint8", ("b",): "int16", ("c",): "float64", ("d", 0): "uint8"}
    read = read_columns([little, big, little], schema, wanted, {})
    assert read.errors == []
    assert [column.tolist() for column in read.columns.values()] == [
        [200] * 3,
        [-2] * 3,
        [1.5] * 3,
        [250] * 3,
    ]
