from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field, field_validator

from ident.errors import BadRecipe
from ident.yaml_file import check, nearest, read_yaml


class Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")

    topic: str
    take_as: str = Field(default="", alias="as")

    @field_validator("topic")
    @classmethod
    def begins_with_slash(cls, value: str) -> str:
        if not value.startswith("/"):
            raise ValueError(f"topic {value} does not begin with /")
        return value


@dataclass(frozen=True)
class Part:
    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 -- pydantic reads it from the class

    rate: float


@dataclass(frozen=True)
class Whole:
    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    seed: int = 0
    entries: dict[str, Entry] = field(default_factory=dict)
    parts: list[Part] | None = None


def problem(data: dict[str, object]) -> str:
    with pytest.raises(BadRecipe) as raised:
        check(Whole, data, "recipe.yaml")
    return str(raised.value)


def write(folder: Path, text: str) -> Path:
    path = folder / "file.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_reads_yaml_1_2(tmp_path: Path) -> None:
    path = write(tmp_path, "a: 1e-3\nb: 10:30\nc: on\nd: 010\n")
    assert read_yaml(path) == {"a": 0.001, "b": "10:30", "c": "on", "d": 10}


def test_an_empty_file_is_an_empty_mapping(tmp_path: Path) -> None:
    assert read_yaml(write(tmp_path, "# nothing said\n")) == {}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: [1\nb: 2", "line 2: is not YAML"),
        ("a: 1\na: 2", 'line 2: is not YAML: found duplicate key "a"'),
        ("- 1", "holds list, need a mapping"),
        ("just words", "holds str, need a mapping"),
        ("a: !!python/object/apply:os.getcwd []", "line 1: is not YAML: could not determine a constructor"),
    ],
)
def test_says_what_is_wrong_with_a_file_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(BadRecipe) as raised:
        read_yaml(path)
    assert str(raised.value).startswith(f"{path}: {expected}")
    assert "\n" not in str(raised.value)


def test_says_why_a_file_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match=r"none\.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "none.yaml")
    with pytest.raises(BadRecipe, match="cannot be read: Is a directory"):
        read_yaml(tmp_path)
    (tmp_path / "latin.yaml").write_bytes(b"a: \xe9\n")
    with pytest.raises(BadRecipe, match="cannot be read: it is not UTF-8 text"):
        read_yaml(tmp_path / "latin.yaml")


def test_gives_the_checked_object() -> None:
    whole = check(
        Whole, {"seed": 3, "entries": {"speed": {"topic": "/v", "as": "x"}}, "parts": [{"rate": 2}]}, "x"
    )
    assert whole == Whole(3, {"speed": Entry.model_validate({"topic": "/v", "as": "x"})}, [Part(2.0)])


def test_names_the_nearest_key_at_each_depth() -> None:
    assert problem({"sed": 1}) == "recipe.yaml: unknown key 'sed': did you mean 'seed'?"
    assert "unknown key 'entries.speed.topics': did you mean 'topic'?" in problem(
        {"entries": {"speed": {"topics": "/v"}}}
    )
    assert "unknown key 'parts.0.rat': did you mean 'rate'?" in problem({"parts": [{"rat": 1}]})


def test_names_an_alias_and_not_the_field_behind_it() -> None:
    message = problem({"entries": {"speed": {"topic": "/v", "ass": "yaw"}}})
    assert "unknown key 'entries.speed.ass': did you mean 'as'?" in message


def test_lists_the_valid_keys_where_none_is_near() -> None:
    assert problem({"colour": 1}).endswith("unknown key 'colour': valid: entries, parts, seed")
    assert nearest("gian", ["gain", "dead_time"]) == "did you mean 'gain'?"


def test_gives_the_value_found_and_the_kind_needed() -> None:
    assert problem({"seed": "many"}).startswith("recipe.yaml: seed: input should be a valid integer")
    assert problem({"seed": "many"}).endswith("not 'many'")
    assert problem({"parts": [{}]}) == "recipe.yaml: 'parts.0.rate' is missing"


def test_gives_a_validators_own_message() -> None:
    message = problem({"entries": {"speed": {"topic": "v"}}})
    assert message == "recipe.yaml: entries.speed.topic: topic v does not begin with /"


def test_a_date_that_cannot_be_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "channels.yaml"
    path.write_text("since: 2025-13-01\n", encoding="utf-8")
    with pytest.raises(BadRecipe, match=r"channels\.yaml: holds a value that cannot be: month must be in"):
        read_yaml(path)
