"""Tyre property files of a vehicle: read for a fit, and made into tyres again from what a result holds."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ident.dynamics.tyres import Tyre
from ident.dynamics.tyres.pac2002_axle import pac2002_axle, scaling_of
from ident.dynamics.tyres.pac2002_coefficients import Pac2002, pac2002_from_file
from ident.dynamics.tyres.property_file import PropertyFile, parse_property_file, read_property_file
from ident.errors import BadRecipe
from ident.estimation.tyre_fit import Axles, Body
from ident.glossary import AXLES
from ident.results import TyreFile
from ident.vehicle import VehicleTyres

PAC2002: Literal["pac2002"] = "pac2002"


@dataclass(frozen=True)
class FileTyres:
    """PAC2002 tyres of both axles.

    files : as they were read
    coefficients, tyres : axle -> of one tyre; of the whole axle
    own : factor, such as "front.LKY" -> its value in the file
    """

    files: list[TyreFile]
    coefficients: Mapping[str, Pac2002]
    tyres: Mapping[str, Tyre]
    own: Mapping[str, float]

    @property
    def axles(self) -> Axles:
        """Both axles, no factor held."""
        return Axles(self.tyres["front"], self.tyres["rear"])


def read_tyre_files(vehicle: VehicleTyres) -> list[TyreFile]:
    """Read the property files that a vehicle file names; both axles of one file stand together.

    Raises
    ------
    BadRecipe
        If one cannot be read, or holds no PAC2002 tyre whose lateral force can be computed.
    """
    made: list[TyreFile] = []
    for axle, one in (("front", vehicle.front), ("rear", vehicle.rear)):
        file = read_property_file(one.file)
        tyre = pac2002_from_file(file)
        pac2002_axle(tyre, one.number)
        digest = hashlib.sha256(file.to_bytes()).hexdigest()
        same = next((other for other in made if other.sha256 == digest), None)
        if same is not None:
            same.number[axle] = one.number
            continue
        text = "".join(file.lines)
        ends = _line_ends(text)
        made.append(
            TyreFile(
                name=one.file.name,
                sha256=digest,
                encoding="utf-8" if file.encoding == "utf-8" else "latin-1",
                lines=ends,
                number={axle: one.number},
                not_modelled=list(tyre.left_out),
                text=text.replace("\r\n", "\n") if ends == "crlf" else text,
            )
        )
    return made


def _line_ends(text: str) -> Literal["lf", "crlf", "mixed"]:
    if "\r" not in text:
        return "lf"
    apart = text.count("\r\n")
    return "crlf" if text.count("\r") == text.count("\n") == apart else "mixed"


def property_file_of(held: TyreFile, source: str) -> PropertyFile:
    """Return the property file that a result or a model holds.

    Raises
    ------
    BadRecipe
        If its text is not that of its hash.
    """
    try:
        text = held.text.replace("\n", "\r\n") if held.lines == "crlf" else held.text
        data = text.encode(held.encoding)
    except UnicodeEncodeError as error:
        raise BadRecipe(
            f"{source}: the text of {held.name} is not {held.encoding}: {error.reason}"
        ) from error
    if hashlib.sha256(data).hexdigest() != held.sha256:
        raise BadRecipe(
            f"{source}: the text of {held.name} is not the one that was fitted (its sha256 differs): "
            "change the file itself and run `ident tyres` again"
        )
    return parse_property_file(data, held.name)


def tyres_of_files(files: Sequence[TyreFile], source: str) -> FileTyres:
    """Make the tyres of both axles from the files that a result or a model holds.

    Raises
    ------
    BadRecipe
        If an axle has no file, or a file is not the one that was fitted.
    """
    coefficients: dict[str, Pac2002] = {}
    tyres: dict[str, Tyre] = {}
    for held in files:
        tyre = pac2002_from_file(property_file_of(held, source))
        for axle, number in held.number.items():
            coefficients[axle], tyres[axle] = tyre, pac2002_axle(tyre, number)
    missing = [axle for axle in AXLES if axle not in tyres]
    if missing:
        raise BadRecipe(f"{source}: holds no property file of the {' and '.join(missing)} tyres, need both")
    own = {
        f"{axle}.{name}": value for axle in AXLES for name, value in scaling_of(coefficients[axle]).items()
    }
    return FileTyres(list(files), coefficients, tyres, own)


def doubts_of_load(tyres: FileTyres, body: Body) -> list[str]:
    """Name the axles whose tyres bear a load beyond that for which the file says it holds."""
    told = []
    for axle in AXLES:
        number = next(one.number[axle] for one in tyres.files if axle in one.number)
        load, (least, most) = body.load(axle) / number, tyres.coefficients[axle].load_range
        if (least is not None and load < least) or (most is not None and load > most):
            told.append(
                f"{tyres.coefficients[axle].source}: each {axle} tyre bears {load:.0f} N at rest, the file "
                f"holds from {least or 0:.0f} to {most or float('inf'):.0f} N: are both the right ones?"
            )
    return told
