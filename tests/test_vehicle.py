"""The vehicle file: all optional, all checked."""

import math

import pytest

from ident.errors import BadRecipe
from ident.vehicle import AxlesOfGroup, AxleTyres, Vehicle, VehicleTyres, read_vehicle


def read(tmp_path, text):
    path = tmp_path / "vehicle.yaml"
    path.write_text(text, encoding="utf-8")
    return read_vehicle(path)


def test_reads_everything_in_si(tmp_path):
    (tmp_path / "tyre.tir").write_text("")
    vehicle = read(
        tmp_path,
        "mass: 12.5 t\nyaw_inertia: 50000 kg m^2\ncg_to_front_axle: 2380 mm\ncg_to_rear_axle: 2.12 m\n"
        "track: 2 m\ncg_height: 1.1 m\nsteering_ratio: 20.5\nreference_point: rear_axle\n"
        "imu_position: [0.6 m, 0 m, 20 cm]\ntyres: tyre.tir\n",
    )
    assert vehicle == Vehicle(
        mass=12500.0,
        yaw_inertia=50000.0,
        cg_to_front_axle=pytest.approx(2.38),
        cg_to_rear_axle=2.12,
        track=2.0,
        cg_height=1.1,
        steering_ratio=20.5,
        reference_point="rear_axle",
        imu_position=(0.6, 0.0, pytest.approx(0.2)),
        tyres=VehicleTyres(AxleTyres(tmp_path / "tyre.tir"), AxleTyres(tmp_path / "tyre.tir")),
    )
    assert vehicle.wheelbase == pytest.approx(4.5)


def test_the_axles_may_have_tyres_of_their_own_and_dual_ones(tmp_path):
    for name in ("steer.tir", "drive.tir"):
        (tmp_path / name).write_text("")
    vehicle = read(tmp_path, "tyres: {front: steer.tir, rear: {file: drive.tir, number: 4}}")
    front, rear = AxleTyres(tmp_path / "steer.tir", 2), AxleTyres(tmp_path / "drive.tir", 4)
    assert vehicle.tyres == VehicleTyres(front, rear)


def test_what_is_missing_is_none(tmp_path):
    assert read(tmp_path, "# nothing known\n") == Vehicle()
    assert Vehicle(cg_to_front_axle=1.0).wheelbase is None


def test_the_steering_ratio_may_be_a_table_of_angles(tmp_path):
    vehicle = read(tmp_path, "steering_ratio: [[-360 deg, -17.5 deg], [0 deg, 0 deg], [360 deg, 18 deg]]")
    assert vehicle.steering_ratio == (
        (-2 * math.pi, pytest.approx(math.radians(-17.5))),
        (0.0, 0.0),
        (2 * math.pi, pytest.approx(math.radians(18))),
    )


@pytest.mark.parametrize(
    ("text", "value", "std"),
    [
        ("mass: 12500 kg ± 300 kg", 12500.0, 300.0),
        ("mass: 12500 kg +- 3 %", 12500.0, 375.0),
        ("mass: 12.5 t+/-0.3 t", 12500.0, 300.0),
        ("mass: 1.25e+4 kg ± 3e-1 t", 12500.0, 300.0),
        ("mass: {value: 12500 kg, std: 300 kg}", 12500.0, 300.0),
        ("mass: {value: 12500 kg, std: 3 %}", 12500.0, 375.0),
        ("mass: 12500 kg ± 0 kg", 12500.0, 0.0),
    ],
)
def test_a_value_may_state_its_standard_deviation(tmp_path, text, value, std):
    vehicle = read(tmp_path, text)
    assert vehicle.mass == pytest.approx(value, rel=1e-12)
    assert vehicle.std == {"mass": pytest.approx(std, rel=1e-12)}


