"""What the evaluation says of its models, as every view of it tells it: names, sizes, who is best where.

An error is judged against the acceptable size of its signal, over windows of ``STANDARD`` length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from ident.report.numbers import NONE, significant
from ident.report.page import Tone
from ident.report.tyre_parameters import in_order, signal_unit
from ident.results import Error, EvaluatedModel, EvaluateResult, ModelName

STANDARD = "2 s"
"""Length of the windows that a model is judged by."""
MODELS: dict[ModelName, str] = {
    "kinematic": "kinematic",
    "linear": "linear",
    "piecewise_linear": "piecewise linear",
    "brush": "brush",
    "magic_formula": "Magic Formula",
    "pac2002": "PAC2002",
    "two_track": "two-track",
}
INPUTS = {"measured": "measured steering", "request": "request"}
OTHERS = ("other_1", "other_2", "other_3", "other_4", "other_5", "other_6")

Judgement = Literal["within", "near", "beyond", "unknown"]
TONES: dict[Judgement, Tone] = {"within": "good", "near": "caution", "beyond": "bad", "unknown": "plain"}
CHECK_TONES: dict[str, Tone] = {"fine": "good", "warning": "caution", "refused": "bad"}
MARKS: dict[Judgement, str] = {"within": "", "near": "≈\u00a0", "beyond": "✗\u00a0", "unknown": ""}


def model_name(name: str) -> str:
    """Name a model for a reader; one that is not known by the name it has."""
    if name.endswith("__request"):
        return f"{model_name(name.removesuffix('__request'))}, on the request"
    return {str(key): text for key, text in MODELS.items()}.get(name, name)


def driven_by(result: EvaluateResult, given: str) -> list[EvaluatedModel]:
    """Give the models that were driven by the measured steering, or by the request."""
    return [model for model in result.models if model.input == given]


def reason(result: EvaluateResult) -> str | None:
    """Say why a model was chosen, or none was, where the verdict does not say it already."""
    return None if result.why in result.verdict else result.why


def costs_told(result: EvaluateResult) -> list[str]:
    """Say how much more one model costs than another, for each pair that the result names."""
    return [
        f"{model_name(one.model)} costs {significant(one.ratio, 2)} times what {model_name(one.over)} does"
        + ("" if one.reported is None else f" (the source reports {significant(one.reported, 2)})")
        for one in result.cost_ratios
    ]


def signals_of(result: EvaluateResult) -> list[str]:
    """Name every signal that some model was compared on, in the order in which errors are told."""
    return in_order(name for model in result.models for name in (*standard(model), *model.rms))


def standard(model: EvaluatedModel) -> Mapping[str, Error]:
    """Give the errors that the model is judged by: over the standard windows, else over whole runs."""
    return model.windows.get(STANDARD) or model.rms


def judge(error: Error | None, limit: Error | None) -> Judgement:
    """Say whether an error is within its acceptable size, beyond it, or whether its interval holds it."""
    if error is None or limit is None:
        return "unknown"
    low = error.value if error.low is None else error.low
    high = error.value if error.high is None else error.high
    if high <= limit.value:
        return "within"
    return "beyond" if low > limit.value else "near"


def shown_error(signal: str, error: Error | float | None) -> str:
    """Give the size of an error in the unit that ``signal_unit`` names."""
    value = error.value if isinstance(error, Error) else error
    return NONE if value is None else significant(value * signal_unit(signal)[0])


def over_acceptable(result: EvaluateResult, model: EvaluatedModel) -> tuple[str, float] | None:
    """Find the signal whose error is largest over its acceptable size, and that share [-]."""
    found = standard(model)
    shares = {
        name: found[name].value / limit.value
        for name, limit in result.acceptable.items()
        if name in found and limit.value > 0
    }
    if not shares:
        return None
    worst = max(shares, key=lambda name: shares[name])
    return worst, shares[worst]


def shown_model(result: EvaluateResult) -> EvaluatedModel | None:
    """Give the chosen model with the input it was chosen for; without one the model whose errors are least.

    Only models with lines in the table over time are of use here: those on measured steering come first.
    """
    chosen = [model for model in result.models if model.name == result.chosen]
    candidates = chosen or result.models
    return min(candidates, key=lambda model: (model.input != "measured", _size(result, model)), default=None)


def _size(result: EvaluateResult, model: EvaluatedModel) -> float:
    worst = over_acceptable(result, model)
    if worst is not None:
        return worst[1]
    return model.nrmse.get("yaw_rate", math.inf)


def roles(result: EvaluateResult) -> dict[str, str]:
    """Give each model its colour, that which is shown the colour of the model."""
    shown = shown_model(result)
    order: list[str] = [shown.name] if shown else []
    found = {str(model.name) for model in result.models}.difference(order)
    order += [name for name in MODELS if name in found]
    return dict(zip(order, ("modelled", *OTHERS), strict=False))


def by_agreement(result: EvaluateResult, runs: Sequence[str]) -> list[str]:
    """Sort runs by how well the shown model follows them, the best first; those without errors last.

    Compared is the root mean square of each signal in the run over that in all runs, the mean over signals.
    """
    model = shown_model(result)
    if model is None:
        return list(runs)
    told = {run.run: run.rms for run in model.by_run}

    def error(run: str) -> float:
        common = {name: size.value for name, size in model.rms.items() if size.value > 0}
        shares = [value / common[name] for name, value in told.get(run, {}).items() if name in common]
        return sum(shares) / len(shares) if shares else math.inf

    return sorted(runs, key=error)


def position_error(errors: Mapping[str, Error]) -> float | None:
    """Join the errors of both coordinates into one distance [m]; None where either is missing."""
    for first, second in (("position_x", "position_y"), ("position_along", "position_across")):
        if first in errors and second in errors:
            return math.hypot(errors[first].value, errors[second].value)
    return None


def judge_position(errors: Mapping[str, Error], limits: Mapping[str, Error]) -> Judgement:
    """Judge both coordinates of the position, the worse counts."""
    found = {judge(errors.get(name), limits.get(name)) for name in ("position_x", "position_y")}
    order: tuple[Judgement, ...] = ("beyond", "near", "within")
    return next((verdict for verdict in order if verdict in found), "unknown")


def window_seconds(length: str) -> float:
    """Read the length of a window, such as "2 s" [s]; infinite where it is none."""
    try:
        return float(length.removesuffix("s").strip())
    except ValueError:
        return math.inf
