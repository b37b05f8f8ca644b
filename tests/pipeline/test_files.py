from __future__ import annotations

import stat
from pathlib import Path

import pytest

from ident.errors import UsageError
from ident.pipeline.files import atomic, plain, remove_left_behind
from ident.results import Gap


def write(path: Path, text: str) -> None:
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old", encoding="utf-8")

    def write_half() -> None:
        with atomic(path) as temporary:
            temporary.write_text("ne", encoding="utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_written_file_has_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    write(tmp_path / "a.json", "{}")
    assert stat.S_IMODE((tmp_path / "a.json").stat().st_mode) == stat.S_IMODE(
        (tmp_path / "usual").stat().st_mode
    )


def test_says_why_a_folder_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"cannot write .*a\.json: File exists: give another folder"):
        write(tmp_path / "file" / "a.json", "{}")


def test_plain_gives_only_what_json_has() -> None:
    assert plain({"a": (1, 2.5, None, True, Gap(0.0, 1.0))}) == {
        "a": [1, 2.5, None, True, {"start": 0.0, "seconds": 1.0}]
    }


def test_removes_what_a_killed_run_had_begun_to_write_and_nothing_else(tmp_path: Path) -> None:
    ours = [".0123456789ab.json", ".0123456789ab", ".index.html.4711"]
    others = ["a.json", ".hidden.json", ".0123456789ab.json.bak.txt", ".gitignore"]
    for name in (*ours, *others):
        (tmp_path / name).touch()
    remove_left_behind(tmp_path)
    remove_left_behind(tmp_path / "absent")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(others)
