"""The colours of every figure, page and recording, each with its meaning.

The hues are those of Okabe and Ito, which stay apart for colour-blind readers, and differ in lightness
too, so that a print in grey can still be read. ``DARK`` holds the same names for a dark background.
"""

from __future__ import annotations

LIGHT: dict[str, str] = {
    "measured": "#15181c",
    "modelled": "#d55e00",
    "request": "#8b939d",
    "residual": "#0072b2",
    "band": "#f2c9a8",
    "other_1": "#0a7abf",
    "other_2": "#00876a",
    "other_3": "#7a4fa3",
    "other_4": "#b23a72",
    "other_5": "#6a6b00",
    "other_6": "#5d4a3f",
    "scale_low": "#cfd9dc",
    "scale_middle": "#7f9aa5",
    "scale_high": "#233a46",
    "minus": "#2a6fb0",
    "between": "#fbfbfa",
    "plus": "#c4511c",
    "text": "#23282e",
    "muted": "#5b646e",
    "grid": "#e4e7ea",
    "axis": "#aab1b8",
    "surface": "#ffffff",
    "page": "#f5f6f7",
    "good": "#00694a",
    "good_fill": "#e3f3ed",
    "caution": "#8a5200",
    "caution_fill": "#fdf0d8",
    "bad": "#a3221b",
    "bad_line": "#c0392b",
    "bad_fill": "#fbe6e3",
}

DARK: dict[str, str] = {
    "measured": "#f0f2f4",
    "modelled": "#ff8a3c",
    "request": "#838b95",
    "residual": "#56b4e9",
    "band": "#6b3d1b",
    "other_1": "#5fb9ee",
    "other_2": "#44c9a4",
    "other_3": "#c3a0e6",
    "other_4": "#f08db8",
    "other_5": "#cfc94a",
    "other_6": "#c9ad98",
    "scale_low": "#38454c",
    "scale_middle": "#7390a0",
    "scale_high": "#e2eef4",
    "minus": "#4d9be0",
    "between": "#22272d",
    "plus": "#f07a3e",
    "text": "#e3e6e9",
    "muted": "#a1a9b2",
    "grid": "#31373e",
    "axis": "#59616a",
    "surface": "#1b1f24",
    "page": "#121518",
    "good": "#5fd3a8",
    "good_fill": "#12352a",
    "caution": "#f0b455",
    "caution_fill": "#3a2a0e",
    "bad": "#ff8d80",
    "bad_line": "#ff7b6b",
    "bad_fill": "#421a17",
}


def dark_of_light() -> dict[str, str]:
    """Give the dark colour that stands for each light one, so that a drawn figure can change."""
    return {colour: DARK[name] for name, colour in LIGHT.items()}
