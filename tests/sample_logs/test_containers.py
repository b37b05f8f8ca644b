"""The runs in other containers: small, the same at each call, and read by the libraries of others."""

import filecmp

import numpy as np
import pytest
from generator.containers import CONTAINERS, container_topics, generate_containers
from generator.messages import TYPES
from generator.steering import ANGLE
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader


def made(truth, name):
    _, start, _, sine = CONTAINERS[name]
    topic = next(t for t in container_topics(truth, 1, name, sine) if t.name == ANGLE)
    return start + topic.stamps, start + topic.arrivals, topic.columns[0]


@pytest.mark.parametrize("name", CONTAINERS)
def test_the_logs_are_those_that_the_program_makes(truth, sample_logs, tmp_path, name):
    (path,) = generate_containers(tmp_path, truth, 1, [name])
    assert filecmp.cmp(path, sample_logs / path.name, shallow=False)
    assert path.stat().st_size < 300_000


def test_another_reader_finds_the_messages_of_the_ros_1_bag(truth, sample_logs):
    with AnyReader([sample_logs / "steering_ros1.bag"]) as log:
        chosen = [c for c in log.connections if c.topic == ANGLE]
        rows = [(at, log.deserialize(raw, c.msgtype)) for c, at, raw in log.messages(connections=chosen)]
    assert_made(truth, "steering_ros1", rows)


def test_another_reader_finds_the_messages_of_the_plain_mcap(truth, sample_logs):
    with (sample_logs / "steering_mcap.mcap").open("rb") as file:
        read = list(make_reader(file).iter_messages(topics=[ANGLE]))
    rows = [(m.log_time, TYPES.deserialize_cdr(m.data, schema.name)) for schema, _, m in read]
    assert_made(truth, "steering_mcap", rows)


def assert_made(truth, name, rows):
    stamps, arrivals, angles = made(truth, name)
    np.testing.assert_array_equal([at for at, _ in rows], arrivals)
    np.testing.assert_array_equal([m.angle for _, m in rows], angles)
    headers = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in rows]
    np.testing.assert_array_equal(headers, stamps)


def test_the_dds_recording_has_its_stamps_as_publish_times(truth, sample_logs):
    stamps, arrivals, angles = made(truth, "steering_dds")
    with (sample_logs / "steering_dds.mcap").open("rb") as file:
        rows = [message for _, _, message in make_reader(file).iter_messages(topics=[ANGLE])]
    np.testing.assert_array_equal([m.publish_time for m in rows], stamps)
    np.testing.assert_array_equal([m.log_time for m in rows], arrivals)
    np.testing.assert_array_equal([np.frombuffer(m.data[4:], "<f8")[0] for m in rows], angles)
