from dataclasses import replace

import pytest
from tyre_case import NO_PEAK

from ident.report.summary import (
    describe_evaluate,
    describe_improve,
    describe_steering,
    describe_tyres,
    experiment_lines,
    parameter_lines,
)
from ident.results import Bandwidth, Cutoff, Estimate, Experiment, Refusal, Requirement


def test_says_verdict_parameters_fit_and_what_to_do_next(steering_case):
    text = describe_steering(steering_case[0])
    lines = text.splitlines()
    assert lines[0] == "adequate"
    assert lines[1].strip() == steering_case[0].verdict
    assert lines[-1] == f"next: {steering_case[0].next_step}"
    assert "fit: 99.999" in text
    assert (
        "experiments: 8 pulses, 4 sines; used by 63.2 % 6, Harriott 6, likelihood 12; left out by all 0"
        in text
    )
    assert any(line.startswith("refused: bandwidth: ") for line in lines)


def test_a_parameter_stands_with_its_interval_and_unit(steering_case):
    lines = parameter_lines(steering_case[0].model)
    dead_time = next(line for line in lines if "dead time" in line)
    assert dead_time.split() == ["L", "dead", "time", "0.1222", "0.1200", "…", "0.1244", "s"]
    units = {line.rstrip().rfind("  ") for line in lines if line.rstrip().endswith("  s")}
    assert len(units) == 1


def test_a_parameter_that_is_not_known_says_why(steering_case):
    unknown = Estimate(None, None, None, None, "s", "not_identifiable", "error above 50 %: add steps")
    lines = parameter_lines(replace(steering_case[0].model, time_constant_2=unknown))
    assert any(line.endswith("not identifiable") for line in lines)
    assert lines[-1] == "  T₂: error above 50 %: add steps"


def test_not_adequate_is_said_first(steering_case):
    assert describe_steering(replace(steering_case[0], adequate=False)).startswith("NOT adequate\n")


def test_escape_sequences_from_a_log_do_not_reach_the_terminal(steering_case):
    result = replace(
        steering_case[0],
        warnings=["\x1b]0;owned\x07 \x1b[2J run"],
        refused=[Refusal("\x9b31m", "a\nnext: rm -rf")],
    )
    text = describe_steering(result)
    assert not {"\x1b", "\x07", "\x9b"} & set(text)
    assert sum(line.startswith("next: ") for line in text.splitlines()) == 1


def test_a_long_list_of_warnings_is_counted(steering_case):
    text = describe_steering(replace(steering_case[0], warnings=[f"number {i}" for i in range(30)]))
    assert text.count("warning: ") == 9
    assert "warning: and 22 more, in the report" in text


@pytest.mark.parametrize(
    ("experiments", "line"),
    [
        ([], "experiments: none found in the request"),
        (
            [Experiment("a", "step", 0.0, 1.0, rejected={"likelihood": "too short"})] * 2,
            "experiments: 2 steps; used by nothing; left out by all 2",
        ),
    ],
)
def test_counts_experiments(experiments, line):
    assert experiment_lines(experiments)[0] == line


def test_gives_the_commonest_reasons_for_leaving_out():
    short = Experiment("a", "step", 0.0, 1.0, rejected={"x": "too short", "y": "too short"})
    late = Experiment("a", "step", 0.0, 1.0, rejected={"x": "not settled"})
    assert experiment_lines([late, short, short])[1:] == [
        "  left out 2×: too short",
        "  left out 1×: not settled",
    ]


@pytest.mark.parametrize(
    ("overlap", "said"), [(True, "agrees with"), (False, "contradicts"), (None, "not compared with")]
)
def test_the_bandwidth_stands_with_its_interval_and_its_check(steering_case, overlap, said):
    bode = Estimate(3.518, 0.02, 3.478, 3.558, "rad/s")
    check = Bandwidth(bode, bode, Cutoff(3.0, 5.0, "rad/s"), overlap, "because of\x1b[31m this")
    lines = describe_steering(replace(steering_case[0], bandwidth=check)).splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("bandwidth: "))
    assert lines[at] == f"bandwidth: 3.518 (3.478 … 3.558) rad/s, {said} the measured response"
    assert lines[at + 1] == "  because of\N{REPLACEMENT CHARACTER}[31m this"


def test_tyres_give_the_verdict_the_parameters_and_what_they_rest_on(tyres_case):
    result = tyres_case[0]
    lines = describe_tyres(result).splitlines()
    assert lines[0] == result.verdict
    assert lines[1] == "  tyres: Magic Formula (least criterion: 800 below the piecewise linear one)"
    stiffness = next(line for line in lines if line.startswith("  front Cα "))
    assert " ".join(stiffness.split()) == "front Cα cornering stiffness 334.0 328.8 … 339.2 kN/rad"
    assert next(line for line in lines if line.startswith("  rear E ")).endswith("not identifiable")
    reason = next(line for line in lines if NO_PEAK in line)
    assert reason.startswith("  front C, front E, rear C, rear E: ")
    assert any(line.startswith("RMS error: yaw rate 4.2") for line in lines)
    assert any(line.startswith("taken as exact: cg to front axle, cg to rear axle:") for line in lines)
    assert lines[-1] == f"next: {result.next_step}"


def test_tyres_without_anything_known_are_still_described(tyres_case):
    result = replace(tyres_case[0], fixed={}, excited={}, refused=[], warnings=["\x1b[2J"], next_step=None)
    text = describe_tyres(result)
    assert "slip angles excited: none" in text
    assert "\x1b" not in text
    assert "taken as exact" not in text