def test_only_what_is_stated_has_a_standard_deviation(tmp_path):
    vehicle = read(
        tmp_path,
        "mass: 12500 kg\nyaw_inertia: {value: 50000 kg m^2}\ncg_to_front_axle: 2.38 m ± 20 mm\n"
        "cg_height: 1.1 m +- 10 %\nsteering_ratio: 20.5 ± 0.2\n",
    )
    assert vehicle.yaw_inertia == 50000.0
    assert vehicle.steering_ratio == 20.5
    assert vehicle.std == {
        "cg_to_front_axle": pytest.approx(0.02),
        "cg_height": pytest.approx(0.11),
        "steering_ratio": pytest.approx(0.2),
    }


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("mas: 3 kg", "unknown key 'mas', did you mean 'mass'?"),
        ("mass: 12500", "mass: '12500' is no quantity with a unit, need such as '1 kg'"),
        ("mass: 3 m", "mass: unit 'm' does not fit, need a unit of 'kg'"),
        ("mass: -3 kg", "mass: -3 is not positive"),
        ("track: 0 m", "track: 0 is not positive"),
        ("reference_point: front", "reference_point: 'front' is not one of rear_axle, cg"),
        ("imu_position: [1 m, 2 m]", "imu_position: ['1 m', '2 m'] is no point"),
        ("steering_ratio: -20", "steering_ratio: -20 is not positive"),
        (
            "steering_ratio: [[1 rad, 1 rad]]",
            "steering_ratio: need a number such as 20.5, or at least two rows",
        ),
        ("steering_ratio: [[1 rad, 1 rad], [0 rad, 2 rad]]", "must rise from row to row"),
        ("steering_ratio: [[1, 0.1], [2, 0.2]]", "steering_ratio: '1' is no quantity with a unit"),
        ("mass: 12500 kg ± -3 kg", "mass: the standard deviation -3 is negative"),
        ("mass: 12500 kg ± 300", "mass: std: '300' is no quantity with a unit"),
        ("mass: 12500 kg ± 3 m", "mass: std: unit 'm' does not fit, need a unit of 'kg'"),
        ("mass: 12500 kg ± 3 kg ± 4 kg", "states more than one spread, need such as '1 kg ± 0.1 kg'"),
        ("mass: 12500 kg ± x %", "mass: std in per cent: 'x' is no quantity"),
        ("mass: {std: 300 kg}", "mass: std given, need value and std, such as {value: 1 kg, std: 0.1 kg}"),
        ("mass: {value: 1 kg, sdt: 1 kg}", "mass: value, sdt given, need value and std"),
        ("tyres: gone.tir", "tyres: there is no file"),
        ("tyres: {front: vehicle.yaml, rear: gone.tir}", "tyres.rear: there is no file"),
        ("tyres: {front: vehicle.yaml}", "tyres: front given, need a file, or front and rear"),
        ("tyres: {front: vehicle.yaml, rear: {number: 4}}", "tyres.rear: number given, need {file: drive"),
        (
            "tyres: {front: vehicle.yaml, rear: {file: vehicle.yaml, number: 3}}",
            "tyres.rear: 3 tyres, need an even number",
        ),
        ("mass: 1 kg\nmass: 2 kg", "is not YAML"),
        ("- mass", "need a mapping"),
    ],
)
def test_refuses_what_is_wrong_in_one_line(tmp_path, text, reason):
    with pytest.raises(BadRecipe) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "vehicle.yaml"))
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_axle_groups_and_shares_of_the_two_track_model_are_read(tmp_path):
    vehicle = read(
        tmp_path,
        "front_roll_share: 42 %\nackermann_share: 0.8 +- 0.1\nload_sensitivity: 0\n"
        "axles: {front: {track: 205 cm}, rear: {number: 3, spacing: 1310 mm, track: 1.83 m, lifted: 1}}\n",
    )
    assert vehicle.axles == {
        "front": AxlesOfGroup(track=pytest.approx(2.05)),
        "rear": AxlesOfGroup(3, pytest.approx(1.31), 1.83, 1),
    }
    shares = vehicle.front_roll_share, vehicle.ackermann_share, vehicle.load_sensitivity
    assert shares == (pytest.approx(0.42), 0.8, 0.0)
    assert vehicle.std == {"ackermann_share": pytest.approx(0.1)}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("axles: 2", "axles: 2, need front, rear or both"),
        ("axles: {middle: {number: 2}}", "need front, rear or both"),
        ("axles: {rear: 2}", "axles.rear: 2, need such as"),
        ("axles: {rear: {number: 2}}", "axles.rear: 2 axles without a spacing"),
        ("axles: {rear: {number: 2, spacing: 0 m}}", "axles.rear.spacing: 0 is not positive"),
        ("axles: {rear: {number: 5, spacing: 1 m}}", "axles.rear.number: 5, need a whole number from 1 to 4"),
        ("axles: {rear: {number: 2, spacing: 1 m, lifted: 0}}", "lifted: 0, need a whole number from 1 to 2"),
        ("axles: {rear: {number: 1, lifted: 1}}", "a single axle has no spacing and is not lifted"),
        ("axles: {rear: {nummer: 2}}", "axles.rear: unknown key 'nummer'.*number"),
        ("front_roll_share: 1.2", "front_roll_share: 1.2, need a share from 0 to 1"),
    ],
)
def test_axles_and_shares_that_cannot_be_are_refused(tmp_path, text, told):
    with pytest.raises(BadRecipe, match=told):
        read(tmp_path, text)
