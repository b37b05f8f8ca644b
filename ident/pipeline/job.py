"""One run on one output folder: each stage is brought up to date, and computed only where it is not.

A stage is up to date where its seal is whole and says that it was made from the same: code, files, settings
and results of the stages that it uses. That it cannot answer is kept in mind in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from ident.errors import BadRecipe, NotIdentifiable
from ident.pipeline.files import plain
from ident.pipeline.hashes import Hashes, code_version
from ident.pipeline.recipe import Recipe
from ident.pipeline.seal import MadeFrom
from ident.pipeline.stages import STAGES, Stage
from ident.pipeline.store import Store
from ident.stages.inputs import SplitSettings
from ident.stages.output import Context

State = Literal["done", "up to date", "refused"]
SPLIT = "split"
DECIDE_ON_SPLIT = ("split", "tyres")


@dataclass(frozen=True)
class Step:
    """What became of one stage; ``text`` says why it was computed, or why it cannot answer."""

    stage: str
    state: State
    text: str = ""


@dataclass
class Job:
    """What is asked; ``prepare`` it, then ``bring`` stages up to date in their order."""

    store: Store
    logs: Sequence[Path]
    recipe: Recipe
    context: Context
    hashes: Hashes = field(default_factory=Hashes)
    steps: dict[str, Step] = field(default_factory=dict)
    _files: dict[str, str] = field(default_factory=dict)
    _runs: list[str] = field(default_factory=list)

    def prepare(self) -> None:
        """Look at all files that decide on the results, and remove what a killed run had begun.

        Without logs, where a stage takes a model instead, there is nothing to look at.

        Raises
        ------
        UnusableLog
            If there is no log.
        BadRecipe
            If a vehicle file is wrong, or the recipe names no run.
        """
        from ident.stages.input_files import input_files

        self.store.tidy()
        if not self.logs:
            return
        listed = input_files(self.logs, self.recipe.inputs())
        for number, file in enumerate(listed):
            self.context.progress("looking for changes", number, len(listed))
            self._files[plain(f"{file.run}: {file.name}")] = self.hashes.of(file.path)
        self._runs = list(dict.fromkeys(file.run for file in listed))
        self.hashes.save()

    def check_split(self) -> None:
        """Raise ``BadRecipe`` where the recipe says what is held out, and that is nothing."""
        split = self.recipe.split
        held_out = [run for run in self._runs if split.holds_out(run) or split.block_of(run)]
        if split.is_stated and not held_out:
            said = ", ".join([*(split.held_out or ()), *(split.blocks or ())])
            raise BadRecipe(f"split: {said} names no run: the runs are {', '.join(self._runs)}")

    def materialise_split(self) -> None:
        """State in full what is held out, where the recipe does not: drawn once, for all stages alike."""
        if self.recipe.split.is_stated:
            return
        from ident.stages.split import drawn_split

        made_from = self._made_from(DECIDE_ON_SPLIT, {})
        seal = self.store.seals.read(SPLIT)
        if seal is not None and seal.made_from == made_from and seal.data is not None:
            split = SplitSettings.from_stored(seal.data)
        else:
            split = drawn_split(self.logs, self.recipe.inputs(), self.recipe.tyres, self.context)
            self.store.seals.write(SPLIT, made_from, data=split.model_dump(mode="json"))
        self.recipe = self.recipe.model_copy(update={"split": split})

    def bring(self, name: str, *, again: bool = False) -> Step:
        """Bring a stage up to date, after those that it uses.

        Parameters
        ----------
        again : compute it even where it is up to date
        """
        if name not in self.steps or again:
            stage = STAGES[name]
            if not stage.given(self.recipe):
                for other in (*stage.helped_by, *stage.needs):
                    self.bring(other)
            self.steps[name] = self._brought(name, stage, again=again)
        return self.steps[name]

    def _brought(self, name: str, stage: Stage, *, again: bool) -> Step:
        made_from = self.made_from(name)
        seal = self.store.seals.read(name)
        if not again and seal is not None and seal.made_from == made_from:
            if seal.refused is not None:
                return Step(name, "refused", seal.refused)
            return Step(name, "up to date")
        why = self._why_again(name, made_from)
        try:
            self._refuse_without(stage)
            used = self._used(stage)
            results = {other: self.store.read_result(other) for other in used}
            models = {other: self.store.model_of(used[: place + 1]) for place, other in enumerate(used)}
            output = stage.run(self.logs, self.recipe, replace(self.context, models=models), results)
        except NotIdentifiable as error:
            if again:
                raise
            self.store.refuse(name, str(error), made_from)
            return Step(name, "refused", str(error))
        self.store.save(name, output, made_from)
        return Step(name, "done", why)

    def made_from(self, name: str) -> MadeFrom:
        """Say what decides on the result of a stage; those that it uses are up to date."""
        stage = STAGES[name]
        needs = {other: self._digest(other) for other in self._used(stage)}
        more = {what: self.hashes.of(path) for what, path in stage.reads(self.recipe).items()}
        return self._made_from(stage.settings, needs, more)

    def _used(self, stage: Stage) -> list[str]:
        """Stages whose results a stage is given, those that it needs first."""
        if stage.given(self.recipe):
            return []
        taken = [other for other in stage.takes if self._is_up_to_date(other)]
        return [*stage.needs, *stage.helped_by, *taken]

    def _is_up_to_date(self, name: str) -> bool:
        seal = self.store.seals.read(name)
        return seal is not None and seal.refused is None and seal.made_from == self.made_from(name)

    def _made_from(
        self, keys: Sequence[str], needs: dict[str, str | None], more: dict[str, str] | None = None
    ) -> MadeFrom:
        said = self.recipe.model_dump(mode="json", include={"align", "runs", "seed", *keys})
        version = code_version(of_results=True)
        return MadeFrom(version, {**self._files, **(more or {})}, plain(said), needs)

    def _digest(self, name: str) -> str | None:
        seal = self.store.seals.read(name)
        return None if seal is None else seal.made_from.digest

    def _why_again(self, name: str, made_from: MadeFrom) -> str:
        if self.store.seals.is_broken(name):
            return "what was stored is not as it was written"
        seal = self.store.seals.read(name)
        return "" if seal is None else made_from.changes(seal.made_from)

    def _refuse_without(self, stage: Stage) -> None:
        for other in () if stage.given(self.recipe) else stage.needs:
            if self.steps[other].state == "refused":
                raise NotIdentifiable(f"needs `ident {other}`, which cannot answer: {self.steps[other].text}")


def describe_steps(steps: Sequence[Step]) -> str:
    """Say what became of each stage, one line each."""
    return "\n".join(f"{step.stage}: {_told(step)}" for step in steps)


def _told(step: Step) -> str:
    if step.state == "refused":
        return f"no answer: {step.text}"
    return f"{step.state}, {step.text}" if step.text else step.state


def plain_steps(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """Return the steps as JSON can hold them."""
    return [asdict(step) for step in steps]
