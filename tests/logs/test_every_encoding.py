"""Numbers of messages of random types in every encoding, as Cyclone DDS and as the standard write them.

Cyclone DDS is the oracle for XCDR2 and, but for enums of fewer than 32 bits (to which it gives 32), XCDR1.
What it does not write (short headers, members in another order, unknown members, absent members) a writer of
our own does, made from the standard (``tests/helpers/cdr_writer.py``).
"""

import os
import random
import struct
from dataclasses import replace

import numpy as np
import pytest
from cdr_writer import Writer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from type_trees import Arr, Choice, Field, Num, Rec, Seq, Str, as_idl, numbers, structs, values

from ident.logs import cdr
from ident.logs.cdr import read_columns
from ident.logs.idl import idl_schema
from ident.logs.schema import ros_schema

QUICK = settings(
    max_examples=int(os.environ.get("IDENT_EXAMPLES", "30")),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
ENCODINGS = [(version, big) for version in (1, 2) for big in (False, True)]


@st.composite
def cases(draw, **chosen):
    """A type and some values of it."""
    root = draw(structs([], **chosen))
    return root, draw(st.lists(values(root), min_size=1, max_size=5))


def wide_enums(kind):
    """The same type with enums of 32 bits."""
    if isinstance(kind, Choice):
        return Choice(32)
    if isinstance(kind, Rec):
        return replace(kind, fields=tuple(replace(each, of=wide_enums(each.of)) for each in kind.fields))
    return replace(kind, of=wide_enums(kind.of)) if isinstance(kind, (Seq, Arr)) else kind


def without_enum_arrays(kind, *, inside=False):
    """The same type with numbers of 16 bits in arrays in place of enums."""
    if isinstance(kind, Choice) and inside:
        return Num("short")
    if isinstance(kind, Rec):
        fields = (replace(each, of=without_enum_arrays(each.of)) for each in kind.fields)
        return replace(kind, fields=tuple(fields))
    if isinstance(kind, (Seq, Arr)):
        return replace(kind, of=without_enum_arrays(kind.of, inside=True))
    return kind


def assert_read(messages, root, expected, idl=None):
    """All numbers of all messages are read, and those that a message does not hold are missing."""
    schema = idl_schema(root.name, idl or as_idl(root))
    held = [{path: (kind, value) for path, kind, value in numbers(root, each)} for each in expected]
    wanted = {path: kind for each in held for path, (kind, _) in each.items()}
    read = read_columns(messages, schema, wanted, {})
    assert read.errors == []
    assert read.good.all()
    for path, column in read.columns.items():
        true = [float(each[path][1]) if path in each else np.nan for each in held]
        np.testing.assert_array_equal(column, true, err_msg=str(path))


# --- the oracle -----------------------------------------------------------------------------------------


@QUICK
@given(case=cases())
def test_every_number_is_what_cyclone_dds_wrote(case):
    oracle_type = pytest.importorskip("dds_oracle", reason="cyclonedds is not installed").Oracle
    for version, big in ENCODINGS:
        root = wide_enums(case[0]) if version == 1 else case[0]
        oracle = oracle_type(root)
        messages = [oracle.serialize(value, version=version, big=big) for value in case[1]]
        assert_read(messages, root, case[1])


@QUICK
@given(case=cases())
def test_our_own_writer_of_xcdr2_writes_what_cyclone_dds_writes(case):
    oracle_type = pytest.importorskip("dds_oracle", reason="cyclonedds is not installed").Oracle
    oracle = oracle_type(case[0])
    for big in (False, True):
        for value in case[1]:
            own = Writer(2, ">" if big else "<", dual=True).message(case[0], value)
            assert own == oracle.serialize(value, version=2, big=big)


EACH = Rec(
    "Each",
    "mutable",
    (
        Field("one", Num("octet")),
        Field("two", Num("short")),
        Field("four", Num("float")),
        Field("eight", Num("double")),
        Field("rows", Arr(Num("double"), 3)),
        Field("text", Str()),
        Field("longs", Seq(Num("long"))),
        Field("doubles", Seq(Num("double")), id=70_000),
        Field("inner", Rec("Inner", "mutable", (Field("x", Num("double")), Field("y", Num("octet"))))),
        Field("last", Num("double")),
    ),
)
VALUE = {
    "one": 1, "two": -2, "four": 4.5, "eight": 8.25, "rows": [1.0, 2.0, 3.0], "text": "abc",
    "longs": [5, 6, 7], "doubles": [8.5, 9.5], "inner": {"x": 10.5, "y": 11}, "last": 12.5,
}  # fmt: skip


def test_every_length_code_of_xcdr2_is_read():
    message = Writer(2, dual=True).message(EACH, VALUE)
    codes, place = [], 8
    while place < len(message):
        header, after = np.frombuffer(message[place : place + 8], "<u4").tolist()
        codes.append(header >> 28)
        sizes = {4: 4 + after, 5: 4 + after, 6: 4 + 4 * after, 7: 4 + 8 * after}
        place += 4 + -(-sizes.get(codes[-1], 1 << codes[-1]) // 4) * 4
    assert codes == [0, 1, 2, 3, 4, 5, 6, 7, 4, 3]
    assert_read([message] * 3, EACH, [VALUE] * 3)
    assert_read([Writer(2).message(EACH, VALUE)] * 3, EACH, [VALUE] * 3)


@pytest.mark.parametrize(("version", "short"), [(1, True), (1, False), (2, False)])
def test_messages_of_any_order_of_members_are_read_in_one_channel(version, short):
    writers = [Writer(version, ">" if k % 2 else "<", short, chance=random.Random(k)) for k in range(40)]
    values_ = [{**VALUE, "last": float(k), "one": k} for k in range(40)]
    messages = [each.message(EACH, value) for each, value in zip(writers, values_, strict=True)]
    assert_read(messages, EACH, values_)


def test_alike_messages_of_a_mutable_type_take_one_layout(monkeypatch):
    walked = []
    find = cdr.find_layout
    monkeypatch.setattr(cdr, "find_layout", lambda *args: walked.append(1) or find(*args))
    many = [{**VALUE, "last": float(k)} for k in range(500)]
    assert_read([Writer(1).message(EACH, each) for each in many], EACH, many)
    assert len(walked) == 1


def hand(*members, end=b"\x02\x3f\0\0"):
    """Message of XCDR1 with short headers: (number, bytes)."""
    parts = [struct.pack("<HH", number, len(data)) + data for number, data in members]
    return b"\0\3\0\0" + b"".join(parts) + end


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (hand((0, b"\1\0\0\0"), (0x4009, bytes(4))), "T has no member 9, which its writer marked must_under"),
        (hand((0, b"\1\0\0\0"), (0, b"\2\0\0\0")), "T states its member 0 twice"),
        (hand((0, b"\1\0")), "ends at byte 10, need 12"),
        (hand((0, bytes(8))), "a states 8 bytes, need 4"),
        (hand((0, bytes(4)), end=b""), "ends at byte 12, need 16"),
        (b"\0\3\0\0" + struct.pack("<HHIH", 0, 400, 1, 0x3F02), "a states 400 bytes, has"),
        (hand((0, bytes(4))) + bytes(9), "9 bytes are left over behind the last field of T"),
    ],
)
def test_a_parameter_list_that_makes_no_sense_is_refused_with_its_reason(message, reason):
    good = hand((5, b"\7\0\0\0"), (0x3F03, bytes(4)), (0, b"\3\0\0\0"))
    schema = idl_schema("T", "@mutable struct T { long a; };")
    read = read_columns([good, message, good], schema, {("a",): "int32"}, {})
    assert read.good.tolist() == [True, False, True]
    assert reason in read.errors[0]
    np.testing.assert_array_equal(read.columns[("a",)], [3, np.nan, 3])


