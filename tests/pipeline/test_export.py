"""``ident export``: what it writes, and that it never writes over anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner
from tyre_files import tyre_text

from ident.cli import main
from ident.errors import UsageError
from ident.model_file import Model, TyresPart, Value, model_text
from ident.pipeline.export import export_tyres
from ident.stages.tyre_files import read_tyre_files
from ident.vehicle import AxleTyres, VehicleTyres


@pytest.fixture
def model(tmp_path: Path) -> Path:
    file = tmp_path / "truck.tir"
    file.write_text(tyre_text(), encoding="utf-8")
    files = read_tyre_files(VehicleTyres(AxleTyres(file), AxleTyres(file)))
    front, rear = (
        {name: Value(value, None, "1") for name in ("LKY", "LMUY", "LCY", "LEY")} for value in (0.5, 1.5)
    )
    path = tmp_path / "model.yaml"
    path.write_text(model_text(Model(tyres=TyresPart("pac2002", front, rear, files))), encoding="utf-8")
    return path


def test_both_axles_have_a_file_of_their_own(model: Path, tmp_path: Path) -> None:
    written = export_tyres(model, tmp_path / "new" / "fit.tir")
    assert written == [tmp_path / "new" / "fit_front.tir", tmp_path / "new" / "fit_rear.tir"]
    assert [
        [line.split()[2] for line in path.read_text().splitlines() if line.startswith("LKY")]
        for path in written
    ] == [["0.5"], ["1.5"]]


def test_one_axle_takes_the_name_that_was_given(model: Path, tmp_path: Path) -> None:
    ended = CliRunner().invoke(
        main, ["export", str(model), "--to", "tir", "--axle", "rear", "--out", str(tmp_path / "r.tir")]
    )
    assert (ended.exit_code, ended.output) == (0, f"{tmp_path / 'r.tir'}\n")
    assert "LKY                  = 1.5   $" in (tmp_path / "r.tir").read_text()


def test_nothing_is_overwritten(model: Path, tmp_path: Path) -> None:
    (tmp_path / "fit_rear.tir").write_text("mine")
    with pytest.raises(UsageError, match=r"fit_rear.tir exists and stays as it is"):
        export_tyres(model, tmp_path / "fit.tir")
    assert not (tmp_path / "fit_front.tir").exists()
    assert (tmp_path / "fit_rear.tir").read_text() == "mine"


def test_a_model_without_such_tyres_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    path.write_text("schema: ident.model/1\n", encoding="utf-8")
    ended = CliRunner().invoke(main, ["export", str(path), "--to", "tir", "--out", str(tmp_path / "r.tir")])
    assert ended.exit_code == 4
    assert "holds no tyres" in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
