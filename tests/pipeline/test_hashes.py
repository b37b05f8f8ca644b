from __future__ import annotations

import hashlib
import os
import time
from pathlib import Path

import pytest

from ident.pipeline import hashes
from ident.pipeline.hashes import Hashes, code_version


@pytest.fixture
def old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that seems to have been written long ago."""
    path = tmp_path / "a.mcap"
    path.write_bytes(b"one")
    now = time.time() + 10
    monkeypatch.setattr(hashes.time, "time", lambda: now)
    return path


def read_files(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that are read from now on."""
    read: list[str] = []
    true = hashes.sha256_of
    monkeypatch.setattr(hashes, "sha256_of", lambda path: (read.append(path.name), true(path))[1])
    return read


def hash_once(file: Path, folder: Path) -> str:
    known = Hashes(folder / "hashes.json")
    digest = known.of(file)
    known.save()
    return digest


def test_a_file_is_read_once_as_long_as_nothing_touches_it(
    old_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = read_files(monkeypatch)
    digests = {hash_once(old_file, tmp_path / "cache") for _ in range(3)}
    assert digests == {hashlib.sha256(b"one").hexdigest()}
    assert read == ["a.mcap"]


def test_a_change_that_keeps_size_and_time_is_seen(old_file: Path, tmp_path: Path) -> None:
    first, times = hash_once(old_file, tmp_path / "cache"), old_file.stat()
    old_file.write_bytes(b"two")
    os.utime(old_file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert hash_once(old_file, tmp_path / "cache") != first
    replaced = tmp_path / "b"
    replaced.write_bytes(b"six")
    os.utime(replaced, ns=(times.st_atime_ns, times.st_mtime_ns))
    replaced.replace(old_file)
    assert hash_once(old_file, tmp_path / "cache") == hashlib.sha256(b"six").hexdigest()


def test_what_has_just_been_written_is_not_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"one")
    read = read_files(monkeypatch)
    for _ in range(2):
        hash_once(path, tmp_path / "cache")
    assert read == ["a.mcap", "a.mcap"]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"a": 1}', '{"a": ["1", 2]}'])
def test_a_damaged_cache_is_forgotten(old_file: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "hashes.json").write_text(text.replace('"a"', f'"{old_file}"'), encoding="utf-8")
    assert hash_once(old_file, tmp_path) == hashlib.sha256(b"one").hexdigest()


def test_what_cannot_be_read_or_remembered_is_no_error(tmp_path: Path, old_file: Path) -> None:
    assert Hashes(tmp_path / "hashes.json").of(tmp_path / "absent") == "unreadable"
    (tmp_path / "file").touch()
    assert hash_once(old_file, tmp_path / "file") == hashlib.sha256(b"one").hexdigest()


def test_the_code_has_another_version_once_a_line_of_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def version(*, of_results: bool) -> str:
        code_version.cache_clear()
        return code_version(of_results=of_results)

    package = tmp_path / "ident"
    for place, text in (("stages/a.py", "x = 1"), ("report/b.py", "y = 1"), ("a/__pycache__/c.py", "z")):
        (package / place).parent.mkdir(parents=True)
        (package / place).write_text(text, encoding="utf-8")
    monkeypatch.setattr(hashes, "PACKAGE", package)
    results, shown = version(of_results=True), version(of_results=False)
    (package / "a" / "__pycache__" / "c.py").write_text("changed", encoding="utf-8")
    assert (version(of_results=True), version(of_results=False)) == (results, shown)
    (package / "report" / "b.py").write_text("y = 2", encoding="utf-8")
    assert version(of_results=True) == results
    assert version(of_results=False) != shown
    (package / "stages" / "a.py").write_text("x = 2", encoding="utf-8")
    assert version(of_results=True) != results
    code_version.cache_clear()
