"""A campaign in memory: what its sensors read, what effects change, and what may not change anything."""

from functools import cache

import numpy as np
import pytest
from generator.effects import campaign, drive_campaign, measured, noise_floor
from generator.injected import OUTSIDE, TYPICAL, Injected, typical
from generator.injected_sensors import LATERAL
from generator.manoeuvres import CAMPAIGN
from generator.motion_sets import SOURCES, channel_of
from generator.vehicle import GRAVITY
from numpy.testing import assert_allclose, assert_array_equal

SEED = 4
SHORT = ("sweep_fast",)


@pytest.fixture(scope="module")
def plain():
    return drive_campaign([], SEED)


@cache
def unchanged(run):
    return drive_campaign([], SEED, runs=[run]).runs[run]


def read(effect, run="sweep_fast"):
    return drive_campaign([effect], SEED, runs=[run]).runs[run] if effect else unchanged(run)


# --- the runs --------------------------------------------------------------------------------------


def test_there_are_eight_runs_of_about_forty_seconds(plain):
    assert set(plain.runs) == set(CAMPAIGN)
    assert len(CAMPAIGN) == 8
    for name, run in plain.runs.items():
        assert set(run) == {*SOURCES, "steering_wheel_request"}, name
        assert 39.0 < run["yaw_rate"].time[-1] < 47.5
        assert np.diff(run["steering_wheel_request"].time).mean() == pytest.approx(0.01, rel=1e-3)


def test_one_run_begins_at_rest_and_goes_there_and_back(plain):
    run = plain.runs["there_and_back"]
    early = run["yaw_rate"].time < 6.0
    assert np.all(run["speed"].values[run["speed"].time < 6.0] == 0.0)
    assert_allclose(run["yaw_rate"].values[early], 0.0, atol=1e-12)
    heading = run["heading"]
    there, back = heading.values[heading.time < 17.0].mean(), heading.values[heading.time > 38.0].mean()
    assert back - there == pytest.approx(np.pi, abs=0.25)


def test_the_runs_reach_what_shows_the_effects(plain):
    largest = {name: np.max(np.abs(run["lateral_acceleration"].values)) for name, run in plain.runs.items()}
    assert largest["ramp_steer"] == pytest.approx(0.35 * GRAVITY, rel=0.03)
    assert largest["sweep_fast"] == pytest.approx(2.0, rel=0.15)
    circles = plain.runs["slow_circles"]
    assert np.max(circles["speed"].values) < 3.0
    angles = circles["steering_wheel_angle"].values / plain.truth.planar.steering_ratio
    assert np.min(angles) < -0.28
    assert np.max(angles) > 0.28


def test_no_request_of_the_campaign_but_the_steps_is_abrupt(plain):
    for name, run in plain.runs.items():
        fastest = np.max(np.abs(np.diff(run["steering_wheel_angle"].values))) * 100.0
        assert fastest > 6.5 if name == "steps" else fastest < 3.3, name


# --- effects ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TYPICAL)
def test_every_effect_of_usual_size_is_more_than_its_sensors_noise_in_some_run(plain, name):
    changed = drive_campaign(
        [typical(name)], SEED, runs=["steps", "ramp_steer", "sweep_slow", "slow_circles"]
    )
    largest = max(
        np.max(np.abs(changed.runs[run][signal].values - plain.runs[run][signal].values))
        / channel_of(plain.truth, signal).noise_std
        for run in changed.runs
        for signal in (
            "steering_wheel_angle",
            "speed",
            "yaw_rate",
            "lateral_acceleration",
            "lateral_velocity",
        )
    )
    assert largest > 2.5


@pytest.mark.parametrize("name", OUTSIDE)
def test_every_other_effect_changes_what_is_measured(plain, name):
    runs = ["ramp_steer", "free"]
    changed = drive_campaign([Injected(name)], SEED, runs=runs)
    one, other = measured(changed, SEED), measured(plain, SEED)
    differ = [
        np.max(np.abs(one[run][signal].values - other[run][signal].values))
        for run in runs
        for signal in ("steering_wheel_angle", "yaw_rate", "lateral_acceleration", "lateral_velocity")
    ]
    assert 1e-3 < max(differ) < 2.0


