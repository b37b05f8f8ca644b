"""Messages of big-endian writers: bytes written by hand, read by Cyclone DDS too; and whole recordings.

Those of whole recordings are what rosbags serialises, every second one of them in big-endian order, so that
one channel holds both. (ROS 1 knows little-endian messages alone.)
"""

from dataclasses import replace

import numpy as np
import pytest
from damaged_tables import IDL, write_eprosima, write_rti
from log_files import START, TYPES, angles, imu, odometry, velocity, write_bag, write_mcap

from ident.logs import open_log
from ident.logs.cdr import read_columns
from ident.logs.idl import idl_schema

VALUES = {("a",): 7, ("b",): 1.5, ("c",): -2}
WANTED = {("a",): "uint8", ("b",): "float64", ("c",): "int32"}
TEXT = "00000003 686900"
BODY = f"07 000000 3ff8000000000000 {TEXT} 00 fffffffe"
BY_HAND = {
    "final, XCDR1": f"00000000 07 00000000000000 3ff8000000000000 {TEXT} 00 fffffffe",
    "mutable, XCDR1": (
        f"00020000 00000001 07 000000 00010008 3ff8000000000000 00020007 {TEXT} 00 00030004 fffffffe 3f020000"
    ),
    "final, XCDR2": f"00060000 {BODY}",
    "appendable, XCDR2": f"00080000 00000018 {BODY}",
    "mutable, XCDR2": (
        "000a0000 0000002c 00000000 07 000000 30000001 3ff8000000000000 "
        f"40000002 00000007 {TEXT} 00 20000003 fffffffe"
    ),
}  # fmt: skip


def extensibility(name):
    return name.partition(",")[0]


@pytest.mark.parametrize("name", list(BY_HAND))
def test_each_encapsulation_written_by_hand_is_read(name):
    schema = idl_schema(
        "T", f"@{extensibility(name)} struct T {{ octet a; double b; string<8> s; long c; }};"
    )
    read = read_columns([bytes.fromhex(BY_HAND[name])] * 3, schema, WANTED, {})
    assert read.errors == []
    assert {path: column.tolist() for path, column in read.columns.items()} == {
        path: [value] * 3 for path, value in VALUES.items()
    }


@pytest.mark.parametrize("name", list(BY_HAND))
def test_cyclone_dds_reads_the_same_from_the_bytes_written_by_hand(name):
    idl = pytest.importorskip("cyclonedds.idl", reason="cyclonedds is not installed")
    types = idl.types
    fields = {"a": types.byte, "b": types.float64, "s": types.bounded_str[8], "c": types.int32}
    made = idl.annotations.extensibility(extensibility(name))(idl.make_idl_struct("T", "T", fields))
    found = made.deserialize(bytes.fromhex(BY_HAND[name]))
    assert (found.a, found.b, found.s, found.c) == (7, 1.5, "hi", -2)


def every_second_big_endian(messages):
    """The same messages; every second one is read by rosbags and written in the other order."""
    return [
        replace(
            each,
            data=bytes(
                TYPES.serialize_cdr(
                    TYPES.deserialize_cdr(each.data, each.kind), each.kind, little_endian=False
                )
            ),
        )
        if k % 2
        else each
        for k, each in enumerate(messages)
    ]


def drive(count=40):
    found = [*angles(count), *(velocity(START + k, 10.0 + k) for k in range(count))]
    found += [imu(START + k, rates=(k, 2.0 * k, -k), yaw=k / 50) for k in range(count)]
    found += [odometry(START + k, k, -k, k / 50, v_x=3.0 * k, rate=k / 7) for k in range(count)]
    return found


def assert_alike(mixed, plain):
    """Every number of every topic, and the stamps, are those of the little-endian log."""
    assert [(t.name, t.messages) for t in mixed.topics] == [(t.name, t.messages) for t in plain.topics]
    for topic in plain.topics:
        fields = list(plain.fields(topic.name))
        one, two = mixed.columns(topic.name, fields), plain.columns(topic.name, fields)
        assert (one.damage, len(one.log_time)) == ([], topic.messages)
        assert np.array_equal(one.header_stamp, two.header_stamp)
        for name in fields:
            np.testing.assert_array_equal(one.values[name], two.values[name], err_msg=name)


@pytest.mark.parametrize("kind", ["mcap", "rosbag2 mcap", "rosbag2 sqlite"])
def test_a_recording_of_both_orders_is_read_as_one_of_little_endian_messages(tmp_path, kind):
    plain, mixed = drive(), every_second_big_endian(drive())
    assert sum(one.data != two.data for one, two in zip(plain, mixed, strict=True)) == len(plain) // 2
    paths = []
    for name, messages in (("plain", plain), ("mixed", mixed)):
        path = tmp_path / name
        if kind == "mcap":
            path = write_mcap(tmp_path / f"{name}.mcap", messages)
        else:
            write_bag(path, messages, sqlite=kind.endswith("sqlite"))
        paths.append(path)
    assert_alike(open_log(paths[1]), open_log(paths[0]))


@pytest.mark.parametrize("write", [write_eprosima, write_rti])
def test_a_recording_of_dds_in_both_orders_is_read(tmp_path, write):
    (tmp_path / "types.idl").write_text(IDL, encoding="utf-8")
    messages = [replace(each, topic="SteeringWheelAngle") for each in angles(40)]
    write(tmp_path / "plain.db", messages)
    write(tmp_path / "mixed.db", every_second_big_endian(messages))
    log = open_log(tmp_path / "mixed.db")
    assert_alike(log, open_log(tmp_path / "plain.db"))
    (topic,) = log.topics
    assert log.columns(topic.name, ["angle"]).values["angle"].tolist() == [k / 100 for k in range(40)]
