"""`ident info`: what is in the logs, which signals they give, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ident.results import SCHEMA_VERSION, InfoResult
from ident.stages.inputs import InputSettings, load, provenance
from ident.stages.output import Context, StageOutput


def info(logs: Sequence[Path], inputs: InputSettings, context: Context) -> StageOutput[InfoResult]:
    """Read every log, and say what it holds and what it has lost.

    Raises
    ------
    UnusableLog
        If there is no log, or none of them can be read.
    """
    loaded = load(logs, inputs, context, every_topic=True)
    return StageOutput(
        InfoResult(
            schema_version=SCHEMA_VERSION,
            provenance=provenance(context, loaded),
            runs=[run.health for run in loaded.runs],
            unreadable=loaded.unreadable,
            warnings=loaded.warnings,
        )
    )
