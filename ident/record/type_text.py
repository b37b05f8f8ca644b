"""TYPE OBJECTS -> OMG IDL: the definition of a type as its writer tells it, as text for a log file.

A type identifier names a type that is built in, a plain collection, or the hash of a complete type object
(DDS-XTypes 1.3, 7.3.4 and annex B). Each type object becomes one IDL definition with all that changes how a
message is laid out: extensibility, member numbers, optional and key members, bit bounds, labels. Types follow
what they are made of, so that the text can be read from top to bottom. The objects are those of Cyclone
DDS's Python package; names come from the network and must be IDL names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from ident.errors import IdentError

PRIMITIVES = {
    0x01: "boolean", 0x02: "octet", 0x03: "short", 0x04: "long", 0x05: "long long", 0x06: "unsigned short",
    0x07: "unsigned long", 0x08: "unsigned long long", 0x09: "float", 0x0A: "double", 0x0B: "long double",
    0x0C: "int8", 0x0D: "uint8", 0x10: "char", 0x11: "wchar",
}  # fmt: skip
STRINGS = {
    0x70: ("string", "string_sdefn"), 0x71: ("string", "string_ldefn"),
    0x72: ("wstring", "string_sdefn"), 0x73: ("wstring", "string_ldefn"),
}  # fmt: skip
SEQUENCES = {0x80: "seq_sdefn", 0x81: "seq_ldefn"}
ARRAYS = {0x90: "array_sdefn", 0x91: "array_ldefn"}
MAPS = {0xA0: "map_sdefn", 0xA1: "map_ldefn"}
COMPLETE, MINIMAL, COMPONENT = 0xF2, 0xF1, 0xB0
ALIAS, ENUM, BITMASK, STRUCTURE, UNION, BITSET = 0x30, 0x40, 0x41, 0x51, 0x52, 0x53
SEQUENCE, ARRAY, MAP = 0x60, 0x61, 0x62
MOST_TYPES = 1000
_DEEPEST = 32
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_KEYWORDS = frozenset(
    [
        "abstract",
        "any",
        "alias",
        "attribute",
        "bitfield",
        "bitmask",
        "bitset",
        "boolean",
        "case",
        "char",
        "component",
        "connector",
        "const",
        "consumes",
        "context",
        "custom",
        "default",
        "double",
        "emits",
        "enum",
        "eventtype",
        "exception",
        "factory",
        "false",
        "finder",
        "fixed",
        "float",
        "getraises",
        "getter",
        "home",
        "import",
        "in",
        "inout",
        "interface",
        "int8",
        "int16",
        "int32",
        "int64",
        "local",
        "long",
        "manages",
        "map",
        "mirrorport",
        "module",
        "multiple",
        "native",
        "object",
        "octet",
        "oneway",
        "out",
        "primarykey",
        "port",
        "porttype",
        "private",
        "provides",
        "public",
        "publishes",
        "raises",
        "readonly",
        "sequence",
        "setraises",
        "setter",
        "short",
        "string",
        "struct",
        "supports",
        "switch",
        "true",
        "truncatable",
        "typedef",
        "typeid",
        "typename",
        "typeprefix",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "union",
        "unsigned",
        "uses",
        "valuebase",
        "valuetype",
        "void",
        "wchar",
        "wstring",
    ]
)


class UntoldType(IdentError):
    """The definition of a type cannot be had, or cannot be written as IDL."""


def type_text(identifier: Any, fetch: Callable[[Any], Any]) -> tuple[str, str]:
    """Return the name of a type, and the IDL of it and of all that it is made of.

    Parameters
    ----------
    identifier : the complete identifier of a struct or union
    fetch : returns the type object of an identifier

    Raises
    ------
    UntoldType
        If a type refers to itself, to a minimal type, to a bit set, or has a name that is none of IDL.
    """
    text = _Text(fetch)
    name, sizes = text.kind(identifier)
    if sizes or identifier.discriminator != COMPLETE:
        raise UntoldType("its type is no struct")
    if text.is_ambiguous():
        text = _Text(fetch, root="::")
        text.kind(identifier)
    return name, "\n".join(text.definitions)


class _Text:
    """Definitions in the order in which they are needed; ``_names``: hash -> full name.

    root : what stands before a full name where it is used, "::" where it could be taken for an inner one
    """

    def __init__(self, fetch: Callable[[Any], Any], root: str = "") -> None:
        self.definitions: list[str] = []
        self._fetch = fetch
        self._root = root
        self._names: dict[bytes, str] = {}
        self._inline: dict[bytes, tuple[str, list[int]]] = {}
        self._open: list[bytes] = []
        self._labels: dict[str, dict[int, str]] = {}

    def is_ambiguous(self) -> bool:
        """Whether the first part of a full name is also the name of something inside a module."""
        parts = [name.split("::") for name in self._names.values()]
        return not {first for first, *_ in parts}.isdisjoint(name for _, *rest in parts for name in rest)

    # --- identifiers ------------------------------------------------------------------------------

    def kind(self, identifier: Any, depth: int = 0) -> tuple[str, list[int]]:
        """Return a type as it stands before a member's name, and the array sizes that stand behind it."""
        number = identifier.discriminator
        if depth > _DEEPEST:
            raise UntoldType(f"its type is nested more than {_DEEPEST} deep")
        if number in PRIMITIVES:
            return PRIMITIVES[number], []
        if number in STRINGS:
            word, part = STRINGS[number]
            return word + _bounded(getattr(identifier, part).bound, "<{}>"), []
        if number in SEQUENCES:
            found = getattr(identifier, SEQUENCES[number])
            return self._sequence(found.element_identifier, found.bound, depth), []
        if number in ARRAYS:
            found = getattr(identifier, ARRAYS[number])
            return self._array(found.element_identifier, found.array_bound_seq, depth)
        if number in MAPS:
            found = getattr(identifier, MAPS[number])
            return self._map(found.key_identifier, found.element_identifier, found.bound, depth), []
        if number == COMPLETE:
            return self._defined(identifier, depth)
        if number == COMPONENT:
            raise UntoldType("its type refers to itself")
        raise UntoldType(f"its type is told by an identifier of kind {number:#x}, not by a complete one")

    def _defined(self, identifier: Any, depth: int) -> tuple[str, list[int]]:
        """Write the definition of a type unless it is written; a collection has none and stands in place."""
        key = bytes(identifier.equivalence_hash)
        if key in self._names:
            return self._root + self._names[key], []
        if key in self._inline:
            return self._inline[key]
        if key in self._open:
            raise UntoldType("its type refers to itself")
        if len(self._names) + len(self._inline) >= MOST_TYPES:
            raise UntoldType(f"its type is made of more than {MOST_TYPES} types")
        self._open.append(key)
        told = self._fetch(identifier)
        if told.discriminator != COMPLETE:
            raise UntoldType("its type is told by a minimal type object, which holds no names")
        found = self._define(told.complete, depth + 1)
        self._open.pop()
        if isinstance(found, str):
            self._names[key] = found
            return self._root + found, []
        self._inline[key] = found
        return found

    def _define(self, told: Any, depth: int) -> str | tuple[str, list[int]]:
        kind = told.discriminator
        if kind == SEQUENCE:
            found = told.sequence_type
            return self._sequence(found.element.common.type, found.header.common.bound, depth), []
        if kind == ARRAY:
            found = told.array_type
            return self._array(found.element.common.type, found.header.common.bound_seq, depth)
        if kind == MAP:
            found = told.map_type
            bound = found.header.common.bound
            return self._map(found.key.common.type, found.element.common.type, bound, depth), []
        writers: dict[int, Callable[[Any, int], str]] = {
            STRUCTURE: self._struct, UNION: self._union, ALIAS: self._alias, ENUM: self._enum,
            BITMASK: self._bitmask,
        }  # fmt: skip
        if kind not in writers:
            raise UntoldType(f"its type holds a {'bit set' if kind == BITSET else f'type of kind {kind:#x}'}")
        return writers[kind](told, depth)

    def _sequence(self, element: Any, bound: int, depth: int) -> str:
        return _template("sequence", f"{self._element(element, depth)}{_bounded(bound, ', {}')}")

    def _map(self, key: Any, element: Any, bound: int, depth: int) -> str:
        inner = f"{self._element(key, depth)}, {self._element(element, depth)}"
        return _template("map", f"{inner}{_bounded(bound, ', {}')}")

    def _array(self, element: Any, sizes: Sequence[int], depth: int) -> tuple[str, list[int]]:
        word, inner = self.kind(element, depth + 1)
        return word, [*map(int, sizes), *inner]

    def _element(self, identifier: Any, depth: int) -> str:
        """Return the type of an element; IDL has no place for the sizes of an array there but a typedef."""
        word, sizes = self.kind(identifier, depth + 1)
        if not sizes:
            return word
        name = re.sub(r"\W+", "_", f"{word}_{'_'.join(map(str, sizes))}_array")
        line = f"typedef {word} {name}{_sizes(sizes)};"
        if line not in self.definitions:
            self.definitions.append(line)
        return name

    # --- definitions ------------------------------------------------------------------------------

    def _struct(self, told: Any, depth: int) -> str:
        found = told.struct_type
        base = found.header.base_type
        after = ""
        if base.discriminator:
            after = f" : {self.kind(base, depth)[0]}"
        lines = []
        # What a member's number is unless it is said: one more than that before.
        expected = None if after or found.struct_flags.IS_MUTABLE else 0
        for member in found.member_seq:
            number = int(member.common.member_id)
            notes = _member_notes(member.common.member_flags)
            notes += "" if number == expected else f"@id({number}) "
            expected = None if expected is None else number + 1
            lines.append(f"  {notes}{self._declared(member, member.common.member_type_id, depth)};")
        head = f"{_extensibility(found.struct_flags)}struct"
        return self._add(head, found.header.detail.type_name, f"{after} {{", lines)

    def _union(self, told: Any, depth: int) -> str:
        found = told.union_type
        chosen_by = self.kind(found.discriminator.common.type_id, depth)[0]
        lines = []
        for member in found.member_seq:
            labels = [f"case {self._label(int(label), chosen_by)}:" for label in member.common.label_seq]
            labels += ["default:"] if member.common.member_flags.IS_DEFAULT else []
            declared = self._declared(member, member.common.type_id, depth)
            lines.append(f"  {' '.join(labels)} @id({int(member.common.member_id)}) {declared};")
        head = f"{_extensibility(found.union_flags)}union"
        return self._add(head, found.header.detail.type_name, f" switch ({chosen_by}) {{", lines)

    def _label(self, value: int, chosen_by: str) -> str:
        if chosen_by == "boolean":
            return "TRUE" if value else "FALSE"
        if chosen_by == "char":
            return f"'\\x{value:02x}'"
        return self._labels.get(chosen_by, {}).get(value, str(value))

    def _alias(self, told: Any, depth: int) -> str:
        found = told.alias_type
        word, sizes = self.kind(found.body.common.related_type, depth)
        return self._add(f"typedef {word}", found.header.detail.type_name, _sizes(sizes), None)

    def _enum(self, told: Any, _: int) -> str:
        found = told.enumerated_type
        literals = {int(each.common.value): _idl_name(each.detail.name) for each in found.literal_seq}
        head = f"@bit_bound({int(found.header.common.bit_bound)}) enum"
        lines = [f"  @value({value}) {name}," for value, name in literals.items()]
        name = self._add(
            head, found.header.detail.type_name, " {", [*lines[:-1], *(x[:-1] for x in lines[-1:])]
        )
        scope = name.rpartition("::")[0]
        inside = f"{self._root}{scope}::" if scope else self._root
        self._labels[self._root + name] = {value: inside + text for value, text in literals.items()}
        return name

    def _bitmask(self, told: Any, _: int) -> str:
        found = told.bitmask_type
        lines = [f"  @position({int(f.common.position)}) {_idl_name(f.detail.name)}," for f in found.flag_seq]
        head = f"@bit_bound({int(found.header.common.bit_bound)}) bitmask"
        return self._add(
            head, found.header.detail.type_name, " {", [*lines[:-1], *(x[:-1] for x in lines[-1:])]
        )

    def _declared(self, member: Any, identifier: Any, depth: int) -> str:
        word, sizes = self.kind(identifier, depth)
        return f"{word} {_idl_name(member.detail.name)}{_sizes(sizes)}"

    def _add(self, head: str, full: str, after: str, lines: Sequence[str] | None) -> str:
        """Add a definition inside its modules; return its full name."""
        *modules, name = [_idl_name(part) for part in str(full).split("::")]
        begin = "".join(f"module {module} {{ " for module in modules)
        body = "" if lines is None else "\n" + "".join(f"{line}\n" for line in lines) + "}"
        self.definitions.append(f"{begin}{head} {name}{after}{body};{' };' * len(modules)}")
        return "::".join([*modules, name])


