"""CDR in all its encodings: messages that Cyclone DDS wrote, whose values are known."""

import numpy as np
import pytest

from ident.logs.cdr import read_columns
from ident.logs.idl import idl_schema
from ident.logs.record import FieldError

# Written by Cyclone DDS 11.0.1 (Python), of a::C as final and as appendable type, in XCDR1 and XCDR2.
MESSAGES = {
    ("final", "00010000"): (
        "000100000200000003000000787800000000004004000000000000000200000000000000000000000000f03f"
        "020000000000000000000000000000000000803f000000000100000000000000000000000100000000000000"
        "090000000000000000000040010000000000000000000000000000c0000000000000f03f0000000000000040"
        "00000000000000400000000000805940"
    ),
    ("final", "00070000"): (
        "000700000200000003000000787800000000004004000000000000000c00000002000000000000000000f03f"
        "1c000000020000000000000000000000000000000000803f0100000000000000040000000000000001000000"
        "00000000200000000c0000000900000000000000000000400c0000000100000000000000000000c000000000"
        "0000f03f000000000000004000000000000000400000000000805940"
    ),
    ("appendable", "00010000"): (
        "000100000200000003000000787800000000004004000000000000000200000000000000000000000000f03f"
        "020000000000000000000000000000000000803f000000000100000000000000000000000100000000000000"
        "090000000000000000000040010000000000000000000000000000c0000000000000f03f0000000000000040"
        "00000000000000400000000000805940"
    ),
    ("appendable", "00090000"): (
        "000900009c0000000200000003000000787800000000004004000000000000000c0000000200000000000000"
        "0000f03f1c000000020000000000000000000000000000000000803f01000000000000000400000000000000"
        "0100000000000000200000000c0000000900000000000000000000400c0000000100000000000000000000c0"
        "000000000000f03f000000000000004000000000000000400000000000805940"
    ),
}
IDL = """module a {
  @final struct P { float x; long long y; };
  @appendable struct Q { octet k; double w; };
  enum E { A, B };
  @EXTENSIBILITY struct C {
    unsigned long id; string s; P p; Q q; sequence<P> ps; sequence<string> ss; E e; sequence<double> d;
    Q ar[2]; double n[3]; double last;
  };
};"""
EXPECTED = {
    ("id",): ("uint32", 2.0),
    ("p", "x"): ("float32", 2.0),
    ("p", "y"): ("int64", 4.0),
    ("q", "k"): ("uint8", 2.0),
    ("q", "w"): ("float64", 1.0),
    ("ps", 1, "x"): ("float32", 1.0),
    ("e",): ("int32", 1.0),
    ("ar", 0, "k"): ("uint8", 9.0),
    ("ar", 1, "w"): ("float64", -2.0),
    ("n", 2): ("float64", 2.0),
    ("last",): ("float64", 102.0),
}
TYPES = {path: kind for path, (kind, _) in EXPECTED.items()}


def schema(extensibility):
    return idl_schema("a::C", IDL.replace("EXTENSIBILITY", extensibility))


@pytest.mark.parametrize("key", MESSAGES, ids="-".join)
def test_every_encoding_gives_the_values_that_were_written(key):
    data = bytes.fromhex(MESSAGES[key])
    read = read_columns([data] * 3, schema(key[0]), TYPES, {})
    assert read.errors == []
    for path, (_, value) in EXPECTED.items():
        assert read.columns[path].tolist() == [value] * 3, path


@pytest.mark.parametrize("key", MESSAGES, ids="-".join)
def test_a_message_cut_off_anywhere_is_an_error_and_costs_no_other(key):
    data = bytes.fromhex(MESSAGES[key])
    cut = [data[:size] for size in range(len(data))]
    read = read_columns([data, *cut, data], schema(key[0]), TYPES, {})
    assert np.flatnonzero(read.good).tolist() == [0, len(data) + 1]
    assert len(read.errors) == len(cut)


def test_messages_of_which_each_has_its_own_layout_are_all_read():
    types = idl_schema("T", "struct T { string a; string b; double c; };")
    messages = []
    for k in range(300):  # of one size, with two strings that share 300 bytes in 300 ways
        a, b = b"x" * k + b"\0", b"y" * (300 - k) + b"\0"
        body = len(a).to_bytes(4, "little") + a
        body += bytes(-len(body) % 4) + len(b).to_bytes(4, "little") + b
        body += bytes(-len(body) % 8) + np.float64(k).tobytes()
        messages.append(b"\0\1\0\0" + body)
    read = read_columns(messages, types, {("c",): "float64"}, {})
    assert read.columns[("c",)].tolist() == list(range(300))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("struct T { Other o; };", "Other is not defined"),
        ("union U switch (long) { case 1: long a; }; struct T { U u; };", "T.u: union U is not read"),
        ("@mutable struct T { @id(3) long a; @id(3) long b; };", "two of its members have the same id"),
        ("struct T { wstring w; };", "wide text is not read"),
        ("struct T { map<long, long> m; };", "a map is not read"),
        ("struct T { long a[N]; };", "the size of a is not known"),
        ("struct T { long a;", "it ends early"),
        ("struct S { long a; };", "does not define T, only S"),
        ("hello", "'hello' where a definition is needed"),
        ("", "does not define T, only nothing"),
    ],
)
def test_idl_that_cannot_be_used_is_refused_in_one_line(text, reason):
    with pytest.raises(FieldError, match=reason) as caught:
        idl_schema("T", text)
    assert "\n" not in str(caught.value)


def test_idl_knows_constants_typedefs_modules_bases_and_annotations():
    text = """
    #include "other.idl"
    /* a comment */
    module a { const long N = 2 * 3; typedef sequence<octet, N> Bytes; typedef double Vec[3];
      module b {
        struct Base { @key long id; }; @final struct T : ::a::b::Base { Vec v; Bytes d; short m[N][2];
        unsigned long long u; @optional double o; boolean _module; }; }; };  // the end
    """
    found = idl_schema("a/b/T", text)
    members = {member.name: member for member in found.types["a::b::T"]}
    assert list(members) == ["id", "v", "d", "m", "u", "o", "module"]
    assert members["m"].kind.size == 6
    assert members["m"].kind.of.size == 2
    assert members["u"].kind.type == "uint64"
    assert members["o"].optional
    assert found.delimited == frozenset({"a::b::Base"})
