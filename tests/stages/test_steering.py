"""The steering stage from logs on disk: truth inside the intervals, symmetry, and what a bad run costs."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from actuator_truth import Test, ar1_noise
from generator.runs import generate
from generator.truth import load_truth
from steering_logs import (
    NOISE,
    PARAMETERS,
    TRUTH,
    Array,
    answer,
    near_truth,
    pulse_test,
    sine_test,
    values,
    write,
)

from ident.errors import NotIdentifiable
from ident.results import SteeringModel, SteeringResult
from ident.stages.inputs import InputSettings
from ident.stages.output import Context, StageOutput
from ident.stages.steering import SteeringSettings, steering

ROOT = Path(__file__).resolve().parents[2]
MEASURED = Path(os.environ.get("IDENT_MEASURED", ROOT / ".." / "shared" / "measured"))
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"no measured logs in {MEASURED} (IDENT_MEASURED)"
)


def run(*logs: Path) -> StageOutput[SteeringResult]:
    context = Context(command="test", date="2026-01-01T00:00:00Z")
    return steering(list(logs), InputSettings(), SteeringSettings(), context)


# --- generated logs -------------------------------------------------------------------------------

SAMPLE_RUNS = ("steering_pulses_b", "steering_sines_b")


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> StageOutput[SteeringResult]:
    folder = tmp_path_factory.mktemp("sample")
    generate(folder, load_truth(), seed=7, only=SAMPLE_RUNS)
    shutil.copy(ROOT / "sample_logs" / "channels.yaml", folder)
    return run(folder)


@pytest.mark.parametrize("name", PARAMETERS)
def test_the_truth_of_generated_logs_lies_in_the_intervals(
    sample: StageOutput[SteeringResult], name: str
) -> None:
    found = getattr(sample.result.model, name)
    truth = float(np.real(getattr(load_truth().steering.actuator, name)))
    assert found.status == "identified"
    assert abs(found.value - truth) < 3.3 * found.std  # once in a thousand
    assert found.low < found.value < found.high


def test_generated_logs_are_judged_adequate_and_of_one_actuator(sample: StageOutput[SteeringResult]) -> None:
    result = sample.result
    assert result.adequate
    assert result.classification == "overdamped"
    assert result.agreement_p is not None
    assert result.agreement_p > 0.001
    assert result.vaf > 0.999
    kinds = [one.kind for one in result.experiments]
    assert kinds.count("sine") == 9
    assert kinds.count("pulse") + kinds.count("step") >= 9
    assert all("likelihood" in one.used_by for one in result.experiments)


def test_the_noise_is_that_of_the_sensor(sample: StageOutput[SteeringResult]) -> None:
    channel = load_truth().steering.angle.channels["angle"]
    noise = sample.result.noise
    total = np.sqrt(channel.white_std**2 + channel.noise_std**2 + channel.resolution**2 / 12)
    assert noise.kind == "ar"
    assert noise.total_std == pytest.approx(total, rel=0.05)
    assert noise.quantisation == pytest.approx(channel.resolution, rel=1e-6)
    assert sample.result.rms_error == pytest.approx(total, rel=0.05)


def test_the_table_of_samples_is_the_fit(sample: StageOutput[SteeringResult]) -> None:
    table = sample.tables["steering"]
    used = table[table["used"]]
    assert len(used) == sample.result.samples
    np.testing.assert_allclose(used["measured"] - used["modelled"], used["residual"], rtol=0, atol=1e-12)
    assert np.sqrt(np.mean(used["residual"] ** 2)) == pytest.approx(sample.result.rms_error, rel=1e-9)
    assert not np.isfinite(table.loc[~table["used"], "residual"]).any()
    for number, one in enumerate(sample.result.experiments):
        inside = table[table["experiment"] == number]
        assert set(inside["run"]) == {one.run}
        assert inside["time"].between(one.start, one.end).all()


def test_the_model_part_carries_the_errors_of_the_result(sample: StageOutput[SteeringResult]) -> None:
    part = sample.model
    assert part is not None
    assert part["parameters"] == [f"steering.{name}" for name in PARAMETERS]
    errors = np.sqrt(np.diag(np.array(part["covariance"])))
    for error, name in zip(errors, PARAMETERS, strict=True):
        assert part["steering"][name]["value"] == getattr(sample.result.model, name).value
        assert error == pytest.approx(part["steering"][name]["std"], rel=0.02)


def test_nothing_in_the_result_is_nan(sample: StageOutput[SteeringResult]) -> None:
    assert json.dumps(asdict(sample.result), allow_nan=False)


# --- symmetry -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> SteeringResult:
    folder = tmp_path_factory.mktemp("plain")
    write(folder / "a.mcap", pulse_test(1), answer(pulse_test(1)))
    write(folder / "b.mcap", sine_test(2), answer(sine_test(2), seed=2))
    return run(folder).result


def test_small_logs_give_the_truth(plain: SteeringResult) -> None:
    near_truth(plain)
    assert plain.adequate


def test_a_mirrored_log_gives_the_same_model(plain: SteeringResult, tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", pulse_test(1), answer(pulse_test(1)), sign=-1)
    write(tmp_path / "b.mcap", sine_test(2), answer(sine_test(2), seed=2), sign=-1)
    mirrored = run(tmp_path).result
    np.testing.assert_allclose(values(mirrored), values(plain), rtol=1e-6)
    assert mirrored.classification == plain.classification
    amplitudes = [one.amplitude for one in plain.experiments if one.kind in ("step", "pulse")]
    assert [-one.amplitude for one in mirrored.experiments if one.kind in ("step", "pulse")] == pytest.approx(
        amplitudes
    )


def test_the_order_of_the_runs_does_not_matter(plain: SteeringResult, tmp_path: Path) -> None:
    write(tmp_path / "b.mcap", pulse_test(1), answer(pulse_test(1)))
    write(tmp_path / "a.mcap", sine_test(2), answer(sine_test(2), seed=2))
    turned = run(tmp_path).result
    np.testing.assert_allclose(values(turned), values(plain), rtol=1e-6)
    for name in PARAMETERS:
        turned_std, std = getattr(turned.model, name).std, getattr(plain.model, name).std
        assert turned_std == pytest.approx(std, rel=1e-3)


def test_the_date_of_the_recording_does_not_matter(plain: SteeringResult, tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", pulse_test(1), answer(pulse_test(1)), epoch=86_400.0 * 365)
    write(tmp_path / "b.mcap", sine_test(2), answer(sine_test(2), seed=2), epoch=-86_400.0)
    np.testing.assert_allclose(values(run(tmp_path).result), values(plain), rtol=1e-6)


# --- one bad run ----------------------------------------------------------------------------------


def mirrored_answer(test: Test) -> Array:
    return -answer(test, seed=5)


def noise_alone(test: Test) -> Array:
    return 0.3 + ar1_noise(test.times.size, NOISE, 0.0, np.random.default_rng(5))


def nothing_moves(test: Test) -> Array:
    return np.full(test.times.size, 0.3)


BAD = {
    "wrong sign": (mirrored_answer, "wrong sign"),
    "noise": (noise_alone, "no answer to its request"),
    "still": (nothing_moves, "the measured angle stays at 0.3 rad while the request changes"),
}


@pytest.mark.parametrize(("measured", "told"), BAD.values(), ids=BAD)
def test_one_bad_run_is_left_out_and_does_not_bend_the_others(
    measured: Callable[[Test], Array], told: str, tmp_path: Path
) -> None:
    write(tmp_path / "good.mcap", pulse_test(1), answer(pulse_test(1)))
    write(tmp_path / "bad.mcap", pulse_test(3), measured(pulse_test(3)))
    result = run(tmp_path).result
    near_truth(result)
    assert result.adequate
    said = [*result.warnings, *(f"{one.what}: {one.reason}" for one in result.refused)]
    assert any(line.startswith("bad") and told in line for line in said), said
    users = {one.run: one.used_by for one in result.experiments if one.used_by}
    assert set(users) == {"good"}
    assert all(fit.gain is None or fit.gain > 0 for fit in result.step_methods)


def test_a_dead_time_beyond_what_is_searched_is_refused(tmp_path: Path) -> None:
    late = replace(TRUTH, dead_time=2.6)
    write(tmp_path / "a.mcap", pulse_test(1), answer(pulse_test(1), late))
    with pytest.raises(NotIdentifiable, match=r"dead time reaches .* different clocks"):
        run(tmp_path)


def test_an_angle_that_never_moves_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", pulse_test(1), nothing_moves(pulse_test(1)))
    with pytest.raises(
        NotIdentifiable, match=r"the measured angle stays at 0\.3 rad while the request changes"
    ):
        run(tmp_path)


# --- requests of other kinds ------------------------------------------------------------------------


def events() -> Test:
    sent, levels = np.array([0.0, 1.0, 5.0, 8.0, 12.0, 15.0]), np.array([0.0, 1.0, 0.0, -0.7, 0.0, 0.5])
    return Test(sent, levels, np.arange(0.005, 20.0, 0.02))


def test_a_request_sent_only_when_it_changes_is_used_by_every_method(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", events(), answer(events()))
    result = run(tmp_path).result
    near_truth(result)
    assert [one.kind for one in result.experiments] == ["pulse", "step", "pulse", "step", "step"]
    assert {fit.method: fit.steps for fit in result.step_methods}["first_order_63"] == 5


@pytest.mark.parametrize("make", [events, lambda: pulse_test(4)], ids=["events", "50 Hz"])
def test_what_happens_after_the_controller_lets_go_is_not_used(
    make: Callable[[], Test], tmp_path: Path
) -> None:
    test = make()
    measured = answer(test)
    driver = test.times > 11.0
    measured[driver] = 0.5 * np.sin(3 * test.times[driver])
    flag = np.arange(0.0, test.times[-1], 0.1)
    write(tmp_path / "a.mcap", test, measured, engaged=(flag, flag < 10.95))
    result = run(tmp_path).result
    near_truth(result)
    assert result.adequate
    assert result.rms_error == pytest.approx(NOISE, rel=0.15)


def test_logs_without_noise_are_no_trouble(tmp_path: Path) -> None:
    test = pulse_test(1)
    write(tmp_path / "a.mcap", test, test.record(TRUTH, np.zeros(test.times.size)).measured)
    output = run(tmp_path)
    np.testing.assert_allclose(values(output.result), [0.95, 0.123, 0.25, 0.08], rtol=1e-4)
    assert json.dumps(asdict(output.result), allow_nan=False)
    assert json.dumps(output.model, allow_nan=False)


def test_jittered_stamps_are_modelled_in_continuous_time(tmp_path: Path) -> None:
    test = pulse_test(1)
    random = np.random.default_rng(5)
    jittered = Test(
        test.command_times, test.command_values, test.times + random.uniform(0, 0.014, test.times.size)
    )
    write(tmp_path / "a.mcap", jittered, answer(jittered))
    result = run(tmp_path).result
    near_truth(result)
    assert result.noise.kind == "continuous_ar1"
    # The noise is AR(1) of 0.5 on the index, so over 20 ms.
    assert result.noise.correlation_time == pytest.approx(0.02 / np.log(2), rel=0.4)


# --- measured logs ----------------------------------------------------------------------------------


@needs_measured
def test_a_servo_is_not_described_by_one_linear_model() -> None:
    folder = MEASURED / "servo_miuzei"
    result = run(*(folder / name for name in ("ramps", "chirp"))).result
    assert not result.adequate
    assert result.verdict.startswith("One linear model does not describe this actuator")
    assert result.agreement_p is not None
    assert result.agreement_p < 1e-6
    assert "amplitude" in str(result.next_step)
    assert json.dumps(asdict(result), allow_nan=False)
    model = [getattr(result.model, name) for name in SteeringModel.__dataclass_fields__]
    assert "identified" not in {one.status for one in model}


@needs_measured
def test_a_car_without_a_request_is_refused_with_what_it_has() -> None:
    with pytest.raises(NotIdentifiable, match="no steering request with a measured angle in 3 runs: found"):
        run(MEASURED / "p1_psu")
