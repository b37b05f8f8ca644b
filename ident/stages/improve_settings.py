"""Settings of the improvement, apart from the stage so that reading a recipe loads no model."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from ident.yaml_file import nearest

CATALOGUE: dict[str, tuple[str, ...]] = {
    "A": (
        *("steering_column_play", "steering_friction", "steering_rate_limit", "steering_dead_zone"),
        *("speed_dependent_steering", "steering_asymmetry", "steering_resonance"),
        *("command_quantisation", "command_hold"),
    ),
    "G": (
        *("steering_linkage_play", "steering_offset", "steering_ratio_nonlinearity"),
        *("compliance_steer", "roll_steer"),
    ),
    "T": (
        *("rear_axle_steer", "load_transfer", "tyre_relaxation", "friction_change"),
        *("tyre_stiffness_drift", "combined_slip"),
    ),
    "Y": ("body_roll", "road_bank", "crosswind", "payload_change", "lifted_axle", "trailer", "slosh"),
    "R": ("pneumatic_trail", "tandem_scrub"),
    "X": (
        *("grade", "aerodynamic_drag", "rolling_resistance", "powertrain_lag"),
        *("brake_fade", "longitudinal_slip"),
    ),
    "M": (
        *("imu_lever_arm", "imu_misalignment", "sensor_bias", "gyro_scale", "wheel_speed_scale"),
        *("sensor_latency", "sensor_filter", "clock_drift", "angle_resolution", "antenna_offset"),
    ),
}
"""Every effect that has a name, built or not, by where it enters first: actuator A, linkage G, tyre T,
lateral force Y, yaw moment R, longitudinal X, measurement M."""
EFFECTS = tuple(name for names in CATALOGUE.values() for name in names)


def _known(names: list[str] | None) -> list[str] | None:
    for name in names or ():
        if name not in EFFECTS:
            raise ValueError(f"unknown effect {name!r}: {nearest(name, EFFECTS)}")
    return names


class ImproveSettings(BaseModel):
    """Settings of this stage.

    runs : globs of the runs to be used, all unless said
    effects : of the catalogue, that are tried; all that are built unless said
    level : of all tests of one step together, the chance of a false alarm
    draws : of the joint distribution behind the p-values
    most_effects : added one after another
    survivors : of the screen, that are fitted in full at each step
    folds : at most so many groups of runs are held out in turn, four unless said
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    runs: Annotated[list[str], Field(min_length=1)] | None = None
    effects: Annotated[list[str] | None, AfterValidator(_known), Field(min_length=1)] = None
    level: Annotated[float, Field(gt=0, lt=1)] = 0.05
    draws: Annotated[int, Field(ge=199)] = 1999
    most_effects: Annotated[int, Field(ge=1)] = 6
    survivors: Annotated[int, Field(ge=1)] = 5
    folds: Annotated[int, Field(ge=2)] | None = None

    @model_validator(mode="after")
    def _can_reject(self) -> Self:
        if (self.draws + 1) * self.level < 1:
            raise ValueError(
                f"level {self.level:g} with {self.draws} draws: no p-value can be below 1/{self.draws + 1}, "
                f"need draws: {round(1 / self.level)} or more"
            )
        return self
