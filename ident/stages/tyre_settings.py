"""Settings of the tyre stage, apart from the stage so that reading a recipe loads no model."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ident.results import TyreKind
from ident.stages.inputs import quantity


class TyresSettings(BaseModel):
    """Settings of this stage.

    kinds : of tyres, unless said all that there are: PAC2002 where the vehicle file names property files
    two_track : whether the two-track model is fitted too, where the vehicle file gives track and cg_height
    runs : globs of the runs to be used, all unless said
    least_speed : below which nothing is used [m/s]
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kinds: Annotated[list[TyreKind], Field(min_length=1)] | None = None
    two_track: bool = True
    runs: list[str] | None = None
    least_speed: Annotated[float, quantity("m/s", positive=True)] = 3.0