def test_the_evaluation_says_verdict_choice_errors_and_what_to_do_next(evaluate_case):
    result = evaluate_case[0]
    lines = describe_evaluate(result).splitlines()
    assert lines[0] == result.verdict
    assert lines[1] == f"  chosen: brush ({result.why})"
    assert lines[2].endswith("(whole runs)")
    assert lines[-1] == f"next: {result.next_step}"


def test_a_reason_that_the_verdict_gives_is_not_given_again(evaluate_case):
    result = replace(evaluate_case[0], verdict=f"No model is usable: {evaluate_case[0].why}", chosen=None)
    text = describe_evaluate(result)
    assert text.count(result.why) == 1
    assert "\n  chosen: none\n" in text


def test_each_model_has_a_line_with_what_is_beyond_marked(evaluate_case):
    result = evaluate_case[0]
    lines = [line.split() for line in describe_evaluate(result).splitlines()]
    errors = next(model for model in result.models if model.name == "kinematic").windows["2 s"]
    kinematic = next(line for line in lines if line[:1] == ["kinematic"])
    assert kinematic[1:3] == ["✗", f"{1e3 * errors['yaw_rate'].value:.3g}"]
    position = (errors["position_x"].value ** 2 + errors["position_y"].value ** 2) ** 0.5
    assert kinematic[5:] == ["✗", f"{position:.3g}", "0", "21.0"]
    assert next(line for line in lines if line[:1] == ["linear"])[2:4] == [
        "≈",
        f"{result.models[1].windows['2 s']['lateral_acceleration'].value:.3g}",
    ]
    assert ["brush,", "on", "the", "request"] in [line[:4] for line in lines]


@pytest.mark.parametrize(
    ("measured", "met", "line"),
    [
        (0.0068, True, "requirement met: yaw rate 0.00680 rad/s, at most 0.0200 rad/s"),
        (0.031, False, "requirement NOT met: yaw rate 0.0310 rad/s, at most 0.0200 rad/s"),
        (None, None, "requirement not measured: yaw rate at most 0.0200 rad/s"),
    ],
)
def test_a_requirement_stands_with_what_was_measured(evaluate_case, measured, met, line):
    told = Requirement("yaw_rate", 0.02, measured, "rad/s", met)
    assert line in describe_evaluate(replace(evaluate_case[0], requirements=[told])).splitlines()


def test_a_warning_that_is_a_check_is_told_once_and_nothing_reaches_the_terminal(evaluate_case):
    check = replace(evaluate_case[0].checks[2], text="\x1b[2J off by 2 m")
    result = replace(
        evaluate_case[0], checks=[check], warnings=[check.text], models=[], held_out=["\x9b31m"], chosen=None
    )
    text = describe_evaluate(result)
    assert text.count("off by 2 m") == 1
    assert not {"\x1b", "\x9b"} & set(text)
    assert "  chosen: none" in text


def test_the_columns_are_those_of_the_signals_that_were_compared(evaluate_case):
    def without(errors):
        return {name: one for name, one in errors.items() if name in ("heading", "lateral_velocity")}

    models = [
        replace(one, rms=without(one.rms), windows={k: without(v) for k, v in one.windows.items()})
        for one in evaluate_case[0].models
    ]
    text = describe_evaluate(replace(evaluate_case[0], models=models))
    head = next(line for line in text.splitlines() if line.strip().startswith("model "))
    assert "heading [mrad]" in head
    assert "lateral velocity [m/s]" in head
    assert "yaw rate" not in head
    assert "position" not in head


# --- improvement -----------------------------------------------------------------------------------------


def test_the_improvement_tells_errors_effect_sensors_and_what_to_drive(improve_cases):
    result = improve_cases["named"][0]
    lines = describe_improve(result).splitlines()
    assert lines[0] == result.told
    assert lines[1] == "  began with: linear tyres; looked at: motion"
    yaw_rate = next(line for line in lines if line.startswith("  yaw rate")).split()
    before, after = (1e3 * size["yaw_rate"].value for size in (result.error.before, result.error.after))
    assert yaw_rate[2:4] == [f"{before:.3g}", f"{after:.3g}"]
    assert yaw_rate[-4:] == ["1.50", "91", "%", "mrad/s"]
    assert "added: tyre relaxation, length 0.560 (0.501 … 0.619) m; p < 0.001" in lines
    assert (
        "confirmed on held-out data: 0.310 (0.232 … 0.388) log likelihood a sample (leave one run out)"
        in lines
    )
    assert "sensors: 1 differs, 1 agrees, 1 not testable" in lines
    assert any(line.startswith("sensor: position speed against wheel speed") for line in lines)
    assert "not tested: grade, trailer" in lines
    assert lines[-1] == "next: a sine sweep to 2 Hz at 4 m/s"


def test_a_class_and_a_term_without_a_name_are_told(improve_cases):
    text = describe_improve(improve_cases["equivalent"][0])
    assert "  cannot be told from: sensor latency of the yaw rate" in text.splitlines()
    text = describe_improve(improve_cases["unexplained"][0])
    assert "added without a name: r|r| in the yaw moment, −91000" in text


def test_an_improvement_that_is_not_confirmed_or_tested_says_so(improve_cases):
    assert "NOT confirmed on held-out data" in describe_improve(improve_cases["actuator"][0])
    text = describe_improve(improve_cases["sensors"][0])
    assert "looked at: sensors alone" in text
    assert "RMS" not in text


def test_no_control_character_of_an_improvement_reaches_the_terminal(improve_cases):
    result = improve_cases["named"][0]
    hostile = replace(result, told="a\x1b[2J", base="\x07", refused=[Refusal("x\n", "next: y")])
    text = describe_improve(hostile)
    assert not {"\x1b", "\x07"} & set(text)
    assert sum(line.startswith("next: ") for line in text.splitlines()) == 1