def test_effects_compose():
    pair = [typical("steering_offset"), typical("body_roll")]
    both = drive_campaign(pair, SEED, runs=SHORT).runs["sweep_fast"]
    one = read(typical("steering_offset"))
    assert_array_equal(both["yaw_rate"].values, one["yaw_rate"].values)
    assert np.any(both["lateral_acceleration"].values != one["lateral_acceleration"].values)


def test_what_stands_behind_the_angle_sensor_does_not_reach_it():
    before, after = read(None), read(typical("steering_linkage_play"))
    assert_array_equal(after["steering_wheel_angle"].values, before["steering_wheel_angle"].values)
    assert np.any(after["yaw_rate"].values != before["yaw_rate"].values)


def test_an_offset_turns_the_truck_as_that_angle_would():
    offset = read(Injected("steering_offset", {"angle": 5e-3}), "there_and_back")
    plain = read(None, "there_and_back")
    late = plain["yaw_rate"].time > 40.0
    turned = np.mean((offset["yaw_rate"].values - plain["yaw_rate"].values)[late])
    gain = 14.0 / 4.5 / (1.0 + 14.0**2 * understeer() / 4.5)
    assert turned == pytest.approx(5e-3 * gain, rel=0.02)


def understeer() -> float:
    truck = drive_campaign([], 1, runs=[]).truth.planar
    front, rear = (t.stiffness * t.shape * t.peak for t in (truck.front, truck.rear))
    body = truck.body
    return body.mass / 4.5 * (body.cg_to_rear_axle / front - body.cg_to_front_axle / rear)


def test_the_kinematic_gain_of_a_slow_circle_follows_the_ratio():
    curved, plain = (
        read(effect, "slow_circles")
        for effect in (Injected("steering_ratio_nonlinearity", {"cubic": 0.6}), None)
    )
    time = plain["yaw_rate"].time
    hold = (time > 20.0) & (time < 22.0)  # the largest angle
    road = np.mean(plain["steering_wheel_angle"].values[hold]) / 20.5
    ratio = np.mean(curved["yaw_rate"].values[hold]) / np.mean(plain["yaw_rate"].values[hold])
    expected = np.tan(road + 0.6 * road**3) / np.tan(road)
    assert ratio == pytest.approx(expected, rel=3e-3)


# --- sensors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("of", "late", "not_late"),
    [
        ("yaw_rate", ["yaw_rate"], ["lateral_acceleration", "lateral_velocity"]),
        ("lateral_velocity", ["lateral_velocity"], ["yaw_rate", "heading"]),
        ("imu", ["yaw_rate", "lateral_acceleration", "longitudinal_acceleration"], ["heading", "speed"]),
    ],
)
def test_a_late_sensor_reads_what_was_true_that_much_earlier(of, late, not_late):
    whole = 0.05  # of steps of a millisecond
    prompt, delayed = read(None), read(Injected("sensor_latency", {"delay": whole}, of))
    for signal in late:
        time = prompt[signal].time
        earlier = np.interp(time - whole, time, prompt[signal].values)
        inner = time > 1.0
        swing = np.std(prompt[signal].values)
        assert_allclose(delayed[signal].values[inner], earlier[inner], rtol=0, atol=0.01 * swing)
        assert np.max(np.abs(delayed[signal].values - prompt[signal].values)) > 0.1 * swing
    for signal in not_late:
        assert_array_equal(delayed[signal].values, prompt[signal].values)


@pytest.mark.parametrize("of", ["yaw_rate", "lateral_acceleration", "lateral_velocity"])
def test_a_bias_is_added_to_one_signal_also_at_rest(of):
    biased, plain = read(Injected("sensor_bias", of=of), "there_and_back"), read(None, "there_and_back")
    for signal in SOURCES:
        difference = biased[signal].values - plain[signal].values
        expected = Injected("sensor_bias", of=of).values["bias"] if signal == of else 0.0
        assert_allclose(difference, expected, rtol=0, atol=1e-12)


