"""One name, several types or definitions: everything is read, no two meanings are mixed, and it is told."""

import json
import struct

import numpy as np
import pytest
from click.testing import CliRunner
from damaged_logs import FORMATS, file_name
from log_files import (
    ANGLE,
    angles,
    message,
    nanoseconds,
    plain,
    velocity,
    write_bag,
    write_mcap,
)
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer

from ident.cli import main
from ident.logs import open_log

TOPIC = "/vehicle/steering_wheel"
TWIST = "geometry_msgs/msg/TwistStamped"
OLD = "float64 angle\n"
NEW = "float64 rate\nfloat64 angle\n"
KIND = "truck_msgs/msg/Steer"


def mixed(many=9, few=4):
    """Angles and speeds under one name, in turn."""
    speeds = [velocity(nanoseconds(k / 10 + 0.05), 100.0 + k, topic=TOPIC) for k in range(few)]
    return sorted(angles(many, rate=10.0) + speeds, key=lambda each: each.time)


def values(log, topic, field):
    columns = log.columns(topic, [field])
    assert np.array_equal(columns.log_time, log.times(topic))
    return columns.values[field].tolist()


@pytest.mark.parametrize("kind", ["mcap zstd", "mcap unchunked", "sqlite", "ros1 none"])
def test_of_two_types_of_one_name_both_are_read(tmp_path, kind):
    path = tmp_path / file_name(kind)
    FORMATS[kind](path, mixed())
    log = open_log(path)
    other = f"{TOPIC} ({TWIST})"
    assert [(topic.name, topic.type, topic.messages) for topic in log.topics] == [
        (TOPIC, ANGLE, 9),
        (other, TWIST, 4),
    ]
    assert values(log, TOPIC, "angle") == [k / 10 for k in range(9)]
    assert values(log, other, "twist.linear.x") == [100.0, 101.0, 102.0, 103.0]
    both = log.read({TOPIC: ["angle"], other: ["twist.linear.x"]})
    assert [len(columns.log_time) for columns in both.values()] == [9, 4]
    assert [(each.what, each.messages_lost) for each in log.damage] == [
        (f"{TOPIC}: recorded as {ANGLE} and as {TWIST}, which is read as '{other}'", None)
    ]


def test_the_type_of_most_messages_keeps_the_name(tmp_path):
    log = open_log(write_mcap(tmp_path / "run.mcap", mixed(many=3, few=4)))
    assert [(topic.name, topic.type) for topic in log.topics] == [
        (TOPIC, TWIST),
        (f"{TOPIC} ({ANGLE})", ANGLE),
    ]


def test_a_channel_without_messages_takes_no_name(tmp_path):
    path = tmp_path / "run.mcap"
    steer(path, [("geometry_msgs/msg/Twist", "", []), (KIND, OLD, [(1, (1.5,))])])
    log = open_log(path)
    assert {topic.name: topic.messages for topic in log.topics}[TOPIC] == 1
    assert values(log, TOPIC, "angle") == [1.5]
    assert log.damage == []


def test_a_type_that_changes_from_file_to_file_is_read_in_all_of_them(tmp_path):
    first, second = tmp_path / "a_0.mcap", tmp_path / "a_1.mcap"
    write_mcap(first, [message(TOPIC, ANGLE, nanoseconds(0.1), angle=1.0)])
    write_mcap(second, [plain(TOPIC, "std_msgs/msg/Float64", nanoseconds(k), data=k) for k in (1, 2)])
    log = open_log(first, (first, second))
    assert values(log, TOPIC, "data") == [1.0, 2.0]
    assert values(log, f"{TOPIC} ({ANGLE})", "angle") == [1.0]


def test_the_counts_of_metadata_are_those_of_the_name_with_all_its_types(tmp_path):
    folder = write_bag(tmp_path / "run", mixed())
    assert [each.what[:60] for each in open_log(folder).damage] == [f"{TOPIC}: recorded as {ANGLE}"[:60]]
    (folder / "run.mcap").write_bytes(b"")
    write_mcap(folder / "run.mcap", mixed()[:-3])
    assert open_log(folder).damage[1].messages_lost == 3


def test_a_name_that_is_taken_is_not_taken_again(tmp_path):
    other = f"{TOPIC} ({TWIST})"
    taken = [message(other, ANGLE, nanoseconds(1.0), angle=7.0)]
    log = open_log(write_mcap(tmp_path / "run.mcap", [*mixed(), *taken]))
    assert {topic.name: topic.messages for topic in log.topics} == {TOPIC: 9, other: 1, other + "'": 4}
    assert values(log, other, "angle") == [7.0]