def test_a_parameter_list_of_a_type_without_ids_is_refused():
    schema = ros_schema("std_msgs/msg/Float64", "float64 data\n")
    read = read_columns([hand((0, bytes(8)))], schema, {("data",): "float64"}, {})
    assert read.errors == [
        "is a parameter list, the definition of std_msgs/msg/Float64 does not number its members"
    ]


def test_an_optional_field_of_xcdr1_with_the_header_of_another_is_refused():
    schema = idl_schema("T", "@final struct T { long a; @optional @id(3) long b; };")
    data = [b"\0\1\0\0" + struct.pack("<iHHi", 1, number, 4, 2) for number in (3, 4)]
    read = read_columns(data, schema, {("b",): "int32"}, {})
    assert read.good.tolist() == [True, False]
    assert read.errors == ["b has the header of 4, need 3"]


def test_ids_are_those_of_the_annotations_of_idl():
    text = """@autoid(HASH) module m {
      @mutable struct H { long color; @id(7) long b; @hashid("shapesize") long c; }; };
    const long N = 40; @mutable struct Base { @id(0x10) long a; long b; };
    @mutable struct T : Base { long c; @id(N) long d; long e; };"""
    members = idl_schema("T", text).types["T"]
    assert {each.name: each.id for each in members} == {"a": 16, "b": 17, "c": 18, "d": 40, "e": 41}
    # The MD5 of "color" begins with 70dda5df, that of "shapesize" with da907714 (md5sum).
    hashed = {each.name: each.id for each in idl_schema("m::H", text).types["m::H"]}
    assert hashed == {"color": 0x0FA5DD70, "b": 7, "c": 0x047790DA}


