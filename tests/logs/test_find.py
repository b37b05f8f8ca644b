"""Which runs lie under the paths that the user gave."""

import os

import pytest
from log_files import angles, write_bag, write_mcap

from ident.errors import UnusableLog
from ident.logs import find_runs, open_log


def names(*paths):
    return [run.name for run in find_runs(paths)]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with every kind of run, and with what is no run."""
    root = tmp_path_factory.mktemp("find") / "day"
    (root / "deep" / "er").mkdir(parents=True)
    write_bag(root / "bag", angles(3))
    write_bag(root / "deep" / "bag", angles(3), sqlite=True)
    write_mcap(root / "single.mcap", angles(3))
    for number in (0, 1, 2, 10):
        write_mcap(root / "deep" / f"split_{number}.mcap", angles(3))
    write_mcap(root / "deep" / "er" / "lap_3.mcap", angles(3))
    write_mcap(root / "deep" / "er" / "lap_4.mcap", angles(3))
    for name in ("channels.yaml", "notes.md", "table.csv", ".hidden.mcap", "index.html", "run.rrd"):
        (root / name).write_bytes(b"x")
    (root / ".git").mkdir()
    write_mcap(root / ".git" / "object.mcap", angles(3))
    return root


def test_finds_bags_files_and_sequences_and_nothing_else(logs):
    assert names(logs) == ["bag", "deep/bag", "deep/er/lap_3", "deep/er/lap_4", "deep/split", "single"]


def test_a_sequence_of_files_is_one_run_in_the_order_of_their_numbers(logs):
    run = next(run for run in find_runs([logs]) if run.name == "deep/split")
    assert [file.name for file in run.files] == [f"split_{number}.mcap" for number in (0, 1, 2, 10)]
    assert open_log(run.path, run.files).topics[0].messages == 12


def test_a_bag_or_file_that_is_named_is_a_run_of_its_own_name(logs):
    assert names(logs / "bag") == ["bag"]
    assert names(logs / "single.mcap") == ["single"]
    assert names(logs / "deep" / "split_1.mcap") == ["split_1"]
    assert names(logs / "deep" / "split_0.mcap", logs / "deep" / "split_1.mcap") == ["split"]


def test_a_name_relative_to_the_current_folder_works(logs, monkeypatch):
    monkeypatch.chdir(logs / "bag")
    assert names(type(logs)()) == ["bag"]
    monkeypatch.chdir(logs)
    assert "deep/split" in names(type(logs)())


def test_a_run_given_twice_is_one_run(logs):
    assert names(logs / "bag", logs / "bag", logs).count("bag") == 1


def test_the_same_name_in_two_folders_is_told_apart(tmp_path):
    for day in ("monday", "tuesday"):
        write_bag(tmp_path / day / "run", angles(2))
    assert names(tmp_path / "monday", tmp_path / "tuesday") == ["monday/run", "tuesday/run"]


def test_the_same_name_in_two_formats_is_told_apart(tmp_path):
    write_mcap(tmp_path / "a.mcap", angles(2))
    (tmp_path / "a.db3").write_bytes(b"")
    assert names(tmp_path) == ["a.db3", "a.mcap"]


def test_a_loop_of_links_ends(tmp_path):
    write_mcap(tmp_path / "a.mcap", angles(2))
    (tmp_path / "loop").symlink_to(tmp_path)
    assert names(tmp_path) == ["a"]


def test_numbers_in_names_sort_as_numbers(tmp_path):
    for number in (2, 10, 1):
        write_mcap(tmp_path / f"lap{number}.mcap", angles(2))
    assert names(tmp_path) == ["lap1", "lap2", "lap10"]


def test_says_what_was_looked_for_where_there_is_no_log(tmp_path):
    (tmp_path / "channels.yaml").write_text("signals: {}")
    with pytest.raises(UnusableLog) as caught:
        find_runs([tmp_path])
    assert str(caught.value) == (
        f"no log found in {tmp_path} (looked for .mcap, .db3, .mcap.zstd, .db3.zstd, .bag, .bag.active, .db, "
        ".dat, .mf4, .MF4, .csv, .parquet, rosbag2 folders)"
    )


def test_says_which_path_does_not_exist(tmp_path):
    with pytest.raises(UnusableLog, match="gone: no such file or folder"):
        find_runs([tmp_path / "gone"])


def test_a_folder_that_may_not_be_looked_into_is_not_passed_over(tmp_path, monkeypatch):
    write_mcap(tmp_path / "a.mcap", angles(2))
    (tmp_path / "closed").mkdir()
    look = os.scandir

    def refuse(path):
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", str(path))
        return look(path)

    monkeypatch.setattr(os, "scandir", refuse)
    assert names(tmp_path) == ["a", "closed"]


def test_a_table_without_times_that_is_named_is_refused_when_it_is_opened(tmp_path):
    (tmp_path / "table.csv").write_text("a,b\n")
    (run,) = find_runs([tmp_path / "table.csv"])
    with pytest.raises(UnusableLog, match="no column of times among 'a', 'b'"):
        open_log(run.path)


def test_tables_are_runs_only_where_no_other_log_lies(tmp_path):
    for name in ("run_1.csv", "run_2.csv", "more/other.parquet"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("t,a\n0,1\n1,2\n")
    assert names(tmp_path) == ["more/other", "run_1", "run_2"]
    write_mcap(tmp_path / "log.mcap", angles(3))
    assert names(tmp_path) == ["log"]
    assert names(tmp_path, tmp_path / "run_1.csv") == ["log", "run_1"]


def test_the_signals_of_a_report_are_no_runs(tmp_path):
    (tmp_path / "signals").mkdir()
    (tmp_path / "signals" / "a.parquet").write_bytes(b"PAR1")
    (tmp_path / "index.html").write_text("")
    with pytest.raises(UnusableLog, match="no log found"):
        find_runs([tmp_path])
