"""Numbers as text: rounded to what their standard error supports, with their units.

A value is given to the second significant digit of its standard error, its interval to the same place.
"""

from __future__ import annotations

import math

from ident.results import Estimate

NONE = "–"
RANGE = " … "


def significant(value: float | None, digits: int = 3) -> str:
    """Round to ``digits`` significant digits, without an exponent between 1e-4 and 1e6."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return fixed(value, max(0, digits - 1 - math.floor(math.log10(abs(value)))))


def fixed(value: float, decimals: int) -> str:
    """Give ``decimals`` places, with a true minus sign and never "-0.0"."""
    text = f"{value:.{decimals}f}"
    if float(text) == 0:
        text = text.removeprefix("-")
    return text.replace("-", "−")


def decimals_of(std: float | None, low: float | None = None, high: float | None = None) -> int | None:
    """Count the decimals that show two significant digits of the standard error, None without one.

    Without ``std`` the half width of the interval stands for it.
    """
    if std is None and low is not None and high is not None:
        std = (high - low) / 4
    if std is None or not math.isfinite(std) or std <= 0:
        return None
    return min(max(0, 1 - math.floor(math.log10(std))), 9)


def estimate_value(estimate: Estimate) -> str:
    """Give the value alone, to the place its standard error supports."""
    if estimate.value is None:
        return NONE
    places = decimals_of(estimate.std, estimate.low, estimate.high)
    return significant(estimate.value, 4) if places is None else fixed(estimate.value, places)


def estimate_interval(estimate: Estimate) -> str:
    """Give the ends of the 95 % interval, or a dash where there is none."""
    if estimate.low is None or estimate.high is None:
        return NONE
    places = decimals_of(estimate.std, estimate.low, estimate.high)
    if places is None:
        return significant(estimate.low, 4) + RANGE + significant(estimate.high, 4)
    return fixed(estimate.low, places) + RANGE + fixed(estimate.high, places)


def unit_text(unit: str) -> str:
    """Show a unit; that of a plain number is a dash."""
    return NONE if unit == "1" else unit.replace("^2", "²").replace("^3", "³").replace("s^-1", "1/s")


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """Give a value and its unit, with a space between that does not break."""
    text = significant(value, digits)
    return text if unit == "1" or text == NONE else f"{text}\u00a0{unit_text(unit)}"


def angle(value: float | None) -> str:
    """Give an angle [rad], small ones in mrad, with degrees beside it."""
    if value is None or not math.isfinite(value):
        return NONE
    small = abs(value) < 0.1
    text = f"{significant(value * 1e3)}\u00a0mrad" if small else f"{significant(value)}\u00a0rad"
    return f"{text} ({significant(math.degrees(value), 2)}°)"


def percent(share: float | None) -> str:
    """Give a share [-] in percent with two decimals, and more where it is within 0.01 % of the whole."""
    if share is None or not math.isfinite(share):
        return NONE
    places = 4 if 0.9999 <= share < 1 else 2
    if 1 - 5e-7 <= share < 1:
        return "> 99.9999\u00a0%"
    return f"{fixed(share * 100, places)}\u00a0%"


def p_value(value: float | None) -> str:
    """Give a p-value with two significant digits, small ones as a bound: p = 0.41, p < 0.001."""
    if value is None or not math.isfinite(value):
        return f"p {NONE}"
    return "p < 0.001" if value < 0.001 else f"p = {significant(value, 2)}"


def duration(seconds: float) -> str:
    """Give a length of time as h, min and s, below a minute in seconds with one decimal."""
    if seconds < 60:
        return f"{seconds:.1f}\u00a0s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    parts = [f"{hours}\u00a0h"] if hours else []
    return " ".join([*parts, f"{minutes}\u00a0min", f"{rest}\u00a0s"])


def size(count: int) -> str:
    """Give a number of bytes in the largest decimal unit that keeps it above one."""
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= factor:
            return f"{significant(count / factor)}\u00a0{unit}"
    return f"{count}\u00a0B"


def count(number: int, what: str, plural: str = "") -> str:
    """Give a number with its noun: 1 gap, 2 gaps."""
    noun = what if number == 1 else (plural or what + "s")
    return f"{number:,}".replace(",", "\u202f") + f" {noun}"


def shorten(text: str, length: int) -> str:
    """Cut a long name in its middle, where it tells least."""
    if len(text) <= length:
        return text
    head = (length - 1) // 2
    return f"{text[:head]}…{text[head + 1 - length :]}"


def listed(names: list[str], most: int = 4) -> str:
    """Join names with commas, the rest of a long list counted."""
    if len(names) <= most:
        return ", ".join(names)
    return ", ".join(names[:most]) + f" and {len(names) - most} more"


def plain(text: str) -> str:
    """Make text from a log safe for a terminal: one line, no control characters, valid Unicode."""
    return "".join(map(_plain_character, text))


def _plain_character(character: str) -> str:
    if character.isprintable():
        return character
    return " " if character.isspace() else "\N{REPLACEMENT CHARACTER}"
