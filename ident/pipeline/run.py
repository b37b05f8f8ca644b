"""Run stages: recipe -> stages -> stored outputs -> report and recording, drawn from what is stored."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from ident.errors import IdentError, NotIdentifiable, RequirementNotMet, UsageError
from ident.pipeline.draw import draw
from ident.pipeline.job import Job, Step, describe_steps, plain_steps
from ident.pipeline.lock import locked
from ident.pipeline.options import Progress, RunOptions, command_line
from ident.pipeline.output_folder import output_folder
from ident.pipeline.recipe import Recipe, recipe_for
from ident.pipeline.stages import STAGES
from ident.pipeline.store import Store
from ident.stages.output import Context


@dataclass(frozen=True)
class Outcome:
    """What was left behind.

    summary : for the terminal: the answer, and what to do next
    json : the text that ``--json`` prints
    error : what is said at the end, when all is stored and drawn
    """

    summary: str
    json: str
    report: Path
    error: IdentError | None = None


def run_stage(stage: str, logs: Sequence[Path], options: RunOptions, progress: Progress) -> Outcome:
    """Run a stage on logs, store what it returns, and draw the report of all that is stored there.

    What it needs first comes from the store where that is up to date, else it is run.

    Raises
    ------
    IdentError
        With one line for the user; the stage has written nothing then unless it says so.
    """
    with _job(stage, logs, options, progress) as job:
        if "split" in STAGES[stage].settings:
            job.check_split()
        if STAGES[stage].needs and not STAGES[stage].given(job.recipe):
            job.materialise_split()
        job.bring(stage, again=True)
        draw(job.store, stage, progress)
        result = job.store.read_result(stage)
        return Outcome(
            summary="\n".join([*_told_before(job, stage), STAGES[stage].describe(result)]),
            json=job.store.result_path(stage).read_text(encoding="utf-8"),
            report=job.store.folder / "index.html",
            error=_requirements([stage], job.store),
        )


def run_recipe(recipe: Path, logs: Sequence[Path], options: RunOptions, progress: Progress) -> Outcome:
    """Run all stages that there are, in their order, but for those that are up to date.

    A stage that cannot answer stops no other.

    Raises
    ------
    IdentError
        With one line for the user: a wrong recipe before any log is opened.
    """
    with _job("run", logs, _with_recipe(options, recipe), progress) as job:
        job.check_split()
        job.materialise_split()
        for stage in STAGES:
            job.bring(stage)
        answered = [step.stage for step in job.steps.values() if step.state != "refused"]
        drawn = draw(job.store, answered[-1] if answered else next(iter(STAGES)), progress)
        steps = list(job.steps.values())
        return Outcome(
            summary=_summary(job.store, steps, drawn=drawn),
            json=json.dumps({"stages": plain_steps(steps)}, indent=2, ensure_ascii=False) + "\n",
            report=job.store.folder / "index.html",
            error=_nothing_identified(steps) or _requirements(answered, job.store),
        )


@contextmanager
def _job(command: str, logs: Sequence[Path], options: RunOptions, progress: Progress) -> Iterator[Job]:
    """Give what is to be done, with the output folder locked and the inputs looked at."""
    recipe = recipe_for(options)
    folder = output_folder(options.out, logs or [_model_alone(command, recipe)])
    with locked(folder):
        context = Context(
            command=command_line(command, logs, options),
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            seed=recipe.seed,
            progress=progress,
            jobs=options.jobs or processors(),
        )
        job = Job(Store(folder), logs, recipe, context)
        job.prepare()
        yield job


def _model_alone(command: str, recipe: Recipe) -> Path:
    """Give the model that stands in for logs, where none are named."""
    model = recipe.validation.model
    if command != "validate" or model is None:
        raise UsageError(f"ident {command} without LOGS: name logs, or a model.yaml with --model")
    return model


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _with_recipe(options: RunOptions, recipe: Path) -> RunOptions:
    return replace(options, recipe=recipe)


def _told_before(job: Job, stage: str) -> list[str]:
    """Say what became of the stages that this one uses, and what was left out of the report."""
    told = [
        f"{name}: left out of the report, what was stored is not as it was written: run `ident {name}` again"
        for name in STAGES
        if job.store.seals.is_broken(name)
    ]
    before = [step for name, step in job.steps.items() if name != stage]
    told += [describe_steps(before)] if before else []
    return [*told, ""] if told else []


def _summary(store: Store, steps: Sequence[Step], *, drawn: bool) -> str:
    lines = [describe_steps(steps), f"report: {'done' if drawn else 'up to date'}"]
    for step in steps:
        result = store.read_result(step.stage)
        verdict = getattr(result, "told", None) or getattr(result, "verdict", None)
        if step.state != "refused" and verdict:
            lines += ["", f"{STAGES[step.stage].title}: {verdict}"]
    return "\n".join(lines)


def _nothing_identified(steps: Sequence[Step]) -> NotIdentifiable | None:
    asked = [step for step in steps if STAGES[step.stage].identifies]
    if any(step.state != "refused" for step in asked):
        return None
    told = "; ".join(f"{step.stage}: {step.text}" for step in asked if not STAGES[step.stage].needs)
    return NotIdentifiable(f"no stage can answer from these logs: {told}")


def _requirements(stages: Sequence[str], store: Store) -> RequirementNotMet | None:
    unmet = [line for stage in stages for line in STAGES[stage].unmet(store.read_result(stage))]
    return RequirementNotMet(*unmet) if unmet else None
