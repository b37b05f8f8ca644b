"""Generated modules on disk: found again by another process, and no harm from damaged files."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ident.dynamics import model_cache
from ident.dynamics.model_cache import MODULE, cached_module

ROOT = Path(__file__).parents[2]

USE = """
import sys
from ident.dynamics import derivation, engine, system
x, u, p = map(system.symbol, "xup")
model = system.System("lag", {"x": (u - x) / p}, ("u",), ("p",), {"y": x})
if "forbid" in sys.argv:
    def refuse(_):
        raise AssertionError("derived again")
    engine.derive = refuse
made = engine.compiled(model)
states, outputs, slopes = made.sensitivities([[0.0]], [[1.0]] * 3, [0.1] * 3, [0, 3], [0.5], active=["p"])
drivers = (made.module.simulate, made.module.sensitivities)
hits = [sum(driver.stats.cache_hits.values()) for driver in drivers]
misses = [sum(driver.stats.cache_misses.values()) for driver in drivers]
print(made.derived, hits, misses, f"{outputs[2, 0]:.9f}")
"""


def used(cache: Path, *arguments: str) -> str:
    """What a process of its own prints."""
    environment = {**os.environ, "IDENT_CACHE": str(cache), "PYTHONPATH": str(ROOT)}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", USE, *arguments]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.strip()


def test_a_second_process_derives_nothing_and_compiles_nothing(tmp_path: Path) -> None:
    assert used(tmp_path) == "True [0, 0] [1, 1] 0.329675729"
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert used(tmp_path, "forbid") == "False [1, 1] [0, 0] 0.329675729"
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == written


# --- damage ------------------------------------------------------------------------------------------

TEXT = """from numba import njit


@njit("int64(int64)", cache=True)
def twice(number):
    return 2 * number
"""


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], bool]:
    """Gets the module and says whether its text was made anew; checks each time that it works."""
    monkeypatch.setenv("IDENT_CACHE", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)

    def use() -> bool:
        module, anew = cached_module("a model", lambda: TEXT)
        assert module.twice(21) == 42
        return anew

    return use


def files(folder: Path, ending: str) -> list[Path]:
    found = sorted(folder.rglob(f"*{ending}"))
    assert found
    return found


def test_an_intact_module_is_not_written_again(made: Callable[[], bool]) -> None:
    assert [made(), made(), made()] == [True, False, False]


@pytest.mark.parametrize("ending", [MODULE, ".nbi", ".nbc", ".pyc"])
@pytest.mark.parametrize("content", [b"", b"\x80garbage", b"# sha256 0\nimport nothing\n"])
def test_damaged_files_are_replaced(
    tmp_path: Path, made: Callable[[], bool], ending: str, content: bytes
) -> None:
    made()
    for path in files(tmp_path, ending):
        path.write_bytes(content)
    made()
    assert made() is False


@pytest.mark.parametrize("ending", [MODULE, ".nbi", ".nbc"])
def test_half_written_files_are_replaced(tmp_path: Path, made: Callable[[], bool], ending: str) -> None:
    made()
    for path in files(tmp_path, ending):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert made() is True
    assert made() is False


def test_of_two_processes_that_write_at_once_the_first_is_kept(tmp_path: Path) -> None:
    model_cache._write(tmp_path, TEXT)
    before = (tmp_path / MODULE).stat()
    model_cache._write(tmp_path, TEXT)
    after = (tmp_path / MODULE).stat()
    assert (after.st_mtime_ns, after.st_ino) == (before.st_mtime_ns, before.st_ino)
    assert [path.name for path in tmp_path.iterdir()] == [MODULE]


def test_a_file_system_without_hard_links_will_do(
    made: Callable[[], bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("no hard links here")

    monkeypatch.setattr(os, "link", refuse)
    assert [made(), made()] == [True, False]


def test_a_module_that_somebody_edited_is_not_believed(tmp_path: Path, made: Callable[[], bool]) -> None:
    made()
    (module,) = files(tmp_path, MODULE)
    module.write_text(
        module.read_text(encoding="utf-8").replace("2 * number", "3 * number"), encoding="utf-8"
    )
    assert made() is True


def test_a_cache_that_cannot_be_written_is_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder", encoding="utf-8")
    monkeypatch.setenv("IDENT_CACHE", str(blocked))
    module, _ = cached_module("a model without a place", lambda: TEXT)
    assert module.twice(4) == 8
    assert blocked.read_text(encoding="utf-8") == "no folder"


def test_a_text_that_is_wrong_fails_and_is_not_taken_for_damage(made: Callable[[], bool]) -> None:
    calls = []

    def make() -> str:
        calls.append(1)
        return "raise RuntimeError('wrong model')"

    with pytest.raises(RuntimeError, match="wrong model"):
        cached_module("a wrong model", make)
    assert len(calls) <= 2


def test_another_generator_gives_another_key(
    made: Callable[[], bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert made() is True
    monkeypatch.setattr(model_cache, "_generator_version", lambda: "another")
    assert made() is True


def test_the_users_cache_directory_is_used_where_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IDENT_CACHE", raising=False)
    assert model_cache.cache_folder().name == "ident"
