"""The tyre stage on logs on disk: truth inside the intervals, tables that agree, and what is left out."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from generator.truth import load_truth
from scipy.stats import norm
from tyre_coverage import true_values

from ident.errors import NotIdentifiable
from ident.results import TyresResult
from ident.stages.inputs import InputSettings
from ident.stages.output import Context, StageOutput
from ident.stages.tyre_settings import TyresSettings
from ident.stages.tyres import tyres

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_logs"
TRUTH = load_truth()
TOLD = ("front.cornering_stiffness", "rear.cornering_stiffness", "yaw_inertia", "understeer_gradient")
BIASES = {
    "yaw_rate": TRUTH.imu.channels["yaw_rate"].bias,
    "lateral_acceleration": TRUTH.imu.channels["lateral_acceleration"].bias,
    "lateral_velocity": TRUTH.odometry.channels["lateral_velocity"].bias,
    "heading": TRUTH.odometry.channels["heading"].bias,
}
Z_99 = float(norm.ppf(0.995))


def stage(*logs: Path, kinds=("linear", "magic_formula"), **settings) -> StageOutput[TyresResult]:
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return tyres(list(logs), InputSettings(), TyresSettings(kinds=list(kinds), **settings), context)


@pytest.fixture(scope="module")
def planar() -> StageOutput[TyresResult]:
    return stage(SAMPLES / "planar")


@pytest.fixture(scope="module")
def chosen(planar):
    return next(fit for fit in planar.result.fits if fit.kind == planar.result.chosen)


def estimates(fit):
    own = {f"{axle}.{name}": one for axle in ("front", "rear") for name, one in getattr(fit, axle).items()}
    return own | {"yaw_inertia": fit.yaw_inertia, "understeer_gradient": fit.understeer_gradient}


def biases(result):
    return {
        (one.run, one.of): next(iter(one.parameters.values()))
        for one in result.nuisance
        if one.name in ("sensor_bias", "antenna_offset") and one.of is not None
    }


# --- the planar truck, of which the model is exactly true ----------------------------------------------


def test_the_kind_of_tyres_that_the_truck_has_is_chosen(planar):
    assert planar.result.chosen == "magic_formula"
    assert "linear" in planar.result.why
    assert planar.result.refused
    assert planar.result.verdict.startswith("Magic Formula axles")


def test_what_is_told_of_the_truck_holds_the_truth(planar, chosen):
    """Every value with an interval; the level of 99 % is that of all of them together."""
    true = true_values(TRUTH.planar)
    told = {name: one for name, one in estimates(chosen).items() if name in true and one.low is not None}
    assert set(TOLD) <= set(told)
    level = float(norm.ppf(1 - 0.005 / len(told)))
    outside = {
        name: round((one.value - true[name]) / one.std, 2)
        for name, one in told.items()
        if abs(one.value - true[name]) > level * one.std
    }
    assert outside == {}


def test_offset_of_the_steering_and_biases_of_the_sensors_hold_the_truth(planar):
    offset = next(one for one in planar.result.nuisance if one.name == "steering_offset")
    angle = offset.parameters["angle"]
    true = -TRUTH.steering.angle.channels["angle"].bias / TRUTH.planar.steering_ratio
    assert abs(angle.value - true) < Z_99 * angle.std
    assert offset.needed
    found = biases(planar.result)
    assert len(found) == 12
    level = float(norm.ppf(1 - 0.005 / len(found)))
    for (run, name), one in found.items():
        assert abs(one.value - BIASES[name]) < level * one.std, (run, name)


def test_a_bias_that_is_there_is_called_needed_and_one_that_is_not_is_not(planar):
    needed = {(one.of, one.needed) for one in planar.result.nuisance if one.name == "sensor_bias"}
    assert needed == {("yaw_rate", True), ("lateral_acceleration", True), ("lateral_velocity", False)}


def test_shape_and_peak_are_not_claimed_from_driving_below_the_peak(chosen):
    for axle in ("front", "rear"):
        own = getattr(chosen, axle)
        assert own["cornering_stiffness"].status == "identified"
        for name in ("shape", "stiffness_factor"):
            assert own[name].status == "not_identifiable"
            assert own[name].low is None
        assert own["peak_force"].status != "identified"
    assert "drive harder" in chosen.front["shape"].reason


def test_the_fit_leaves_what_the_sensors_err(planar):
    noise = planar.result.noise
    for name, sensor in (("yaw_rate", TRUTH.imu), ("lateral_acceleration", TRUTH.imu)):
        channel = sensor.channels[name]
        true = np.sqrt(channel.white_std**2 + channel.noise_std**2 + channel.resolution**2 / 12)
        assert noise[name].std <= noise[name].total_std
        assert noise[name].total_std == pytest.approx(true, rel=0.05)
    assert not any(one.coloured_beyond for one in noise.values())


def test_what_is_excited_is_what_was_driven(planar, chosen):
    low, high = planar.result.lateral_acceleration
    assert -5.2 < low < -3.5
    assert 3.5 < high < 5.2
    for axle in ("front", "rear"):
        low, high = chosen.excited[axle]
        assert -0.12 < low < -0.05
        assert 0.05 < high < 0.12
        curve = chosen.curves[axle]
        assert max(curve.slip_angle) > 1.3 * high
        assert curve.force[len(curve.force) // 2] == pytest.approx(0.0, abs=1e-6)


def test_tables_agree_with_the_result(planar, chosen):
    table = planar.tables["tyres"]
    assert table["run"].nunique() == 3
    for name in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        left = (table[name] - table[f"{name}_model"]).dropna()
        assert len(left) > 0.95 * len(table)
        # the result is of the raw samples, the table of values between them, which are a little smoother
        assert 0.7 < np.sqrt(np.mean(left**2)) / chosen.rms[name] < 1.02, name
    forces = planar.tables["tyre_forces"]
    assert set(forces["axle"]) == {"front", "rear"}
    own = forces[forces["axle"] == "front"]
    curve = chosen.curves["front"]
    expected = np.interp(own["slip_angle"], curve.slip_angle, curve.force)
    assert np.abs(np.mean(own["force"] - expected)) < 100.0
    assert np.std(own["force"] - expected) < 0.03 * np.ptp(own["force"])


def test_results_keep_their_schema(planar):
    schema = json.loads((ROOT / "docs" / "schema" / "tyres.schema.json").read_text(encoding="utf-8"))
    plain = json.loads(json.dumps(asdict(planar.result), allow_nan=False))
    jsonschema.Draft202012Validator(schema).validate(plain)


def test_the_model_holds_what_the_result_says_and_its_covariance(planar, chosen):
    model = planar.model
    names, covariance = model["parameters"], np.array(model["covariance"])
    assert covariance.shape == (len(names), len(names))
    assert np.linalg.eigvalsh(covariance / np.sqrt(np.outer(*[np.diag(covariance)] * 2))).min() > -1e-9
    for name, one in estimates(chosen).items():
        where = f"vehicle.{name}" if name == "yaw_inertia" else f"tyres.{name}"
        if where in names:
            index = names.index(where)
            assert np.sqrt(covariance[index, index]) == pytest.approx(one.std, rel=1e-9), name
    assert (
        model["tyres"]["front"]["cornering_stiffness"]["value"] == chosen.front["cornering_stiffness"].value
    )
    assert model["vehicle"]["mass"]["value"] == 12500.0


def test_runs_of_one_truck_are_all_used(planar):
    assert [one.run for one in planar.result.by_run] == ["planar_a", "planar_b", "planar_c"]
    assert all(one.windows == 6 for one in planar.result.by_run)
    assert not [one for one in planar.result.warnings if "alone it would move" in one]


# --- what is left out, and what is refused ------------------------------------------------------------


def copied(folder: Path, *runs: str) -> Path:
    shutil.copy(SAMPLES / "vehicle.yaml", folder / "vehicle.yaml")
    for run in runs:
        shutil.copytree(SAMPLES / run, folder / run)
    return folder


def test_runs_of_another_vehicle_file_and_without_motion_are_left_out_with_reasons(tmp_path):
    logs = copied(tmp_path, "manual_a", "manual_b", "steering_pulses_a")
    shutil.copytree(SAMPLES / "planar" / "planar_a", logs / "other" / "planar_a")
    text = (SAMPLES / "planar" / "vehicle.yaml").read_text(encoding="utf-8")
    (logs / "other" / "vehicle.yaml").write_text(text.replace("12500 kg", "9000 kg"), encoding="utf-8")
    result = stage(logs, kinds=["linear"]).result
    assert [one.run for one in result.by_run] == ["manual_a", "manual_b"]
    reasons = {one.what: one.reason for one in result.refused}
    assert "another vehicle" in reasons["other/planar_a"]
    assert "nothing to compare" in reasons["steering_pulses_a"]


def test_runs_named_in_the_recipe_are_the_only_ones_used(tmp_path):
    logs = copied(tmp_path, "manual_a", "slow_circle")
    result = stage(logs, kinds=["linear"], runs=["*manual*"]).result
    assert [one.run for one in result.by_run] == ["manual_a"]
    assert ("slow_circle", "not among tyres.runs") in [(one.what, one.reason) for one in result.refused]
    with pytest.raises(NotIdentifiable, match=r"no run is named by tyres\.runs nobody"):
        stage(logs, runs=["nobody"])


def test_without_the_mass_nothing_is_fitted(tmp_path):
    logs = copied(tmp_path, "manual_a")
    text = (SAMPLES / "vehicle.yaml").read_text(encoding="utf-8").replace("mass: 12500 kg\n", "")
    (logs / "vehicle.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(NotIdentifiable, match="the vehicle file lacks mass"):
        stage(logs)


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_observed_forces_stand_beside_the_inversion_nearer_to_the_fitted_tyres(planar, chosen, axle):
    """The fit holds the truth: its forces, all runs by one tyre, are the nearest to it there are."""
    told, forces, motion = planar.result.observer, planar.tables["tyre_forces"], planar.tables["tyres"]
    own = forces[forces["axle"] == axle]
    assert own["observed_force"].notna().mean() > 0.99
    inverted, observed, inside = [], [], []
    for name, rows in own.groupby("run", observed=True):
        model = motion[motion["run"] == name]
        truth = np.interp(rows["time"], model["time"], model[f"{axle}_lateral_force"])
        inverted.append(rows["force"] - truth)
        observed.append(rows["observed_force"] - truth)
        inside.append(np.abs(observed[-1]) <= 1.96 * rows["observed_std"])
    sizes = [np.sqrt(np.mean(np.concatenate(each) ** 2)) for each in (inverted, observed)]
    assert sizes[1] < 0.85 * sizes[0]
    assert np.mean(np.concatenate(inside)) > 0.9
    assert told.half_width[axle] == pytest.approx(1.96 * own["observed_std"].median(), rel=1e-3)
    assert set(told.innovations) == {"yaw_rate", "lateral_acceleration", "lateral_velocity"}
    assert told.from_wheels == {}