def test_arrays_of_enums_that_could_be_either_are_refused():
    kind = Rec("K", "appendable", (Field("e", Seq(Choice(32))), Field("x", Num("octet"))))
    message = Writer(2, enum_lengths=False).message(kind, {"e": [0, 1, 2, 3], "x": 9})
    read = read_columns([message], idl_schema("K", as_idl(kind)), {("x",): "uint8"}, {})
    assert read.errors == [
        "fits a longer type, and this one if its arrays of enums do not state their length"
    ]


# --- the standard ---------------------------------------------------------------------------------------


@QUICK
@given(case=cases(), short=st.booleans(), seed=st.integers(0, 1 << 30))
def test_every_choice_that_a_writer_has_is_read(case, short, seed):
    for version, big in ENCODINGS:
        chance = random.Random(seed)
        writer = Writer(version, ">" if big else "<", short=short, dual=short, chance=chance)
        assert_read([writer.message(case[0], value) for value in case[1]], *case)


@QUICK
@given(case=cases(extensibility="mutable"), data=st.data())
def test_members_that_a_mutable_message_lacks_are_missing_and_cost_nothing(case, data):
    root, expected = case
    left = data.draw(st.lists(st.sampled_from(root.fields), unique_by=lambda each: each.name))
    ids = root.ids()
    written = replace(root, fields=tuple(replace(each, id=ids[each.name]) for each in left))
    held = [{each.name: value[each.name] for each in left} for value in expected]
    for version, big in ENCODINGS:
        writer = Writer(version, ">" if big else "<")
        assert_read([writer.message(written, value) for value in expected], written, held, as_idl(root))


@QUICK
@given(case=cases(extensibility="appendable"), data=st.data())
def test_a_longer_or_shorter_appendable_message_of_xcdr2_is_read(case, data):
    root, expected = without_enum_arrays(case[0]), case[1]
    count = data.draw(st.integers(1, len(root.fields)))
    shorter = replace(root, fields=root.fields[:count])
    held = [{each.name: value[each.name] for each in shorter.fields} for value in expected]
    for wrapped in (False, True):
        short, long = (
            Rec("W", "final", (Field("a", r), Field("z", Num("double")))) if wrapped else r
            for r in (shorter, root)
        )
        some = [{"a": value, "z": 7.5} if wrapped else value for value in held]
        all_ = [{"a": value, "z": 7.5} if wrapped else value for value in expected]
        assert_read([Writer(2).message(short, value) for value in some], short, some, as_idl(long))
        assert_read([Writer(2).message(long, value) for value in all_], short, some, as_idl(short))


@QUICK
@given(case=cases(), seed=st.integers(0, 1 << 30))
def test_messages_of_xcdr2_whose_arrays_of_enums_do_not_state_their_length_are_read(case, seed):
    writer = Writer(2, enum_lengths=False)
    assert_read([writer.message(case[0], value) for value in case[1]], *case)


@QUICK
@given(case=cases(), version=st.sampled_from([1, 2]), at=st.floats(0, 1))
def test_a_message_cut_off_is_an_error_or_lacks_only_its_padding(case, version, at):
    root, expected = case
    data = Writer(version).message(root, expected[0])
    cut = data[: int(at * (len(data) - 1))]
    read = read_columns([cut, data], idl_schema(root.name, as_idl(root)), {}, {})
    assert read.good.tolist() == [False, True]
