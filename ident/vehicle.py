"""The vehicle file: what an engineer knows about the truck. All of it is optional.

A value may state how well it is known. The number after the sign is one standard deviation, in a unit of its
own or in per cent of the value; the long form says the same:

    mass: 12500 kg ± 300 kg            # or +-, or +/-
    mass: 12500 kg +- 3 %
    mass: {value: 12500 kg, std: 300 kg}

The tyres are property files (``.tir``), with paths relative to the vehicle file:

    tyres: truck.tir                                                # the same on both axles, two on each
    tyres: {front: steer.tir, rear: {file: drive.tir, number: 4}}   # dual tyres behind

The two-track model asks for ``track`` and ``cg_height``, and takes these where they are stated:

    front_roll_share: 0.42     # of the overturning moment, by the roll stiffness in front and behind
    ackermann_share: 0.8       # 0: front wheels parallel, 1: Ackermann's geometry
    load_sensitivity: 0.3      # share of its stiffness that an axle would lose with all its load on one side
    axles: {rear: {number: 2, spacing: 1.35 m, track: 1.83 m, lifted: 2}}    # a tandem, its second axle up

``axles`` need only name what is not one axle of the vehicle's track; ``lifted`` says that this axle of the
group, 1 being the foremost, was off the road in all these logs. ``cg_to_front_axle`` and ``cg_to_rear_axle``
reach to the middle of a group.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Literal, get_args

from ident.errors import BadRecipe
from ident.glossary import AXLES
from ident.units import parse_quantity
from ident.yaml_file import nearest, read_yaml

ReferencePoint = Literal["rear_axle", "cg"]
Point = tuple[float, float, float]

MOST_TYRES = 16  # on one axle group

UNITS = {
    "mass": "kg",
    "yaw_inertia": "kg m^2",
    "cg_to_front_axle": "m",
    "cg_to_rear_axle": "m",
    "track": "m",
    "cg_height": "m",
    "front_roll_share": "1",
    "ackermann_share": "1",
    "load_sensitivity": "1",
}
SHARES = {"front_roll_share": (0.0, 1.0), "ackermann_share": (-0.5, 1.5), "load_sensitivity": (0.0, 0.9)}
MOST_AXLES = 4  # in one group
RATIO = "steering_ratio"
_PLUS_MINUS = re.compile(r"\s*(?:±|\+/?-)\s*")
_PER_CENT = re.compile(r"(.*?)\s*(?:%|percent)\s*")


@dataclass(frozen=True)
class AxleTyres:
    """The tyres of one axle: their property file, and how many there are, 4 where they are dual."""

    file: Path
    number: int = 2


@dataclass(frozen=True)
class VehicleTyres:
    """The tyres of both axles."""

    front: AxleTyres
    rear: AxleTyres


@dataclass(frozen=True)
class AxlesOfGroup:
    """Axles that stand close together, in front or behind.

    number : of axles; spacing : from one to the next, None of a single axle [m]
    track : from the left to the right wheels, None where it is that of the vehicle [m]
    lifted : which of them is off the road, 1 is the foremost; None: none
    """

    number: int = 1
    spacing: float | None = None
    track: float | None = None
    lifted: int | None = None


@dataclass(frozen=True)
class Vehicle:
    """What is known about a vehicle; None where it is not.

    mass : [kg]; yaw_inertia : about the CG [kg m²]
    cg_to_front_axle, cg_to_rear_axle, track, cg_height : [m]
    steering_ratio : steering wheel over road wheel [-], or a table of (steering wheel, road wheel) [rad]
    reference_point : the point that logged poses and velocities refer to
    imu_position : from the CG, x forward, y left, z up [m]
    tyres : property files (.tir) of both axles
    front_roll_share, ackermann_share, load_sensitivity : of the two-track model [-]
    axles : "front", "rear" -> the axles there, where they are stated
    std : name of a value above -> its standard deviation in the same unit, only where the file states it
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
    tyres: VehicleTyres | None = None
    front_roll_share: float | None = None
    ackermann_share: float | None = None
    load_sensitivity: float | None = None
    axles: Mapping[str, AxlesOfGroup] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)

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
    valid = [each.name for each in fields(Vehicle) if each.name != "std"]
    found: dict[str, object] = {}
    std: dict[str, float] = {}
    for key, value in read_yaml(path).items():
        if key not in valid:
            raise BadRecipe(f"{path}: unknown key {key!r}, {nearest(str(key), valid)}")
        try:
            found[key], known = _read(key, value, path)
        except BadRecipe as error:
            raise BadRecipe(f"{path}: {error}") from error
        if known is not None:
            std[key] = known
    return Vehicle(**found, std=std)  # type: ignore[arg-type]


def _read(key: str, value: object, path: Path) -> tuple[object, float | None]:
    """Value of a key, and its standard deviation where that is stated."""
    if key == RATIO and isinstance(value, list):
        return _steering_table(value), None
    if key in {*UNITS, RATIO}:
        return _known_value(key, value, UNITS.get(key, "1"))
    if key == "reference_point":
        if value not in get_args(ReferencePoint):
            raise BadRecipe(f"{key}: {value!r} is not one of {', '.join(get_args(ReferencePoint))}")
        return value, None
    if key == "imu_position":
        if not isinstance(value, list) or len(value) != 3:
            raise BadRecipe(f"{key}: {value!r} is no point, need such as [0.5 m, 0 m, 0.2 m] from the CG")
        return tuple(parse_quantity(part, unit="m", quantity=key) for part in value), None
    if key == "axles":
        return _axles(value), None
    return _tyres(value, path), None


