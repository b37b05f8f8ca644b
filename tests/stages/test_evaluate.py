"""The evaluation stage on runs of the sample logs: what is predicted, by which input, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import BadRecipe, NotIdentifiable
from ident.model_file import model_from, model_text
from ident.pipeline.files import plain
from ident.report.summary import describe_evaluate
from ident.results import AccelerationBand, Error, EvaluateResult, SteeringResult, TyresResult
from ident.stages.evaluate import choose, evaluate
from ident.stages.evaluate_errors import valid_to
from ident.stages.evaluate_settings import EvaluateSettings
from ident.stages.inputs import InputSettings, SplitSettings
from ident.stages.output import Context, StageOutput
from ident.stages.steering import SteeringSettings, steering
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import tyres

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
CONTEXT = Context(command="test", date="2026-01-01T00:00:00Z")
INPUTS = InputSettings(vehicle=SAMPLES / "vehicle.yaml", split=SplitSettings(held_out=["manual_c", "path_b"]))
LOGS = [SAMPLES / name for name in ("manual_a", "manual_c", "path_b")]
MODELS = ("kinematic", "linear", "magic_formula")


@pytest.fixture(scope="module")
def identified() -> StageOutput[TyresResult]:
    settings = TyresSettings(kinds=["linear", "magic_formula"], runs=["manual_a"], two_track=False)
    return tyres([SAMPLES / "manual_a"], INPUTS, settings, CONTEXT)


@pytest.fixture(scope="module")
def fitted(identified: StageOutput[TyresResult]) -> TyresResult:
    return identified.result


@pytest.fixture(scope="module")
def actuator() -> SteeringResult:
    return steering([SAMPLES / "steering_pulses_a"], INPUTS, SteeringSettings(), CONTEXT).result


def settings(**said: object) -> EvaluateSettings:
    return EvaluateSettings(models=list(MODELS), **said)


@pytest.fixture(scope="module")
def output(fitted: TyresResult, actuator: SteeringResult) -> StageOutput[EvaluateResult]:
    require = {"yaw_rate": "0.01 rad/s", "lateral_acceleration": "0.001 m/s^2"}
    said = settings(require=require)
    return evaluate(LOGS, INPUTS, said, CONTEXT, tyres=fitted, steering=actuator)


def model(result: EvaluateResult, name: str, level: str = "measured"):
    return next(one for one in result.models if (one.name, one.input) == (name, level))


def test_only_what_is_held_out_is_predicted(output: StageOutput[EvaluateResult]) -> None:
    result = output.result
    assert (result.held_out, result.training, result.split_by) == (
        ["manual_c", "path_b"],
        ["manual_a"],
        "run",
    )
    assert {one.run for one in model(result, "linear").by_run} == {"manual_c", "path_b"}
    assert not [one for one in result.checks if one.verdict == "refused"]


def test_two_tracks_that_the_recipe_does_not_want_are_not_there(fitted: TyresResult) -> None:
    assert fitted.two_track is None
    assert "two_track" not in {one.what for one in fitted.refused}


def test_physics_orders_the_models(output: StageOutput[EvaluateResult]) -> None:
    rms = [model(output.result, name).windows["2 s"]["yaw_rate"].value for name in MODELS]
    assert rms[0] > 5 * rms[1] > 5 * rms[2]
    assert model(output.result, "kinematic").valid_to is None
    assert model(output.result, "magic_formula").valid_to == 4.0


def test_an_error_grows_with_the_lateral_acceleration_for_linear_tyres(
    output: StageOutput[EvaluateResult],
) -> None:
    bands = model(output.result, "linear").by_lateral_acceleration
    rms = [band.rms["yaw_rate"].value for band in bands]
    assert [band.lowest for band in bands] == [0.0, 1.0, 2.0, 3.0]
    assert rms == sorted(rms)


def test_the_request_through_the_actuator_predicts_the_angle_and_the_motion(
    output: StageOutput[EvaluateResult],
) -> None:
    driven = model(output.result, "magic_formula", "request")
    assert {one.run for one in driven.by_run} == {"path_b"}
    assert driven.rms["road_wheel_angle"].value < 0.003
    assert (
        driven.windows["2 s"]["yaw_rate"].value
        < 2 * model(output.result, "magic_formula").windows["2 s"]["yaw_rate"].value
    )


def test_the_cheapest_acceptable_model_is_chosen(output: StageOutput[EvaluateResult]) -> None:
    result = output.result
    assert result.chosen == "linear"
    assert "linear model is usable for control" in result.verdict
    limits = {name: one.value for name, one in result.acceptable.items()}
    measured = [one for one in result.models if one.input == "measured"]
    assert choose(measured, {**limits, "yaw_rate": 1e-6}) is None
    assert choose(
        [replace(one, cost_ns_per_step=1.0 / one.cost_ns_per_step) for one in measured], limits
    ) == ("magic_formula")


def test_requirements_are_measured_over_whole_runs(output: StageOutput[EvaluateResult]) -> None:
    result = output.result
    told = {one.signal: one for one in result.requirements}
    assert told["yaw_rate"].met is True
    assert told["lateral_acceleration"].met is False
    assert told["yaw_rate"].measured == model(result, "linear").rms["yaw_rate"].value


def test_better_models_are_better_for_certain(output: StageOutput[EvaluateResult]) -> None:
    pairs = {(one.better, one.worse): one for one in output.result.comparisons if one.signal == "yaw_rate"}
    assert pairs["linear", "kinematic"].p_value < 0.01
    assert pairs["magic_formula", "linear"].ratio.high < 1


def test_the_table_gives_the_errors_again(output: StageOutput[EvaluateResult]) -> None:
    table = output.tables["evaluate"]
    own = table[table["run"] == "manual_c"]
    error = (own["yaw_rate"] - own["yaw_rate__linear"]).to_numpy()
    told = next(one for one in model(output.result, "linear").by_run if one.run == "manual_c").rms["yaw_rate"]
    assert np.sqrt(np.nanmean(error**2)) == pytest.approx(told, rel=0.1)
    assert own["yaw_rate__linear__request"].isna().all()


def test_where_every_run_was_fitted_nothing_is_evaluated(fitted: TyresResult) -> None:
    inputs = InputSettings(vehicle=SAMPLES / "vehicle.yaml")
    with pytest.raises(NotIdentifiable, match=r"all 1 runs were used in the fit: hold one out"):
        evaluate([SAMPLES / "manual_a"], inputs, settings(), CONTEXT, tyres=fitted)


def test_a_model_is_compared_with_that_of_another_file(
    identified: StageOutput[TyresResult], tmp_path: Path
) -> None:
    model = model_from(plain(identified.model), "test")
    tyre = model.tyres
    assert tyre is not None
    softer = {**tyre.rear, "cornering_stiffness": replace(tyre.rear["cornering_stiffness"], value=3e5)}
    other = replace(model, tyres=replace(tyre, rear=softer))
    for name, one, better in (("same", model, False), ("other", other, True)):
        path = tmp_path / f"{name}.yaml"
        path.write_text(model_text(one), encoding="utf-8")
        said = settings(against=path)
        result = evaluate(LOGS, INPUTS, said, CONTEXT, tyres=identified.result).result
        pairs = [pair for pair in result.comparisons if str(path) in (pair.better, pair.worse)]
        yaw_rate = next(pair for pair in pairs if pair.signal == "yaw_rate")
        assert (yaw_rate.p_value < 0.01) is better
        assert (yaw_rate.ratio.value < 0.5) is better
        if better:
            assert (yaw_rate.better, yaw_rate.worse) == (identified.result.chosen, str(path))
            assert f"times the error of {path}" in describe_evaluate(result)
        else:
            assert yaw_rate.ratio.value == pytest.approx(1.0, abs=1e-6)


def test_a_file_without_tyres_is_no_model_to_compare_with(fitted: TyresResult, tmp_path: Path) -> None:
    (tmp_path / "old.yaml").write_text("schema: ident.model/1\n", encoding="utf-8")
    with pytest.raises(BadRecipe, match="holds no tyres"):
        evaluate(LOGS, INPUTS, settings(against=tmp_path / "old.yaml"), CONTEXT, tyres=fitted)


def test_a_stretch_shorter_than_the_judged_window_is_refused(fitted: TyresResult) -> None:
    split = SplitSettings(blocks={"manual_c": ("10 s", "11.5 s")})
    inputs = INPUTS.model_copy(update={"split": split})
    with pytest.raises(
        NotIdentifiable, match=r"the longest stretch that is held out has 1\.5 s, need more than 2 s"
    ):
        evaluate([SAMPLES / "manual_c"], inputs, settings(), CONTEXT, tyres=fitted)


def test_an_underdamped_actuator_drives_too(fitted: TyresResult, actuator: SteeringResult) -> None:
    """It has no real time constants: natural frequency and damping stand for the lags."""
    unknown = replace(actuator.model.time_constant_1, value=None)
    model = replace(actuator.model, time_constant_1=unknown, time_constant_2=unknown)
    results = [
        evaluate(
            LOGS, INPUTS, settings(), CONTEXT, tyres=fitted, steering=replace(actuator, model=one)
        ).result
        for one in (actuator.model, model)
    ]
    known, same = (
        model_of.rms["road_wheel_angle"].value
        for model_of in (next(one for one in result.models if one.input == "request") for result in results)
    )
    assert same == pytest.approx(known, rel=1e-9)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"yaw_rat": "0.02 rad/s"}, "unknown signal 'yaw_rat'"),
        ({"yaw_rate": "0.02 m"}, "yaw_rate"),
        ({"yaw_rate": "-1 rad/s"}, "is not positive"),
        (["yaw_rate"], "is no mapping"),
    ],
)
def test_a_wrong_requirement_is_refused(said: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EvaluateSettings(require=said)


def band(low: float, high: float | None, value: float) -> AccelerationBand:
    return AccelerationBand(low, high, 10.0, {"yaw_rate": Error(value, None, None, "rad/s")})


def test_a_model_is_valid_up_to_the_first_band_that_is_not_acceptable() -> None:
    bands = [band(0, 1, 0.001), band(1, 2, 0.005), band(2, 3, 0.02), band(3, 4, 0.001)]
    assert valid_to(bands, {"yaw_rate": 0.01}) == 2
    assert valid_to(bands, {"yaw_rate": 0.0005}) is None
    assert valid_to([*bands[:2], band(4, None, 0.001)], {"yaw_rate": 0.01}) == 2  # 2 to 4 was not driven
    assert valid_to([band(1, 2, 0.001)], {"yaw_rate": 0.01}) is None
    assert valid_to([band(0, 1, 0.001), band(1, None, 0.001)], {"yaw_rate": 0.01}) == 1
