"""Logs to runs: signals in SI units on one clock, sorted, with everything counted that was left out."""

import hashlib

import numpy as np
import pytest
from log_files import (
    ANGLE,
    START,
    angles,
    imu,
    message,
    nanoseconds,
    odometry,
    plain,
    velocity,
    write_bag,
    write_mcap,
)

from ident.errors import BadRecipe, UnusableLog
from ident.signals.run import load_runs

TOPIC = "/vehicle/steering_wheel"
ENTRY = "steering_wheel_angle: {topic: /vehicle/steering_wheel, field: angle, unit: rad}"


def load(folder, messages, *, channels=None, vehicle=None, name="run"):
    """Write a bag and the files beside it, and read it."""
    folder.mkdir(exist_ok=True)
    write_bag(folder / name, sorted(messages, key=lambda each: each.time))
    if channels is not None:
        (folder / "channels.yaml").write_text("signals:\n  " + "\n  ".join(channels))
    if vehicle is not None:
        (folder / "vehicle.yaml").write_text(vehicle)
    (run,) = load_runs([folder]).runs
    return run


def angle(stamp, value, *, time=None):
    return message(
        TOPIC, ANGLE, nanoseconds(stamp), time=None if time is None else nanoseconds(time), angle=value
    )


def test_time_zero_is_the_earliest_stamp_of_any_signal(tmp_path):
    run = load(
        tmp_path / "logs",
        [
            *angles(100),
            velocity(nanoseconds(-0.5), 3.0, time=nanoseconds(0.2)),
            velocity(nanoseconds(0.7), 4.0),
        ],
    )
    assert run.start_ns == nanoseconds(-0.5)
    assert run.signals["speed"].time.tolist() == [0.0, 1.2]
    assert run.signals["speed"].arrival.tolist() == pytest.approx([0.7, 1.2])
    assert run.signals["steering_wheel_angle"].time[0] == pytest.approx(0.5)
    assert run.duration == pytest.approx(1.49)
    assert run.health.start == "2023-11-14T22:13:19.500+00:00"


def test_units_are_converted_and_counts_are_marked(tmp_path):
    run = load(
        tmp_path / "logs",
        [angle(k, 90.0) for k in range(3)] + [velocity(nanoseconds(k), 36.0) for k in range(3)],
        channels=[
            "steering_wheel_angle: {topic: /vehicle/steering_wheel, field: angle, unit: deg}",
            "speed: {topic: /vehicle/velocity, field: twist.linear.x, unit: km/h}",
            "steering_torque_request: {topic: /vehicle/steering_wheel, field: angle, unit: raw}",
        ],
    )
    assert run.signals["steering_wheel_angle"].values.tolist() == pytest.approx([np.pi / 2] * 3)
    assert run.signals["speed"].values.tolist() == pytest.approx([10.0] * 3)
    torque = run.signals["steering_torque_request"]
    assert (torque.values.tolist(), torque.raw, torque.unit) == ([90.0] * 3, True, "1")
    assert not run.signals["speed"].raw


def test_a_field_that_counts_the_other_way_is_turned(tmp_path):
    run = load(
        tmp_path / "logs",
        [angle(k, 90.0) for k in range(3)] + [odometry(nanoseconds(k), 0.0, 0.0, 0.4) for k in range(3)],
        channels=[
            "steering_wheel_angle: {topic: /vehicle/steering_wheel, field: angle, unit: deg, invert: true}",
            "heading: {topic: /localization/odometry, field: pose.pose.orientation, as: yaw, invert: true}",
        ],
    )
    assert run.signals["steering_wheel_angle"].values.tolist() == pytest.approx([-np.pi / 2] * 3)
    assert run.signals["heading"].values.tolist() == pytest.approx([-0.4] * 3)


