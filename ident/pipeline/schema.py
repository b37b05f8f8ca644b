"""JSON Schemas of the outputs, generated from their classes.

Written by ``python -m ident.pipeline.schema docs/schema``; the descriptions are the classes' docstrings.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from ident.model_file import Model
from ident.pipeline.files import atomic
from ident.pipeline.store import RESULTS

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schemas() -> dict[str, dict[str, Any]]:
    """Give the schema of each output by its name: "steering" is that of ``steering.json``."""
    return {name: _schema(kind) for name, kind in {**RESULTS, "model": Model}.items()}


def schema_text(schema: dict[str, Any]) -> str:
    """Write a schema as it is committed."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def main(folder: Path) -> None:
    """Write ``<name>.schema.json`` for every output."""
    for name, schema in schemas().items():
        with atomic(folder / f"{name}.schema.json") as path:
            path.write_text(schema_text(schema), encoding="utf-8", newline="\n")


class _Described(GenerateJsonSchema):
    """A name that only repeats the key is left out."""

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002 -- pydantic calls it so
        return False


class _AsWritten(_Described):
    """Every field of a result is always written, so every one is required."""

    def field_is_required(self, field: Any, total: bool) -> bool:  # noqa: ARG002 -- pydantic calls it so
        return True


def _schema(kind: type[Any]) -> dict[str, Any]:
    # The model file leaves out what it does not have, and a person may leave out what has a default.
    generator = _Described if kind is Model else _AsWritten
    schema = TypeAdapter(kind).json_schema(mode="serialization", schema_generator=generator)
    return {"$schema": DIALECT, **schema}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
