"""What is refused before anything is recorded, in one line; needs no Cyclone DDS."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from mcap.reader import make_reader

from ident.cli import main
from ident.errors import UsageError
from ident.record.log_file import DiskError, LogFile
from ident.record.selection import Selection, log_name


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["record", *arguments], prog_name="ident")


def test_says_how_to_install_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ident.record.recorder", "ident.record.cyclone"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "cyclonedds"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    ended = call("--out", str(tmp_path / "a.mcap"), "--all")
    assert ended.exit_code == 2
    assert ended.stderr.startswith(
        "ident: recording needs Cyclone DDS, which is not installed: pip install 'ident[dds]'"
    )
    assert len(ended.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [[], ["--all", "/odom"]])
def test_topics_or_all_are_said(tmp_path: Path, arguments: list[str]) -> None:
    ended = call("--out", str(tmp_path / "a.mcap"), *arguments)
    assert (ended.exit_code, ended.stderr[:26]) == (2, "ident: name topics to reco")


@pytest.mark.parametrize(
    ("duration", "words"),
    [("10", "no quantity with a unit"), ("3 m", "need a unit of 's'"), ("0 s", "need more than 0 s")],
)
def test_a_duration_is_a_time(tmp_path: Path, duration: str, words: str) -> None:
    ended = call("--out", str(tmp_path / "a.mcap"), "--all", "--duration", duration)
    assert ended.exit_code in {2, 3}
    assert words in ended.stderr
    assert list(tmp_path.iterdir()) == []


# --- the file ----------------------------------------------------------------------------------------


def test_a_file_that_exists_stays_as_it_is_unless_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"dear")
    with pytest.raises(UsageError, match=r"a\.mcap exists and stays as it is"):
        LogFile(path, overwrite=False)
    assert path.read_bytes() == b"dear"
    with LogFile(path, overwrite=True):
        pass
    with path.open("rb") as file:
        assert make_reader(file).get_summary() is not None


@pytest.mark.parametrize(
    ("name", "words"), [("a.db3", "ends in .mcap"), ("none/a.mcap", "No such file or directory")]
)
def test_a_name_that_will_not_do_is_told(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        LogFile(tmp_path / name, overwrite=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_disk_that_takes_nothing_is_told(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    path.symlink_to("/dev/full")
    with pytest.raises(DiskError, match="No space left on device"):
        LogFile(path, overwrite=True)


def test_a_message_without_a_stamp_gets_the_time_of_its_arrival(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with LogFile(path, overwrite=False) as log:
        channel = log.channel("a", "A", "struct A { long x; };", {})
        for number, sent in enumerate((None, -1, 1 << 63, 5)):
            log.write(channel, b"\x00\x01\x00\x00\x01\x00\x00\x00", received=7, sent=sent, number=number)
    with path.open("rb") as file:
        assert [m.publish_time for _, _, m in make_reader(file).iter_messages()] == [7, 7, 7, 5]


# --- topics ------------------------------------------------------------------------------------------


def test_ros_topics_go_by_both_names() -> None:
    ros = ("rt/control/steer", "pkg::msg::dds_::Steer_")
    assert log_name(*ros) == "/control/steer"
    assert log_name("rt/control/steer", "pkg::Steer") == "rt/control/steer"
    for name in ("/control/steer", "rt/control/steer", "/control/*", "*steer"):
        assert Selection([name]).takes(*ros)
    assert not Selection(["control/*"]).takes(*ros)
    assert not Selection([], ["/control/*"]).takes(*ros)
    assert Selection().takes(*ros)


def test_what_was_asked_for_and_not_seen_is_known() -> None:
    assert Selection(["/a", "b*", "/c"]).missing([("rt/a", "p::dds_::A_"), ("bb", "B")]) == ["/c"]
