"""Messages to columns: which fields there are, and what comes out of them."""

import numpy as np
import pytest
from log_files import TYPES, angles, imu, message, nanoseconds, new, odometry, plain, write_mcap
from rosbags.typesys import get_types_from_msg

from ident.logs import FieldError, open_log

ODD = "odd_msgs/msg/Odd"
TYPES.register(
    get_types_from_msg(
        "int8 small\nuint64 large\nbool flag\nfloat32 single\nstring text\nfloat64[3] three\n"
        "float64[] many\ngeometry_msgs/Point[] points\nint32 from\n",
        ODD,
    )
)


def odd(k, **more):
    fields = {
        "small": -k,
        "large": 2**53 + k,
        "flag": k % 2 == 1,
        "single": 0.1,
        "text": "x",
        "three": np.array([1.0, 2.0, 3.0]) * k,
        "many": np.arange(float(k)),
        "points": [new("geometry_msgs/msg/Point", x=float(i), y=0.0, z=0.0) for i in range(k)],
        "from_": 7,
    }
    return plain("/odd", ODD, nanoseconds(k), **fields, **more)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    messages = [odd(k) for k in range(4)] + [
        odometry(nanoseconds(0.5), 1.0, 2.0, 0.3, 4.0),
        imu(nanoseconds(0.6)),
        plain("/bare", "std_msgs/msg/Float64", nanoseconds(0.7), data=3.5),
        plain("/text", "std_msgs/msg/String", nanoseconds(0.8), data="hello"),
    ]
    return open_log(write_mcap(tmp_path_factory.mktemp("odd") / "odd.mcap", messages))


def test_every_kind_of_number_becomes_a_float(log):
    fields = ["small", "large", "flag", "single", "three[1]", "from"]
    values = log.columns("/odd", fields).values
    assert values["small"].tolist() == [0, -1, -2, -3]
    assert values["large"].tolist() == [2**53, 2**53, 2**53 + 2, 2**53 + 4]  # the nearest float64
    assert values["flag"].tolist() == [0, 1, 0, 1]
    assert values["single"].tolist() == [float(np.float32(0.1))] * 4
    assert values["three[1]"].tolist() == [0, 2, 4, 6]
    assert values["from"].tolist() == [7] * 4
    assert all(column.dtype == np.float64 for column in values.values())


def test_what_a_short_sequence_does_not_hold_is_missing(log):
    values = log.columns("/odd", ["many[1]", "points[2].x"]).values
    assert np.isnan(values["many[1]"]).tolist() == [True, True, False, False]
    assert values["points[2].x"][3] == 2.0


def test_a_quaternion_gives_its_four_parts(log):
    values = log.columns("/localization/odometry", ["pose.pose.orientation"]).values
    parts = [values[f"pose.pose.orientation.{part}"][0] for part in "xyzw"]
    assert parts == pytest.approx([0, 0, np.sin(0.15), np.cos(0.15)])


def test_header_stamps_are_read_where_there_are_some(log):
    assert log.columns("/localization/odometry", []).header_stamp.tolist() == [nanoseconds(0.5)]
    assert log.columns("/bare", ["data"]).header_stamp is None


def test_lists_all_numbers_of_a_topic(log):
    fields = log.fields("/odd")
    assert fields["three[2]"] == "float64"
    assert "text" not in fields
    assert log.fields("/localization/odometry")["twist.twist.linear.y"] == "float64"
    assert log.fields("/text") == {}


@pytest.mark.parametrize(
    ("topic", "field", "reason"),
    [
        ("/bare", "dat", "std_msgs/msg/Float64 has no field 'dat', did you mean 'data'?"),
        ("/odd", "text", "is text, need a number"),
        ("/odd", "three", "is an array, need one of its elements: 'three[0]'"),
        ("/odd", "small[0]", "is no array: leave out the index"),
        ("/odd", "small.x", "has nothing named 'x'"),
        ("/odd", "a b", "is not a path such as"),
        ("/odd", "", "is not a path such as"),
        ("/odd", "small.__class__", "has nothing named '__class__'"),
        ("/localization/odometry", "pose.pose", "need one of its numbers: pose.pose.position.x"),
        ("/bar", "data", "no topic '/bar', did you mean '/bare'?"),
    ],
)
def test_a_field_that_does_not_exist_is_refused_with_the_nearest(log, topic, field, reason):
    with pytest.raises(FieldError) as caught:
        log.columns(topic, [field])
    assert reason in str(caught.value)


def test_decodes_twenty_thousand_messages_in_seconds(tmp_path):
    import time  # noqa: PLC0415

    path = write_mcap(tmp_path / "a.mcap", angles(20_000), chunk_size=1 << 20)
    start = time.perf_counter()
    columns = open_log(path).columns("/vehicle/steering_wheel", ["angle"])
    assert len(columns.log_time) == 20_000
    assert time.perf_counter() - start < 5.0


def test_a_message_that_is_too_short_is_counted_and_left_out(tmp_path):
    messages = angles(10)
    object.__setattr__(messages[3], "data", messages[3].data[:20])
    object.__setattr__(messages[5], "data", b"")
    columns = open_log(write_mcap(tmp_path / "a.mcap", messages)).columns(
        "/vehicle/steering_wheel", ["angle"]
    )
    assert columns.values["angle"].tolist() == pytest.approx([0, 0.01, 0.02, 0.04, 0.06, 0.07, 0.08, 0.09])
    assert columns.damage[0].messages_lost == 2


def test_big_endian_messages_are_read(tmp_path):
    kind = "truck_msgs/msg/SteeringWheelAngle"
    little = message("/a", kind, nanoseconds(1), angle=2.5)
    data = TYPES.serialize_cdr(TYPES.deserialize_cdr(little.data, kind), kind, little_endian=False)
    object.__setattr__(little, "data", bytes(data))
    columns = open_log(write_mcap(tmp_path / "a.mcap", [little])).columns("/a", ["angle"])
    assert columns.values["angle"].tolist() == [2.5]
    assert columns.header_stamp.tolist() == [nanoseconds(1)]
