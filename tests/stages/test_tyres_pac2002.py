"""PAC2002 tyres from the vehicle file to the exported property file, on one planar sample run."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from tyre_files import tyre_text

from ident.control.truck import Truck
from ident.dynamics.tyres.property_file import parse_property_file
from ident.errors import BadRecipe, NotIdentifiable
from ident.model_file import Model, model_from, model_text
from ident.pipeline.files import plain
from ident.pipeline.model import composed
from ident.pipeline.store import result_text
from ident.report.html import render
from ident.report.pages.tyres import tyres_page
from ident.report.summary import describe_evaluate, describe_tyres
from ident.results import EvaluatedModel, TyresResult
from ident.stages.evaluate import evaluate
from ident.stages.evaluate_models import candidates, cost_ratios, from_file
from ident.stages.evaluate_settings import EvaluateSettings
from ident.stages.export import tyre_files
from ident.stages.inputs import InputSettings, SplitSettings
from ident.stages.output import Context, StageOutput
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import choose, tyres
from ident.stages.validate_truck import other_models, tyre_parameters

ROOT = Path(__file__).resolve().parents[2]
PLANAR = ROOT / "sample_logs" / "planar"
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")
HELD_OUT = SplitSettings(held_out=["planar_b"])
HOSTILE = "truck <b>.tir"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs") / "planar"
    for name in ("planar_a", "planar_b"):
        shutil.copytree(PLANAR / name, folder / name)
    shutil.copy(PLANAR.parent / "channels.yaml", folder)
    vehicle = (PLANAR / "vehicle.yaml").read_text(encoding="utf-8")
    (folder / "vehicle.yaml").write_text(f"{vehicle}tyres: {HOSTILE}\n", encoding="utf-8")
    (folder / HOSTILE).write_text(tyre_text(model={"TYRESIDE": "SYMMETRIC"}), encoding="utf-8")
    return folder


def stage(logs: Path, **settings: object) -> StageOutput[TyresResult]:
    return tyres([logs], InputSettings(split=HELD_OUT), TyresSettings(**settings), CONTEXT)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def output(logs: Path) -> StageOutput[TyresResult]:
    return stage(logs, kinds=["piecewise_linear", "pac2002"])


@pytest.fixture(scope="module")
def alone(logs: Path) -> StageOutput[TyresResult]:
    return stage(logs, kinds=["pac2002"])


@pytest.fixture(scope="module")
def model(alone: StageOutput[TyresResult]) -> Model:
    return composed({"tyres": alone.model or {}}, {"tyres": alone.result.provenance})


def test_the_factors_stand_beside_the_other_kinds(output: StageOutput[TyresResult]) -> None:
    by_kind = {fit.kind: fit for fit in output.result.fits}
    scaled, piecewise = by_kind["pac2002"], by_kind["piecewise_linear"]
    for axle in ("front", "rear"):
        stiffness = [getattr(fit, axle)["cornering_stiffness"].value for fit in (scaled, piecewise)]
        assert stiffness[0] == pytest.approx(stiffness[1], rel=0.1)
        assert list(getattr(scaled, axle)) == ["LKY", "LMUY", "LCY", "LEY", "cornering_stiffness"]
        assert getattr(scaled, axle)["LKY"].status == "identified"
        assert getattr(scaled, axle)["LEY"].status == "not_identifiable"
    assert scaled.rms["yaw_rate"] < piecewise.rms["yaw_rate"]
    assert all(high - low > 0.1 for low, high in scaled.excited.values())


def test_it_goes_on_only_where_it_alone_is_asked_for(
    output: StageOutput[TyresResult], alone: StageOutput[TyresResult]
) -> None:
    assert output.result.chosen == "piecewise_linear"
    assert alone.result.chosen == "pac2002"
    assert "PAC2002 goes on only where it alone is asked for" in output.result.why
    assert choose({"linear": 0.0, "pac2002": -1e6}) == "linear"
    assert choose({"pac2002": 3.0}) == "pac2002"
    assert output.model is not None
    assert output.model["tyres"]["property_files"] is None


def test_the_result_holds_the_file_and_keeps_the_schema(output: StageOutput[TyresResult]) -> None:
    (file,) = output.result.property_files
    assert (file.name, file.number) == (HOSTILE, {"front": 2, "rear": 2})
    schema = json.loads((ROOT / "docs" / "schema" / "tyres.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(result_text(output.result)), schema)


def test_the_pages_and_the_summary_say_it(
    output: StageOutput[TyresResult], alone: StageOutput[TyresResult]
) -> None:
    assert "PAC2002" in describe_tyres(output.result)
    for one in (output, alone):
        html = render([tyres_page(one.result, one.tables)])
        assert "stiffness factor LKY" in html
        assert "truck &lt;b&gt;.tir" in html
        assert "truck <b>" not in html


def test_without_a_property_file_the_kind_is_no_part_of_all_kinds(logs: Path) -> None:
    plain = InputSettings(vehicle=PLANAR / "vehicle.yaml", split=HELD_OUT)
    with pytest.raises(NotIdentifiable, match=r"names none: add `tyres: file.tir`"):
        tyres([logs / "planar_a"], plain, TyresSettings(kinds=["pac2002"]), CONTEXT)


def test_a_property_file_that_is_none_is_one_line(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "x.tir").write_text("nothing")
    vehicle = tmp_path / "vehicle.yaml"
    vehicle.write_text(
        f"{(PLANAR / 'vehicle.yaml').read_text(encoding='utf-8')}tyres: x.tir\n", encoding="utf-8"
    )
    with pytest.raises(BadRecipe, match=r"x.tir: line 1: 'nothing' is no \[SECTION\]"):
        tyres([logs], InputSettings(vehicle=vehicle, split=HELD_OUT), TyresSettings(), CONTEXT)


# --- the model, the evaluation, the export ------------------------------------------------------------


def test_the_evaluation_has_the_model_and_its_cost(logs: Path, output: StageOutput[TyresResult]) -> None:
    said = EvaluateSettings(models=["piecewise_linear", "pac2002", "two_track"])
    found = evaluate([logs], InputSettings(split=HELD_OUT), said, CONTEXT, tyres=output.result)
    rms = {one.name: one.windows["2 s"]["yaw_rate"].value for one in found.result.models}
    assert rms["pac2002"] < rms["piecewise_linear"]
    (why,) = [one.reason for one in found.result.refused if one.what == "two_track"]
    assert why.startswith("is not testable: the vehicle file states no track and cg_height: add")
    (ratio,) = found.result.cost_ratios
    cost = {one.name: one.cost_ns_per_step for one in found.result.models}
    assert ratio.ratio == cost["pac2002"] / cost["piecewise_linear"]
    assert 1.2 < ratio.ratio < 30
    assert "take 2 PAC2002 curves" in ratio.reason  # a symmetric tyre needs no mirror image
    assert f"(the source reports {ratio.reported:.1f})" in describe_evaluate(found.result)


def test_the_cost_is_not_told_where_one_model_was_not_evaluated(output: StageOutput[TyresResult]) -> None:
    assert cost_ratios([], output.result) == []
    one = EvaluatedModel("pac2002", "measured", {}, {}, {}, {}, {}, [], None, 700.0, [])
    assert cost_ratios([one], output.result) == []
    other = replace(one, name="piecewise_linear", cost_ns_per_step=200.0)
    (told,) = cost_ratios([one, other], output.result)
    assert told.ratio == 3.5


def test_a_model_file_makes_the_same_model_elsewhere(
    model: Model, alone: StageOutput[TyresResult], tmp_path: Path
) -> None:
    path = tmp_path / "model.yaml"
    path.write_text(model_text(model), encoding="utf-8")
    (here,), there = candidates(alone.result, ["pac2002"]), from_file(path)
    assert here.engine.parameters == there.engine.parameters
    assert {n: there.parameters[n] for n in here.parameters} == pytest.approx(
        dict(here.parameters), rel=1e-12
    )


def test_what_was_fitted_is_what_is_exported(model: Model, alone: StageOutput[TyresResult]) -> None:
    written = tyre_files(model, "model.yaml")
    for axle in ("front", "rear"):
        file = parse_property_file(written[axle], axle)
        told = getattr(alone.result.fits[0], axle)
        for name in ("LKY", "LMUY", "LCY", "LEY"):
            assert file.number(name) == pytest.approx(told[name].value, rel=1e-6)


def test_a_fit_beside_others_is_kept_in_the_model_and_exported(output: StageOutput[TyresResult]) -> None:
    beside = composed({"tyres": output.model or {}}, {"tyres": output.result.provenance})
    assert beside.tyres is not None
    assert beside.property_tyres is not None
    assert (beside.tyres.kind, beside.property_tyres.kind) == ("piecewise_linear", "pac2002")
    assert all(name.partition(".")[0] != "property_tyres" for name in beside.parameters)
    written = tyre_files(model_from(plain(beside), "m"), "m")
    scaled = next(fit for fit in output.result.fits if fit.kind == "pac2002")
    for axle in ("front", "rear"):
        told = getattr(scaled, axle)
        assert parse_property_file(written[axle], axle).number("LKY") == pytest.approx(told["LKY"].value)


def test_the_validation_says_that_it_simulates_no_such_truck(
    model: Model, alone: StageOutput[TyresResult]
) -> None:
    assert model.tyres is not None
    with pytest.raises(NotIdentifiable, match=r"m: its tyres are those of a property file \(pac2002\)"):
        tyre_parameters(model.tyres, "m")
    truck = Truck("linear", {"mass": 12500.0}, None)  # type: ignore[arg-type]
    assert set(other_models(truck, alone.result.fits)) == {"kinematic", "linear"}
