"""The outputs' contract: the committed schemas are those of the classes, and what is written keeps them."""

from __future__ import annotations

import json
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import jsonschema
import pytest
from ruamel.yaml import YAML

from ident.model_file import Model, SignalNoise, SteeringPart, Value, model_text
from ident.pipeline.schema import main, schema_text, schemas
from ident.pipeline.seal import MadeFrom
from ident.pipeline.store import RESULTS, Store, result_text
from ident.results import SCHEMA_VERSION
from ident.stages.output import StageOutput

FOLDER = Path(__file__).parents[2] / "docs" / "schema"
PLAIN = {float: 0.1 + 0.2, int: 7, bool: True, str: "<b> µ"}


def example(kind: Any, full: bool) -> Any:
    """An object of a class of results with everything that may be missing present, or all of it missing."""
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        filled = {name: example(inner, full) for name, inner in get_type_hints(kind).items()}
        return kind(**filled | ({"schema_version": SCHEMA_VERSION} if "schema_version" in filled else {}))
    if origin is Literal:
        return arguments[-1]
    if origin in {Union, UnionType}:
        assert NoneType in arguments
        return example(arguments[0], full) if full else None
    if origin is list:
        return [example(arguments[0], full)] if full else []
    if origin is dict:
        return {"some key": example(arguments[1], full)} if full else {}
    return PLAIN[kind]


def validator(name: str) -> Any:
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_committed_schemas_are_those_of_the_classes() -> None:
    committed = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.iterdir()}
    assert committed == {f"{name}.schema.json": schema_text(schema) for name, schema in schemas().items()}, (
        "run: make schema"
    )


def test_the_command_writes_them(tmp_path: Path) -> None:
    main(tmp_path / "schema")
    assert sorted(path.name for path in (tmp_path / "schema").iterdir()) == sorted(
        path.name for path in FOLDER.iterdir()
    )


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("stage", RESULTS)
def test_a_result_keeps_its_schema_and_is_read_back_as_it_was(tmp_path: Path, stage: str, full: bool) -> None:
    store = Store(tmp_path)
    result = example(RESULTS[stage], full)
    store.save(stage, StageOutput(result), MadeFrom("1"))
    path = store.result_path(stage)
    validator(stage).validate(json.loads(path.read_text(encoding="utf-8")))
    assert store.read_result(stage) == result


@pytest.mark.parametrize("stage", RESULTS)
def test_a_schema_refuses_what_the_class_does_not_have(stage: str) -> None:
    data = json.loads(result_text(example(RESULTS[stage], full=True)))
    assert not validator(stage).is_valid({key: value for key, value in data.items() if key != "warnings"})
    assert not validator(stage).is_valid({**data, "warnings": "none"})
    assert not validator(stage).is_valid({**data, "runs": [{}]})


def test_every_class_of_a_result_says_in_the_schema_what_it_is() -> None:
    for name, schema in schemas().items():
        undescribed = [key for key, inner in schema["$defs"].items() if "description" not in inner]
        assert undescribed == [], name


def test_a_model_keeps_its_schema() -> None:
    value = Value(1.0, None, "s")
    model = Model(steering=SteeringPart(value, value, value, value), noise={"yaw_rate": SignalNoise(0.1)})
    check = validator("model")
    for written in (model, Model()):
        check.validate(YAML(typ="safe", pure=True).load(model_text(written)))
    assert not check.is_valid({"schema": "ident.model/1", "steering": {}})
