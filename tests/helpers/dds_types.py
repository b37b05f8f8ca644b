"""Types of DDS that a test publishes, one of each way in which a message is laid out, and values of them."""

import dataclasses
import random
from enum import Enum
from typing import Any, Optional

import cyclonedds.idl.annotations as note
import cyclonedds.idl.types as of
from cyclonedds import idl

# ruff: noqa: UP045 (cyclonedds reads Optional alone)


class Gear(idl.IdlEnum, typename="truck.Gear"):
    neutral = 0
    drive = 1
    reverse = 5


@dataclasses.dataclass
@note.final
class Stamp(idl.IdlStruct, typename="truck.basic.Stamp"):
    sec: of.int32
    nanosec: of.uint32


@dataclasses.dataclass
@note.appendable
class Wheel(idl.IdlStruct, typename="truck.basic.Wheel"):
    name: str
    speed: of.float32


@dataclasses.dataclass
@note.final
class Plain(idl.IdlStruct, typename="truck.Plain"):
    flag: bool
    x: of.float64
    y: of.uint16
    text: str
    z: of.int64


@dataclasses.dataclass
@note.appendable
class State(idl.IdlStruct, typename="truck.State"):
    stamp: Stamp
    number: of.uint8
    note.key("number")
    gear: Gear
    angle: of.float64
    wheels: of.sequence[Wheel]
    counts: of.sequence[of.int16, 10]
    grid: of.array[of.float32, 3]
    text: of.bounded_str[20]
    extra: Optional[of.float64]
    flag: bool
    big: of.uint64


@dataclasses.dataclass
@note.mutable
class Loose(idl.IdlStruct, typename="truck.Loose"):
    speed: of.float64
    note.member_id("speed", 40)
    gear: Optional[of.int32]
    wheel: Wheel
    values: of.sequence[of.float64]


@dataclasses.dataclass
@note.final
class Reading(idl.IdlStruct, typename="truck_msgs.msg.dds_.Reading_"):
    stamp: Stamp
    value: of.float64


@note.final
class Choice(idl.IdlUnion, discriminator=of.int32, typename="truck.Choice"):
    whole: of.case[[1, 2], of.int32]
    real: of.default[of.float64]


@dataclasses.dataclass
@note.final
class Chosen(idl.IdlStruct, typename="truck.Chosen"):
    choice: Choice


def plain(i: int) -> Plain:
    return Plain(i % 2 == 0, -1.5 * i, 65_535 - i, "a" * (i % 5), -(2**53) + i)


def noise(i: int) -> Plain:
    """A message that no compression makes shorter than 1 kB."""
    return dataclasses.replace(plain(i), text=random.Random(i).randbytes(1000).hex())


def state(i: int) -> State:
    wheels = [Wheel("w" * k, 0.5 * i + k) for k in range(i % 3)]
    stamp = Stamp(1_700_000_000 + i, 999_999_999 - i)
    gear = list(Gear)[i % 3]
    extra = None if i % 2 else -2.5 * i
    counts = list(range(-i, -i + i % 4))
    grid = [0.25 * i, 1.5, -3.0]
    return State(
        stamp, i % 2, gear, 0.1 * i, wheels, counts, grid, "t" * (i % 7), extra, i % 3 == 0, 2**40 + i
    )


def loose(i: int) -> Loose:
    return Loose(0.1 * i, None if i % 3 else i, Wheel("x" * (i % 4), 2.0 * i), [0.5 * i] * (i % 3))


def reading(i: int) -> Reading:
    return Reading(Stamp(i, 7 * i), 0.25 * i)


def chosen(i: int) -> Chosen:
    return Chosen(Choice(discriminator=1, value=i) if i % 2 else Choice(discriminator=7, value=0.5 * i))


def numbers(value: Any, path: str = "") -> dict[str, float]:
    """Path -> number, of all that a message holds, as ident.logs names them."""
    if isinstance(value, Enum):
        return {path: float(value.value)}
    if isinstance(value, bool | int | float):
        return {path: float(value)}
    if isinstance(value, list):
        inner = ((f"{path}[{k}]", each) for k, each in enumerate(value))
    elif dataclasses.is_dataclass(value):
        dot = f"{path}." if path else ""
        inner = ((f"{dot}{field.name}", getattr(value, field.name)) for field in dataclasses.fields(value))
    else:
        return {}
    return {name: number for at, each in inner for name, number in numbers(each, at).items()}