def test_samples_are_sorted_by_stamp_and_the_disorder_is_counted(tmp_path):
    stamps = [0.0, 0.1, 0.3, 0.2, 0.4]
    run = load(tmp_path / "logs", [angle(stamp, stamp, time=k / 10) for k, stamp in enumerate(stamps)])
    signal = run.signals["steering_wheel_angle"]
    assert signal.time.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert signal.values.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert signal.arrival.tolist() == pytest.approx([0.0, 0.1, 0.3, 0.2, 0.4])
    assert run.health.topics[0].out_of_order == 1


def test_of_samples_with_one_stamp_the_last_is_kept(tmp_path):
    messages = [angle(0.0, 1.0, time=0.0), angle(0.1, 2.0, time=0.1), angle(0.1, 3.0, time=0.2)]
    run = load(tmp_path / "logs", messages)
    assert run.signals["steering_wheel_angle"].values.tolist() == [1.0, 3.0]
    assert run.health.topics[0].repeated_stamps == 1


def test_shuffled_times_give_the_same_signal(tmp_path):
    ordered = angles(200)
    order = np.random.default_rng(3).permutation(200)
    shuffled = [ordered[k] for k in order]
    path = write_mcap(tmp_path / "a.mcap", shuffled)
    (run,) = load_runs([path]).runs
    assert run.signals["steering_wheel_angle"].time == pytest.approx(np.arange(200) / 100)
    assert run.signals["steering_wheel_angle"].values == pytest.approx(np.arange(200) / 100)
    assert run.health.topics[0].out_of_order == int(np.sum(np.diff(order) < 0))


def test_values_that_are_not_finite_are_left_out_and_counted(tmp_path):
    run = load(tmp_path / "logs", [angle(k, v) for k, v in enumerate([1.0, np.nan, 2.0, np.inf])])
    assert run.signals["steering_wheel_angle"].values.tolist() == [1.0, 2.0]
    assert run.health.signals["steering_wheel_angle"].not_finite == 2


def test_a_signal_without_any_finite_value_is_missing_and_said(tmp_path):
    run = load(tmp_path / "logs", [angle(k, np.nan) for k in range(3)] + [velocity(nanoseconds(1), 1.0)])
    assert "steering_wheel_angle" not in run.signals
    assert "steering_wheel_angle" in run.health.missing
    assert any("holds no finite value" in item.what for item in run.health.damage)


def test_yaw_and_roll_come_from_the_quaternion_and_the_heading_is_unwrapped(tmp_path):
    yaws = np.linspace(0, 15, 60)
    run = load(
        tmp_path / "logs",
        [imu(nanoseconds(k / 10), yaw=yaw, roll=0.2) for k, yaw in enumerate(yaws)],
        channels=[
            "heading: {topic: /sensing/imu, field: orientation, as: yaw}",
            "roll_angle: {topic: /sensing/imu, field: orientation, as: roll}",
        ],
    )
    assert run.signals["heading"].values == pytest.approx(yaws, abs=1e-12)
    assert run.signals["roll_angle"].values == pytest.approx(np.full(60, 0.2), abs=1e-12)


def test_an_imu_that_says_it_has_no_orientation_gives_none(tmp_path):
    run = load(
        tmp_path / "logs",
        [imu(nanoseconds(k / 10)) for k in range(9)],
        channels=[
            "heading: {topic: /sensing/imu, field: orientation, as: yaw}",
            "yaw_rate: {topic: /sensing/imu, field: angular_velocity.z, unit: rad/s}",
        ],
    )
    assert run.health.missing == ["heading"]
    assert "yaw_rate" in run.signals


def test_a_derived_signal_is_the_slope_of_its_base(tmp_path):
    times = np.arange(200) / 20
    run = load(
        tmp_path / "logs",
        [odometry(nanoseconds(t), 0, 0, 0.3 * t**2 / 2) for t in times],
        channels=[
            "heading: {topic: /localization/odometry, field: pose.pose.orientation, as: yaw}",
            "yaw_rate: {derivative_of: heading}",
        ],
    )
    yaw_rate = run.signals["yaw_rate"]
    assert yaw_rate.values == pytest.approx(0.3 * yaw_rate.time, abs=1e-6)
    assert run.health.signals["yaw_rate"].source == "derivative of heading"


