"""ASAM MDF 4 files: written block by block from the standard, and by asammdf."""

import datetime as dt
import hashlib
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mdf_writer import Chan, Group, write_mdf

from ident.errors import UnusableLog
from ident.logs import FieldError, find_runs, open_log

START = 1_700_000_000_123_456_789
COUNT = 1000
STEPS = np.arange(COUNT)
INVALID = STEPS % 7 == 0


@pytest.fixture
def reader():
    return pytest.importorskip("asammdf", reason="asammdf (the extra mdf) is not installed")


def vehicle():
    return Group(
        "Vehicle",
        [
            Chan("t", STEPS / 50, "s", sync=1),
            Chan("Angle", (STEPS - 500).astype(">i2"), "deg", linear=(0.5, 0.1)),
            Chan("Bits", STEPS.astype("u1"), bits=(2, 3)),
            Chan("Speed", (STEPS / 8).astype("<f4"), "m/s", invalid=INVALID),
            Chan("Engaged", (STEPS // 100 % 2).astype("u1"), bits=(0, 1), invalid=~INVALID),
        ],
    )


def other(name="", count=100):
    return Group(name, [Chan("t", np.arange(count) / 10, sync=1), Chan("x", np.arange(count).astype(">f8"))])


def assert_true(columns, count=COUNT):
    steps = STEPS[:count]
    assert columns.log_time.tolist() == [START + 20_000_000 * int(k) for k in steps]
    assert columns.header_stamp is None
    np.testing.assert_allclose(columns.values["Angle"], 0.5 + 0.1 * (steps - 500), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(columns.values["Bits"], (steps % 256) >> 2 & 7)
    np.testing.assert_array_equal(columns.values["Speed"], np.where(INVALID[:count], np.nan, steps / 8))
    np.testing.assert_array_equal(
        columns.values["Engaged"], np.where(INVALID[:count], steps // 100 % 2, np.nan)
    )


def test_reads_the_numbers_of_every_group_with_units_and_times_since_1970(reader, tmp_path):
    log = open_log(write_mdf(tmp_path / "a.mf4", [vehicle(), other(), other("Vehicle", 50)], START))
    assert (log.format, log.damage) == ("mdf 4.10", [])
    held = [(topic.name, topic.messages) for topic in log.topics]
    assert held == [("/Vehicle", COUNT), ("/Vehicle_2", 50), ("/group_1", 100)]
    fields = log.fields("/Vehicle")
    assert fields == {
        "Angle": "float64 [deg]", "Bits": "float64", "Speed": "float64 [m/s]", "Engaged": "bool",
    }  # fmt: skip
    assert_true(log.columns("/Vehicle", list(fields)))
    assert log.read({"/group_1": ["x"]})["/group_1"].values["x"].tolist() == list(range(100))
    assert log.columns("/group_1", []).values == {}
    log.check()
    assert log.damage == []
    log.close()


def test_reads_what_asammdf_wrote_compressed_with_texts_and_enumerations(reader, tmp_path):
    times = STEPS / 100
    gears = {"val_0": 0, "text_0": b"neutral", "val_1": 1, "text_1": b"drive", "default": b""}
    written = reader.MDF(version="4.10")
    written.start_time = dt.datetime(2024, 5, 6, 7, 8, 9, 123456, tzinfo=dt.UTC)
    signals = [
        reader.Signal(np.sin(times), times, name="Angle", unit="rad"),
        reader.Signal((STEPS % 2).astype("u1"), times, name="Gear", conversion=gears),
        reader.Signal(np.array([b"ab"] * COUNT), times, name="Text", encoding="utf-8"),
    ]
    written.append(signals, acq_name="Vehicle")
    written.save(tmp_path / "a.mf4", compression=2)
    written.close()
    log = open_log(tmp_path / "a.mf4")
    assert log.fields("/Vehicle") == {"Angle": "float64 [rad]", "Gear": "float64"}
    columns = log.columns("/Vehicle", ["Angle", "Gear"])
    np.testing.assert_array_equal(columns.values["Angle"], np.sin(times))
    np.testing.assert_array_equal(columns.values["Gear"], STEPS % 2)
    assert columns.log_time[0] == 1_714_979_289_123_456_000
    assert columns.log_time[-1] == columns.log_time[0] + 9_990_000_000
    log.close()


def test_a_value_of_a_scaled_channel_that_stands_for_a_text_is_missing(reader, tmp_path):
    raw = np.where(STEPS < 10, 65535, STEPS).astype("<u2")
    torque = Chan("Torque", raw, "Nm", linear=(-100.0, 0.1), texts={65535.0: "not available"})
    group = Group("Eps", [Chan("t", STEPS / 100, "s", sync=1), torque])
    log = open_log(write_mdf(tmp_path / "a.mf4", [group], START))
    values = log.columns("/Eps", ["Torque"]).values["Torque"]
    np.testing.assert_allclose(values, np.where(STEPS < 10, np.nan, 0.1 * raw - 100))


def test_only_the_channels_that_are_asked_for_are_read(reader, tmp_path, monkeypatch):
    log = open_log(write_mdf(tmp_path / "a.mf4", [vehicle()], START))
    asked = []
    get = log._mdf.get
    monkeypatch.setattr(log._mdf, "get", lambda **which: asked.append(which["index"]) or get(**which))
    assert list(log.columns("/Vehicle", ["Speed"]).values) == ["Speed"]
    assert asked == [3]


@pytest.mark.parametrize("which", ["times", "angle"])
def test_a_group_without_times_is_told_and_costs_no_other(reader, tmp_path, which):
    odd = vehicle()
    odd.channels[0].sync = {"times": 0, "angle": 2}[which]
    log = open_log(write_mdf(tmp_path / "a.mf4", [odd, other("Rest")], START))
    assert [topic.name for topic in log.topics] == ["/Rest"]
    assert [(item.what, item.messages_lost) for item in log.damage] == [
        ("a.mf4: channel group 'Vehicle' has no channel of times", COUNT)
    ]


def test_a_file_that_its_recorder_did_not_close_is_read_and_told(reader, tmp_path):
    log = open_log(write_mdf(tmp_path / "a.mf4", [vehicle()], START, unfinished=True))
    assert_true(log.columns("/Vehicle", list(log.fields("/Vehicle"))))
    assert [item.what for item in log.damage] == [
        "a.mf4: was not closed by its recorder, completed in a copy"
    ]


@pytest.mark.parametrize("part", [0.35, 0.6, 0.999])
def test_of_a_file_that_ends_early_all_whole_samples_are_read(reader, tmp_path, part):
    path = write_mdf(tmp_path / "a.mf4", [vehicle(), other()], START)
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    log = open_log(path)
    held = {topic.name: topic.messages for topic in log.topics}
    assert_true(log.columns("/Vehicle", list(log.fields("/Vehicle"))), held["/Vehicle"])
    begin = data.index(b"##DT") + 24
    whole = min((int(part * len(data)) - begin) // 17, COUNT)
    assert held["/Vehicle"] == whole > 0
    assert sum(held.values()) < COUNT + 100
    assert log.damage[0].messages_lost == COUNT + 100 - sum(held.values())
    assert "ends early" in log.damage[0].what


def test_nothing_is_changed_or_left_behind(reader, tmp_path, capfd):
    folder, left = tmp_path / "logs", tmp_path / "left"
    folder.mkdir()
    left.mkdir()
    for name, more in (("a", {}), ("b", {"unfinished": True})):
        write_mdf(folder / f"{name}.mf4", [vehicle()], START, **more)
    (folder / "c.mf4").write_bytes((folder / "a.mf4").read_bytes()[:9000])
    (folder / "d.mf4").write_bytes((folder / "a.mf4").read_bytes()[:300])
    before = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}
    program = (
        "import sys\nfrom pathlib import Path\nfrom ident.logs import open_log\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try:\n        log = open_log(path)\n"
        "    except Exception as error:\n        print(path.name, type(error).__name__)\n        continue\n"
        "    log.columns('/Vehicle', ['Speed'])\n    log.close()\n    print(path.name)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(folder)],
        env={"TMPDIR": str(left), "PYTHONPATH": ":".join(sys.path), "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["a.mf4", "b.mf4", "c.mf4", "d.mf4", "CannotRead"]
    assert done.stderr == ""
    assert {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()} == before
    assert list(left.iterdir()) == []


def test_a_formula_that_is_more_than_arithmetic_is_never_evaluated(reader, tmp_path):
    group = other("Vehicle")
    group.channels[1].formula = "__import__('os').system('true')"
    group.channels.append(Chan("y", np.arange(100.0), formula="2*X + 1e-3"))
    log = open_log(write_mdf(tmp_path / "a.mf4", [group], START))
    with pytest.raises(FieldError, match="is no formula of X that is read"):
        log.columns("/Vehicle", ["x"])
    np.testing.assert_allclose(log.columns("/Vehicle", ["y"]).values["y"], 2 * np.arange(100.0) + 1e-3)


@pytest.mark.parametrize(
    ("topic", "field", "reason"),
    [
        ("/Vehicle", "Sped", "/Vehicle has no channel of numbers 'Sped', did you mean 'Speed'?"),
        ("/Vehicl", "Speed", "no topic '/Vehicl', did you mean '/Vehicle'?"),
    ],
)
def test_a_channel_that_does_not_exist_is_refused_with_the_nearest(reader, tmp_path, topic, field, reason):
    log = open_log(write_mdf(tmp_path / "a.mf4", [vehicle()], START))
    with pytest.raises(FieldError) as caught:
        log.columns(topic, [field])
    assert str(caught.value) == reason


BYTE_OFFSET, BIT_COUNT, FLAGS, INVALIDATION_BIT = 4, 8, 12, 16
"""Places in the data of a CN block."""


def written_by_asammdf(asammdf, path):
    """A group of three channels: times (8 bytes), x (4 bytes) and y (2 bytes) with an invalidation bit."""
    times = np.arange(20) / 10
    signals = [
        asammdf.Signal(np.arange(20, dtype="<f4"), times, name="x"),
        asammdf.Signal(np.arange(20, dtype="<u2"), times, name="y", invalidation_bits=np.arange(20) % 3 == 0),
    ]
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append(signals, acq_name="Vehicle", common_timebase=True)
        mdf.save(path, overwrite=True, compression=0)
    return path


def description(data, name):
    """Where the data of the CN block of a channel begin, found by the links of the blocks."""
    place = data.find(b"##CN")
    while place >= 0:
        (links,) = struct.unpack_from("<Q", data, place + 16)
        (text,) = struct.unpack_from("<Q", data, place + 24 + 8 * 2)
        if data[text + 24 :].startswith(name.encode() + b"\0"):
            return place + 24 + 8 * links
        place = data.find(b"##CN", place + 1)
    raise AssertionError(f"no channel {name}")


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("x", BYTE_OFFSET, 1 << 20),
        ("x", BYTE_OFFSET, (1 << 32) - 1),
        ("y", BIT_COUNT, 24),
        ("y", BYTE_OFFSET, 13),
        ("y", INVALIDATION_BIT, 8),
        ("y", INVALIDATION_BIT, (1 << 32) - 1),
        ("x", FLAGS, 2),
        ("time", BYTE_OFFSET, 1 << 20),
    ],
)
def test_a_channel_outside_its_record_is_refused_before_anything_reads_it(
    reader, tmp_path, monkeypatch, name, place, value
):
    path = written_by_asammdf(reader, tmp_path / "a.mf4")
    data = bytearray(path.read_bytes())
    if (name, place) == ("x", FLAGS):  # "may be invalid", by a bit of a byte that no record has
        struct.pack_into("<I", data, description(data, name) + INVALIDATION_BIT, 8)
    struct.pack_into("<I", data, description(data, name) + place, value)
    path.write_bytes(data)
    log = open_log(path)
    (topic,) = [topic.name for topic in log.topics]
    read = []
    for method in ("get", "get_master"):
        original = getattr(log._mdf, method)
        monkeypatch.setattr(
            log._mdf, method, lambda *a, _of=original, **k: (read.append(k.get("index")), _of(*a, **k))[1]
        )
    asked = "x" if name == "time" else name
    with pytest.raises(FieldError, match=rf"{name}: lies outside its records of \d+ bytes"):
        log.columns(topic, [asked])
    index = log._fields[topic][asked]
    assert index not in read
    if name != "time":
        rest = "y" if name == "x" else "x"
        assert len(log.columns(topic, [rest]).values[rest]) == 20
    log.close()


def test_a_channel_that_ends_where_its_record_ends_is_read(reader, tmp_path):
    log = open_log(written_by_asammdf(reader, tmp_path / "a.mf4"))
    (topic,) = [topic.name for topic in log.topics]
    found = log.columns(topic, ["x", "y"]).values
    assert found["x"].tolist() == list(range(20))
    np.testing.assert_array_equal(found["y"], np.where(np.arange(20) % 3 == 0, np.nan, np.arange(20)))
    log.close()


def test_samples_whose_time_is_none_are_left_out_and_counted(reader, tmp_path):
    odd = other("Odd")
    odd.channels[0].values = np.where(np.arange(100) == 3, np.nan, np.arange(100.0))
    log = open_log(write_mdf(tmp_path / "a.mf4", [odd], START))
    kept = [k for k in range(100) if k != 3]
    columns = log.columns("/Odd", ["x"])
    assert columns.values["x"].tolist() == kept
    assert columns.log_time.tolist() == [START + k * 10**9 for k in kept]
    assert [(item.what, item.messages_lost) for item in log.damage] == [
        ("a.mf4: /Odd: samples whose time is none, first at row 4", 1)
    ]


def test_a_group_of_which_few_samples_have_a_time_is_refused(reader, tmp_path):
    odd = other("Odd")
    odd.channels[0].values = np.where(np.arange(100) < 51, np.nan, np.arange(100.0))
    log = open_log(write_mdf(tmp_path / "a.mf4", [odd], START))
    with pytest.raises(FieldError, match="/Odd: 51 of its 100 times are no times in seconds"):
        log.columns("/Odd", ["x"])
    log.check()
    assert log.damage[0].messages_lost == 100


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: write_mdf(path, [], START), "no channel group with times and numbers among 0"),
        (lambda path: write_mdf(path, [vehicle()], START, version=b"3.30"), "MDF version 3.30, need 4.00"),
        (lambda path: path.write_bytes(b"MDF     4.10    " + bytes(60)), "MDF file that cannot be read"),
    ],
)
def test_a_file_that_holds_nothing_is_refused_in_one_line(reader, tmp_path, make, reason):
    make(tmp_path / "a.mf4")
    with pytest.raises(UnusableLog, match=reason) as caught:
        open_log(tmp_path / "a.mf4")
    assert "\n" not in str(caught.value)


def test_without_asammdf_the_refusal_says_how_to_install_it(tmp_path, monkeypatch):
    path = write_mdf(tmp_path / "a.mf4", [vehicle()], START)
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(UnusableLog) as caught:
        open_log(path)
    text = "is an MDF file, which asammdf reads: install it with pip install 'ident[mdf]'"
    assert str(caught.value) == f"{path}: {text}"


def test_mdf_files_are_found_each_as_a_run_of_its_own(tmp_path):
    for name in ("drive_0.mf4", "drive_1.mf4", "B.MF4"):
        write_mdf(tmp_path / name, [vehicle()], START)
    assert [run.name for run in find_runs([tmp_path])] == ["B", "drive_0", "drive_1"]


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.integers(0, 2500), st.integers(0, 255)), max_size=4))
def test_no_damage_of_the_description_brings_another_error(reader, tmp_path, places):
    buffer = tmp_path / "a.mf4"
    data = bytearray(write_mdf(buffer, [vehicle(), other()], START).read_bytes())
    for place, value in places:
        data[place] = value
    buffer.write_bytes(data)
    try:
        log = open_log(buffer)
    except UnusableLog:
        return
    for topic in log.topics:
        try:
            columns = log.columns(topic.name, list(log.fields(topic.name)))
        except FieldError:
            continue
        lost = topic.messages - len(columns.log_time)
        assert lost == sum(item.messages_lost for item in log.damage if topic.name in item.what)
    log.close()
