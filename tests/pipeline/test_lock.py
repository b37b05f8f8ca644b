from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ident.errors import UsageError
from ident.pipeline.lock import locked


def test_a_second_run_on_the_same_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    with (
        locked(tmp_path / "out"),
        pytest.raises(UsageError, match=r"another run is writing to .*out: wait"),
        locked(tmp_path / "out"),
    ):
        pass
    with locked(tmp_path / "out"):
        assert (tmp_path / "out" / ".ident" / "lock").is_file()


def test_nothing_is_left_where_nothing_was_written(tmp_path: Path) -> None:
    with locked(tmp_path / "reports" / "out"):
        pass
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    with locked(tmp_path / "mine" / "out"):
        (tmp_path / "mine" / "out" / "info.json").touch()
    assert [path.name for path in (tmp_path / "mine" / "out").iterdir()] == ["info.json"]


def test_a_folder_that_was_there_stays(tmp_path: Path) -> None:
    with locked(tmp_path):
        pass
    assert tmp_path.is_dir()


def test_the_lock_of_a_killed_run_does_not_matter(tmp_path: Path) -> None:
    program = (
        "import os, pathlib, signal, sys\n"
        "from ident.pipeline.lock import locked\n"
        "with locked(pathlib.Path(sys.argv[1])):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], check=False, cwd=Path(__file__).parents[2]
    )
    assert ended.returncode == -9
    assert (tmp_path / ".ident" / "lock").is_file()
    with locked(tmp_path):
        pass


def test_says_why_a_folder_cannot_be_locked(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(UsageError, match=r"cannot write .*: (File exists|Not a directory): give another"),
        locked(tmp_path / "file" / "out"),
    ):
        pass
