"""Channel maps: checked before any log is opened, and the best one chosen."""

import pytest

from ident.errors import BadRecipe
from ident.signals.channel_map import best_map, built_in_maps, read_channel_map, scale


def read(tmp_path, text):
    path = tmp_path / "channels.yaml"
    path.write_text(text, encoding="utf-8")
    return read_channel_map(path)


FULL = """
signals:
  steering_wheel_request: {topic: /request, field: angle, unit: deg}
  speed: {topic: /speed, field: v, unit: km/h, stamp: log}
  heading: {topic: /odometry, field: pose.orientation, as: yaw}
  lateral_velocity: {topic: /odometry, field: v_y, unit: m/s, at: rear_axle}
  yaw_rate: {derivative_of: heading}
  steering_torque_request: {topic: /eps, field: torque, unit: raw}
  engaged: {topic: /mode, field: mode, equals: 1}
  road_wheel_angle:
    - {topic: /new, field: angle, unit: rad}
    - {topic: /old, field: angle, unit: deg}
"""


def test_reads_every_kind_of_entry(tmp_path):
    found = read(tmp_path, FULL).signals
    assert found["heading"][0].as_ == "yaw"
    assert found["lateral_velocity"][0].at == "rear_axle"
    assert (found["speed"][0].stamp, found["heading"][0].stamp) == ("log", "header")
    assert [channel.topic for channel in found["road_wheel_angle"]] == ["/new", "/old"]
    assert scale("speed", found["speed"][0]) == (pytest.approx(1 / 3.6), False)
    assert scale("steering_torque_request", found["steering_torque_request"][0]) == (1.0, True)
    assert scale("engaged", found["engaged"][0]) == (1.0, False)


def test_the_number_one_as_a_unit_is_a_count_where_a_dimension_is_needed(tmp_path):
    found = read(tmp_path, "signals: {yaw_rate: {topic: /a, field: b, unit: 1}}").signals
    assert scale("yaw_rate", found["yaw_rate"][0]) == (1.0, True)


def test_the_first_alternative_that_a_log_has_is_chosen(tmp_path):
    channels = read(tmp_path, FULL)
    both = channels.choose(lambda channel: channel.topic in {"/new", "/old"})
    old = channels.choose(lambda channel: channel.topic == "/old")
    assert (both["road_wheel_angle"].topic, old["road_wheel_angle"].topic) == ("/new", "/old")


def test_a_derived_signal_is_there_where_its_base_is(tmp_path):
    channels = read(tmp_path, FULL)
    assert "yaw_rate" in channels.choose(lambda channel: channel.topic == "/odometry")
    assert "yaw_rate" not in channels.choose(lambda channel: channel.topic == "/speed")


def test_the_map_that_finds_most_is_best_and_the_first_of_two_equals(tmp_path):
    channels = read(tmp_path, FULL)
    sample, autoware = built_in_maps()
    topics = ["/vehicle/steering_wheel", "/sensing/imu"]
    assert best_map([channels, autoware, sample], topics) is sample
    assert best_map([sample, autoware], ["/vehicle/status/steering_status"]) is autoware
    assert best_map([autoware, sample], []) is autoware


def test_the_built_in_maps_are_valid_and_name_steering_pairs():
    sample, autoware = built_in_maps()
    assert {"steering_wheel_request", "steering_wheel_angle", "yaw_rate", "engaged"} <= sample.signals.keys()
    assert {"road_wheel_request", "road_wheel_angle", "yaw_rate", "engaged"} <= autoware.signals.keys()
    assert (sample.source, autoware.source) == ("built-in sample_truck", "built-in autoware")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "signals: {yawrate: {topic: /a, field: b, unit: rad/s}}",
            "unknown signal 'yawrate': did you mean 'yaw_rate'?",
        ),
        ("signals: {yaw_rate: {topic: /a, field: b, unt: rad/s}}", "did you mean 'unit'?"),
        ("signal: {}", "unknown key 'signal': did you mean 'signals'?"),
        ("{}", "'signals' is missing"),
        ("signals: {yaw_rate: {topic: /a, field: b, unit: rad}}", "yaw_rate: unit 'rad' does not fit"),
        (
            "signals: {yaw_rate: {topic: /a, field: b, unit: furlong}}",
            "yaw_rate: unit 'furlong' is not known",
        ),
        ("signals: {yaw_rate: {topic: /a, unit: rad/s}}", "needs 'topic' and 'field'"),
        ("signals: {yaw_rate: {topic: /a, field: b}}", "needs 'unit'"),
        ("signals: {yaw_rate: {topic: /a, field: b, as: yaw}}", "gives an angle, need a unit of 'rad/s'"),
        ("signals: {yaw_rate: {topic: /a, field: b, equals: 1}}", "gives 0 or 1, need a unit of 'rad/s'"),
        ("signals: {heading: {topic: /a, field: b, as: pitch}}", "not 'pitch'"),
        ("signals: {speed: {topic: /a, field: b, unit: m/s, at: roof}}", "not 'roof'"),
        ("signals: {speed: {topic: /a, field: b, unit: m/s, stamp: now}}", "not 'now'"),
        ("signals: {yaw_rate: {derivative_of: heading}}", "'derivative_of: heading' is not in this map"),
        (
            "signals: {yaw_rate: {derivative_of: speed}, speed: {topic: /a, field: b, unit: m/s}}",
            "is not the rate of change of 'speed' (m/s per second)",
        ),
        ("signals: {yaw_rate: {derivative_of: heading, topic: /a}}", "stands alone"),
        ("signals: {yaw_rate: {derivative_of: heading, invert: true}}", "stands alone"),
        ("signals: {engaged: {topic: /a, field: b, equals: 1, invert: true}}", "leave out 'invert'"),
        ("signals: {yaw_rate: []}", "yaw_rate"),
        ("signals: {yaw_rate: 3}", "yaw_rate"),
    ],
)
def test_refuses_what_is_wrong_in_one_line(tmp_path, text, reason):
    with pytest.raises(BadRecipe) as caught:
        read(tmp_path, text)
    assert reason in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
