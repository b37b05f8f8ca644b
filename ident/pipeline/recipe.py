"""The recipe: one YAML file for the whole pipeline, checked whole before the first log is opened.

Each stage brings its own settings; this module only puts them together. Paths in a recipe are relative
to it; what the command line says comes before what the recipe says.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from ident.errors import UsageError
from ident.pipeline.options import RunOptions
from ident.stages.inputs import InputSettings
from ident.stages.steering import SteeringSettings
from ident.stages.tyre_settings import TyresSettings
from ident.yaml_file import check, read_yaml


class Recipe(InputSettings):
    """Which files apply to the logs and how they are read, then the settings of each stage."""

    steering: SteeringSettings = Field(default_factory=SteeringSettings)
    tyres: TyresSettings = Field(default_factory=TyresSettings)

    def inputs(self) -> InputSettings:
        """Give what every stage needs to read the logs."""
        return InputSettings(**{name: getattr(self, name) for name in InputSettings.model_fields})


def recipe_for(options: RunOptions) -> Recipe:
    """Read the recipe that the options name, if any, and put the options over it.

    Raises
    ------
    BadRecipe
        If a key, a value or a unit is wrong.
    """
    if options.recipe is None:
        return check(Recipe, _said(options), "options")
    data = _relative_to(options.recipe.parent, read_yaml(options.recipe))
    return check(Recipe, {**data, **_said(options)}, str(options.recipe))


def _said(options: RunOptions) -> dict[str, Any]:
    """Give the settings that the command line says, under their names in a recipe."""
    said = {"channels": _channels(options.channels), "vehicle": options.vehicle}
    return {name: value for name, value in said.items() if value is not None}


def _channels(said: tuple[str, ...]) -> str | list[str] | None:
    if "auto" not in said:
        return list(said) or None
    if len(said) > 1:
        raise UsageError(f"--channels auto with {len(said) - 1} more: name either auto or files")
    return "auto"


def _relative_to(folder: Path, data: dict[str, Any]) -> dict[str, Any]:
    """Make the paths of a recipe relative to its folder; what is no path is left for the check to refuse."""
    placed = dict(data)
    if isinstance(data.get("vehicle"), str):
        placed["vehicle"] = folder / data["vehicle"]
    channels = data.get("channels")
    if isinstance(channels, list):
        placed["channels"] = [_placed(folder, name) for name in channels]
    elif channels is not None:
        placed["channels"] = _placed(folder, channels)
    return placed


def _placed(folder: Path, channels: Any) -> Any:
    return folder / channels if isinstance(channels, str) and channels != "auto" else channels
