"""Settings of the validation, apart from the stage so that reading a recipe loads no model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from ident.errors import BadRecipe
from ident.results.validate import ControllerName, ScenarioName
from ident.stages.evaluate_settings import ACCEPTABLE as OF_MOTION
from ident.stages.evaluate_settings import Limits
from ident.stages.inputs import quantity
from ident.units import parse_quantity
from ident.yaml_file import nearest

CONTROLLERS: tuple[ControllerName, ...] = get_args(ControllerName)
SCENARIOS: tuple[ScenarioName, ...] = tuple(name for name in get_args(ScenarioName) if name != "logged")
MISMATCH: dict[str, tuple[float, ...]] = {
    "mass": (-0.4, 0.3),
    "stiffness": (-0.3, 0.3),
    "friction": (0.5,),
    "dead_time": (-0.1, 0.1, 0.2),
    "time_constant": (-0.5, 0.5),
    "ratio": (-0.05, 0.05),
}
"""What the simulated truck is given that its model does not know: relative to the model, but for the dead
time (in seconds more) and the friction (of the road, 1 where it is as identified)."""
UNITS = {name: "s" if name == "dead_time" else "1" for name in MISMATCH}
ACCEPTABLE = {**OF_MOTION, "road_wheel_angle": 0.002}

Speed = Annotated[float, quantity("m/s", positive=True)]


def _sweeps(value: Any) -> Any:
    """Read what is changed -> sizes, each in the unit of its kind."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{value!r} is no mapping, need such as {{dead_time: [0.1 s]}}")  # noqa: TRY004 pydantic
    made = {}
    for name, sizes in value.items():
        if name not in MISMATCH:
            raise ValueError(f"unknown mismatch {name!r}: {nearest(str(name), list(MISMATCH))}")
        listed = sizes if isinstance(sizes, list | tuple) else [sizes]
        made[name] = tuple(_size(name, one) for one in listed)
    return made


def _size(name: str, value: Any) -> float:
    try:
        number = parse_quantity(value, unit=UNITS[name], quantity=name)
    except BadRecipe as error:
        raise ValueError(str(error)) from error
    if name == "friction" and not 0 < number <= 1:
        raise ValueError(f"friction: {value!r} is not above 0 and at most 1")
    if name not in {"friction", "dead_time"} and number <= -1:
        raise ValueError(f"{name}: {value!r} leaves nothing of it, need more than -1")
    return number


def _no_log(names: list[ScenarioName]) -> list[ScenarioName]:
    if "logged" in names:
        raise ValueError("logged is no scenario to be chosen: it is there where the logs hold a reference")
    return names


class ValidateSettings(BaseModel):
    """Settings of this stage.

    model : model.yaml of the truck; what steering and tyre stage have identified unless said
    controllers, scenarios : which are tried, all that there are unless said
    speeds : at which each scenario is driven [m/s]
    period : of the controllers [s]
    lane_half_width : from the path to the edge of the lane [m]; who leaves it has lost
    lateral_acceleration : the speed is lowered where the path would ask for more [m/s²]
    disturbances : starts drawn at random, or the fixed grid of sizes one at a time
    starts : how many are drawn
    mismatch : what the simulated truck has that its model does not know -> sizes; {} tries none
    pairs : controllers of the matrix of prediction models against simulation models
    runs : globs of the logged runs that are compared, all that hold a reference unless said
    acceptable : signal -> rms error over windows of 2 s up to which model and log agree, beside the noise
        and the error bars of the model
    quick : a first look: one scenario, two starts, no sweep
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: Path | None = None
    controllers: Annotated[list[ControllerName], Field(min_length=1)] = list(CONTROLLERS)
    scenarios: Annotated[list[ScenarioName], Field(min_length=1), AfterValidator(_no_log)] = list(SCENARIOS)
    speeds: Annotated[list[Speed], Field(min_length=1)] = [80 / 3.6]
    period: Annotated[float, quantity("s", positive=True)] = 0.05
    lane_half_width: Annotated[float, quantity("m", positive=True)] = 1.75
    lateral_acceleration: Annotated[float, quantity("m/s^2", positive=True)] = 3.0
    disturbances: Literal["monte_carlo", "grid"] = "monte_carlo"
    starts: Annotated[int, Field(ge=1)] = 5
    mismatch: Annotated[dict[str, tuple[float, ...]], BeforeValidator(_sweeps)] = Field(
        default_factory=lambda: dict(MISMATCH)
    )
    pairs: list[ControllerName] = ["lqr", "mpc_spatial"]
    runs: Annotated[list[str], Field(min_length=1)] | None = None
    acceptable: Limits = Field(default_factory=lambda: dict(ACCEPTABLE))
    quick: bool = False