def _extensibility(flags: Any) -> str:
    word = "mutable" if flags.IS_MUTABLE else "appendable" if flags.IS_APPENDABLE else "final"
    return f"@{word} {'@nested ' if flags.IS_NESTED else ''}"


def _member_notes(flags: Any) -> str:
    notes = {
        "key": flags.IS_KEY, "optional": flags.IS_OPTIONAL, "external": flags.IS_EXTERNAL,
        "must_understand": flags.IS_MUST_UNDERSTAND and not flags.IS_KEY,
    }  # fmt: skip
    return "".join(f"@{name} " for name, said in notes.items() if said)


def _bounded(bound: int, form: str) -> str:
    return form.format(int(bound)) if bound else ""


def _template(word: str, inside: str) -> str:
    """Return ``word<inside>``; to some readers ">>" is one sign."""
    return f"{word}<{inside}{' ' if inside.endswith('>') else ''}>"


def _sizes(sizes: Sequence[int]) -> str:
    return "".join(f"[{size}]" for size in sizes)


def _idl_name(name: object) -> str:
    """Return a name as IDL writes it: with "_" before a keyword, and before one that begins with "_"."""
    text = str(name)
    if not _NAME.fullmatch(text):
        raise UntoldType(f"its type uses the name {text[:60]!r}, which is none of IDL")
    return f"_{text}" if text.startswith("_") or text.lower() in _KEYWORDS else text