def test_a_value_that_is_asked_for_gives_a_flag(tmp_path):
    modes = [
        plain("/mode", "std_msgs/msg/UInt8", nanoseconds(k), data=mode) for k, mode in enumerate([4, 1, 1, 5])
    ]
    run = load(tmp_path / "logs", modes, channels=["engaged: {topic: /mode, field: data, equals: 1}"])
    assert run.signals["engaged"].values.tolist() == [0, 1, 1, 0]


def test_the_reference_point_is_that_of_the_vehicle_unless_the_map_says_another(tmp_path):
    entry = "topic: /localization/odometry, field: twist.twist.linear"
    run = load(
        tmp_path / "logs",
        [odometry(nanoseconds(k / 10), k, 0, 0) for k in range(9)],
        channels=[
            f"longitudinal_velocity: {{{entry}.x, unit: m/s}}",
            f"lateral_velocity: {{{entry}.y, unit: m/s, at: cg}}",
            "yaw_rate: {topic: /localization/odometry, field: twist.twist.angular.z, unit: rad/s}",
        ],
        vehicle="reference_point: rear_axle\n",
    )
    points = {name: signal.at for name, signal in run.signals.items()}
    assert points == {"longitudinal_velocity": "rear_axle", "lateral_velocity": "cg", "yaw_rate": None}


def test_a_field_that_does_not_exist_is_said_and_the_rest_is_read(tmp_path):
    run = load(
        tmp_path / "logs",
        angles(5),
        channels=[
            "steering_wheel_request: {topic: /vehicle/steering_wheel, field: angel, unit: rad}",
            ENTRY,
        ],
    )
    assert list(run.signals) == ["steering_wheel_angle"]
    assert any("has no field 'angel', did you mean 'angle'?" in item.what for item in run.health.damage)


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        (
            "heading: {topic: /vehicle/steering_wheel, field: angle, as: yaw}",
            "is no orientation: leave out 'as'",
        ),
        (
            "steering_wheel_angle: {topic: /localization/odometry, field: pose.pose.orientation, unit: rad}",
            "is an orientation: add 'as: yaw'",
        ),
    ],
)
def test_an_orientation_and_a_number_are_not_confused(tmp_path, entry, reason):
    run = load(tmp_path / "logs", [*angles(5), odometry(nanoseconds(0), 0, 0, 0)], channels=[entry])
    assert run.signals == {}
    assert any(reason in item.what for item in run.health.damage)


def test_the_next_alternative_is_used_where_the_first_has_no_such_field(tmp_path):
    run = load(
        tmp_path / "logs",
        angles(5),
        channels=[
            "steering_wheel_angle:",
            "  - {topic: /vehicle/steering_wheel, field: position, unit: rad}",
            "  - {topic: /vehicle/steering_wheel, field: angle, unit: rad}",
        ],
    )
    assert run.health.signals["steering_wheel_angle"].source == "/vehicle/steering_wheel.angle"


# --- stamps ---------------------------------------------------------------------------------------


def test_messages_without_header_take_the_log_time(tmp_path):
    messages = [plain("/bare", "std_msgs/msg/Float64", nanoseconds(k / 10), data=float(k)) for k in range(5)]
    run = load(tmp_path / "logs", messages, channels=["speed: {topic: /bare, field: data, unit: m/s}"])
    assert run.signals["speed"].time.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert run.signals["speed"].arrival is None
    assert run.health.topics[0].stamp == "log"


def test_the_map_may_ask_for_the_log_time(tmp_path):
    messages = [angle(k / 10, float(k), time=k / 10 + 0.03) for k in range(5)]
    entry = ENTRY.replace("rad}", "rad, stamp: log}")
    run = load(
        tmp_path / "logs",
        [*messages, velocity(nanoseconds(0), 1.0)],
        channels=[
            entry,
            "speed: {topic: /vehicle/velocity, field: twist.linear.x, unit: m/s}",
        ],
    )
    assert run.signals["steering_wheel_angle"].time.tolist() == pytest.approx([0.03, 0.13, 0.23, 0.33, 0.43])


