"""Units, converted to SI once, where a file is read.

The registry is our own and short. The angle is a dimension of its own in it, so that degrees never pass
for a ratio, and 1 Hz never for 1 rad/s (as it does with pint's own definitions): a value in cycles is
multiplied by 2 pi here, explicitly, where an angular frequency is needed. ``raw`` is no unit but a count:
good for alignment and correlation, refused in a fit.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from ident.errors import BadRecipe

if TYPE_CHECKING:
    from pint import UnitRegistry

RAW = "raw"
CYCLES = {"Hz": 1.0, "kHz": 1e3}
GRAVITY = {"g": "g_0", "G": "g_0"}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")
_POWER_TOWER = re.compile(r"(?:\^|\*\*)(?!\s*-?\d(?!\d|\s*(?:\^|\*\*)))")
LONGEST = 60
_DEFINITIONS = """
milli- = 1e-3 = m-
micro- = 1e-6 = µ- = u-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
kilo- = 1e3 = k-
mega- = 1e6 = M-
nano- = 1e-9 = n-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [angle] = rad
percent = 0.01 = %
degree = 0.017453292519943295 * radian = deg = ° = degrees
turn = 6.283185307179586 * radian = turn = revolution = rev
minute = 60 * second = min
hour = 3600 * second = h = hr
tonne = 1000 * kilogram = t
pound = 0.45359237 * kilogram = lb
inch = 0.0254 * meter = in
foot = 0.3048 * meter = ft
mile = 1609.344 * meter = mi
newton = kilogram * meter / second ** 2 = N
pound_force = 4.4482216152605 * newton = lbf
standard_gravity = 9.80665 * meter / second ** 2 = g_0
joule = newton * meter = J
watt = joule / second = W
pascal = newton / meter ** 2 = Pa
bar = 100000 * pascal
psi = 6894.757293168 * pascal
Nm = newton * meter
kNm = 1000 * newton * meter
rpm = revolution / minute
hertz = 1 / second = Hz
kph = kilometer / hour = kmh
mph = mile / hour
knot = 1852 * meter / hour = kn
"""


@lru_cache(maxsize=1)
def registry() -> UnitRegistry[Any]:
    """Return the registry of all units, made at first use."""
    from pint import UnitRegistry  # noqa: PLC0415 (heavy; ident --help must not load it)

    units: UnitRegistry[Any] = UnitRegistry(None)
    units.load_definitions(_DEFINITIONS.strip().splitlines())
    return units


def is_raw(unit: str, needed: str) -> bool:
    """Whether ``unit`` says that a value is a count: "raw", or "1" where a dimension is needed."""
    return unit == RAW or (unit == "1" and needed != "1")


def factor(unit: str, needed: str, quantity: str) -> float:
    """Return the factor from ``unit`` to the SI unit ``needed`` of a quantity; 1 for a count.

    Raises
    ------
    BadRecipe
        If the unit is unknown, or has another dimension than ``needed``.
    """
    if is_raw(unit, needed):
        return 1.0
    if needed == "rad/s" and unit in CYCLES:
        return 2 * math.pi * CYCLES[unit]
    if needed == "m/s^2":
        unit = GRAVITY.get(unit, unit)
    units = registry()
    given = _parse(unit, quantity, needed)
    target = _parse(needed, quantity, needed)
    if given.dimensionality != target.dimensionality:
        raise BadRecipe(f"{quantity}: unit {unit!r} does not fit, need a unit of {needed!r}")
    return float(units.Quantity(1.0, given).to(target).magnitude)


def to_si(value: float, unit: str, needed: str, quantity: str) -> float:
    """Convert one value to SI; ``BadRecipe`` where the unit does not fit the quantity."""
    return value * factor(unit, needed, quantity)


def parse_quantity(text: object, *, unit: str, quantity: str) -> float:
    """Read "12500 kg" and return it in ``unit``.

    Raises
    ------
    BadRecipe
        If it is not a number with a unit of the right dimension; a number alone will do only where
        ``unit`` is "1".
    """
    match = _QUANTITY.fullmatch(str(text)) if not isinstance(text, bool) else None
    if match is None or (not match[2] and unit != "1"):
        raise BadRecipe(f"{quantity}: {str(text)!r} is no quantity with a unit, need such as '1 {unit}'")
    if is_raw(match[2], unit):
        raise BadRecipe(f"{quantity}: {str(text)!r} has no unit, need a unit of {unit!r}")
    value = to_si(float(match[1]), match[2] or "1", unit, quantity)
    if not math.isfinite(value):
        raise BadRecipe(f"{quantity}: {str(text)!r} is too large for a number")
    return value


def _parse(unit: str, quantity: str, needed: str) -> Any:
    problem = f"{quantity}: unit {unit!r} is not known, need a unit of {needed!r}"
    if len(unit) > LONGEST or _POWER_TOWER.search(unit):
        raise BadRecipe(problem)
    try:
        return registry().Unit("dimensionless" if unit == "1" else unit)
    except Exception as error:  # pint raises whatever its parser met
        raise BadRecipe(problem) from error
