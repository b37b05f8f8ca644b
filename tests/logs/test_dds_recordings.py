"""Random types through whole recordings: MCAP with IDL, eProsima's SQLite with type objects."""

import base64
import sqlite3

import numpy as np
import pytest
from cdr_writer import Writer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter
from type_trees import Choice, Field, Num, Rec, Seq, Str, as_idl, numbers, structs, values

from ident.logs import FieldError, open_log

START = 1_700_000_000 * 10**9
QUICK = settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture
def oracle():
    return pytest.importorskip("dds_oracle", reason="cyclonedds is not installed").Oracle


def name_of(path):
    return path[0] + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path[1:])


def write_mcap(path, topics):
    """Topics: name -> (type name, IDL, messages)."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for topic, (kind, idl, messages) in topics.items():
            schema = writer.register_schema(kind, "omgidl", idl.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for k, data in enumerate(messages):
                writer.add_message(channel, START + k, data, START + k)
        writer.finish()
    return path


def assert_columns(log, topic, root, expected):
    held = [{name_of(path): float(value) for path, _, value in numbers(root, each)} for each in expected]
    wanted = list(dict.fromkeys(name for each in held for name in each))
    columns = log.columns(topic, wanted)
    assert list(columns.damage) == []
    assert list(columns.values) == wanted
    for name in wanted:
        true = [each.get(name, np.nan) for each in held]
        np.testing.assert_array_equal(columns.values[name], true, err_msg=name)


@QUICK
@given(data=st.data())
def test_a_recording_with_idl_gives_what_cyclone_dds_wrote(oracle, tmp_path, data):
    root = data.draw(structs([]))
    expected = data.draw(st.lists(values(root), min_size=1, max_size=5))
    made = oracle(root)
    messages = [made.serialize(each, version=2, big=k % 2 == 1) for k, each in enumerate(expected)]
    log = open_log(write_mcap(tmp_path / "a.mcap", {"/t": (root.name, as_idl(root), messages)}))
    assert_columns(log, "/t", root, expected)
    log.close()


@QUICK
@given(data=st.data())
def test_a_recording_with_type_objects_gives_what_cyclone_dds_wrote(oracle, tmp_path_factory, data):
    root = data.draw(structs([]))
    expected = data.draw(st.lists(values(root), min_size=1, max_size=5))
    made = oracle(root)
    messages = [made.serialize(each, version=2, big=False) for each in expected]
    path = write_eprosima(tmp_path_factory.mktemp("db") / "a.db", root.name, made, messages)
    log = open_log(path)
    assert log.format == "eprosima sqlite (types from the recording)"
    assert_columns(log, "t", root, expected)
    log.close()


def write_eprosima(path, kind, made, messages):
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE Topics (name, type, qos, is_ros2_type)")
    database.execute("CREATE TABLE Types (name, information, object, is_ros2_type)")
    database.execute(
        "CREATE TABLE Messages (writer_guid, sequence_number, data_json, data_cdr, data_cdr_size, topic, "
        "type, key, log_time, publish_time)"
    )
    database.execute("INSERT INTO Topics VALUES ('t', ?, '', 'false')", (kind,))
    database.executemany("INSERT INTO Types VALUES (?, ?, ?, 'false')", type_objects(made))
    for k, data in enumerate(messages):
        time = f"2025-10-02 07:24:06.{k:09d}"
        row = ("", k, None, data, len(data), "t", kind, "", time, time)
        database.execute(f"INSERT INTO Messages VALUES ({', '.join('?' * len(row))})", row)
    database.commit()
    database.close()
    return path


def type_objects(made):
    """Name, identifier and complete object of each type, as Cyclone DDS tells them; in base64."""
    for pair in made.type.__idl__.get_type_mapping().identifier_object_pair_complete:
        described = pair.type_object.complete.value
        name = described.header.detail.type_name
        parts = [each.serialize(use_version_2=True)[4:] for each in (pair.type_identifier, pair.type_object)]
        yield (name, *(base64.b64encode(part).decode() for part in parts))


# --- one bad schema, and fields that nobody asked for ---------------------------------------------------

GOOD = Rec("Good", "mutable", (Field("a", Num("double")), Field("b", Choice(8)), Field("s", Seq(Str()))))
UNION = "union U switch (long) { case 1: long a; }; struct Bad { U u; };"
BAD = {
    "union": ("Bad", UNION, "Bad.u: union U is not read"),
    "nonsense": ("Bad", "struct Bad { long ; ]] }", "definition of Bad cannot be read as IDL"),
    "empty": ("Bad", "struct Other { long a; };", "does not define Bad, only Other"),
    "endless": ("Bad", "struct Bad { Bad b; };", None),
    "huge": ("Bad", "struct Bad { double d[1000000][1000000]; };", None),
}


@pytest.mark.parametrize("which", BAD)
def test_one_bad_schema_costs_only_its_own_topic(tmp_path, which):
    expected = [{"a": k / 3, "b": k % 4, "s": ["x"] * k} for k in range(5)]
    messages = [Writer(2).message(GOOD, each) for each in expected]
    kind, idl, reason = BAD[which]
    topics = {
        "/bad": (kind, idl, [bytes.fromhex("00010000") + bytes(8)]),
        "/good": ("Good", as_idl(GOOD), messages),
    }
    log = open_log(write_mcap(tmp_path / "a.mcap", topics))
    assert [(topic.name, topic.messages) for topic in log.topics] == [("/bad", 1), ("/good", 5)]
    assert_columns(log, "/good", GOOD, expected)
    if reason is None:  # the definition can be read, no message fits it
        assert log.columns("/bad", []).damage[0].messages_lost == 1
    else:
        with pytest.raises(FieldError, match=reason):
            log.columns("/bad", [])
    log.close()


def test_one_bad_definition_in_an_idl_file_costs_only_what_is_made_of_it(tmp_path):
    idl = "module m { struct Bad { long ; ]] }; };\nstruct Uses { m::Bad b; };\n" + as_idl(GOOD)
    message = Writer(2).message(GOOD, {"a": 1.5, "b": 2, "s": []})
    topics = {"/good": ("Good", idl, [message]), "/uses": ("Uses", idl, [message])}
    log = open_log(write_mcap(tmp_path / "a.mcap", topics))
    assert log.columns("/good", ["a"]).values["a"].tolist() == [1.5]
    with pytest.raises(FieldError, match=r"Uses\.b: its definition cannot be read as IDL"):
        log.fields("/uses")


def test_only_fields_that_are_asked_for_become_columns(tmp_path):
    messages = [Writer(2).message(GOOD, {"a": float(k), "b": 1, "s": []}) for k in range(3)]
    log = open_log(write_mcap(tmp_path / "a.mcap", {"/good": ("Good", as_idl(GOOD), messages)}))
    assert list(log.columns("/good", ["b"]).values) == ["b"]
    assert log.columns("/good", []).values == {}
    assert len(log.columns("/good", []).log_time) == 3