def test_stamps_that_are_always_zero_give_way_to_the_log_time(tmp_path):
    messages = [message(TOPIC, ANGLE, 0, time=nanoseconds(k / 10), angle=1.0) for k in range(5)]
    run = load(tmp_path / "logs", messages)
    assert run.signals["steering_wheel_angle"].time.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert run.health.topics[0].stamp == "log"


def test_a_few_absurd_stamps_are_left_out_and_counted(tmp_path):
    messages = angles(100)
    messages[10] = message(TOPIC, ANGLE, 0, time=messages[10].time, angle=9.0)
    messages[20] = message(TOPIC, ANGLE, START + 10**17, time=messages[20].time, angle=9.0)
    run = load(tmp_path / "logs", messages)
    signal = run.signals["steering_wheel_angle"]
    assert len(signal.time) == 98
    assert signal.values.max() < 1.0
    lost = next(item for item in run.health.damage if "stamped 0 or more than 60 s off" in item.what)
    assert lost.messages_lost == 2


def test_a_simulated_clock_is_kept_and_log_times_are_brought_to_it(tmp_path):
    offset = 10**9 * 10**9
    messages = [
        message(TOPIC, ANGLE, k * 10**8 + 5 * 10**9, time=k * 10**8 + 5 * 10**9 + offset, angle=float(k))
        for k in range(10)
    ]
    messages += [
        plain("/bare", "std_msgs/msg/Float64", k * 10**8 + 5 * 10**9 + offset, data=float(k))
        for k in range(10)
    ]
    run = load(tmp_path / "logs", messages, channels=[ENTRY, "speed: {topic: /bare, field: data, unit: m/s}"])
    assert run.start_ns == 5 * 10**9
    assert run.signals["speed"].time == pytest.approx(run.signals["steering_wheel_angle"].time)
    assert any("the run is on the stamps' clock" in note for note in run.health.clocks)


def test_a_topic_on_another_clock_takes_the_log_time(tmp_path):
    strange = [
        message("/boot", ANGLE, k * 10**8 + 1, time=nanoseconds(k / 10), angle=float(k)) for k in range(10)
    ]
    speeds = [velocity(nanoseconds(k / 10), 1.0) for k in range(10)]
    run = load(
        tmp_path / "logs",
        [*angles(100), *speeds, *strange],
        channels=[
            ENTRY,
            "road_wheel_angle: {topic: /boot, field: angle, unit: rad}",
            "speed: {topic: /vehicle/velocity, field: twist.linear.x, unit: m/s}",
        ],
    )
    assert run.signals["road_wheel_angle"].time == pytest.approx(np.arange(10) / 10)
    assert any("/boot" in note and "log time used" in note for note in run.health.clocks)


# --- which files apply ----------------------------------------------------------------------------


def test_the_nearest_files_apply_up_to_the_path_that_was_given(tmp_path):
    for folder, unit in (("", "deg"), ("day/", "rad")):
        place = tmp_path / "all" / folder
        place.mkdir(parents=True)
        (place / "channels.yaml").write_text(f"signals: {{{ENTRY.replace('rad}', unit + '}')}}}")
    (tmp_path / "vehicle.yaml").write_text("mass: 1 kg")
    write_bag(tmp_path / "all" / "day" / "run", angles(5))
    write_bag(tmp_path / "all" / "other", angles(5))
    runs = {run.name: run for run in load_runs([tmp_path / "all"]).runs}
    assert runs["day/run"].health.channels == "day/channels.yaml"
    assert runs["other"].health.channels == "channels.yaml"
    assert runs["other"].health.vehicle == "none"  # vehicle.yaml lies above the path that was given


