"""Run one stage: recipe -> stage -> stored outputs -> report and recording, drawn from what is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.pipeline.options import Progress, RunOptions, command_line
from ident.pipeline.recipe import recipe_for
from ident.pipeline.stages import STAGES
from ident.pipeline.store import Store, atomic, output_folder
from ident.report.html import write_report
from ident.stages.output import Context, StageOutput

if TYPE_CHECKING:
    from ident.report.recording import Part


@dataclass(frozen=True)
class Outcome:
    """What a stage left behind.

    summary : for the terminal: the answer, and what to do next
    """

    summary: str
    json: Path
    report: Path


def run_stage(stage: str, logs: Sequence[Path], options: RunOptions, progress: Progress) -> Outcome:
    """Run a stage on logs, store what it returns, and draw the report of all that is stored there.

    Raises
    ------
    IdentError
        With one line for the user; nothing is written then unless it says so.
    """
    recipe = recipe_for(options)
    store = Store(output_folder(options.out, logs))
    context = Context(
        command=command_line(stage, logs, options),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        seed=recipe.seed,
        progress=progress,
    )
    output = STAGES[stage].run(logs, recipe, context)
    save(store, stage, output)
    progress("drawing the report", 0, 1)
    report = draw(store, stage)
    return Outcome(STAGES[stage].describe(output.result), store.result_path(stage), report)


def save(store: Store, stage: str, output: StageOutput[Any]) -> None:
    """Store a stage's tables, its part of the model, and last its result, which says that all is there."""
    store.write_tables(output.tables)
    if output.model is not None:
        store.write_model(stage, output.model, output.result.provenance)
    store.write_result(stage, output.result)


def draw(store: Store, shown: str) -> Path:
    """Draw the report and the recording from what is stored, both opening at the stage ``shown``.

    The recording is drawn anew where the stage ``shown`` has a part in it; it holds those of all stages.
    """
    pages, recorded = [], []
    for name, stage in STAGES.items():
        result = store.read_result(name)
        if result is None:
            continue
        tables = store.read_tables(stage.tables)
        pages.append(stage.page(result, tables))
        if stage.record is not None and STAGES[shown].record is not None:
            recorded.append(stage.record(result, tables))
    if recorded:
        _write_recording(store, recorded, shown)
    return write_report(store.folder, pages, shown)


def _write_recording(store: Store, parts: Sequence[Part], shown: str) -> None:
    from ident.report.recording import write_recording

    with atomic(store.folder / "run.rrd") as path:
        write_recording(path, parts, shown)
