"""The artefacts of a run: ``<stage>.json``, ``model.yaml``, ``signals/*.parquet``, each whole or not there.

What a stage has made is sealed (``ident.pipeline.seal``): only what is as its seal says is ever read. JSON
holds SI values only and neither NaN nor infinity. ``model.yaml`` is put together from the sealed parts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from ident.model_file import Model, model_text, read_model
from ident.pipeline.files import atomic, plain, remove_left_behind
from ident.pipeline.lock import KEPT
from ident.pipeline.model import composed
from ident.pipeline.seal import MadeFrom, Seals
from ident.results import (
    SCHEMA_VERSION,
    EvaluateResult,
    ImproveResult,
    InfoResult,
    SteeringResult,
    TyresResult,
    ValidateResult,
)
from ident.stages.output import StageOutput

if TYPE_CHECKING:
    import pandas as pd

RESULTS: dict[str, type[Any]] = {
    "info": InfoResult,
    "steering": SteeringResult,
    "tyres": TyresResult,
    "evaluate": EvaluateResult,
    "improve": ImproveResult,
    "validate": ValidateResult,
}

_TABLE_NAME = re.compile(r"[a-z][a-z0-9_]*")


class Store:
    """The outputs in one folder, which is made when something is first written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.seals = Seals(folder)
        self._readers: dict[str, TypeAdapter[Any]] = {}

    @property
    def model_path(self) -> Path:
        """Where the model is kept, whether or not it has been written."""
        return self.folder / "model.yaml"

    def result_path(self, stage: str) -> Path:
        """Where a stage's result is kept, whether or not it has been written."""
        return self.folder / f"{stage}.json"

    def table_path(self, name: str) -> Path:
        """Where a table is kept, whether or not it has been written."""
        if not _TABLE_NAME.fullmatch(name):
            raise ValueError(f"table name {name!r}, need lower-case letters, digits and underscores")
        return self.folder / "signals" / f"{name}.parquet"

    def save(self, stage: str, output: StageOutput[Any], made_from: MadeFrom) -> None:
        """Store what a stage has made, in place of what it made before, and seal it.

        Raises
        ------
        ValueError
            If the result holds NaN or infinity, naming the field.
        BadRecipe
            If its part of the model could not be read again; nothing is written in either case.
        """
        text = result_text(output.result)
        tables = {self.table_path(name): table for name, table in output.tables.items()}
        if output.model is not None:
            composed({stage: output.model}, {stage: output.result.provenance})
        files = [*tables, self.result_path(stage)]
        self._make_way(stage, files)
        for path, table in tables.items():
            with atomic(path) as temporary:
                table.to_parquet(temporary, index=False)
        self._write_text(self.result_path(stage), text)
        self.seals.write(stage, made_from, files=files, data=output.model)
        self.write_model()

    def refuse(self, stage: str, reason: str, made_from: MadeFrom) -> None:
        """Keep in mind that a stage cannot answer; what it made of other data is removed."""
        self._make_way(stage, [])
        self.seals.write(stage, made_from, refused=reason)
        self.write_model()

    def read_result(self, stage: str) -> Any | None:
        """Read a stage's result into its class of ``ident.results``.

        None where there is none that is whole and as it was written, or where another version wrote it.
        """
        seal = self.seals.read(stage)
        if seal is None or seal.refused is not None:
            return None
        data = self.result_path(stage).read_bytes()
        try:
            if json.loads(data).get("schema_version") != SCHEMA_VERSION:
                return None
            return self._reader(stage).validate_json(data)
        except ValidationError:
            return None

    def read_tables(self, stage: str, names: Sequence[str]) -> dict[str, pd.DataFrame]:
        """Read those of the named tables that a stage has made."""
        import pandas as pd

        made = self.seals.files(stage)
        paths = {name: self.table_path(name) for name in names}
        return {name: pd.read_parquet(path) for name, path in paths.items() if path in made}

    def read_model(self) -> Model:
        """Read ``model.yaml``; an empty model where there is none."""
        return read_model(self.model_path) if self.model_path.is_file() else Model()

    def write_model(self) -> None:
        """Put ``model.yaml`` together from the parts that are sealed; without one there is no such file."""
        if not (parts := self._parts(list(RESULTS))):
            self.model_path.unlink(missing_ok=True)
            return
        text = model_text(self._composed(parts))
        if not self.model_path.is_file() or self.model_path.read_bytes() != text.encode():
            self._write_text(self.model_path, text)

    def model_of(self, stages: Sequence[str]) -> Model:
        """Put together what these stages have identified; an empty model where that is nothing."""
        return self._composed(self._parts(stages))

    def _parts(self, stages: Sequence[str]) -> dict[str, Any]:
        seals = {stage: self.seals.read(stage) for stage in RESULTS if stage in stages}
        return {
            stage: seal.data for stage, seal in seals.items() if seal is not None and seal.data is not None
        }

    def _composed(self, parts: dict[str, Any]) -> Model:
        made = {stage: json.loads(self.result_path(stage).read_bytes())["provenance"] for stage in parts}
        return composed(parts, made)

    def tidy(self) -> None:
        """Remove what a killed run had begun to write."""
        for folder in (self.folder, self.folder / "signals", self.folder / KEPT):
            remove_left_behind(folder)

    def _reader(self, stage: str) -> TypeAdapter[Any]:
        if stage not in self._readers:
            self._readers[stage] = TypeAdapter(RESULTS[stage])
        return self._readers[stage]

    def _make_way(self, stage: str, files: Sequence[Path]) -> None:
        """Remove what a stage made before and does not write again, then its seal."""
        for path in self.seals.files(stage):
            if path not in files:
                path.unlink(missing_ok=True)
        self.seals.remove(stage)

    def _write_text(self, path: Path, text: str) -> None:
        with atomic(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")


def result_text(result: Any) -> str:
    """Write a result as it is stored.

    Raises
    ------
    ValueError
        If it holds NaN or infinity, naming the field.
    """
    return f"{json.dumps(plain(result), allow_nan=False, indent=2, ensure_ascii=False)}\n"