def _known_value(key: str, given: object, unit: str) -> tuple[float, float | None]:
    text, spread = _value_and_spread(key, given, unit)
    value = _within(parse_quantity(text, unit=unit, quantity=key), key)
    if spread is None:
        return value, None
    relative = _PER_CENT.fullmatch(str(spread))
    if relative is not None:
        std = value * parse_quantity(relative[1], unit="1", quantity=f"{key}: std in per cent") / 100
    else:
        std = parse_quantity(spread, unit=unit, quantity=f"{key}: std")
    if std < 0:
        raise BadRecipe(f"{key}: the standard deviation {std:g} is negative")
    return value, std


def _value_and_spread(key: str, given: object, unit: str) -> tuple[object, object | None]:
    """What stands for the value and what for its standard deviation, as given."""
    if isinstance(given, Mapping):
        if set(given) not in ({"value"}, {"value", "std"}):
            raise BadRecipe(
                f"{key}: {', '.join(map(str, given)) or 'nothing'} given, need value and std, such as "
                f"{{value: 1 {unit}, std: 0.1 {unit}}}"
            )
        return given["value"], given.get("std")
    parts = _PLUS_MINUS.split(str(given)) if isinstance(given, str) else [given]
    if len(parts) > 2:
        raise BadRecipe(f"{key}: {given!r} states more than one spread, need such as '1 {unit} ± 0.1 {unit}'")
    return parts[0], parts[1] if len(parts) == 2 else None


def _within(value: float, key: str) -> float:
    if key in SHARES:
        least, most = SHARES[key]
        if not least <= value <= most:
            raise BadRecipe(f"{key}: {value:g}, need a share from {least:g} to {most:g}")
        return value
    if value <= 0:
        raise BadRecipe(f"{key}: {value:g} is not positive")
    return value


def _steering_table(value: list[object]) -> tuple[tuple[float, float], ...]:
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


def _tyres(value: object, path: Path) -> VehicleTyres:
    if not isinstance(value, Mapping):
        both = _axle_tyres(value, path, "tyres")
        return VehicleTyres(both, both)
    if set(value) != set(AXLES):
        raise BadRecipe(
            f"tyres: {', '.join(map(str, value)) or 'nothing'} given, need a file, or front and rear: "
            "{front: steer.tir, rear: drive.tir}"
        )
    return VehicleTyres(*(_axle_tyres(value[axle], path, f"tyres.{axle}") for axle in AXLES))


def _axle_tyres(value: object, path: Path, key: str) -> AxleTyres:
    given = value if isinstance(value, Mapping) else {"file": value}
    if "file" not in given or set(given) - {"file", "number"}:
        raise BadRecipe(
            f"{key}: {', '.join(map(str, given)) or 'nothing'} given, need {{file: drive.tir, number: 4}}"
        )
    file, number = path.parent / str(given["file"]), given.get("number", 2)
    if not isinstance(given["file"], str) or not file.is_file():
        raise BadRecipe(f"{key}: there is no file {file}")
    if type(number) is not int or number % 2 or not 2 <= number <= MOST_TYRES:
        raise BadRecipe(f"{key}: {number} tyres, need an even number of 2 to {MOST_TYRES}: 4 are dual tyres")
    return AxleTyres(file, number)


def _axles(value: object) -> dict[str, AxlesOfGroup]:
    if not isinstance(value, Mapping) or not value or set(value) - set(AXLES):
        raise BadRecipe(
            f"axles: {value!r}, need front, rear or both: {{rear: {{number: 2, spacing: 1.35 m}}}}"
        )
    return {name: _group(own, f"axles.{name}") for name, own in value.items()}


def _group(given: object, key: str) -> AxlesOfGroup:
    valid = [each.name for each in fields(AxlesOfGroup)]
    if not isinstance(given, Mapping):
        raise BadRecipe(f"{key}: {given!r}, need such as {{number: 2, spacing: 1.35 m}}")
    for name in given:
        if name not in valid:
            raise BadRecipe(f"{key}: unknown key {name!r}, {nearest(str(name), valid)}")
    number = _count(given.get("number", 1), f"{key}.number", 1, MOST_AXLES)
    lengths = {
        name: _within(parse_quantity(given[name], unit="m", quantity=f"{key}.{name}"), f"{key}.{name}")
        for name in ("spacing", "track")
        if name in given
    }
    if number > 1 and "spacing" not in lengths:
        raise BadRecipe(f"{key}: {number} axles without a spacing, need such as spacing: 1.35 m")
    if number == 1 and given.keys() & {"spacing", "lifted"}:
        raise BadRecipe(f"{key}: a single axle has no spacing and is not lifted, need number: 2 or more")
    lifted = _count(given["lifted"], f"{key}.lifted", 1, number) if "lifted" in given else None
    return AxlesOfGroup(number, lengths.get("spacing"), lengths.get("track"), lifted)


def _count(value: object, key: str, least: int, most: int) -> int:
    if type(value) is not int or not least <= value <= most:
        raise BadRecipe(f"{key}: {value!r}, need a whole number from {least} to {most}")
    return value
