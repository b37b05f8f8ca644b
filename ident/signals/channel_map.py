"""CHANNEL MAP: which field of which topic is which signal, in which unit.

Read and checked whole before any log is opened. A signal may have several alternatives: the first that a
log has is used. Several maps may apply: the one that finds the most signals in a log is used, the earlier
one where two find as many.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ident.errors import BadRecipe
from ident.glossary import SIGNALS
from ident.units import factor, is_raw, registry
from ident.vehicle import ReferencePoint
from ident.yaml_file import check, nearest, read_yaml

BUILT_IN = ("sample_truck", "autoware")


class Channel(BaseModel):
    """Where one signal comes from.

    as_ : of a quaternion, this angle [rad]
    at : the point of the vehicle that it refers to, None: that of the vehicle file
    stamp : the time of a sample: that of the sender, where the message holds one, or of the recorder
    equals : the signal is 1 where the field has this value, else 0
    invert : the field counts the other way (right or clockwise positive): the sign is turned
    derivative_of : the signal is the rate of change of this one
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    topic: str | None = None
    field: str | None = None
    unit: Annotated[str | None, BeforeValidator(lambda unit: str(unit) if unit == 1 else unit)] = None
    as_: Literal["yaw", "roll"] | None = Field(default=None, alias="as")
    at: ReferencePoint | None = None
    stamp: Literal["header", "log"] = "header"
    equals: float | None = None
    invert: bool = False
    derivative_of: str | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Channel:
        if self.derivative_of is not None:
            if self.topic or self.field or self.unit or self.as_ or self.equals is not None or self.invert:
                raise ValueError(
                    "'derivative_of' stands alone: leave out topic, field, unit, as, equals, invert"
                )
            return self
        if not self.topic or not self.field:
            raise ValueError("needs 'topic' and 'field', or 'derivative_of'")
        if self.unit is None and self.as_ is None and self.equals is None:
            raise ValueError("needs 'unit', such as 'rad' or 'deg/s', or 'raw' for a count")
        if self.invert and self.equals is not None:
            raise ValueError("'equals' gives 0 or 1: leave out 'invert'")
        return self


def _as_list(entry: object) -> object:
    return entry if isinstance(entry, list) else [entry]


class _MapFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    signals: dict[str, Annotated[list[Channel], BeforeValidator(_as_list), Field(min_length=1)]]


@dataclass(frozen=True)
class ChannelMap:
    """Signal -> alternatives; ``source`` is the file, or "built-in NAME"."""

    source: str
    signals: Mapping[str, list[Channel]]

    def choose(self, has: Callable[[Channel], bool]) -> dict[str, Channel]:
        """Of each signal, the first alternative that a log has; signals without one are absent.

        A signal that is derived from another is had where that other is.
        """
        chosen: dict[str, Channel] = {}
        for name, alternatives in self.signals.items():
            found = next((channel for channel in alternatives if channel.topic and has(channel)), None)
            if found is not None:
                chosen[name] = found
        for name, alternatives in self.signals.items():
            derived = [channel for channel in alternatives if channel.derivative_of in chosen]
            if name not in chosen and derived:
                chosen[name] = derived[0]
        return chosen


def read_channel_map(path: Path) -> ChannelMap:
    """Read a channel map.

    Raises
    ------
    BadRecipe
        For an unknown signal or key, naming the nearest valid one, and for a unit that does not fit.
    """
    return _checked(read_yaml(path), str(path), str(path))


@lru_cache(maxsize=1)
def built_in_maps() -> tuple[ChannelMap, ...]:
    """Return the maps that come with the program."""
    return tuple(_built_in(name) for name in BUILT_IN)


def best_map(maps: Collection[ChannelMap], topics: Collection[str]) -> ChannelMap:
    """Choose the map that finds the most signals in these topics, the earlier of two equals."""
    return max(maps, key=lambda candidate: len(candidate.choose(lambda channel: channel.topic in topics)))


def _built_in(name: str) -> ChannelMap:
    path = resources.files("ident.signals").joinpath("channels").joinpath(f"{name}.yaml")
    with resources.as_file(path) as file:
        return _checked(read_yaml(file), f"built-in {name}", f"built-in {name}")


def _checked(data: Mapping[str, Any], source: str, where: str) -> ChannelMap:
    signals = check(_MapFile, data, where).signals
    for name, alternatives in signals.items():
        if name not in SIGNALS:
            raise BadRecipe(f"{where}: unknown signal {name!r}: {nearest(name, SIGNALS)}")
        try:
            for channel in alternatives:
                _check_channel(name, channel, signals)
        except BadRecipe as error:
            raise BadRecipe(f"{where}: {error}") from error
    return ChannelMap(source, signals)


def _check_channel(name: str, channel: Channel, signals: Collection[str]) -> None:
    needed = SIGNALS[name].unit
    if channel.derivative_of is not None:
        _check_derivative(name, channel.derivative_of, signals)
    elif channel.as_ is not None and needed != "rad":
        raise BadRecipe(f"{name}: 'as: {channel.as_}' gives an angle, need a unit of {needed!r}")
    elif channel.equals is not None and needed != "1":
        raise BadRecipe(f"{name}: 'equals' gives 0 or 1, need a unit of {needed!r}")
    elif channel.unit is not None and channel.as_ is None:
        factor(channel.unit, needed, name)


def _check_derivative(name: str, base: str, signals: Collection[str]) -> None:
    if base not in signals:
        raise BadRecipe(f"{name}: 'derivative_of: {base}' is not in this map: {nearest(base, signals)}")
    units = registry()
    rate = units.Unit(_text(SIGNALS[base].unit)) / units.Unit("s")
    if base == name or rate.dimensionality != units.Unit(_text(SIGNALS[name].unit)).dimensionality:
        raise BadRecipe(f"{name}: is not the rate of change of {base!r} ({SIGNALS[base].unit} per second)")


def _text(unit: str) -> str:
    return "dimensionless" if unit == "1" else unit


def scale(name: str, channel: Channel) -> tuple[float, bool]:
    """Return the factor to SI of a signal's field with its sign, and whether it is a mere count."""
    sign = -1.0 if channel.invert else 1.0
    if channel.unit is None or channel.as_ is not None or channel.equals is not None:
        return sign, False
    needed = SIGNALS[name].unit
    return sign * factor(channel.unit, needed, name), is_raw(channel.unit, needed)
