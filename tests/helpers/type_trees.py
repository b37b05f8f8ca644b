"""Types of DDS as plain trees: each can be written as IDL, and as random trees with values by hypothesis.

A value is what Python has for it: a dict of the members of a struct, a list of an array or a sequence, a
string, a number; None is an optional member that is absent. Nothing here comes from ``ident``.
"""

import zlib
from dataclasses import dataclass, field

import numpy as np
from hypothesis import strategies as st

NUMBERS = {  # name in IDL -> numpy type
    "boolean": "bool", "octet": "uint8", "char": "uint8", "int8": "int8", "short": "int16", "long": "int32",
    "long long": "int64", "uint8": "uint8", "unsigned short": "uint16", "unsigned long": "uint32",
    "unsigned long long": "uint64", "float": "float32", "double": "float64",
}  # fmt: skip
EXTENSIBILITIES = ("final", "appendable", "mutable")


@dataclass(frozen=True)
class Num:
    """A number, by its name in IDL."""

    idl: str


@dataclass(frozen=True)
class Str:
    """A string; ``bound`` is how long it may be, None without a bound."""

    bound: int | None = None


@dataclass(frozen=True)
class Choice:
    """An enum of ``bits`` bits with the values 0 to 3."""

    bits: int = 32

    @property
    def name(self):
        return f"Choice{self.bits}"


@dataclass(frozen=True)
class Seq:
    of: object
    bound: int | None = None


@dataclass(frozen=True)
class Arr:
    of: object
    size: int


@dataclass(frozen=True)
class Field:
    name: str
    of: object
    optional: bool = False
    id: int | None = None


@dataclass(frozen=True)
class Rec:
    """A struct."""

    name: str
    extensibility: str
    fields: tuple = field(default_factory=tuple)

    def ids(self):
        """Id of each field: as annotated, else one more than the one before."""
        found, number = {}, -1
        for each in self.fields:
            number = number + 1 if each.id is None else each.id
            found[each.name] = number
        return found


# --- as IDL ---------------------------------------------------------------------------------------------


def as_idl(root):
    """IDL of a struct and all it is made of, inner ones first."""
    parts = {}
    _define(root, parts)
    return "\n".join(parts.values())


def _define(kind, parts):
    if isinstance(kind, Rec):
        for each in kind.fields:
            _define(each.of, parts)
        lines = [_line(each) for each in kind.fields]
        parts[kind.name] = "\n".join([f"@{kind.extensibility} struct {kind.name} {{", *lines, "};"])
    elif isinstance(kind, Choice):
        names = ", ".join(f"K{kind.bits}_{k}" for k in range(4))
        parts[kind.name] = f"@bit_bound({kind.bits}) enum {kind.name} {{ {names} }};"
    elif isinstance(kind, (Seq, Arr)):
        _define(kind.of, parts)
        if isinstance(kind.of, Arr):  # an array inside a template needs a name
            name, sizes = _spelled(kind.of)
            parts[_alias(kind.of)] = f"typedef {name} {_alias(kind.of)}{sizes};"


def _line(each):
    notes = "@optional " if each.optional else ""
    notes += f"@id({each.id}) " if each.id is not None else ""
    name, sizes = _spelled(each.of)
    return f"  {notes}{name} {each.name}{sizes};"


def _spelled(kind):
    """Name of a type, and the sizes behind the name of what is declared."""
    if isinstance(kind, Arr):
        name, sizes = _spelled(kind.of)
        return name, f"[{kind.size}]{sizes}"
    if isinstance(kind, Seq):
        inner = _alias(kind.of) if isinstance(kind.of, Arr) else _spelled(kind.of)[0]
        return f"sequence<{inner}{'' if kind.bound is None else f', {kind.bound}'}>", ""
    if isinstance(kind, Str):
        return "string" if kind.bound is None else f"string<{kind.bound}>", ""
    return (kind.idl if isinstance(kind, Num) else kind.name), ""


def _alias(kind):
    return f"A{zlib.crc32(repr(kind).encode()):08x}"


# --- numbers in it --------------------------------------------------------------------------------------


def numbers(kind, value, path=()):
    """Yield (path, numpy type, value) of every number that a value holds."""
    if value is None:
        return
    if isinstance(kind, Num):
        yield path, NUMBERS[kind.idl], value
    elif isinstance(kind, Choice):
        yield path, f"int{kind.bits}", value
    elif isinstance(kind, (Seq, Arr)):
        for index, each in enumerate(value):
            yield from numbers(kind.of, each, (*path, index))
    elif isinstance(kind, Rec):
        for each in kind.fields:
            yield from numbers(each.of, value.get(each.name), (*path, each.name))


# --- random ones ----------------------------------------------------------------------------------------


def kinds(names, depth=2):
    """Random types; ``names`` is a list that grows by the names of the structs."""
    simple = st.one_of(
        st.sampled_from([Num(name) for name in NUMBERS]),
        st.sampled_from([Str(), Str(9), Choice(8), Choice(16), Choice(32)]),
    )
    if depth == 0:
        return simple
    inner = kinds(names, depth - 1)
    return st.one_of(
        simple,
        st.builds(Seq, inner, st.sampled_from([None, 4])),
        st.builds(Arr, inner, st.integers(1, 3)),
        structs(names, depth - 1),
    )


@st.composite
def structs(draw, names, depth=2, extensibility=None):
    """Random structs with ids, of which some leave gaps and some need extended headers."""
    chosen = extensibility or draw(st.sampled_from(EXTENSIBILITIES))
    number, fields = -1, []
    for index in range(draw(st.integers(1, 5))):
        step = draw(st.sampled_from([1, 1, 1, 2, 70, 20_000]))
        number += step
        kind = draw(kinds(names, depth))
        fields.append(Field(f"f{index}", kind, draw(st.integers(0, 3)) == 0, None if step == 1 else number))
    names.append(f"S{len(names)}")
    return Rec(names[-1], chosen, tuple(fields))


def values(kind):
    """Random values of a type."""
    if isinstance(kind, Num):
        return _plain("char" if kind.idl == "char" else NUMBERS[kind.idl])
    if isinstance(kind, Choice):
        return st.integers(0, 3)
    if isinstance(kind, Str):
        return st.text("abcdé", max_size=4)
    if isinstance(kind, Seq):
        return st.lists(values(kind.of), max_size=3)
    if isinstance(kind, Arr):
        return st.lists(values(kind.of), min_size=kind.size, max_size=kind.size)
    return st.fixed_dictionaries({each.name: _member(each) for each in kind.fields})


def _member(each):
    return st.none() | values(each.of) if each.optional else values(each.of)


def _plain(name):
    if name == "bool":
        return st.booleans()
    if name == "char":
        return st.integers(0, 127)
    if name.startswith("float"):
        return st.floats(width=int(name[5:]), allow_nan=False)
    limits = np.iinfo(name)
    return st.integers(int(limits.min), int(limits.max))
