"""Trucks drawn from the covariance of a fit."""

from __future__ import annotations

import numpy as np
import pytest
from bench_case import truck

from ident.control.draws import draw, uncertain
from ident.errors import BadRecipe, NotIdentifiable
from ident.model_file import Model, SteeringPart, TyresPart, Value, VehiclePart

NAMES = ["tyres.front.cornering_stiffness", "tyres.rear.cornering_stiffness", "vehicle.yaw_inertia"]
VALUES = np.array([2.4e5, 4.1e5, 6e4])
RELATIVE = np.array([[4e-4, 2e-4, -1e-4], [2e-4, 9e-4, 0.0], [-1e-4, 0.0, 1e-4]])


def model(names=(), covariance=(), **parts):
    return Model(parameters=list(names), covariance=[list(row) for row in covariance], **parts)


def fitted(extra=(), sizes=()):
    names = [*NAMES, *extra]
    covariance = np.zeros((len(names), len(names)))
    covariance[:3, :3] = RELATIVE * VALUES * VALUES[:, None]
    covariance[range(3, len(names)), range(3, len(names))] = np.square(sizes)
    return model(names, covariance)


def values_of(trucks):
    names = [name.partition(".")[2] for name in NAMES]
    return np.array([[one.parameters[name] for name in names] for one in trucks])


def test_draws_have_the_covariance_of_the_fit_in_the_logarithm():
    found = draw(truck(), fitted(), 4000, 3)
    logs = np.log(values_of(found.trucks) / VALUES)
    np.testing.assert_allclose(np.cov(logs.T), RELATIVE, atol=4e-5)
    np.testing.assert_allclose(np.mean(logs, axis=0), 0.0, atol=2e-3)
    assert found.drawn == tuple(NAMES)
    assert found.left_out == ()


def test_a_wide_draw_stays_positive_about_its_median():
    found = draw(truck(), model(["steering.dead_time"], [[0.08**2]]), 2000, 1)
    times = np.array([one.steering.dead_time for one in found.trucks])
    assert np.min(times) > 0
    assert np.median(times) == pytest.approx(0.12, rel=0.03)
    assert np.std(np.log(times)) == pytest.approx(0.08 / 0.12, rel=0.05)


def test_seeds_reproduce_and_more_draws_keep_the_first():
    few, many = (draw(truck(), fitted(), count, 3).trucks for count in (5, 12))
    np.testing.assert_array_equal(values_of(few), values_of(many)[:5])
    assert not np.array_equal(values_of(few), values_of(draw(truck(), fitted(), 5, 4).trucks))


def test_what_has_a_standard_error_alone_is_drawn_independently():
    def known(value, std, unit="1"):
        return Value(value, std, unit)

    steering = SteeringPart(known(0.95, 0.01), known(0.12, 0.004), known(0.1, None), known(0.05, None))
    tyres = TyresPart("linear", {"cornering_stiffness": known(2.4e5, 9e9)}, {})
    vehicle = VehiclePart(mass=known(12500.0, 250.0, "kg"))
    told = model(NAMES, RELATIVE * VALUES * VALUES[:, None], steering=steering, tyres=tyres, vehicle=vehicle)
    names, covariance = uncertain(told)
    assert names == [*NAMES, "vehicle.mass", "steering.gain", "steering.dead_time"]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance))[3:], [250.0, 0.01, 0.004])
    trucks = draw(truck(), told, 1500, 0).trucks
    mass = np.log([one.parameters["mass"] for one in trucks])
    gain = np.log([one.steering.gain for one in trucks])
    assert np.std(mass) == pytest.approx(0.02, rel=0.06)
    assert abs(np.corrcoef(mass, gain)[0, 1]) < 0.08


def test_effects_are_drawn_by_the_names_of_their_fit():
    effects = {
        "tyre_relaxation": {"length": 0.6},
        "steering_linkage_play": {"width": 0.006},
        "sensor_latency yaw_rate": {"delay": 0.06},
        "steering_offset": {"angle": -0.004},
        "sensor_latency steering_angle": {"delay": 0.01},
    }
    one = truck("magic_formula", effects=effects)
    names = ["tyre_relaxation.length", "linkage_play", "delay.yaw_rate", "steering_offset"]
    names = [f"effects.{name}" for name in [*names, "delay.road_wheel_angle"]]
    sizes = [0.01, 1e-4, 1e-3, 1e-3, 1e-4]
    strange = ["effects.reference_x", "effects.yaw_moment: r|r|", "steering.natural_frequency"]
    found = draw(one, fitted([*names, *strange], [*sizes, 1.0, 1.0, 1.0]), 800, 2)
    assert found.drawn == (*NAMES, *names)
    assert found.left_out == tuple(strange)
    for (key, own), size in zip(effects.items(), sizes, strict=True):
        ((name, value),) = own.items()
        drawn = np.array([made.effects[key][name] for made in found.trucks])
        assert np.mean(drawn) == pytest.approx(value, abs=4 * size / np.sqrt(800))
        assert np.std(drawn) == pytest.approx(size, rel=0.1)
    assert one.effects["tyre_relaxation"] == {"length": 0.6}


def test_what_no_truck_can_be_is_drawn_again():
    names = ["steering.time_constant_1", "steering.time_constant_2", "tyres.front.shape"]
    told = model(names, np.diag([0.03**2, 0.03**2, 0.6**2]))
    for one in draw(truck("magic_formula"), told, 300, 9).trucks:
        assert one.steering.time_constant_2 <= one.steering.time_constant_1
        assert 0.5 <= one.parameters["front.shape"] <= 2.5


def test_refuses_a_model_that_cannot_be_drawn_from():
    with pytest.raises(NotIdentifiable, match="holds no standard error"):
        draw(truck(), model(), 3, 0)
    with pytest.raises(NotIdentifiable, match="holds no standard error"):
        draw(truck("kinematic"), fitted(), 3, 0)
    with pytest.raises(BadRecipe, match="negative variance"):
        draw(truck(), model(NAMES[:2], [[1e6, 3e6], [3e6, 1e6]]), 3, 0)
    with pytest.raises(BadRecipe, match="need 1 or more"):
        draw(truck(), fitted(), 0, 0)
    wild = model(["tyres.front.shape"], [[1e6]])
    with pytest.raises(BadRecipe, match="none of 200 draws"):
        draw(truck("magic_formula"), wild, 40, 0)
