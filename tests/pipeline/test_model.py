from __future__ import annotations

from typing import Any

import pytest

from ident.errors import BadRecipe
from ident.model_file import Model
from ident.pipeline.model import composed
from ident.results import Provenance

PROVENANCE = Provenance("0.1.0", "ident info logs", 1, "2026-01-02T03:04:05+00:00")
VALUE = {"value": 1.0, "std": 2.0, "unit": "1"}


def steering(dead_time: float) -> dict[str, Any]:
    value = {"value": dead_time, "std": 0.001, "unit": "s"}
    return {
        "steering": dict.fromkeys(("gain", "dead_time", "time_constant_1", "time_constant_2"), value),
        "noise": {"steering_wheel_angle": {"std": 0.1}},
        "parameters": ["steering.dead_time"],
        "covariance": [[1e-6]],
    }


TYRES = {
    "tyres": {"kind": "linear", "front": {"a": VALUE}, "rear": {"b": VALUE}},
    "parameters": ["tyres.front.a", "tyres.rear.b"],
    "covariance": [[4.0, 1.0], [1.0, 4.0]],
    "noise": {"yaw_rate": {"std": 0.01}},
}


def compose(**parts: dict[str, Any]) -> Model:
    return composed(parts, dict.fromkeys(parts, PROVENANCE))


def test_parts_stand_beside_each_other_as_fitted_independently() -> None:
    model = compose(steering=steering(0.1), tyres=TYRES)
    assert model.steering is not None
    assert model.tyres is not None
    assert list(model.noise) == ["steering_wheel_angle", "yaw_rate"]
    assert model.parameters == ["steering.dead_time", "tyres.front.a", "tyres.rear.b"]
    assert model.covariance == [[1e-6, 0.0, 0.0], [0.0, 4.0, 1.0], [0.0, 1.0, 4.0]]
    assert list(model.provenance) == ["steering", "tyres"]


def test_a_later_part_replaces_what_it_holds_too() -> None:
    model = compose(steering=steering(0.1), again=steering(0.2))
    assert model.steering is not None
    assert model.steering.dead_time.value == 0.2
    assert (model.parameters, model.covariance) == (["steering.dead_time"], [[1e-6]])


def test_no_part_is_an_empty_model() -> None:
    assert compose() == Model()


def test_refuses_a_part_that_could_not_be_read_and_names_its_stage() -> None:
    with pytest.raises(BadRecipe, match="model of steering: covariance has rows"):
        compose(steering=steering(0.1) | {"parameters": []})
    with pytest.raises(ValueError, match=r"steering\.gain\.value is nan"):
        compose(steering=steering(float("nan")))
