"""The recipe: one YAML file for the whole pipeline, checked whole before the first log is opened.

Each stage brings its own settings; this module only puts them together. Paths in a recipe are relative
to it; what the command line says comes before what the recipe says.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from ident.errors import UsageError
from ident.model_file import read_model
from ident.pipeline.options import RunOptions
from ident.stages.evaluate_settings import EvaluateSettings
from ident.stages.improve_settings import ImproveSettings
from ident.stages.inputs import InputSettings
from ident.stages.steering import SteeringSettings
from ident.stages.tyre_settings import TyresSettings
from ident.stages.validate_settings import ValidateSettings
from ident.yaml_file import check, read_yaml


class Recipe(InputSettings):
    """Which files apply to the logs and how they are read, then the settings of each stage."""

    steering: SteeringSettings = Field(default_factory=SteeringSettings)
    tyres: TyresSettings = Field(default_factory=TyresSettings)
    evaluate: EvaluateSettings = Field(default_factory=EvaluateSettings)
    improve: ImproveSettings = Field(default_factory=ImproveSettings)
    validation: ValidateSettings = Field(default_factory=ValidateSettings, alias="validate")

    def inputs(self) -> InputSettings:
        """Give what every stage needs to read the logs."""
        return InputSettings(**{name: getattr(self, name) for name in InputSettings.model_fields})


def recipe_for(options: RunOptions) -> Recipe:
    """Read the recipe that the options name, if any, and put the options over it.

    Raises
    ------
    BadRecipe
        If a key, a value or a unit is wrong, or a model that is to be compared cannot be read.
    """
    if options.recipe is None:
        recipe = check(Recipe, _said(options), "options")
    else:
        data = _relative_to(options.recipe.parent, read_yaml(options.recipe))
        recipe = check(Recipe, {**data, **_said(options)}, str(options.recipe))
    if options.against is not None:
        evaluate = recipe.evaluate.model_copy(update={"against": options.against})
        recipe = recipe.model_copy(update={"evaluate": evaluate})
    if recipe.evaluate.against is not None:
        read_model(recipe.evaluate.against)
    return _with_model(recipe, options)


def _with_model(recipe: Recipe, options: RunOptions) -> Recipe:
    """Put what the options say of the validation over the recipe."""
    said: dict[str, Any] = {} if options.model is None else {"model": options.model}
    said |= {"quick": True} if options.quick else {}
    validate = recipe.validation.model_copy(update=said)
    if validate.model is not None:
        read_model(validate.model)
    return recipe.model_copy(update={"validation": validate})


def _said(options: RunOptions) -> dict[str, Any]:
    """Give the settings that the command line says, under their names in a recipe."""
    said = {"channels": _channels(options.channels), "vehicle": options.vehicle, "seed": options.seed}
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
    for stage, key in (("evaluate", "against"), ("validate", "model")):
        said = data.get(stage)
        if isinstance(said, dict) and isinstance(said.get(key), str):
            placed[stage] = {**said, key: folder / said[key]}
    return placed


def _placed(folder: Path, channels: Any) -> Any:
    return folder / channels if isinstance(channels, str) and channels != "auto" else channels
