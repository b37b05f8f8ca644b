from __future__ import annotations

from pathlib import Path

import pytest

from ident.errors import UsageError
from ident.pipeline import init as pipeline
from ident.pipeline.init import Written, write_guesses
from ident.stages.init import InitTexts
from ident.stages.output import Context


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Context]:
    """The contexts that the stage was called with; it guesses two short files."""
    contexts: list[Context] = []

    def init(logs: list[Path], context: Context) -> InitTexts:
        contexts.append(context)
        return InitTexts("signals: {}\n", "# mass: µ\n", ["speed"], ["b is cut"])

    monkeypatch.setattr(pipeline, "init", init)
    return contexts


def write(out: Path) -> Written:
    return write_guesses([Path("logs")], out, lambda *_: None)


def test_writes_both_files_into_a_new_folder(asked: list[Context], tmp_path: Path) -> None:
    out = tmp_path / "my" / "truck"
    assert write(out) == Written(out / "channels.yaml", out / "vehicle.yaml", ["speed"], ["b is cut"])
    written = {path.name: path.read_text(encoding="utf-8") for path in out.iterdir()}
    assert written == {"channels.yaml": "signals: {}\n", "vehicle.yaml": "# mass: µ\n"}
    assert asked[0].command == f"ident init logs --out {out}"


@pytest.mark.parametrize("name", ["channels.yaml", "vehicle.yaml"])
def test_never_replaces_a_file_and_finds_it_before_reading_logs(
    asked: list[Context], tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match=rf"{name} exists and stays as it is: name another folder"):
        write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text(encoding="utf-8") == "mine"
    assert asked == []


def test_writes_nothing_into_a_log(asked: list[Context], tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").touch()
    (tmp_path / "run_0.mcap").touch()
    for out in (tmp_path, tmp_path / "deep"):
        with pytest.raises(UsageError, match="lies inside the log"):
            write(out)
    assert asked == []
