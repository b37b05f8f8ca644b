"""Property files for tests: a made-up truck tyre that uses every coefficient; where files of others are."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
OTHERS = Path(os.environ.get("IDENT_TYRE_FILES", ROOT.parent / "shared" / "tyres"))

VERTICAL = {"FNOMIN": 32000.0}
DIMENSION = {"UNLOADED_RADIUS": 0.52}
SCALING = {
    "LFZO": 0.95, "LCX": 1.02, "LMUX": 0.9, "LEX": 1.1, "LKX": 1.05, "LHX": 0.8, "LVX": 1.2, "LGAX": 0.9,
    "LCY": 0.98, "LMUY": 0.92, "LEY": 1.05, "LKY": 1.08, "LHY": 0.7, "LVY": 1.3, "LGAY": 1.1, "LKG": 0.9,
    "LTR": 1.15, "LRES": 0.85, "LGAZ": 0.95, "LXAL": 1.1, "LYKA": 0.9, "LVYKA": 1.2, "LS": 0.8, "LIP": 1.02,
}  # fmt: skip
LONGITUDINAL = {
    "PCX1": 1.6, "PDX1": 0.82, "PDX2": -0.11, "PDX3": 1.4, "PEX1": 0.31, "PEX2": 0.12, "PEX3": -0.05,
    "PEX4": 0.09, "PKX1": 13.5, "PKX2": -1.2, "PKX3": 0.21, "PHX1": -0.0011, "PHX2": 0.0007, "PVX1": 0.002,
    "PVX2": -0.001, "PPX1": -0.3, "PPX2": 0.2, "PPX3": -0.1, "PPX4": 0.3, "RBX1": 10.5, "RBX2": -9.1,
    "RCX1": 1.05, "REX1": 0.2, "REX2": -0.07, "RHX1": 0.004,
}  # fmt: skip
LATERAL = {
    "PCY1": 1.45, "PDY1": 0.76, "PDY2": -0.09, "PDY3": 1.9, "PEY1": 0.2, "PEY2": -0.31, "PEY3": 0.17,
    "PEY4": 2.3, "PKY1": -9.6, "PKY2": 2.7, "PKY3": 0.4, "PHY1": 0.0031, "PHY2": -0.0012, "PHY3": 0.028,
    "PVY1": 0.011, "PVY2": -0.006, "PVY3": -0.21, "PVY4": -0.08, "PPY1": -0.4, "PPY2": 0.6, "PPY3": -0.2,
    "PPY4": 0.1, "RBY1": 12.1, "RBY2": 6.3, "RBY3": 0.012, "RCY1": 1.03, "REY1": 0.11, "REY2": -0.04,
    "RHY1": 0.013, "RHY2": -0.003, "RVY1": 0.016, "RVY2": -0.031, "RVY3": -0.12, "RVY4": 9.5, "RVY5": 1.8,
    "RVY6": -8.2,
}  # fmt: skip
ALIGNING = {
    "QBZ1": 6.3, "QBZ2": -0.4, "QBZ3": -0.9, "QBZ4": 0.5, "QBZ5": -0.7, "QBZ9": 9.1, "QBZ10": 0.3,
    "QCZ1": 1.3, "QDZ1": 0.081, "QDZ2": -0.021, "QDZ3": 0.19, "QDZ4": -2.1, "QDZ6": -0.0016, "QDZ7": 0.0011,
    "QDZ8": -0.047, "QDZ9": 0.022, "QEZ1": -0.4, "QEZ2": 0.31, "QEZ3": -0.11, "QEZ4": 0.27, "QEZ5": -3.1,
    "QHZ1": 0.0061, "QHZ2": -0.0031, "QHZ3": 0.11, "QHZ4": -0.13, "QPZ1": 0.2, "QPZ2": -0.3, "SSZ1": -0.017,
    "SSZ2": 0.021, "SSZ3": 0.24, "SSZ4": -0.33,
}  # fmt: skip
SECTIONS = {
    "VERTICAL": VERTICAL,
    "DIMENSION": DIMENSION,
    "TIRE_CONDITIONS": {"IP": 850000.0, "IP_NOM": 800000.0},
    "VERTICAL_FORCE_RANGE": {"FZMIN": 2000.0, "FZMAX": 70000.0},
    "SCALING_COEFFICIENTS": SCALING,
    "LONGITUDINAL_COEFFICIENTS": LONGITUDINAL,
    "LATERAL_COEFFICIENTS": LATERAL,
    "ALIGNING_COEFFICIENTS": ALIGNING,
}
UNITS = {"LENGTH": "meter", "FORCE": "newton", "ANGLE": "radian", "MASS": "kg", "TIME": "second"}
MODEL = {"PROPERTY_FILE_FORMAT": "PAC2002", "TYRESIDE": "LEFT"}


def tyre_text(*, model: Mapping[str, object] | None = None, without: str = "", **changed: float | str) -> str:
    """Text of a property file.

    model : further lines of [MODEL], or in place of those there
    without : keywords that are left out, apart by spaces
    changed : keyword -> other value
    """
    lines = ["$ a made-up truck tyre", "[UNITS]"]
    lines += [f"{name} = '{word}'" for name, word in UNITS.items()]
    lines += ["[MODEL]"]
    for name, value in (MODEL | dict(model or {})).items():
        lines.append(f"{name} = '{value}'" if isinstance(value, str) else f"{name} = {value}")
    for section, values in SECTIONS.items():
        lines.append(f"[{section}]")
        lines += [
            f"{name:<20} = {changed.get(name, value)}  $ of {section.lower()}"
            for name, value in values.items()
            if name not in without.split()
        ]
    return "\n".join(lines) + "\n"
