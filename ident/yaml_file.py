"""YAML files that a person writes: read as YAML 1.2 and checked whole, with errors that say what to mend.

YAML 1.2 means that ``1e-3`` is a number, ``10:30`` is text and ``on`` is text. An unknown key is an
error that names the nearest valid one, because a key that is misspelt and ignored is worse than none.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from pydantic import BaseModel, TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from ident.errors import BadRecipe

Checked = TypeVar("Checked")


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises
    ------
    BadRecipe
        If the file cannot be read, is not YAML, repeats a key, or holds something else than a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise BadRecipe(f"{path}: cannot be read: {reason}") from error
    try:
        data = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        raise BadRecipe(f"{path}: {_yaml_problem(error)}") from error
    except ValueError as error:  # what looks like a date, and is none
        raise BadRecipe(f"{path}: holds a value that cannot be: {error}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise BadRecipe(f"{path}: holds {type(data).__name__}, need a mapping such as 'seed: 1'")
    return data


def check(kind: type[Checked], data: Mapping[str, Any], source: str) -> Checked:
    """Turn what a file holds into ``kind``, a pydantic model or a dataclass.

    Parameters
    ----------
    source : what the error message begins with, mostly the path of the file

    Raises
    ------
    BadRecipe
        For the first thing that is wrong: where it stands, what it is, what is needed.
    """
    try:
        return TypeAdapter(kind).validate_python(dict(data))
    except ValidationError as error:
        raise BadRecipe(f"{source}: {_first_problem(kind, error)}") from error


def nearest(key: str, valid: Collection[str]) -> str:
    """Say which valid key is meant: "did you mean 'gain'?", or all of them where none is near."""
    close = difflib.get_close_matches(key, list(valid), n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else f"valid: {', '.join(sorted(valid))}"


def _yaml_problem(error: YAMLError) -> str:
    if not isinstance(error, MarkedYAMLError):
        return f"is not YAML: {' '.join(str(error).split())}"
    mark = error.problem_mark or error.context_mark
    where = f"line {mark.line + 1}: " if mark else ""
    return f"{where}is not YAML: {' '.join(str(error.problem or error.context).split())}"


def _first_problem(kind: type[Any], error: ValidationError) -> str:
    # An unknown key explains the missing one beside it, so it is told first.
    found = error.errors(include_url=False)
    first = next((item for item in found if _is_unknown(item["type"])), found[0])
    # pydantic puts the branch of a union that it tried, such as literal['auto'], into the place.
    where = ".".join(str(part) for part in first["loc"] if not str(part).endswith("]"))
    if _is_unknown(first["type"]):
        *above, key = first["loc"]
        return f"unknown key '{where}': {nearest(str(key), _fields_at(kind, above))}"
    if first["type"] in {"missing", "missing_argument"}:
        return f"'{where}' is missing"
    message = first["msg"].removeprefix("Value error, ")
    given = "" if first["type"] == "value_error" else f", not {_short(first['input'])}"
    return f"{where}: {message[:1].lower()}{message[1:]}{given}" if where else f"{message}{given}"


def _is_unknown(error_type: str) -> bool:
    return error_type in {"extra_forbidden", "unexpected_keyword_argument"}


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _fields_at(kind: Any, location: list[int | str]) -> list[str]:
    """Names of the keys that are valid at ``location``; a list index or a free key changes nothing."""
    for part in location:
        kind = _fields_in(kind).get(str(part), kind)
    return list(_fields_in(kind))


def _fields_in(kind: Any) -> dict[str, Any]:
    """Keys of the models and dataclasses that an annotation such as ``dict[str, Entry] | None`` holds."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
    if isinstance(kind, type) and is_dataclass(kind):
        return get_type_hints(kind)
    return {name: inner for part in get_args(kind) for name, inner in _fields_in(part).items()}
