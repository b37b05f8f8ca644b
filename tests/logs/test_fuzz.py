"""What no damage may bring out: errors of others, hangs, memory without bound, changed files."""

import base64
import os
import signal
import tempfile
import time

import fuzz_logs
import numpy as np
import pytest
from fuzz_logs import FINE, read_apart, run_batch, table
from fuzz_mutations import CHANGES, mutation
from fuzz_targets import outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_corpus import IDL, ROS1, ROS2, SEEDS, definition_of, seeds, struct_object

from ident.logs.decode import BinaryDecoder
from ident.logs.record import Channel, FieldError, Stored
from ident.logs.type_object import read_type_objects

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
FEW = 20
ANY = 10_000_000  # numbers far from those of the study
DAMAGED = {"no footer", "no checksums", "no summary", "active", "two types"}


@pytest.mark.parametrize("kind", list(SEEDS))
def test_damaged_files_give_values_or_our_own_errors(tmp_path, kind):
    row = run_batch(kind, range(ANY, ANY + FEW), tmp_path / "found")
    assert row["defects"] == []
    assert sum(row[end] for end in FINE) == FEW


@pytest.mark.parametrize("kind", [kind for kind in SEEDS if kind != "cdr"])
def test_sound_seeds_are_read_whole(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for number, seed in enumerate(seeds(kind, tmp_path)):
        place = tmp_path / str(number)
        place.mkdir()
        assert outcome(kind, seed.files, place) == ("damaged" if seed.name in DAMAGED else "read"), seed.name


def test_a_number_always_gives_the_same_damage_and_another_number_another(tmp_path):
    files = [seed.files for seed in seeds("csv", tmp_path)]
    drawn = [mutation(number, "csv", files) for number in range(300)]
    assert drawn == [mutation(number, "csv", files) for number in range(300)]
    assert len({tuple(each.values()) for _, each in drawn}) > 250
    assert sum(each in files for _, each in drawn) < 30
    assert {change for done, _ in drawn for change in done.split(" and ")} >= {*CHANGES, "splice"}


def misbehave(kind, files, folder):
    """Do what is written in the file."""
    what = files["a"].decode()
    if what == "foreign":
        return {}["a key"]
    if what == "died":
        os.kill(os.getpid(), signal.SIGSEGV)
    if what == "slow":
        while True:
            pass
    if what == "memory":
        return "read" if bytearray(100 << 20).count(0) else ""
    if what == "silent":
        time.sleep(60)
    return what


def test_every_kind_of_defect_is_seen_and_the_next_file_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz_logs, "outcome", misbehave)
    monkeypatch.setattr(fuzz_logs, "CPU_CAP", 1.5)
    monkeypatch.setattr(fuzz_logs, "WALL_CAP", 6.0)
    done = ["read", "foreign", "died", "slow", "memory", "silent", "damaged", "refused"]
    found = list(read_apart("csv", range(len(done)), lambda n: {"a": done[n].encode()}, tmp_path))
    assert [number for number, _ in found] == list(range(len(done)))
    ends = [end for _, end in found]
    assert [ends[0], *ends[-2:]] == ["read", "damaged", "refused"]
    assert ends[1].startswith("KeyError")
    assert ends[2].startswith("SIGSEGV")
    assert ends[3].startswith("more than 1.5 s")
    assert "MiB more memory" in ends[4]
    assert ends[5] == "no answer"


def test_the_table_adds_up_all_batches():
    rows = [
        {"kind": "csv", "count": 5, "read": 1, "damaged": 1, "refused": 2, "defects": [{}], "seconds": 60},
        {"kind": "csv", "count": 5, "read": 5, "damaged": 0, "refused": 0, "defects": [], "seconds": 60},
    ]
    assert "| csv | 10 | 6 | 1 | 2 | 1 | 2 |" in table(rows).splitlines()


# --- definitions and messages by hypothesis ---------------------------------------------------------

PHRASES = """
struct module enum typedef const union sequence< > string < { } [ ] ( ) ; , : :: = @optional @id( @mutable
@bit_bound( long double A b 0 7 4294967296 - / * ' // /* */ # float64 float64[] A[3] string<=4 K=3 Header time
x bool case default << "
"""
WORDS = [*PHRASES.split(), "1 << 40", "\nMSG: p/A\n", "\n" + "=" * 80 + "\n", "uint8 K=3\n"]
TEXTS = st.one_of(
    st.lists(st.sampled_from(WORDS), max_size=40).map(" ".join),
    st.tuples(st.sampled_from([IDL, ROS1, ROS2]), st.integers(0, 300), st.lists(st.sampled_from(WORDS))).map(
        lambda drawn: drawn[0][: drawn[1]] + " ".join(drawn[2]) + drawn[0][drawn[1] :]
    ),
    st.text(max_size=80),
)


@QUICK
@given(text=TEXTS, language=st.sampled_from(["omgidl", "ros2idl", "ros2msg", "ros1msg"]))
def test_any_text_is_a_definition_or_refused(text, language):
    for name in ("truck::State", "p/A", "A"):
        try:
            fields = BinaryDecoder(Channel("/x", name, "cdr", text, language)).fields()
        except FieldError as error:
            assert str(error)  # noqa: PT017
            continue
        assert all(isinstance(path, str) for path in fields)


@QUICK
@given(data=st.binary(max_size=200), place=st.integers(0, 120), piece=st.binary(max_size=8))
def test_any_bytes_are_a_type_object_or_left_out(data, place, piece):
    sound = struct_object("truck::Angle")
    for each in (data, sound[:place] + piece + sound[place + len(piece) :]):
        encoded = base64.b64encode(each).decode()
        read = read_type_objects([("truck::Angle", base64.b64encode(bytes(15)).decode(), encoded)])
        try:
            schema = read.schema("truck::Angle").check()
        except FieldError:
            continue
        assert isinstance(BinaryDecoder(Channel("/x", schema.root, "cdr", "", "", schema)).fields(), dict)


MESSAGES = st.tuples(
    st.sampled_from([bytes([0, k, 0, 0]) for k in range(12)]), st.binary(max_size=160), st.integers(0, 3)
).map(lambda drawn: drawn[0] + drawn[1] + b"\xff" * (4 * drawn[2]))
KINDS = ("sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "truck::State", "Wheel_mutable", "Wheel_final")


@QUICK
@given(data=st.lists(MESSAGES, min_size=1, max_size=8), kind=st.sampled_from(KINDS))
def test_any_bytes_are_a_message_or_counted_as_lost(data, kind):
    language, text = definition_of(kind)
    decoder = BinaryDecoder(Channel("/x", kind, "cdr", text, language))
    stored = Stored(np.zeros(len(data), np.int64), data)
    columns = decoder.columns(stored, list(decoder.fields())[:20])
    lost = sum(each.messages_lost or 0 for each in columns.damage)
    assert len(columns.log_time) + lost == len(data)
