"""The ratio map against maps that are known."""

import numpy as np
import pytest

from ident.errors import NotIdentifiable
from ident.estimation.ratio_map import FEWEST, fit_ratio_map, kinematic_road_angle


def applied(table, wheel):
    """The table with its end slopes carried on."""
    x, y = np.array(table).T
    inner = np.interp(wheel, x, y)
    first = (y[1] - y[0]) / (x[1] - x[0])
    last = (y[-1] - y[-2]) / (x[-1] - x[-2])
    below, above = np.minimum(wheel - x[0], 0.0), np.maximum(wheel - x[-1], 0.0)
    return inner + first * below + last * above


def driven(count=6000, reach=6.0, seed=0):
    random = np.random.default_rng(seed)
    return reach * np.sin(np.linspace(0, 40, count)) * random.uniform(0.9, 1.0, count)


def test_a_constant_ratio_gives_two_knots():
    wheel = driven()
    road = wheel / 20.5 + 0.002 + 0.001 * np.random.default_rng(1).standard_normal(wheel.size)
    table = fit_ratio_map(wheel, road)
    assert len(table) == 2
    (x0, y0), (x1, y1) = table
    assert (x1 - x0) / (y1 - y0) == pytest.approx(20.5, rel=2e-3)
    assert applied(table, np.zeros(1))[0] == pytest.approx(0.002, abs=2e-4)


def test_a_progressive_ratio_is_followed_and_stays_monotone():
    wheel = driven()
    true = wheel / 20.5 * (1 + 0.004 * wheel**2)
    road = true + 0.001 * np.random.default_rng(2).standard_normal(wheel.size)
    table = fit_ratio_map(wheel, road)
    assert len(table) > 3
    assert np.all(np.diff(np.array(table), axis=0) > 0)
    error = applied(table, wheel) - true
    assert np.sqrt(np.mean(error**2)) < 0.002
    assert np.abs(error).max() < 0.012


def test_mirrored_data_give_the_mirrored_map():
    wheel = driven()
    road = wheel / 20.5 * (1 + 0.004 * wheel**2) + 0.003
    table, mirrored = np.array(fit_ratio_map(wheel, road)), np.array(fit_ratio_map(-wheel, -road))
    assert mirrored[::-1] == pytest.approx(-table, abs=1e-9)


def test_a_play_that_makes_the_noise_locally_fall_does_not_make_the_map_fall():
    wheel = driven(reach=0.5)
    road = 0.05 * np.sign(wheel) + 0.003 * np.random.default_rng(3).standard_normal(wheel.size)
    assert np.all(np.diff(np.array(fit_ratio_map(wheel, road))[:, 1]) >= 0)


def test_refuses_a_wheel_that_hardly_turns():
    wheel = driven(reach=0.05)
    with pytest.raises(NotIdentifiable, match=r"0\.10 rad of the steering wheel, need 200 over 0\.2 rad"):
        fit_ratio_map(wheel, wheel / 20)


def test_refuses_too_few_samples():
    wheel = driven(count=FEWEST - 1)
    with pytest.raises(NotIdentifiable, match=f"{FEWEST - 1} samples"):
        fit_ratio_map(wheel, wheel / 20)


def test_refuses_opposite_signs():
    wheel = driven()
    with pytest.raises(NotIdentifiable, match="wrong sign"):
        fit_ratio_map(wheel, -wheel / 20)


def test_the_kinematic_angle_is_exact_without_slip():
    angle, speed, wheelbase = np.linspace(-0.1, 0.1, 41), np.full(41, 2.0), 3.7
    found, weight = kinematic_road_angle(speed, speed * np.tan(angle) / wheelbase, wheelbase)
    assert found == pytest.approx(angle, abs=1e-12)
    assert weight == pytest.approx(speed)


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.5, 0.01), (8.0, 0.01), (5.0, 0.3)])
def test_the_kinematic_angle_is_not_taken_where_tyres_slip_or_the_vehicle_crawls(speed, yaw_rate):
    found, weight = kinematic_road_angle(np.array([speed]), np.array([yaw_rate]), 3.7)
    assert np.isnan(found[0])
    assert weight[0] == 0
