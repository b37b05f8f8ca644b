"""The vehicle file: what an engineer knows about the truck. All of it is optional."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Literal, get_args

from ident.errors import BadRecipe
from ident.units import parse_quantity
from ident.yaml_file import nearest, read_yaml

ReferencePoint = Literal["rear_axle", "cg"]
Point = tuple[float, float, float]

UNITS = {
    "mass": "kg",
    "yaw_inertia": "kg m^2",
    "cg_to_front_axle": "m",
    "cg_to_rear_axle": "m",
    "track": "m",
    "cg_height": "m",
}


@dataclass(frozen=True)
class Vehicle:
    """What is known about a vehicle; None where it is not.

    mass : [kg]; yaw_inertia : about the CG [kg m²]
    cg_to_front_axle, cg_to_rear_axle, track, cg_height : [m]
    steering_ratio : steering wheel over road wheel [-], or a table of (steering wheel, road wheel) [rad]
    reference_point : the point that logged poses and velocities refer to
    imu_position : from the CG, x forward, y left, z up [m]
    tyres : path of a .tir file
    """

    mass: float | None = None
    yaw_inertia: float | None = None
    cg_to_front_axle: float | None = None
    cg_to_rear_axle: float | None = None
    track: float | None = None
    cg_height: float | None = None
    steering_ratio: float | tuple[tuple[float, float], ...] | None = None
    reference_point: ReferencePoint | None = None
    imu_position: Point | None = None
    tyres: Path | None = None

    @property
    def wheelbase(self) -> float | None:
        """Distance of the axles [m]."""
        if self.cg_to_front_axle is None or self.cg_to_rear_axle is None:
            return None
        return self.cg_to_front_axle + self.cg_to_rear_axle


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle file (YAML 1.2, quantities with units as text).

    Raises
    ------
    BadRecipe
        For an unknown key, naming the nearest valid one, and for a wrong value or unit.
    """
    valid = [field.name for field in fields(Vehicle)]
    found: dict[str, object] = {}
    for key, value in read_yaml(path).items():
        if key not in valid:
            raise BadRecipe(f"{path}: unknown key {key!r}, {nearest(str(key), valid)}")
        try:
            found[key] = _read(key, value, path)
        except BadRecipe as error:
            raise BadRecipe(f"{path}: {error}") from error
    return Vehicle(**found)  # type: ignore[arg-type]


def _read(key: str, value: object, path: Path) -> object:
    if key in UNITS:
        return _positive(parse_quantity(value, unit=UNITS[key], quantity=key), key)
    if key == "steering_ratio":
        return _steering_ratio(value)
    if key == "reference_point":
        if value not in get_args(ReferencePoint):
            raise BadRecipe(f"{key}: {value!r} is not one of {', '.join(get_args(ReferencePoint))}")
        return value
    if key == "imu_position":
        if not isinstance(value, list) or len(value) != 3:
            raise BadRecipe(f"{key}: {value!r} is no point, need such as [0.5 m, 0 m, 0.2 m] from the CG")
        return tuple(parse_quantity(part, unit="m", quantity=key) for part in value)
    return _tyres(value, path)


def _positive(value: float, key: str) -> float:
    if value <= 0:
        raise BadRecipe(f"{key}: {value:g} is not positive")
    return value


def _steering_ratio(value: object) -> float | tuple[tuple[float, float], ...]:
    if not isinstance(value, list):
        return _positive(parse_quantity(value, unit="1", quantity="steering_ratio"), "steering_ratio")
    rows = [row for row in value if isinstance(row, list) and len(row) == 2]
    if len(rows) != len(value) or len(rows) < 2:
        raise BadRecipe(
            "steering_ratio: need a number such as 20.5, or at least two rows "
            "[steering wheel, road wheel] such as [-360 deg, -17.5 deg]"
        )
    wheel, road = (
        [parse_quantity(row[column], unit="rad", quantity="steering_ratio") for row in rows]
        for column in (0, 1)
    )
    if not (_rises(wheel) and _rises(road)):
        raise BadRecipe("steering_ratio: both columns of the table must rise from row to row")
    return tuple(zip(wheel, road, strict=True))


def _rises(values: list[float]) -> bool:
    return all(first < second for first, second in pairwise(values))


def _tyres(value: object, path: Path) -> Path:
    file = path.parent / str(value)
    if not isinstance(value, str) or not file.is_file():
        raise BadRecipe(f"tyres: there is no file {file}")
    return file
