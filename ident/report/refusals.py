"""What was refused, put together by reason: many runs may be left out for one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ident.report.numbers import listed
from ident.results import Refusal

MOST_EACH = 3
"""More names than these are told by the folder that they share."""
MOST_PARTS = 8


def by_reason(refused: Sequence[Refusal]) -> list[tuple[str, str]]:
    """Return (what, reason), each reason once, in the order in which they first come."""
    found: dict[str, list[str]] = {}
    for one in refused:
        found.setdefault(one.reason, []).append(one.what)
    return [(_together(names), reason) for reason, names in found.items()]


def _together(names: Sequence[str]) -> str:
    """Join names; those of a folder that holds many of them are counted."""
    names = list(dict.fromkeys(names))
    folders = Counter(_folder(name) for name in names)
    parts = []
    for name in names:
        folder = _folder(name)
        many = bool(folder) and folders[folder] > MOST_EACH
        parts.append(f"{folder}/… ({folders[folder]} runs)" if many else name)
    return listed(list(dict.fromkeys(parts)), MOST_PARTS)


def _folder(name: str) -> str:
    """Return the first folder of a run's name, "" where it has none."""
    return name.partition("/")[0] if "/" in name else ""
