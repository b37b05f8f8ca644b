"""The folder of a run's outputs: ``<stage>.json``, ``model.yaml``, ``signals/*.parquet``.

A file appears whole or not at all: it is written beside its final name, forced to the disk, then
renamed. JSON holds SI values only and neither NaN nor infinity.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import re
import secrets
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from ident.errors import BadRecipe, UsageError
from ident.model_file import Model, model_from, model_text, read_model
from ident.results import SCHEMA_VERSION, InfoResult, Provenance, SteeringResult, TyresResult

if TYPE_CHECKING:
    import pandas as pd

RESULTS: dict[str, type[Any]] = {"info": InfoResult, "steering": SteeringResult, "tyres": TyresResult}

_LOG_SUFFIXES = {".mcap", ".db3", ".bag", ".zstd"}
_TABLE_NAME = re.compile(r"[a-z][a-z0-9_]*")


class Store:
    """The outputs in one folder, which is made when something is first written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def model_path(self) -> Path:
        """Where the model is kept, whether or not it has been written."""
        return self.folder / "model.yaml"

    def result_path(self, stage: str) -> Path:
        """Where a stage's result is kept, whether or not it has been written."""
        return self.folder / f"{stage}.json"

    def write_result(self, stage: str, result: Any) -> Path:
        """Write ``<stage>.json``.

        Raises
        ------
        ValueError
            If the result holds NaN or infinity, naming the field.
        """
        text = json.dumps(plain(result), allow_nan=False, indent=2, ensure_ascii=False)
        return self._write_text(self.result_path(stage), f"{text}\n")

    def read_result(self, stage: str) -> Any | None:
        """Read a stage's result into its class of ``ident.results``; None where this version wrote none."""
        path = self.result_path(stage)
        if not path.is_file():
            return None
        data = path.read_bytes()
        try:
            if json.loads(data).get("schema_version") != SCHEMA_VERSION:
                return None
            return TypeAdapter(RESULTS[stage]).validate_json(data)
        except (ValueError, AttributeError, ValidationError) as error:
            raise BadRecipe(f"{path}: is not a result of ident: remove it and run the stage again") from error

    def write_tables(self, tables: Mapping[str, pd.DataFrame]) -> None:
        """Write ``signals/<name>.parquet`` for each table."""
        for name, table in tables.items():
            if not _TABLE_NAME.fullmatch(name):
                raise ValueError(f"table name {name!r}, need lower-case letters, digits and underscores")
            with atomic(self.folder / "signals" / f"{name}.parquet") as path:
                table.to_parquet(path, index=False)

    def read_tables(self, names: Sequence[str]) -> dict[str, pd.DataFrame]:
        """Read those of the named tables that exist."""
        import pandas as pd

        paths = {name: self.folder / "signals" / f"{name}.parquet" for name in names}
        return {name: pd.read_parquet(path) for name, path in paths.items() if path.is_file()}

    def read_model(self) -> Model:
        """Read ``model.yaml``; an empty model where there is none."""
        return read_model(self.model_path) if self.model_path.is_file() else Model()

    def write_model(self, stage: str, part: Mapping[str, Any], provenance: Provenance) -> Path:
        """Put what a stage has identified into ``model.yaml`` and keep what other stages wrote there.

        A key of ``part`` replaces that key as a whole, but for ``noise`` (signal by signal) and the
        covariance: parameters of other parts than those in ``part`` stay, as fitted independently of them.
        """
        known = {key: value for key, value in plain(self.read_model()).items() if value not in (None, {}, [])}
        new = plain(part)
        merged = {
            **known,
            **new,
            "noise": known.get("noise", {}) | new.get("noise", {}),
            "provenance": known.get("provenance", {}) | {stage: plain(provenance)},
            **_covariances(known, new),
        }
        model = model_from(merged, f"model of {stage}")
        return self._write_text(self.model_path, model_text(model))

    def _write_text(self, path: Path, text: str) -> Path:
        with atomic(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
        return path


def _covariances(known: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Put the covariance of what a stage has fitted after that of the parts it did not touch.

    A parameter belongs to the part that its name begins with: "tyres.front.cornering_stiffness" to "tyres".
    """
    before, after = known.get("parameters", []), new.get("parameters", [])
    kept = [
        index for index, name in enumerate(before) if name.partition(".")[0] not in new and name not in after
    ]
    rows = [[known["covariance"][i][j] for j in kept] + [0.0] * len(after) for i in kept]
    rows += [[0.0] * len(kept) + list(row) for row in new.get("covariance", [])]
    return {"parameters": [*(before[i] for i in kept), *after], "covariance": rows}


@contextlib.contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; what was written there becomes ``path`` at the end.

    Raises
    ------
    UsageError
        If the folder cannot be made or written, saying why.
    """
    temporary = path.with_name(f".{secrets.token_hex(6)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb+") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"cannot write {path}: {reason}: give another folder with --out") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def plain(value: Any, where: str = "") -> Any:
    """Turn dataclasses and mappings into what JSON can hold, refusing NaN and infinity by their place.

    Text that is not valid Unicode (the name of a file with stray bytes) gets its strays written out.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: plain(inner, f"{where}.{name}") for name, inner in fields}
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(inner, f"{where}.{key}") for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner, f"{where}[{index}]") for index, inner in enumerate(value)]
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{where.removeprefix('.')} is {value}, need a finite number or None")
    return value


def output_folder(out: Path | None, logs: Sequence[Path]) -> Path:
    """Choose the folder of the outputs and check it, before any work.

    Raises
    ------
    UsageError
        If outputs would come to lie beside the logs or in place of files that are not ours.
    """
    folder = out if out is not None else Path("reports") / name_of(logs)
    _refuse_folder_of_logs(folder, logs)
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder} is a file: name a folder")
    ours = any((folder / f"{stage}.json").is_file() for stage in RESULTS)
    foreign = [name for name in ("index.html", "model.yaml", "run.rrd") if (folder / name).exists()]
    if foreign and not ours:
        raise UsageError(f"--out {folder} holds another {foreign[0]}: name a new or empty folder")
    return folder


def name_of(logs: Sequence[Path]) -> str:
    """Name the outputs after the logs: "sample_logs", or "run_1_and_2_more"."""
    path = logs[0].resolve()
    name = (path.name if path.is_dir() else path.stem) or "logs"
    return name if len(logs) == 1 else f"{name}_and_{len(logs) - 1}_more"


def _refuse_folder_of_logs(folder: Path, logs: Sequence[Path]) -> None:
    resolved = folder.resolve()
    beside = {path.resolve() if path.is_dir() else path.resolve().parent for path in logs}
    if resolved in beside or _holds_log(resolved):
        raise UsageError(f"the outputs would lie beside the logs in {folder}: name another folder with --out")
    refuse_inside_a_log(folder)


def refuse_inside_a_log(folder: Path) -> None:
    """Raise ``UsageError`` if a folder is, or lies inside, a rosbag2 folder: nothing is written there."""
    resolved = folder.resolve()
    for parent in (resolved, *resolved.parents):
        if (parent / "metadata.yaml").is_file() and _holds_log(parent):
            raise UsageError(f"{folder} lies inside the log {parent.name}: name another folder with --out")


def _holds_log(folder: Path) -> bool:
    return folder.is_dir() and any(path.suffix in _LOG_SUFFIXES for path in folder.iterdir())