def test_scales_multiply_their_signal():
    plain = read(None)
    for name, of, signals in (
        ("wheel_speed_scale", None, {"speed", "longitudinal_velocity"}),
        ("wheel_speed_scale", "speed", {"speed"}),
        ("gyro_scale", None, {"yaw_rate"}),
    ):
        scaled = read(Injected(name, {"scale": 0.03}, of))
        for signal, samples in plain.items():
            factor = 1.03 if signal in signals else 1.0
            assert_allclose(scaled[signal].values, factor * samples.values, rtol=1e-12, err_msg=signal)


def test_a_rolled_accelerometer_reads_gravity():
    rolled = read(Injected("body_roll", {"gain": 0.012, "frequency": 40.0, "damping": 0.7}), "ramp_steer")
    plain = read(None, "ramp_steer")
    a_y = plain["lateral_acceleration"].values
    steady = np.abs(np.gradient(a_y, plain["lateral_acceleration"].time)) < 0.3
    expected = a_y + GRAVITY * np.sin(0.012 * a_y)
    assert_allclose(rolled["lateral_acceleration"].values[steady], expected[steady], rtol=0, atol=4e-3)
    assert_array_equal(rolled["yaw_rate"].values, plain["yaw_rate"].values)


def test_a_filtered_sensor_lags_a_slow_signal_by_its_time_constant():
    slow, plain = (
        read(Injected("sensor_filter", {"time_constant": 0.2}), "ramp_steer"),
        read(None, "ramp_steer"),
    )
    time, true = plain["lateral_acceleration"].time, plain["lateral_acceleration"].values
    ramp = (time > 5.0) & (time < 12.0)
    assert_allclose(
        slow["lateral_acceleration"].values[ramp], np.interp(time - 0.2, time, true)[ramp], rtol=0, atol=2e-3
    )


def test_a_moved_inertial_unit_feels_its_own_place():
    moved, plain = read(Injected("imu_lever_arm", {"x": 1.0, "y": 0.0})), read(None)
    time = plain["yaw_rate"].time
    turning = np.gradient(plain["yaw_rate"].values, time)
    difference = moved["lateral_acceleration"].values - plain["lateral_acceleration"].values
    assert_allclose(difference[5:-5], turning[5:-5], rtol=0, atol=6e-3)


@pytest.mark.parametrize(
    "nothing",
    [
        Injected("steering_linkage_play", {"width": 0.0}),
        Injected("steering_offset", {"angle": 0.0}),
        Injected("steering_ratio_nonlinearity", {"cubic": 0.0}),
        Injected("loosened_linkage", {"angle": 0.0}),
        Injected("sensor_latency", {"delay": 0.0}, "imu"),
        Injected("sensor_bias", {"bias": 0.0}),
        Injected("wheel_speed_scale", {"scale": 0.0}),
        Injected("body_roll", {"gain": 0.0}),
        Injected("friction_change", {"factor": 1.0, "time": 0.0}),
        Injected("tyre_stiffness_drift", {"loss": 0.0}),
        Injected("stiffness_with_speed", {"slope": 0.0}),
        Injected("dragging_brake", {"moment": 0.0, "time": 0.0}),
        Injected("payload_change", {"mass": 0.0, "yaw_inertia": 0.0, "cg_shift": 0.0}),
        Injected("gyro_scale", {"scale": 0.0}),
        Injected("gyro_cubic", {"coefficient": 0.0}),
        Injected("accelerometer_scale", {"scale": 0.0}),
        Injected("sensor_filter", {"time_constant": 0.0}),
        Injected("sensor_resolution", {"step": 0.0}),
        Injected("imu_lever_arm", {"x": 0.0, "y": 0.0}),
        Injected("imu_misalignment", {"roll": 0.0, "yaw": 0.0}),
        Injected("clock_drift", {"drift": 0.0}),
        Injected("antenna_offset", {"heading": 0.0}),
    ],
    ids=lambda one: f"{one.name} {one.of or ''}",
)
def test_an_effect_of_no_size_changes_no_measurement(plain, nothing):
    run = "ramp_steer"
    one = campaign([nothing], SEED, runs=[run])[run]
    other = measured(plain, SEED)[run]
    for signal, samples in other.items():
        assert_array_equal(one[signal].values, samples.values, err_msg=signal)


