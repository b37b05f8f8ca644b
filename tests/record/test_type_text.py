"""Type objects of Cyclone DDS as IDL: what is written, and that it means the same to readers of IDL."""

# No `from __future__ import annotations`: cyclonedds reads the annotations of its classes themselves.
import subprocess
import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Optional

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: pip install 'ident[dds]'")

import cyclonedds.idl.annotations as note
import cyclonedds.idl.types as of
import dds_types as types
from cyclonedds import idl

from ident.logs.idl import idl_schema
from ident.logs.schema import Many, Number, Struct
from ident.record.type_text import UntoldType, type_text

# ruff: noqa: UP045 (cyclonedds reads Optional alone)


@note.bit_bound(8)
class Mode(idl.IdlEnum, typename="deep.kinds.Mode"):
    off = 0
    hold = 3


@note.bit_bound(16)
@dataclass
class Faults(idl.IdlBitmask, typename="deep.kinds.Faults"):
    hot: bool
    note.position("hot", 2)
    wet: bool
    note.position("wet", 9)


@note.appendable
class Either(idl.IdlUnion, discriminator=Mode, typename="deep.kinds.Either"):
    first: of.case[[Mode.off], of.int32]
    other: of.default[str]


@dataclass
@note.final
class Base(idl.IdlStruct, typename="deep.Base"):
    count: of.int64


@dataclass
@note.final
class Deep(Base, typename="deep.kinds.Deep"):
    module: of.int8
    own: of.uint16
    mode: Mode
    faults: Faults
    either: Either
    table: of.array[of.array[of.float64, 3], 2]
    rows: of.sequence[of.array[of.float32, 4]]
    lists: of.sequence[of.sequence[of.int32, 5]]
    letter: of.char
    octet_: of.byte
    perhaps: Optional[of.uint64]
    text: of.bounded_str[300]
    speed: of.typedef["deep.Speed", of.float64]  # noqa: F821


DEEP = """\
module deep { @final struct Base {
  long long count;
}; };
module deep { module kinds { @bit_bound(8) enum Mode {
  @value(0) off,
  @value(3) hold
}; }; };
module deep { module kinds { @bit_bound(16) bitmask Faults {
  @position(2) hot,
  @position(9) wet
}; }; };
module deep { module kinds { @appendable union Either switch (deep::kinds::Mode) {
  case deep::kinds::off: @id(0) long first;
  default: @id(1) string other;
}; }; };
typedef float float_4_array[4];
module deep { typedef double Speed; };
module deep { module kinds { @final struct Deep : deep::Base {
  @id(1) int8 _module;
  @id(2) unsigned short own;
  @id(3) deep::kinds::Mode mode;
  @id(4) deep::kinds::Faults faults;
  @id(5) deep::kinds::Either either;
  @id(6) double table[2][3];
  @id(7) sequence<float_4_array> rows;
  @id(8) sequence<sequence<long, 5> > lists;
  @id(9) char letter;
  @id(10) octet octet_;
  @optional @id(11) unsigned long long perhaps;
  @id(12) string<300> text;
  @id(13) deep::Speed speed;
}; }; };"""


@dataclass
@note.final
class OuterName(idl.IdlStruct, typename="twice.Name"):
    x: of.float32


@dataclass
@note.final
class InnerName(idl.IdlStruct, typename="other.twice.Name"):
    y: of.float64


@dataclass
@note.final
class Named(idl.IdlStruct, typename="other.Named"):
    outer: OuterName
    inner: InnerName


# Cyclone DDS's own reader of IDL: case sensitive, with int8; it ends with the parser's answer.
PARSE = """
import ctypes, sys
from pathlib import Path
import cyclonedds

folder = Path(cyclonedds.__file__).parents[1] / "cyclonedds.libs"
library = ctypes.CDLL(str(next(folder.glob("libcycloneddsidl*"))))
state = ctypes.c_void_p()
known = ctypes.byref(ctypes.c_char.in_dll(library, "builtin_annotations"))
assert library.idl_create_pstate(6, known, ctypes.byref(state)) == 0
sys.exit(library.idl_parse_string(state, b'# 1 "read.idl"\\n' + sys.stdin.buffer.read()) != 0)
"""


def told(kind: Any) -> tuple[str, str]:
    pairs = kind.__idl__.get_type_mapping().identifier_object_pair_complete
    objects = {bytes(pair.type_identifier.equivalence_hash): pair.type_object for pair in pairs}
    return type_text(kind.__idl__.get_type_id(), lambda each: objects[bytes(each.equivalence_hash)])


def test_every_construct_is_written_as_it_was_declared() -> None:
    assert told(Deep) == ("deep::kinds::Deep", DEEP)


