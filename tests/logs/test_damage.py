"""What is saved of damaged logs is all that their bytes still hold; what would burst is refused."""

import hashlib
import json
import struct
import tracemalloc

import damage_table
import pytest
from click.testing import CliRunner
from damage_table import by_ident, page, rows
from damaged_logs import COUNT, FORMATS, Case, beside, cases, file_name, recording, saved, truth
from fuzz_logs import FINE, read_apart
from log_bombs import BOMBS
from log_corpus import seeds
from log_files import START, angles, write_bag, write_mcap

from ident.cli import main
from ident.errors import UnusableLog
from ident.logs import open_log

UNCOUNTED = {"mcap unchunked", "ros1 none", "csv", "parquet", "parquet checked"}
"""Formats in which nothing says how many messages were where bytes are lost."""


@pytest.fixture(scope="module", params=list(FORMATS))
def damaged(request, tmp_path_factory):
    """A format and what becomes of each damaged file of it."""
    kind = request.param
    if kind == "mdf":
        pytest.importorskip("asammdf", reason="asammdf (the extra mdf) is not installed")
    folder = tmp_path_factory.mktemp("damaged")
    found = {}
    for number, (name, case) in enumerate(cases(kind, folder).items()):
        place = folder / str(number)
        place.mkdir()
        path = place / (case.name or file_name(kind))
        path.write_bytes(case.data)
        for other, data in beside(kind).items():
            (place / other).write_bytes(data)
        found[name] = (case, by_ident(path, case))
    return kind, found


def test_all_that_can_be_saved_is_read_and_nothing_else(damaged):
    _, found = damaged
    for name, (case, recovered) in found.items():
        assert (recovered.right, recovered.wrong) == (case.can_be_saved, 0), name


def test_where_messages_are_lost_it_is_said(damaged):
    _, found = damaged
    for name, (case, recovered) in found.items():
        lost = len(case.messages) - recovered.right
        told = [each.messages_lost for each in recovered.said if each.messages_lost is not None]
        if told:
            assert sum(told) == lost, name
        if lost:
            where = [each for each in recovered.said if "at byte" in each.what or "at row" in each.what]
            assert where or told or name == "zero length", name


def test_messages_of_a_bad_chunk_are_counted(damaged):
    kind, found = damaged
    for name in ("40 bytes lost in the middle", "a chunk's compression broken"):
        if name in found and kind not in UNCOUNTED:
            case, recovered = found[name]
            (said,) = recovered.said
            assert said.messages_lost == len(case.messages) - recovered.right > 0


def test_the_cases_are_damaged_and_are_not_all_lost(damaged):
    kind, found = damaged
    parts = [found[f"cut off at {part} %"][0].can_be_saved for part in (25, 50, 75)]
    if kind.startswith("parquet"):
        assert parts == [0, 0, 0]  # all of it is described at its end
        assert 0 < found["40 bytes lost in the middle"][0].can_be_saved < COUNT
    else:
        assert 0 <= parts[0] < parts[1] < parts[2] < COUNT
    assert saved(kind, recording(), b"") == 0
    assert sum(truth(recording()).values()) == COUNT


def test_the_table_tells_what_others_read_of_the_same_file(monkeypatch):
    monkeypatch.setattr(damage_table, "cases", lambda kind, folder: dict(some_cases(kind, folder)))
    found = list(rows("mcap zstd"))
    cut, whole = found
    assert cut["ident"] == {"right": cut["can"], "wrong": 0}
    assert whole["ident"] == whole["rosbags"] == whole["mcap"] == {"right": COUNT, "wrong": 0}
    assert cut["rosbags"]["right"] < cut["can"]
    lines = page(found).splitlines()
    assert (
        f"| mcap zstd | cut off at 50 % | {COUNT} | {cut['can']} | {cut['can']} | 0 | {cut['can']} |" in lines
    )
    assert any(line.startswith("| mcap zstd | cut off at 50 % | run.mcap: ") for line in lines)


