"""Numbers of messages of random types in every encoding, as Cyclone DDS and as the standard write them.

Cyclone DDS is the oracle for XCDR2 and, but for enums of fewer than 32 bits (to which it gives 32), XCDR1.
What it does not write (short headers, members in another order, unknown members, absent members) a writer of
our own does, made from the standard (``tests/helpers/cdr_writer.py``).
"""

import os
import random
from dataclasses import replace

import numpy as np
import pytest
from cdr_writer import Writer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from type_trees import Arr, Choice, Field, Num, Rec, Seq, as_idl, numbers, structs, values

from ident.logs.cdr import read_columns
from ident.logs.idl import idl_schema

QUICK = settings(
    max_examples=int(os.environ.get("IDENT_EXAMPLES", "60")),
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