@pytest.mark.skipif(sys.platform != "linux", reason="the library has this name on Linux")
@pytest.mark.parametrize("text", [DEEP, told(types.State)[1], told(types.Loose)[1], told(Named)[1]])
def test_the_reader_of_cyclone_dds_takes_the_text(text: str) -> None:
    def parse(given: str) -> int:
        command = [sys.executable, "-c", PARSE]
        return subprocess.run(command, input=given, text=True, capture_output=True, check=False).returncode

    assert parse(text) == 0
    if text == DEEP:
        assert parse(text.replace("deep::Speed speed", "deep::Sped speed")) == 1


def test_ident_reads_what_was_declared() -> None:
    schema = idl_schema(*told(types.State))
    members = {member.name: member for member in schema.types[schema.root]}
    assert schema.root == "truck::State"
    assert list(members) == [
        "stamp", "number", "gear", "angle", "wheels", "counts", "grid", "text", "extra", "flag", "big",
    ]  # fmt: skip
    assert members["wheels"].kind == Many(Struct("truck::basic::Wheel"))
    assert members["grid"].kind == Many(Number("float32"), 3)
    assert [name for name, member in members.items() if member.optional] == ["extra"]
    assert schema.delimited == {"truck::State", "truck::basic::Wheel"}


def test_names_that_idl_reserves_are_read_back() -> None:
    for name in ("module", "_own", "Sequence"):
        text = type_text(complete(b"a"), lambda _, name=name: struct("A", name, FLOAT))
        assert [member.name for member in idl_schema(*text).types["A"]] == [name]


def test_names_that_stand_inside_each_other_are_told_apart() -> None:
    name, text = told(Named)
    assert name == "other::Named"
    assert "::twice::Name outer;" in text
    schema = idl_schema(name, text)
    assert [member.kind for member in schema.types[name]] == [
        Struct("twice::Name"),
        Struct("other::twice::Name"),
    ]


# --- refusals ----------------------------------------------------------------------------------------


def complete(key: bytes) -> Any:
    return SimpleNamespace(discriminator=0xF2, equivalence_hash=key)


def struct(name: str, member: str, kind: Any) -> Any:
    """A complete type object of a struct with one member."""
    flags = SimpleNamespace(
        IS_MUTABLE=False, IS_APPENDABLE=False, IS_NESTED=False, IS_KEY=False, IS_OPTIONAL=False,
        IS_EXTERNAL=False, IS_MUST_UNDERSTAND=False,
    )  # fmt: skip
    only = SimpleNamespace(
        common=SimpleNamespace(member_id=0, member_flags=flags, member_type_id=kind),
        detail=SimpleNamespace(name=member),
    )
    header = SimpleNamespace(
        base_type=SimpleNamespace(discriminator=0), detail=SimpleNamespace(type_name=name)
    )
    found = SimpleNamespace(struct_flags=flags, header=header, member_seq=[only])
    return SimpleNamespace(
        discriminator=0xF2, complete=SimpleNamespace(discriminator=0x51, struct_type=found)
    )


FLOAT = SimpleNamespace(discriminator=9)


def test_a_struct_with_a_number_is_written() -> None:
    assert type_text(complete(b"a"), lambda _: struct("A", "x", FLOAT)) == (
        "A",
        "@final struct A {\n  float x;\n};",
    )


@pytest.mark.parametrize(
    ("identifier", "answer", "words"),
    [
        (FLOAT, None, "its type is no struct"),
        (complete(b"a"), struct("A", "x", complete(b"a")), "its type refers to itself"),
        (complete(b"a"), struct("A", "x; }; //", FLOAT), r"'x; \}; //', which is none of IDL"),
        (complete(b"a"), struct("a::<script>", "x", FLOAT), "'<script>', which is none of IDL"),
        (complete(b"a"), struct("A", "x", SimpleNamespace(discriminator=0xF1)), "not by a complete one"),
        (complete(b"a"), SimpleNamespace(discriminator=0xF1), "minimal type object"),
        (
            complete(b"a"),
            SimpleNamespace(discriminator=0xF2, complete=SimpleNamespace(discriminator=0x53)),
            "holds a bit set",
        ),
    ],
)
def test_a_type_that_cannot_be_written_is_refused(identifier: Any, answer: Any, words: str) -> None:
    with pytest.raises(UntoldType, match=words):
        type_text(identifier, lambda _: answer)


def test_a_type_of_endlessly_many_parts_is_refused() -> None:
    number = iter(range(10_000))

    def answer(_: Any) -> Any:
        k = next(number)
        return struct(f"A{k}", "x", complete(b"%d" % (k + 1)))

    with pytest.raises(UntoldType, match="nested more than 32 deep"):
        type_text(complete(b"0"), answer)