def test_the_page_in_docs_holds_what_the_kept_rows_say():
    kept = [json.loads(line) for line in damage_table.KEPT.read_text(encoding="utf-8").splitlines()]
    assert damage_table.PAGE.read_text(encoding="utf-8") == page(kept)
    assert {row["format"] for row in kept} == set(FORMATS)
    for row in kept:
        assert row["ident"] == {"right": row["can"], "wrong": 0}, row


def some_cases(kind, folder):
    made = cases(kind, folder)
    yield "cut off at 50 %", made["cut off at 50 %"]
    yield "messages out of order", made["messages out of order"]


def test_wrong_values_are_told_as_wrong(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", angles(10, value=lambda t: t + 1))
    recovered = by_ident(path, Case(b"", angles(10), 10))
    assert (recovered.right, recovered.wrong) == (0, 10)


def test_info_says_each_loss_and_changes_no_file(tmp_path):
    bag = write_bag(tmp_path / "logs" / "run", angles(1000))
    path = bag / "run.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 7 // 10])
    log = open_log(bag)
    log.check()
    read = len(log.columns(log.topics[0].name, ["angle"]).log_time)
    before = {f: (hashlib.sha256(f.read_bytes()).digest(), f.stat().st_mtime_ns) for f in bag.iterdir()}
    result = CliRunner().invoke(main, ["info", str(bag), "--json", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    (run,) = json.loads(result.stdout)["runs"]
    said = {item["what"]: item for item in run["damage"]}
    counted = next(item for what, item in said.items() if "metadata.yaml counts 1000 messages" in what)
    assert counted["messages_lost"] == 1000 - read > 0
    assert any("cut off at the end, at byte" in what for what in said)
    assert any("has no footer" in what for what in said)
    after = {f: (hashlib.sha256(f.read_bytes()).digest(), f.stat().st_mtime_ns) for f in bag.iterdir()}
    assert after == before


# --- bombs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(BOMBS))
def test_what_would_burst_takes_neither_memory_nor_time(tmp_path, name):
    kind, make = BOMBS[name]
    files = make(tmp_path).files
    assert sum(map(len, files.values())) < 1 << 20 or kind == "csv"
    folder = tmp_path / "read"
    folder.mkdir()
    sound = [seed.files for seed in seeds(kind, tmp_path)][:1]
    ((_, end),) = read_apart(kind, [0], lambda _: files, folder, sound)
    assert end in FINE


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("a chunk that claims much", "damaged chunk (claims to hold 2147483648 bytes in 64)"),
        ("zeros in a chunk", "damaged chunk (claims to hold 314572800 bytes in"),
        ("zeros in a message", "/x: cannot be decoded: its data lie in a damaged part of the file"),
        ("a view without end", "'messages' is a view or a virtual table, need plain tables"),
        ("rows of zeros", "claims to hold 12582912 rows of 3 columns in"),
        ("a table of very many columns", "has 500002 columns, at most 10000 are read"),
    ],
)
def test_says_what_would_burst(tmp_path, name, reason):
    _, make = BOMBS[name]
    ((file, data),) = make(tmp_path).files.items()
    path = tmp_path / f"the_{file}"
    path.write_bytes(data)
    try:
        log = open_log(path)
        log.check()
        said = [each.what for each in log.damage]
        said += [each.what for topic in log.topics for each in log.columns(topic.name, ["data"]).damage]
    except UnusableLog as error:
        said = [str(error)]
    assert any(reason in what for what in said), said


def test_a_record_that_claims_the_rest_of_a_large_file_is_not_read_at_once(tmp_path):
    path = tmp_path / "run.mcap"
    head = b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 1 << 40) + struct.pack("<QQQII", START, START, 9, 0, 0)
    with path.open("wb") as file:
        file.write(head)
        file.truncate(64 << 20)
    tracemalloc.start()
    try:
        log = open_log(path)
        log.check()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20 << 20
    assert any("no records" in each.what for each in log.damage)