def test_a_log_named_itself_uses_the_files_beside_it(tmp_path):
    load(tmp_path / "logs", angles(5), channels=[ENTRY], vehicle="mass: 7 kg")
    (run,) = load_runs([tmp_path / "logs" / "run"]).runs
    assert (run.health.channels, run.health.vehicle) == ("channels.yaml", "vehicle.yaml")
    assert run.vehicle.mass == 7


def test_named_files_come_before_those_that_lie_there(tmp_path):
    load(tmp_path / "logs", angles(5), channels=[ENTRY], vehicle="mass: 7 kg")
    named, vehicle = tmp_path / "mine.yaml", tmp_path / "truck.yaml"
    named.write_text(f"signals: {{{ENTRY.replace('rad}', 'deg}')}}}")
    vehicle.write_text("mass: 8 kg")
    (run,) = load_runs([tmp_path / "logs"], channels=[named], vehicle=vehicle).runs
    assert (run.health.channels, run.health.vehicle, run.vehicle.mass) == ("mine.yaml", "truck.yaml", 8)
    assert run.signals["steering_wheel_angle"].values[-1] == pytest.approx(np.radians(0.04))


def test_of_several_maps_the_best_fitting_is_chosen_for_each_run(tmp_path):
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text(f"signals: {{{ENTRY}}}")
    two.write_text("signals: {speed: {topic: /vehicle/velocity, field: twist.linear.x, unit: m/s}}")
    write_bag(tmp_path / "logs" / "a", angles(5))
    write_bag(tmp_path / "logs" / "b", [velocity(nanoseconds(k), 1.0) for k in range(5)])
    runs = load_runs([tmp_path / "logs"], channels=[one, two]).runs
    assert [run.health.channels for run in runs] == ["one.yaml", "two.yaml"]


def test_a_wrong_map_is_found_before_any_log_is_read(tmp_path):
    (tmp_path / "broken.mcap").write_bytes(b"no log at all")
    (tmp_path / "channels.yaml").write_text("signals: {yawrate: {}}")
    with pytest.raises(BadRecipe):
        load_runs([tmp_path])


# --- several runs ---------------------------------------------------------------------------------


def test_unreadable_logs_are_listed_and_the_others_read(tmp_path):
    write_bag(tmp_path / "good", angles(5))
    (tmp_path / "bad.mcap").write_bytes(b"")
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    loaded = load_runs([tmp_path])
    assert [run.name for run in loaded.runs] == ["good"]
    assert {refusal.what: refusal.reason.split(": ", 1)[1] for refusal in loaded.unreadable} == {
        "bad": "is empty (0 bytes)",
        "old": "ROS 1 bag without a record that can be read (13 bytes)",
    }
    assert len(loaded.warnings) == 2


def test_logs_that_are_all_unreadable_are_an_error(tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"")
    (tmp_path / "worse.mcap").write_bytes(b"x")
    with pytest.raises(UnusableLog, match=r"none of 2 logs can be read, the first: .*is empty"):
        load_runs([tmp_path])


def test_files_are_named_from_the_path_given_with_their_sha256(tmp_path):
    folder = write_bag(tmp_path / "logs" / "deep" / "run", angles(5))
    (file,) = load_runs([tmp_path / "logs"]).files
    data = (folder / "run.mcap").read_bytes()
    assert (file.path, file.bytes) == ("deep/run/run.mcap", len(data))
    assert file.sha256 == hashlib.sha256(data).hexdigest()


def test_progress_is_told(tmp_path):
    for name in "ab":
        write_bag(tmp_path / name, angles(5))
    told = []
    load_runs([tmp_path], progress=lambda *what: told.append(what))
    assert told == [("reading a", 0, 2), ("reading b", 1, 2), ("reading", 2, 2)]


def test_a_log_without_any_signal_is_still_described(tmp_path):
    run = load(
        tmp_path / "logs", [plain("/x", "std_msgs/msg/Float64", nanoseconds(k), data=1.0) for k in range(5)]
    )
    assert run.signals == {}
    assert (run.duration, run.health.topics[0].messages) == (4.0, 5)
    assert (run.health.channels, run.health.missing) == ("none", [])
