"""``model.yaml``: the identified model as the stages exchange it, and as a person can read and edit it.

All values are SI; each has its standard error. ``parameters`` and ``covariance`` hold what was fitted
together: entry (i, j) is the covariance of the i-th and j-th parameter, named by its place as in
``steering.dead_time`` or ``tyres.front.cornering_stiffness``. Floats are written with all their digits:
reading gives the same numbers back.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.representer import RoundTripRepresenter
from ruamel.yaml.scalarstring import LiteralScalarString

from ident.errors import BadRecipe
from ident.results import Provenance, TyreFile, TyreKind
from ident.vehicle import ReferencePoint
from ident.yaml_file import check, read_yaml

LONGEST_LINE = 110
OTHER_LINE_ENDS = frozenset("\r\x85\u2028\u2029")  # which a block of text in YAML would not keep
_STRICT = {"extra": "forbid"}


@dataclass(frozen=True)
class Value:
    """A parameter: ``value`` is None where the data cannot give one, ``std`` where there is no error."""

    __pydantic_config__ = _STRICT

    value: float | None
    std: float | None
    unit: str


@dataclass(frozen=True)
class SteeringPart:
    """K exp(-L s) / ((T1 s + 1)(T2 s + 1)), equation (2.25), from the request to the measured angle.

    pair : whether both are of the steering wheel or of the road wheel
    natural_frequency, damping_ratio : instead of T1 and T2 where the response is underdamped (2.19)
    ratio : [[steering-wheel angle, road-wheel angle], ...] [rad]
    """

    __pydantic_config__ = _STRICT

    gain: Value
    dead_time: Value
    time_constant_1: Value
    time_constant_2: Value
    total_lag: Value | None = None
    natural_frequency: Value | None = None
    damping_ratio: Value | None = None
    pair: Literal["steering_wheel", "road_wheel"] = "steering_wheel"
    ratio: list[tuple[float, float]] | None = None


@dataclass(frozen=True)
class VehiclePart:
    """The rigid body: what the vehicle file gave, or what was identified; None where neither did."""

    __pydantic_config__ = _STRICT

    mass: Value | None = None
    yaw_inertia: Value | None = None
    cg_to_front_axle: Value | None = None
    cg_to_rear_axle: Value | None = None
    track: Value | None = None
    cg_height: Value | None = None


@dataclass(frozen=True)
class TyresPart:
    """The axle tyres: parameter -> value; the force is that of the axle, both sides together.

    property_files : of PAC2002 tyres, whose parameters are scaling factors of them
    """

    __pydantic_config__ = _STRICT

    kind: TyreKind
    front: dict[str, Value]
    rear: dict[str, Value]
    property_files: list[TyreFile] | None = None


@dataclass(frozen=True)
class EffectPart:
    """An effect that is part of the model.

    name, enters : as in the catalogue of effects
    of : the signal that it acts on, where it acts on one; run : where it belongs to one run
    """

    __pydantic_config__ = _STRICT

    name: str
    enters: str
    parameters: dict[str, Value]
    of: str | None = None
    run: str | None = None


@dataclass(frozen=True)
class ValidRange:
    """What the data covered: [lowest, highest]; beyond it the model is a guess.

    speed : [m/s]; lateral_acceleration : [m/s²]
    """

    __pydantic_config__ = _STRICT

    speed: tuple[float, float] | None = None
    lateral_acceleration: tuple[float, float] | None = None


@dataclass(frozen=True)
class SignalNoise:
    """The noise of one signal; ``std`` is that of the innovations, in the signal's SI unit.

    ar : y_k = sum a_i y_(k-i) + e_k, at ``sample_period`` [s]
    correlation_time : of a continuous-time AR(1) [s], where the stamps jitter too much for ``ar``
    """

    __pydantic_config__ = _STRICT

    std: float
    ar: list[float] = field(default_factory=list)
    sample_period: float | None = None
    correlation_time: float | None = None


@dataclass(frozen=True)
class Model:
    """What has been identified so far, each part with the provenance of the stage that wrote it.

    reference_point : the point that logged poses and velocities refer to
    property_tyres : PAC2002 tyres fitted beside ``tyres``, for export; their covariance is not in the file
    """

    __pydantic_config__ = _STRICT

    schema: Literal["ident.model/1"] = "ident.model/1"
    vehicle: VehiclePart | None = None
    reference_point: ReferencePoint | None = None
    steering: SteeringPart | None = None
    tyres: TyresPart | None = None
    property_tyres: TyresPart | None = None
    effects: list[EffectPart] = field(default_factory=list)
    noise: dict[str, SignalNoise] = field(default_factory=dict)
    parameters: list[str] = field(default_factory=list)
    covariance: list[list[float]] = field(default_factory=list)
    valid_range: ValidRange | None = None
    provenance: dict[str, Provenance] = field(default_factory=dict)


def read_model(path: Path) -> Model:
    """Read a model file.

    Raises
    ------
    BadRecipe
        If it cannot be read, has an unknown key, a missing value, or a covariance of the wrong size.
    """
    return model_from(read_yaml(path), str(path))


def model_from(data: Mapping[str, Any], source: str) -> Model:
    """Check the content of a model file; ``source`` begins the message of an error."""
    model = check(Model, data, source)
    size = len(model.parameters)
    if len(model.covariance) != size or any(len(row) != size for row in model.covariance):
        rows = [len(row) for row in model.covariance]
        raise BadRecipe(f"{source}: covariance has rows of {rows} values, need {size} rows of {size}")
    _refuse_not_finite(asdict(model), source, "")
    return model


def model_text(model: Model) -> str:
    """Write a model as YAML, leaving out the parts that it does not have."""
    yaml = YAML()
    yaml.Representer = _Representer
    yaml.width = 4096
    stream = io.StringIO()
    tree = _block({key: part for key, part in asdict(model).items() if part not in (None, {}, [])})
    tree.fa.set_block_style()
    yaml.dump(tree, stream)
    return stream.getvalue()


class _Representer(RoundTripRepresenter):
    """Writes None as ``null``, not as nothing, and 1e-05 as 1.0e-05: a number for YAML 1.1 readers too."""

    def represent_nothing(self, _: None) -> Any:
        return self.represent_scalar("tag:yaml.org,2002:null", "null")

    def represent_number(self, number: float) -> Any:
        mantissa, *exponent = repr(number).split("e")
        text = "e".join([mantissa if "." in mantissa or not exponent else f"{mantissa}.0", *exponent])
        return self.represent_scalar("tag:yaml.org,2002:float", text)


_Representer.add_representer(type(None), _Representer.represent_nothing)
_Representer.add_representer(float, _Representer.represent_number)


def _block(value: Any) -> Any:
    """Lay a tree out for reading: a list or a short mapping of only numbers and text stands on one line."""
    if isinstance(value, dict):
        present = {key: _block(inner) for key, inner in value.items() if inner is not None or _is_leaf(value)}
        laid_out: Any = CommentedMap(present)
    elif _is_list(value):
        laid_out = CommentedSeq([_block(inner) for inner in value])
    elif isinstance(value, str) and "\n" in value and not OTHER_LINE_ENDS.intersection(value):
        return LiteralScalarString(value)
    else:
        return value
    if _is_leaf(value) and (_is_list(value) or len(str(value)) <= LONGEST_LINE):
        laid_out.fa.set_flow_style()
    return laid_out


def _is_leaf(value: dict[str, Any] | list[Any] | tuple[Any, ...]) -> bool:
    inner = value.values() if isinstance(value, dict) else value
    return not any(isinstance(item, dict | list | tuple) for item in inner)


def _refuse_not_finite(value: Any, source: str, where: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise BadRecipe(f"{source}: {where} is {value}, need a finite number or null")
    inner = value.items() if isinstance(value, dict) else enumerate(value) if _is_list(value) else ()
    for key, item in inner:
        _refuse_not_finite(item, source, f"{where}.{key}" if where else str(key))


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)
