"""The coefficients of a PAC2002 tyre from a property file; what the equations do not cover is refused.

Read are the formats ``PAC2002`` and ``MF_05`` (MF-Tyre 5.0 to 5.2, FITTYP 5, 6 and 21), whose steady-state
forces and aligning moment are the same equations; the later ones have a few coefficients more, and where
those are missing they are zero. MF-Tyre/MF-Swift 6 and all other tyre models are refused.

A file need not hold all parts. What cannot be computed is refused when it is asked for: combined slip of a
file without its coefficients, or of one that wants the friction ellipse instead (``FE_METHOD = 'YES'``).
What the file holds beyond the steady-state forces and the aligning moment is listed in ``left_out``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import sympy
from sympy import Expr

from ident.dynamics.tyres.property_file import PropertyFile
from ident.errors import BadRecipe

Part = Literal["longitudinal", "lateral", "aligning", "combined longitudinal", "combined lateral"]
Side = Literal["left", "right", "symmetric"]

NEEDED: dict[Part, str] = {
    "longitudinal": "PCX1 PDX1 PDX2 PEX1 PEX2 PEX3 PEX4 PKX1 PKX2 PKX3 PHX1 PHX2 PVX1 PVX2",
    "lateral": "PCY1 PDY1 PDY2 PDY3 PEY1 PEY2 PEY3 PEY4 PKY1 PKY2 PKY3 PHY1 PHY2 PHY3 PVY1 PVY2 PVY3 PVY4",
    "aligning": "QBZ1 QBZ2 QBZ3 QBZ4 QBZ5 QBZ9 QCZ1 QDZ1 QDZ2 QDZ3 QDZ4 QDZ6 QDZ7 QDZ8 QDZ9 "
    "QEZ1 QEZ2 QEZ3 QEZ4 QEZ5 QHZ1 QHZ2 QHZ3 QHZ4",
    "combined longitudinal": "RBX1 RBX2 RCX1 RHX1",
    "combined lateral": "RBY1 RBY2 RBY3 RCY1 RHY1 RVY1 RVY2 RVY3 RVY4 RVY5 RVY6",
}
LATER = (
    "PDX3 PPX1 PPX2 PPX3 PPX4 PPY1 PPY2 PPY3 PPY4 REX1 REX2 REY1 REY2 RHY2 "
    "QBZ10 QPZ1 QPZ2 SSZ1 SSZ2 SSZ3 SSZ4"
)
SCALING = {
    "LFZO": "nominal load",
    "LCX": "shape of the longitudinal force",
    "LMUX": "longitudinal peak friction",
    "LEX": "curvature of the longitudinal force",
    "LKX": "longitudinal slip stiffness",
    "LHX": "horizontal shift of the longitudinal force",
    "LVX": "vertical shift of the longitudinal force",
    "LGAX": "camber in the longitudinal force",
    "LCY": "shape of the lateral force",
    "LMUY": "lateral peak friction",
    "LEY": "curvature of the lateral force",
    "LKY": "cornering stiffness",
    "LHY": "horizontal shift of the lateral force",
    "LVY": "vertical shift of the lateral force",
    "LGAY": "camber in the lateral force",
    "LKG": "camber stiffness",
    "LTR": "peak of the pneumatic trail",
    "LRES": "residual moment",
    "LGAZ": "camber in the aligning moment",
    "LXAL": "slip angle in the longitudinal force",
    "LYKA": "longitudinal slip in the lateral force",
    "LVYKA": "lateral force induced by longitudinal slip",
    "LS": "lever arm of the longitudinal force",
    "LIP": "inflation pressure",
}
POSITIVE = ("LFZO", "LCX", "LMUX", "LKX", "LCY", "LMUY", "LKY")  # the curves have no meaning without
OTHER_SPELLINGS = {"LFZO": ("LFZ0",), "LKG": ("LKYG",)}
# What makes the tyre pull to a side, so that F_y(-α, -γ) is not -F_y(α, γ): zero in a symmetric tyre.
ONE_SIDED = "PEY3 PHY1 PHY2 PVY1 PVY2 RBY3 RHX1 RVY1 RVY2 QBZ4 QDZ3 QDZ6 QDZ7 QEZ4 QHZ1 QHZ2 SSZ1"
LEFT_OUT = {
    "overturning moment": "QSX1 QSX2 QSX3 QSX4 QSX5 QSX6 QSX7 QSX8 QSX9 QSX10 QSX11 QPX1",
    "rolling resistance moment": "QSY1 QSY2 QSY3 QSY4 QSY5 QSY6 QSY7 QSY8",
    "longitudinal relaxation length": "PTX1 PTX2 PTX3 PTX4",
    "lateral relaxation length": "PTY1 PTY2 PTY3",
    "gyroscopic couple": "QTZ1 MBELT",
    "turn slip": "PDXP1 PKYP1 PDYP1 PHYP1 PECP1 QDTP1 QCRP1 QBRP1 QDRP1",
}
MODELLED = {"PAC2002", "MF_05"}
FIT_TYPES = {5, 6, 21}  # MF-Tyre 5.0, 5.1 and 5.2
NOT_ZERO = {"longitudinal": "PCX1 PDX1 PKX1", "lateral": "PCY1 PDY1 PKY1 PKY2"}


@dataclass(frozen=True)
class Pac2002:
    """Coefficients of one tyre, in the file's own signs (see ``pac2002``).

    coefficients : (name, value), with FNOMIN [N], UNLOADED_RADIUS [m] and PRESSURE, the relative change of
        the inflation pressure from its nominal value [-]
    missing : (part, reason) of what the file cannot tell
    side : on which side of the vehicle the tyre was measured; the left one where the file does not know
    left_out : what the file holds that is not modelled here, one line each
    load_range : least and largest load of the file [N], None where it has none
    source : of the file
    """

    coefficients: tuple[tuple[str, float], ...]
    missing: tuple[tuple[Part, str], ...]
    side: Side
    left_out: tuple[str, ...]
    load_range: tuple[float | None, float | None]
    source: str

    def symbols(self, *parts: Part, free: dict[str, Expr] | None = None) -> dict[str, Expr]:
        """Coefficients as SymPy numbers, those in ``free`` as the given expressions.

        Raises
        ------
        BadRecipe
            If the file lacks what a part needs.
        """
        for part, reason in self.missing:
            if part in parts:
                what = "aligning moment" if part == "aligning" else f"{part} force"
                raise BadRecipe(f"{self.source}: no {what} of this tyre: {reason}")
        own = {name: _number(value) for name, value in self.coefficients}
        return own | (free or {})

    def value(self, name: str) -> float:
        """Value of one coefficient or scaling factor."""
        return dict(self.coefficients)[name]


def pac2002_from_file(file: PropertyFile) -> Pac2002:
    """Take the coefficients of a PAC2002 tyre out of a property file.

    Raises
    ------
    BadRecipe
        If the file is one of another tyre model, lacks the nominal load or the radius, or none of the pure
        forces can be computed; if a value is no number.
    """
    _refuse_other_models(file)
    values = {"FNOMIN": _positive(file, "FNOMIN"), "UNLOADED_RADIUS": _positive(file, "UNLOADED_RADIUS")}
    for name in SCALING:
        given = file.number(name, *OTHER_SPELLINGS.get(name, ()))
        values[name] = 1.0 if given is None else given
        if name in POSITIVE and values[name] <= 0:
            raise BadRecipe(f"{file.source}: {name} = {values[name]:g}, need a positive scaling factor")
    missing: list[tuple[Part, str]] = []
    for part in get_args(Part):
        reason = _read_part(file, part, values)
        if reason:
            missing.append((part, reason))
    _refuse_useless(file, dict(missing))
    for name in LATER.split():
        values[name] = file.number(name) or 0.0
    values["PRESSURE"] = _pressure(file, values["LIP"])
    side = _side(file)
    if side == "symmetric":
        values |= dict.fromkeys(ONE_SIDED.split(), 0.0)
    limits = (file.number("FZMIN"), file.number("FZMAX"))
    return Pac2002(tuple(values.items()), tuple(missing), side, _left_out(file), limits, file.source)


def with_scaling(file: PropertyFile, scaling: Mapping[str, float]) -> PropertyFile:
    """Return a property file with other scaling factors, such as those of a fit; all else stays as it is.

    Parameters
    ----------
    scaling : name in ``SCALING`` -> value; one that the file lacks is added to its scaling section

    Raises
    ------
    BadRecipe
        If a value is not finite.
    ValueError
        If a name is no scaling factor.
    """
    unknown = sorted(set(scaling) - set(SCALING))
    if unknown:
        raise ValueError(f"no scaling factors: {', '.join(unknown)}; there are {', '.join(SCALING)}")
    spelt = {name: file.entry(name, *OTHER_SPELLINGS.get(name, ())) for name in scaling}
    as_spelt = {(entry.keyword if entry else name): scaling[name] for name, entry in spelt.items()}
    return file.with_numbers(as_spelt, section="SCALING_COEFFICIENTS")


def _refuse_other_models(file: PropertyFile) -> None:
    named = file.text("PROPERTY_FILE_FORMAT")
    fit = file.number("FITTYP")
    needed = "need PAC2002 or MF_05 (MF-Tyre 5)"
    if fit is not None and fit >= 60:
        raise BadRecipe(f"{file.source}: FITTYP = {fit:g} is MF-Tyre/MF-Swift {fit / 10:.1f}, {needed}")
    if fit is not None and fit not in FIT_TYPES and (named or "").upper() != "PAC2002":
        raise BadRecipe(f"{file.source}: FITTYP = {fit:g} is not known, {needed}")
    if named is None and fit is None:
        raise BadRecipe(f"{file.source}: no PROPERTY_FILE_FORMAT and no FITTYP in [MODEL], {needed}")
    if named is not None and named.upper() not in MODELLED:
        raise BadRecipe(f"{file.source}: PROPERTY_FILE_FORMAT = {named[:40]!r} is not modelled, {needed}")


def _read_part(file: PropertyFile, part: Part, values: dict[str, float]) -> str:
    """Add the coefficients of a part to ``values``; say why where the part cannot be computed."""
    found = {name: file.number(name) for name in NEEDED[part].split()}
    lacking = [name for name, value in found.items() if value is None]
    values |= {name: value or 0.0 for name, value in found.items()}
    if lacking:
        several = f" and {len(lacking) - 4} more" if len(lacking) > 4 else ""
        return f"the file lacks {', '.join(lacking[:4])}{several}"
    zero = [name for name in NOT_ZERO.get(part, "").split() if values[name] == 0]
    if zero:
        return f"{zero[0]} is 0, need another value"
    if part.startswith("combined") and _wants_ellipse(file):
        return "FE_METHOD = 'YES' asks for the friction ellipse, which is not modelled"
    return ""


def _refuse_useless(file: PropertyFile, missing: dict[Part, str]) -> None:
    if "longitudinal" in missing and "lateral" in missing:
        raise BadRecipe(f"{file.source}: no force can be computed: {missing['lateral']}: is the file whole?")


def _positive(file: PropertyFile, name: str) -> float:
    value = file.number(name)
    if value is None or value <= 0:
        given = "is missing" if value is None else f"= {value:g}"
        raise BadRecipe(f"{file.source}: {name} {given}, need a positive number")
    return value


def _pressure(file: PropertyFile, scale: float) -> float:
    """Relative change of the inflation pressure; zero where the file does not say both."""
    pressure, nominal = file.number("IP", "INFLPRES"), file.number("IP_NOM", "NOMPRES")
    if pressure is None or not nominal:
        return 0.0
    return (pressure * scale - nominal) / nominal


def _side(file: PropertyFile) -> Side:
    """Side of the tyre; a negative USE_MODE says that it is to be mirrored."""
    given = (file.text("TYRESIDE", "TIRESIDE") or "UNKNOWN").upper()
    sides: dict[str, Side] = {"LEFT": "left", "RIGHT": "right", "SYMMETRIC": "symmetric", "UNKNOWN": "left"}
    if given not in sides:
        raise BadRecipe(f"{file.source}: TYRESIDE = {given[:40]!r}, need LEFT, RIGHT, SYMMETRIC or UNKNOWN")
    side = sides[given]
    mirrored: dict[Side, Side] = {"left": "right", "right": "left", "symmetric": "symmetric"}
    return mirrored[side] if (file.number("USE_MODE") or 0.0) < 0 else side


def _left_out(file: PropertyFile) -> tuple[str, ...]:
    lines = []
    for what, names in LEFT_OUT.items():
        there = [name for name in names.split() if file.number(name)]
        if there:
            lines.append(f"{what} ({', '.join(there[:4])}{', ...' if len(there) > 4 else ''})")
    return (*lines, *(["friction ellipse for combined slip (FE_METHOD)"] if _wants_ellipse(file) else []))


def _wants_ellipse(file: PropertyFile) -> bool:
    return (file.text("FE_METHOD") or "").upper() == "YES"


def _number(value: float) -> Expr:
    """Exact where it is a small whole number, so that zeros and ones vanish from the equations."""
    return sympy.Integer(int(value)) if value in {0.0, 1.0, -1.0} else sympy.Float(value)
