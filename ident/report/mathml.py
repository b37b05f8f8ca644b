"""Equations of results as MathML that may stand in a page: known elements and attributes, nothing else.

An equation is stored with the result that holds it, as text. It is parsed and written anew, so that
nothing but an equation comes out of it, whatever stands in the file.
"""

from __future__ import annotations

import html
import re
from html.entities import html5
from xml.etree import ElementTree as ET

from ident.report.page import Block, Code, Equation

ELEMENTS = frozenset(
    [
        *("math", "mrow", "mi", "mo", "mn", "mtext", "mspace", "msub", "msup", "msubsup", "mfrac", "msqrt"),
        *("mroot", "mover", "munder", "munderover", "mtable", "mtr", "mtd", "mstyle", "mpadded", "mphantom"),
    ]
)
ATTRIBUTES = frozenset(
    [
        *("display", "displaystyle", "mathvariant", "columnalign", "width"),
        *("stretchy", "fence", "linethickness", "accent"),
    ]
)
_ENTITY = re.compile(r"&([A-Za-z][A-Za-z0-9]*);")
_KEPT = ("lt", "gt", "amp", "quot", "apos")


def equation(text: str) -> Block:
    """Give an equation to show; one that is no MathML is shown as the text it is."""
    root = _parsed(text)
    if root is None:
        return Code(text)
    inside = "".join(map(_written, root)) if _name(root) == "math" else _written(root)
    return Equation(f'<math display="block">{inside}</math>', spoken(root))


def spoken(root: ET.Element) -> str:
    """Give the symbols of an equation in their order, for a reader that cannot see it."""
    return " ".join(part.strip() for part in root.itertext() if part.strip())


def _parsed(text: str) -> ET.Element | None:
    """Parse an equation; None where it is none, or holds anything but known elements."""
    if "<!" in text or "<?" in text:
        return None
    try:
        root = ET.fromstring(_ENTITY.sub(_character, text))  # noqa: S314 -- no declarations, see above
    except ET.ParseError:
        return None
    known = all(_name(one) in ELEMENTS | {"mfenced"} for one in root.iter())
    return root if known else None


def _character(found: re.Match[str]) -> str:
    """Turn a name that HTML knows and XML does not, such as InvisibleTimes, into its character."""
    name = found.group(1)
    return found.group() if name in _KEPT else html.escape(html5.get(f"{name};", found.group()))


def _name(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _written(element: ET.Element) -> str:
    name = _name(element)
    if name == "mfenced":  # browsers no longer draw it
        return _fenced(element)
    given = "".join(
        f' {key}="{html.escape(value)}"' for key, value in element.attrib.items() if key in ATTRIBUTES
    )
    inside = html.escape((element.text or "").strip(), quote=False) + "".join(map(_written, element))
    return f"<{name}{given}>{inside}</{name}>"


def _fenced(element: ET.Element) -> str:
    begin, end = (html.escape(element.get(key, usual)) for key, usual in (("open", "("), ("close", ")")))
    inside = "<mo>,</mo>".join(map(_written, element))
    return f"<mrow><mo>{begin}</mo>{inside}<mo>{end}</mo></mrow>"
