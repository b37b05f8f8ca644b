"""Units of tyre property files: what the words of ``[UNITS]`` mean, and which keywords have which unit.

Only lengths, forces, angles of ranges, speeds and the like have a unit. The coefficients of the Magic
Formula are numbers alone by their making (loads are divided by the nominal load, lengths by the radius)
and hold for slip angles in radians, whatever ``ANGLE`` says: that is the choice made here, since the
formula takes them so.
"""

from __future__ import annotations

from collections.abc import Mapping

from ident.errors import BadRecipe
from ident.units import factor
from ident.yaml_file import nearest

WORDS = {
    "LENGTH": {
        "m": "meter m",
        "mm": "millimeter mm",
        "cm": "centimeter cm",
        "km": "kilometer km",
        "in": "inch in",
        "ft": "foot ft",
        "mi": "mile",
    },
    "FORCE": {
        "N": "newton n",
        "kN": "knewton kilonewton kn",
        "lbf": "pound_force lbf",
        "klbf": "kpound_force",
        "kg*g_0": "kg_force kilogram_force kgf",
    },
    "ANGLE": {"rad": "radian radians rad", "deg": "degree degrees deg"},
    "MASS": {
        "kg": "kg kilogram",
        "gram": "gram",
        "t": "tonne megagram",
        "lb": "pound_mass lbm",
        "lbf*s**2/ft": "slug",
    },
    "TIME": {"s": "second sec s", "ms": "millisecond ms", "min": "minute min", "hour": "hour h"},
    "PRESSURE": {
        "Pa": "pascal pa",
        "kPa": "kpascal kilopascal kpa",
        "MPa": "megapascal mpascal mpa",
        "bar": "bar",
        "psi": "psi",
    },
}
SI = {"LENGTH": "m", "FORCE": "N", "ANGLE": "rad", "MASS": "kg", "TIME": "s", "PRESSURE": "Pa"}
_KEYWORDS = {
    "UNLOADED_RADIUS WIDTH RIM_RADIUS RIM_WIDTH BOTTOMING_RADIUS": {"LENGTH": 1},
    "FNOMIN FZMIN FZMAX": {"FORCE": 1},
    "ALPMIN ALPMAX CAMMIN CAMMAX": {"ANGLE": 1},
    "LONGVL VXLOW": {"LENGTH": 1, "TIME": -1},
    "VERTICAL_STIFFNESS": {"FORCE": 1, "LENGTH": -1},
    "VERTICAL_DAMPING": {"FORCE": 1, "TIME": 1, "LENGTH": -1},
    "IP IP_NOM INFLPRES NOMPRES PRESMIN PRESMAX": {"PRESSURE": 1},
    "MBELT BELT_MASS MASS": {"MASS": 1},
}
DIMENSIONS = {keyword: powers for keywords, powers in _KEYWORDS.items() for keyword in keywords.split()}


def si_factor(keyword: str, units: Mapping[str, str], source: str) -> float:
    """Return the factor from the units of a file to SI for the value of a keyword; 1 where it has no unit.

    Parameters
    ----------
    units : words of the units section, such as {"LENGTH": "meter"}
    source : what the message begins with

    Raises
    ------
    BadRecipe
        If a unit that the keyword needs is missing, or its word is not known.
    """
    product = 1.0
    for kind, power in DIMENSIONS.get(keyword, {}).items():
        product *= _unit(kind, keyword, units, source) ** power
    return product


def _unit(kind: str, keyword: str, units: Mapping[str, str], source: str) -> float:
    word = units.get(kind, "").lower()
    if not word and kind == "PRESSURE":
        return _unit("FORCE", keyword, units, source) / _unit("LENGTH", keyword, units, source) ** 2
    if not word:
        raise BadRecipe(
            f"{source}: {keyword} has a unit, but [UNITS] has no {kind}, need such as {SI[kind]!r}"
        )
    known = {name: unit for unit, names in WORDS[kind].items() for name in names.split()}
    if word not in known:
        raise BadRecipe(f"{source}: [UNITS] {kind} = {word!r} is not known, {nearest(word, known)}")
    return factor(known[word], SI[kind], f"{kind} of {source}")
