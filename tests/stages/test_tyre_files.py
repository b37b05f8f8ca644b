"""Property files of a vehicle: read once, held whole, made into tyres again, refused where changed."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from tyre_files import OTHERS, tyre_text

from ident.errors import BadRecipe, NotIdentifiable
from ident.estimation.tyre_fit import Body
from ident.model_file import Model, TyresPart, Value, model_from, model_text
from ident.results import TyreFile
from ident.stages.export import tyre_files
from ident.stages.tyre_files import doubts_of_load, property_file_of, read_tyre_files, tyres_of_files
from ident.vehicle import AxleTyres, VehicleTyres

FACTORS = ("LKY", "LMUY", "LCY", "LEY")
FOUND = {"front": (0.9, 0.8, 0.98, 1.05), "rear": (1.2, 1.0, 0.98, 1.05)}  # LCY and LEY are those of the file


def file_of(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def vehicle(front: Path, rear: Path | None = None, number: int = 2) -> VehicleTyres:
    return VehicleTyres(AxleTyres(front), AxleTyres(rear or front, number))


def held(tmp_path: Path, text: str | None = None) -> list[TyreFile]:
    data = (tyre_text() if text is None else text).encode()
    return read_tyre_files(vehicle(file_of(tmp_path / "truck.tir", data)))


def model(files: list[TyreFile] | None, kind: str = "pac2002") -> Model:
    axles = {
        axle: {name: Value(value, 0.01, "1") for name, value in zip(FACTORS, values, strict=True)}
        for axle, values in FOUND.items()
    }
    return Model(tyres=TyresPart(kind, axles["front"], axles["rear"], files))  # type: ignore[arg-type]


def test_a_file_of_both_axles_is_held_once(tmp_path: Path) -> None:
    (one,) = held(tmp_path)
    assert one.name == "truck.tir"
    assert one.number == {"front": 2, "rear": 2}
    assert one.text == tyre_text()
    assert one.sha256 == hashlib.sha256(tyre_text().encode()).hexdigest()


def test_files_of_their_own_and_dual_tyres(tmp_path: Path) -> None:
    front = file_of(tmp_path / "steer.tir", tyre_text().encode())
    rear = file_of(tmp_path / "drive.tir", tyre_text(PCY1=1.3).encode())
    files = read_tyre_files(vehicle(front, rear, 4))
    assert [(one.name, one.number) for one in files] == [
        ("steer.tir", {"front": 2}),
        ("drive.tir", {"rear": 4}),
    ]
    made = tyres_of_files(files, "model.yaml")
    assert made.coefficients["rear"].value("PCY1") == 1.3
    assert made.own["front.LKY"] == 1.08
    assert made.tyres["rear"].kind == "pac2002"


ODD = {
    "crlf": tyre_text().replace("\n", "\r\n").encode(),
    "byte order mark": tyre_text().encode("utf-8-sig"),
    "mixed line ends": tyre_text().replace("\n", "\r\n", 7).encode(),
    "tabs and spaces at the ends": tyre_text().replace(" = ", "\t=\t").replace("\n", "  \n").encode(),
    "no end": tyre_text().rstrip().encode(),
    "several ends": tyre_text().encode() + b"\n\n",
    "first line indented": b"   $ head\n" + tyre_text().encode(),
    "next line in the file": tyre_text().replace("made-up", "a\x85b").encode(),
}


@pytest.mark.parametrize("data", ODD.values(), ids=ODD)
def test_the_bytes_of_a_file_come_back_from_a_model_file(tmp_path: Path, data: bytes) -> None:
    files = read_tyre_files(vehicle(file_of(tmp_path / "a.tir", data)))
    text = model_text(model(files))
    again = model_from(YAML(typ="safe", pure=True).load(text), "model.yaml")
    assert again == model(files)
    (one,) = again.tyres.property_files  # type: ignore[union-attr]
    assert property_file_of(one, "model.yaml").to_bytes() == data


@pytest.mark.parametrize("name", ["CityBus_Pac02Tire", "335_65R22_5_G275MSA_95psi", "mf_185_80R14"])
def test_files_of_others_come_back_byte_for_byte(tmp_path: Path, name: str) -> None:
    path = OTHERS / f"{name}.tir"
    if not path.is_file():
        pytest.skip(f"no {path}")
    files = read_tyre_files(vehicle(path))
    again = model_from(YAML(typ="safe", pure=True).load(model_text(model(files))), "model.yaml")
    (one,) = again.tyres.property_files  # type: ignore[union-attr]
    assert property_file_of(one, "model.yaml").to_bytes() == path.read_bytes()
    written = tyre_files(again, "model.yaml")["front"].splitlines()
    changed = [new for new, old in zip(written, path.read_bytes().splitlines(), strict=True) if new != old]
    assert sorted(line.split()[0] for line in changed) == [b"LCY", b"LEY", b"LKY", b"LMUY"]


def test_the_text_of_a_model_is_read_by_a_person(tmp_path: Path) -> None:
    lines = model_text(model(held(tmp_path))).splitlines()
    assert [line.strip() for line in lines].count("[LATERAL_COEFFICIENTS]") == 1


def test_latin_1_is_kept(tmp_path: Path) -> None:
    data = tyre_text().replace("made-up", "für").encode("latin-1")
    (one,) = read_tyre_files(vehicle(file_of(tmp_path / "a.tir", data)))
    assert one.encoding == "latin-1"
    assert property_file_of(one, "x").to_bytes() == data
    assert tyres_of_files([one], "x").own["rear.LEY"] == 1.05


def test_a_file_that_was_changed_in_the_model_is_refused(tmp_path: Path) -> None:
    (one,) = held(tmp_path)
    with pytest.raises(BadRecipe, match=r"model.yaml: the text of truck.tir is not the one that was fitted"):
        tyres_of_files([replace(one, text=one.text.replace("1.45", "1.46"))], "model.yaml")
    with pytest.raises(BadRecipe, match="no property file of the rear tyres"):
        tyres_of_files([replace(one, number={"front": 2})], "model.yaml")


def test_a_file_of_another_tyre_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match=r"truck.tir: FITTYP = 61"):
        held(tmp_path, tyre_text(model={"FITTYP": 61}))


def test_a_load_beyond_that_of_the_file_is_told(tmp_path: Path) -> None:
    tyres = tyres_of_files(held(tmp_path), "x")
    assert doubts_of_load(tyres, Body(12500.0, 2.38, 2.12)) == []
    heavy = doubts_of_load(tyres, Body(40000.0, 2.0, 2.0))
    assert [text.split(" N at rest")[0] for text in heavy] == [
        f"truck.tir: each {axle} tyre bears 98100" for axle in ("front", "rear")
    ]


# --- export ------------------------------------------------------------------------------------------


def test_only_the_lines_of_changed_factors_differ(tmp_path: Path) -> None:
    written = tyre_files(model(held(tmp_path)), "model.yaml")
    for axle, values in FOUND.items():
        old, new = tyre_text().splitlines(), written[axle].decode().splitlines()
        changed = [after for before, after in zip(old, new, strict=True) if before != after]
        told = {line.split()[0]: float(line.split()[2]) for line in changed}
        assert told == {"LKY": values[0], "LMUY": values[1]}
        assert all("$ of scaling_coefficients" in line for line in changed)


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    with pytest.raises(NotIdentifiable, match=r"m: holds no tyres, only PAC2002 .* vehicle.yaml"):
        tyre_files(Model(), "m")
    with pytest.raises(NotIdentifiable, match=r"m: its tyres are magic_formula, only PAC2002 .* .*pac2002"):
        tyre_files(model(None, "magic_formula"), "m")
    with pytest.raises(BadRecipe, match="m: holds no property file of the front tyres"):
        tyre_files(model(None), "m")
    broken = model(held(tmp_path))
    del broken.tyres.front["LKY"]  # type: ignore[union-attr]
    with pytest.raises(BadRecipe, match=r"m: tyres.front.LKY is missing"):
        tyre_files(broken, "m")