def test_info_tells_what_it_found(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", mixed())
    result = CliRunner().invoke(main, ["info", str(path), "--json", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    (run,) = json.loads(result.stdout)["runs"]
    assert {topic["name"]: topic["messages"] for topic in run["topics"]} == {
        TOPIC: 9,
        f"{TOPIC} ({TWIST})": 4,
    }
    assert any(
        "recorded as truck_msgs/msg/SteeringWheelAngle and as" in each["what"] for each in run["damage"]
    )


# --- one type, several channels or definitions ----------------------------------------------------


def steer(path, channels):
    """An MCAP file: of each channel of the topic its type, definition and messages (time [s], numbers)."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        for kind, text, messages in channels:
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel(TOPIC, "cdr", schema)
            for time, numbers in messages:
                data = b"\0\1\0\0" + struct.pack(f"<{len(numbers)}d", *numbers)
                writer.add_message(channel, nanoseconds(time), data, nanoseconds(time))
        writer.finish()
    return path


def test_two_channels_of_one_definition_are_one_topic_in_the_order_of_the_file(tmp_path):
    path = steer(tmp_path / "run.mcap", [(KIND, OLD, [(1, (1.0,)), (3, (3.0,))]), (KIND, OLD, [(2, (2.0,))])])
    log = open_log(path)
    assert values(log, TOPIC, "angle") == [1.0, 3.0, 2.0]
    assert ([topic.name for topic in log.topics], log.damage) == ([TOPIC], [])


def test_two_connections_of_a_bag_are_one_topic(tmp_path):
    path = tmp_path / "run.bag"
    with Ros1Writer(path) as writer:
        for caller in ("/one", "/two"):
            made = writer.add_connection(TOPIC, KIND, msgdef=OLD, md5sum="0" * 32, callerid=caller)
            for time in (1, 2):
                writer.write(made, nanoseconds(time), struct.pack("<d", time))
    log = open_log(path)
    assert values(log, TOPIC, "angle") == [1.0, 2.0, 1.0, 2.0]
    assert ([topic.name for topic in log.topics], log.damage) == ([TOPIC], [])


def test_each_definition_of_a_type_decodes_its_own_messages(tmp_path):
    channels = [(KIND, OLD, [(1, (1.0,)), (4, (4.0,))]), (KIND, NEW, [(2, (20.0, 2.0)), (3, (30.0, 3.0))])]
    log = open_log(steer(tmp_path / "run.mcap", channels))
    assert [(topic.name, topic.messages) for topic in log.topics] == [(TOPIC, 4)]
    assert log.fields(TOPIC) == {"angle": "float64", "rate": "float64"}
    assert values(log, TOPIC, "angle") == [1.0, 2.0, 3.0, 4.0]
    assert log.damage[0].what == (
        f"{TOPIC}: recorded with 2 definitions of {KIND}: fields of one name are taken as one"
    )


def test_what_a_definition_lacks_is_nan_or_where_nothing_is_left_counted(tmp_path):
    channels = [(KIND, OLD, [(1, (1.0,)), (4, (4.0,))]), (KIND, NEW, [(2, (20.0, 2.0)), (3, (30.0, 3.0))])]
    log = open_log(steer(tmp_path / "run.mcap", channels))
    both = log.columns(TOPIC, ["rate", "angle"])
    assert np.array_equal(both.values["rate"], [np.nan, 20.0, 30.0, np.nan], equal_nan=True)
    told = f"{TOPIC}: 2 messages are of a definition of {KIND} without rate"
    assert [(each.what, each.messages_lost) for each in both.damage] == [(told, None)]
    alone = log.columns(TOPIC, ["rate"])
    assert alone.values["rate"].tolist() == [20.0, 30.0]
    assert [(each.what, each.messages_lost) for each in alone.damage] == [(told, 2)]


def test_definitions_that_differ_in_their_words_alone_are_one(tmp_path):
    channels = [(KIND, OLD, [(1, (1.0,))]), (KIND, "# of the wheel\nfloat64   angle", [(2, (2.0,))])]
    log = open_log(steer(tmp_path / "run.mcap", channels))
    assert values(log, TOPIC, "angle") == [1.0, 2.0]
    assert log.damage == []


def test_a_definition_that_cannot_be_read_costs_its_own_messages(tmp_path):
    channels = [(KIND, "(((", [(1, (1.0,))]), (KIND, OLD, [(2, (2.0,)), (3, (3.0,))])]
    log = open_log(steer(tmp_path / "run.mcap", channels))
    columns = log.columns(TOPIC, ["angle"])
    assert columns.values["angle"].tolist() == [2.0, 3.0]
    (told,) = columns.damage
    assert told.messages_lost == 1
    assert "cannot be read as ros2msg" in told.what
    assert log.damage == []


def test_a_file_without_definitions_uses_those_of_another_file(tmp_path):
    first, second = tmp_path / "a_0.mcap", tmp_path / "a_1.mcap"
    steer(first, [(KIND, "", [(1, (1.0,))])])
    steer(second, [(KIND, OLD, [(2, (2.0,))])])
    log = open_log(first, (first, second))
    assert values(log, TOPIC, "angle") == [1.0, 2.0]
    assert log.damage == []


def test_an_array_in_one_definition_and_a_number_in_the_other_are_not_mixed(tmp_path):
    channels = [(KIND, OLD, [(1, (1.0,))]), (KIND, "float64[2] angle", [(2, (8.0, 9.0))])]
    log = open_log(steer(tmp_path / "run.mcap", channels))
    columns = log.columns(TOPIC, ["angle"])
    assert columns.values["angle"].tolist() == [1.0]
    assert columns.damage[0].messages_lost == 1
    assert log.columns(TOPIC, ["angle[1]"]).values["angle[1]"].tolist() == [9.0]
