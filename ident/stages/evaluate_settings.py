"""Settings of the evaluation, apart from the stage so that reading a recipe loads no model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from ident.errors import BadRecipe
from ident.glossary import SIGNALS
from ident.results import ModelName
from ident.units import parse_quantity
from ident.yaml_file import nearest

SIGNALS_JUDGED = (
    "position_x",
    "position_y",
    "heading",
    "lateral_velocity",
    "yaw_rate",
    "lateral_acceleration",
    "road_wheel_angle",
)
UNITS = {name: SIGNALS[name].unit for name in SIGNALS_JUDGED}
ACCEPTABLE = {
    "position_x": 0.3,
    "position_y": 0.3,
    "heading": 0.01,
    "lateral_velocity": 0.1,
    "yaw_rate": 0.01,
    "lateral_acceleration": 0.3,
}
TOLERANCE = 0.1


def _limits(value: Any) -> Any:
    """Read signal -> quantity, each in the unit of its signal."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{value!r} is no mapping, need such as {{yaw_rate: 0.02 rad/s}}")  # noqa: TRY004 pydantic
    made = {}
    for name, limit in value.items():
        if name not in UNITS:
            raise ValueError(f"unknown signal {name!r}: {nearest(str(name), list(UNITS))}")
        try:
            made[name] = parse_quantity(limit, unit=UNITS[name], quantity=name)
        except BadRecipe as error:
            raise ValueError(str(error)) from error
        if made[name] <= 0:
            raise ValueError(f"{name}: {limit!r} is not positive")
    return made


Limits = Annotated[dict[str, float], BeforeValidator(_limits)]


class EvaluateSettings(BaseModel):
    """Settings of this stage.

    models : which are evaluated, all that there are unless said
    require : signal -> largest rms over whole held-out runs with measured steering; not met is exit code 5
    acceptable : signal -> rms over windows of 2 s up to which a model is good enough
    tolerance : relative difference between measured and simulated characteristics
    against : another model.yaml, compared on the same runs
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    models: Annotated[list[ModelName], Field(min_length=1)] | None = None
    require: Limits = Field(default_factory=dict)
    acceptable: Limits = Field(default_factory=lambda: dict(ACCEPTABLE))
    tolerance: Annotated[float, Field(gt=0)] = TOLERANCE
    against: Path | None = None