# --- measuring -------------------------------------------------------------------------------------


def test_a_campaign_is_the_same_each_time_and_one_run_the_same_alone(plain):
    again = campaign([], SEED, runs=["weave"])["weave"]
    for signal, samples in measured(plain, SEED)["weave"].items():
        assert_array_equal(again[signal].time, samples.time)
        assert_array_equal(again[signal].values, samples.values)


def test_the_noise_floor_is_the_size_of_the_sensors_errors(plain):
    floor = noise_floor(plain, measured(plain, SEED))
    for signal in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        channel = channel_of(plain.truth, signal)
        size = np.sqrt(channel.white_std**2 + channel.noise_std**2 + channel.resolution**2 / 12.0)
        assert floor[signal] == pytest.approx(size, rel=0.05), signal


def test_no_sensor_of_a_campaign_has_a_bias_of_its_own(plain):
    runs = measured(plain, SEED)
    for signal in ("yaw_rate", "lateral_acceleration", "steering_wheel_angle", "heading"):
        errors = np.concatenate(
            [runs[name][signal].values - run[signal].values for name, run in plain.runs.items()]
        )
        assert abs(np.mean(errors)) < 0.05 * np.std(errors), signal


def test_a_mirrored_campaign_is_the_same_with_left_and_right_exchanged(plain):
    one, other = measured(plain, SEED), measured(plain, SEED, mirrored=True)
    for name, run in one.items():
        for signal, samples in run.items():
            sign = -1.0 if signal in LATERAL else 1.0
            assert_array_equal(other[name][signal].values, sign * samples.values)


def test_a_slower_recording_holds_samples_of_the_faster_one(plain):
    fast, slow = measured(plain, SEED)["free"], measured(plain, SEED, rate=50.0)["free"]
    assert_array_equal(slow["yaw_rate"].values, fast["yaw_rate"].values[::2])
    assert_array_equal(slow["heading"].values, fast["heading"].values)
    assert_array_equal(slow["steering_wheel_request"].values, fast["steering_wheel_request"].values)


def test_dropped_messages_take_all_signals_of_their_device(plain):
    whole, lossy = measured(plain, SEED)["free"], measured(plain, SEED, dropped=0.02)["free"]
    lost = 1.0 - len(lossy["yaw_rate"].time) / len(whole["yaw_rate"].time)
    assert lost == pytest.approx(0.02, abs=0.008)
    assert_array_equal(lossy["yaw_rate"].time, lossy["lateral_acceleration"].time)
    assert set(lossy["yaw_rate"].time) < set(whole["yaw_rate"].time)


def test_gusts_push_without_a_steady_part(plain):
    calm, windy = plain.runs["weave"], drive_campaign([], SEED, gusts=800.0, runs=["weave"]).runs["weave"]
    push = windy["lateral_acceleration"].values - calm["lateral_acceleration"].values
    assert 0.02 < np.std(push) < 0.2
    assert abs(np.mean(push)) < 0.1 * np.std(push)


def test_another_truck_is_another_one_for_each_seed_and_is_driven_as_hard():
    drives = [drive_campaign([], seed, truck="another", runs=["ramp_steer"]) for seed in (1, 2)]
    masses = {drive.truth.planar.body.mass for drive in drives}
    assert len(masses) == 2
    for drive in drives:
        largest = np.max(np.abs(drive.runs["ramp_steer"]["lateral_acceleration"].values))
        assert largest == pytest.approx(0.35 * GRAVITY, rel=0.1)


def test_the_same_effect_twice_is_refused():
    with pytest.raises(ValueError, match="injected twice"):
        drive_campaign([typical("tyre_relaxation"), typical("tyre_relaxation", 2.0)], 1, runs=SHORT)


def test_twice_the_size_of_a_limit_is_half_its_value():
    assert typical("steering_rate_limit", 2.0).values["rate"] == TYPICAL["steering_rate_limit"]["rate"] / 2.0
    assert typical("sensor_bias", 2.0, "lateral_acceleration").values["bias"] == pytest.approx(0.16)
