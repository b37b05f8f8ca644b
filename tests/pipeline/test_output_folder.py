from __future__ import annotations

from pathlib import Path

import pytest

from ident.errors import UsageError
from ident.pipeline.output_folder import name_of, output_folder


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "my.logs"
    (folder / "run_a").mkdir(parents=True)
    (folder / "run_a" / "metadata.yaml").touch()
    (folder / "run_a" / "run_a_0.mcap").touch()
    (folder / "single.mcap").touch()
    monkeypatch.chdir(tmp_path)
    return folder


def test_outputs_are_named_after_the_logs(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert output_folder(None, [logs]) == Path("reports/my.logs")
    assert output_folder(None, [logs / "single.mcap"]) == Path("reports/single")
    assert output_folder(None, [logs / "run_a", logs / "single.mcap"]) == Path("reports/run_a_and_1_more")
    assert name_of([Path("/")]) == "logs"
    monkeypatch.chdir(logs)
    assert output_folder(None, [Path()]) == Path("reports/my.logs")


@pytest.mark.parametrize("out", ["my.logs", "my.logs/run_a", "my.logs/../my.logs"])
def test_refuses_to_write_beside_the_logs(logs: Path, out: str) -> None:
    for given in ([logs], [logs / "run_a"], [logs / "single.mcap"]):
        with pytest.raises(UsageError, match="would lie beside the logs in"):
            output_folder(Path(out), given)


def test_refuses_to_write_into_a_log(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="lies inside the log run_a: name another folder with --out"):
        output_folder(logs / "run_a" / "deep" / "report", [logs])
    monkeypatch.chdir(logs / "run_a")
    with pytest.raises(UsageError, match="lies inside the log run_a"):
        output_folder(None, [Path()])


def test_refuses_to_replace_what_it_has_not_written(logs: Path) -> None:
    site = logs.parent / "site"
    site.mkdir()
    (site / "index.html").touch()
    with pytest.raises(UsageError, match=r"holds another index\.html: name a new or empty folder"):
        output_folder(site, [logs])
    (site / "info.json").touch()
    assert output_folder(site, [logs]) == site


def test_goes_on_in_a_folder_where_a_killed_run_has_left_a_model_but_no_result(logs: Path) -> None:
    site = logs.parent / "site"
    (site / ".ident").mkdir(parents=True)
    (site / "model.yaml").touch()
    assert output_folder(site, [logs]) == site


def test_refuses_a_file_as_folder(logs: Path) -> None:
    (logs.parent / "notes").touch()
    with pytest.raises(UsageError, match="is a file: name a folder"):
        output_folder(Path("notes"), [logs])
