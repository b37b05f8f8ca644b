"""rosbag2 folders: metadata.yaml is believed only as far as the files bear it out."""

import numpy as np
import pytest
from log_files import START, angles, write_bag, write_mcap

from ident.errors import UnusableLog
from ident.logs import open_log

TOPIC = "/vehicle/steering_wheel"


def assert_whole(folder, count=500):
    log = open_log(folder)
    columns = log.columns(TOPIC, ["angle"])
    assert len(columns.log_time) == count
    assert np.allclose(columns.values["angle"], (columns.log_time - START) / 1e9, rtol=0, atol=1e-9)
    log.close()
    return log


@pytest.mark.parametrize("compress", ["", "file", "message", "storage"])
def test_reads_every_kind_of_mcap_bag(tmp_path, compress):
    log = assert_whole(write_bag(tmp_path / "run", angles(500), compress=compress))
    assert (log.format, log.damage) == ("rosbag2 mcap", [])


@pytest.mark.parametrize("compress", ["", "file", "message"])
def test_reads_every_kind_of_sqlite_bag(tmp_path, compress):
    log = assert_whole(write_bag(tmp_path / "run", angles(500), sqlite=True, compress=compress))
    assert (log.format, log.damage) == ("rosbag2 sqlite3", [])


def test_a_compressed_file_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path):
    noise = np.random.default_rng(1)
    messages = angles(20_000, value=lambda t: t + 0 * noise.normal())
    folder = write_bag(tmp_path / "run", messages, compress="file")
    file = folder / "run.mcap.zstd"
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 6 // 10])
    log = open_log(folder)
    columns = log.columns(TOPIC, ["angle"])
    assert 0.3 * 20_000 < len(columns.log_time) < 0.8 * 20_000
    assert any("its compression is damaged (cut off)" in item.what for item in log.damage)
    lost = next(item for item in log.damage if "metadata.yaml counts 20000 messages" in item.what)
    assert lost.messages_lost == 20_000 - len(columns.log_time)
    gone = next(item for item in log.damage if "went on for another" in item.what)
    assert gone.seconds_lost == pytest.approx(lost.messages_lost / 100, abs=0.02)


def test_missing_metadata_is_no_obstacle(tmp_path):
    folder = write_bag(tmp_path / "run", angles(500))
    (folder / "metadata.yaml").unlink()
    log = assert_whole(folder)
    assert log.damage[0].what == "metadata.yaml is missing, the files themselves were read"


@pytest.mark.parametrize(
    "text",
    ["", "not: rosbag2", "[1, 2", "rosbag2_bagfile_information: 7", "\x00\x01", "- a", "a: &a [*a, *a]"],
)
def test_wrong_metadata_is_no_obstacle(tmp_path, text):
    folder = write_bag(tmp_path / "run", angles(500))
    (folder / "metadata.yaml").write_text(text)
    log = assert_whole(folder)
    assert "metadata.yaml" in log.damage[0].what
    assert "the files themselves were read" in log.damage[0].what


def test_metadata_cannot_lead_out_of_the_folder(tmp_path):
    write_mcap(tmp_path / "secret.mcap", angles(7))
    folder = write_bag(tmp_path / "run", angles(500))
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("run.mcap", "../secret.mcap"))
    log = assert_whole(folder)
    assert [file.name for file in log.files] == ["run.mcap"]
    assert log.damage[0].what == "secret.mcap is listed in metadata.yaml and missing"


def test_a_listed_file_that_is_missing_is_said_with_what_it_held(tmp_path):
    folder = split_bag(tmp_path, [200, 200, 100])
    (folder / "run_1.mcap").unlink()
    log = open_log(folder)
    assert len(log.columns(TOPIC, ["angle"]).log_time) == 300
    assert log.damage[0].what == "run_1.mcap is listed in metadata.yaml and missing"
    assert any(item.messages_lost == 200 for item in log.damage)


def split_bag(tmp_path, counts):
    """A bag of several files, one after the other in time."""
    messages = angles(sum(counts))
    folder = write_bag(tmp_path / "run", messages)
    (folder / "run.mcap").unlink()
    names, first = [], 0
    for number, count in enumerate(counts):
        names.append(f"run_{number}.mcap")
        write_mcap(folder / names[-1], messages[first : first + count])
        first += count
    metadata = folder / "metadata.yaml"
    listed = "\n".join(f"  - {name}" for name in names)
    metadata.write_text(metadata.read_text().replace("  - run.mcap", listed))
    return folder


def test_several_files_are_read_in_the_order_of_their_numbers(tmp_path):
    folder = split_bag(tmp_path, [10] * 12)
    log = assert_whole(folder, 120)
    assert [file.name for file in log.files] == [f"run_{number}.mcap" for number in range(12)]
    assert np.all(np.diff(log.times(TOPIC)) > 0)


def test_a_file_that_metadata_does_not_list_is_read_all_the_same(tmp_path):
    folder = split_bag(tmp_path, [200, 200, 100])
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("  - run_2.mcap\n", ""))
    log = assert_whole(folder)
    assert log.damage[0].what == "run_2.mcap: not listed in metadata.yaml, read all the same"


def test_one_unreadable_file_of_several_costs_only_itself(tmp_path):
    folder = split_bag(tmp_path, [200, 200, 100])
    (folder / "run_1.mcap").write_bytes(b"")
    log = open_log(folder)
    assert len(log.columns(TOPIC, ["angle"]).log_time) == 300
    assert "run_1.mcap: is empty (0 bytes)" in log.damage[0].what


def test_a_bag_without_any_readable_file_is_refused(tmp_path):
    folder = write_bag(tmp_path / "run", angles(5))
    (folder / "run.mcap").write_bytes(b"")
    with pytest.raises(UnusableLog, match=r"nothing can be read: .*run\.mcap: is empty"):
        open_log(folder)


def test_the_files_of_a_log_are_never_written(tmp_path):
    folder = write_bag(tmp_path / "run", angles(500), sqlite=True)
    before = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.iterdir()}
    assert_whole(folder)
    assert {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.iterdir()} == before
