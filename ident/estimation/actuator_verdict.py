"""Whether one linear actuator describes the runs, in numbers and in a sentence.

Two things can be wrong with (2.25). It may leave much of the measured angle unexplained, or the runs may
disagree on its parameters: then each is described by a linear model of its own, and the differences follow
the excitation. A disagreement that is certain but of no consequence (less than the practical limits below) is
told and does not make the model inadequate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.estimation.actuator_fit import ActuatorFit, agreement, doubted, steering_model
from ident.estimation.actuator_runs import POOR_VAF, RunsFit
from ident.results import Classification, Estimate, RunFit, SteeringModel

ENOUGH_VAF = 0.95
SIGNIFICANT = 0.01
PRACTICAL_GAIN = 0.03  # relative spread between runs
PRACTICAL_LAG = 0.1  # of the total lag, spread between runs
LISTED = 4  # names of runs in a sentence


@dataclass(frozen=True)
class Judgement:
    """The verdict: one line, whether the model is adequate, and what to do next."""

    verdict: str
    adequate: bool
    agreement_p: float | None
    next_step: str | None


def run_fits(fit: RunsFit, excitation: Mapping[str, list[str]]) -> list[RunFit]:
    """Each run's own fit beside what the common model explains of it.

    excitation : run -> kinds of its experiments
    """
    return [_run_fit(name, alone, fit, excitation.get(name, [])) for name, alone in fit.alone.items()]


def _run_fit(name: str, alone: ActuatorFit | str, fit: RunsFit, excitation: list[str]) -> RunFit:
    common = _on_run(fit, name)
    if isinstance(alone, str):
        rms, vaf, samples = common or (0.0, 0.0, 0)
        return RunFit(name, excitation, samples, None, rms, vaf, None, alone, used=common is not None)
    rms, vaf, samples = common or (alone.rms, alone.vaf, alone.samples)
    model = steering_model(alone.fit)
    return RunFit(
        name,
        excitation,
        samples,
        doubted(model) if alone.misfit else model,
        rms,
        vaf,
        alone.vaf,
        fit.excluded.get(name),
        used=common is not None,
    )


def _on_run(fit: RunsFit, name: str) -> tuple[float, float, int] | None:
    """(rms error [rad], vaf, samples) of the common model on one run."""
    picked = [i for i, (run, _) in enumerate(fit.places) if run == name]
    if not picked:
        return None
    residual = np.concatenate([fit.common.fit.residuals[i] for i in picked])
    measured = np.concatenate([fit.common.records[i].measured for i in picked])
    left = float(residual @ residual)
    spread = float(np.square(measured - measured.mean()).sum())
    return float(np.sqrt(left / residual.size)), 1 - left / spread if spread else 0.0, residual.size


def judge(fit: RunsFit, model: SteeringModel, shape: Classification) -> Judgement:
    """Put the result in one line."""
    fits = [
        one for name, one in fit.alone.items() if isinstance(one, ActuatorFit) and name not in fit.excluded
    ]
    p = agreement(fits) if len(fits) > 1 else None
    gain_spread, lag_spread = _spreads(fits)
    differ = p is not None and p < SIGNIFICANT
    matters = differ and (gain_spread > PRACTICAL_GAIN or lag_spread > PRACTICAL_LAG)
    share = f"explains {100 * max(fit.common.vaf, 0):.1f} % of the measured angle in {_runs(len(fit.used))}"
    nonlinear = [name for name in fit.excluded if _own_vaf(fit, name) >= POOR_VAF]
    if fit.common.vaf >= ENOUGH_VAF and not matters and not nonlinear:
        verdict = f"{_constants(model, shape)}; {share}"
        return Judgement(verdict, adequate=True, agreement_p=p, next_step=_next(model))
    told = f"One linear model does not describe this actuator: it {share}"
    if matters:
        told += f", with {_ranges(fits)} from run to run"
    if nonlinear:
        told += f"; {_listed(nonlinear)} no linear model follows"
    advice = (
        "compare the runs below by size and kind of excitation, and drive steps of three sizes: what changes "
        "with amplitude is a rate limit, a dead zone or play, which this linear model cannot have"
    )
    return Judgement(told, adequate=False, agreement_p=p, next_step=advice)


def _own_vaf(fit: RunsFit, name: str) -> float:
    alone = fit.alone[name]
    if isinstance(alone, ActuatorFit) and alone.fit.shared[0] > 0:
        return alone.vaf
    return 0.0


def _ranges(fits: Sequence[ActuatorFit]) -> str:
    gains = [float(f.fit.shared[0]) for f in fits]
    lags = [float(f.fit.shared[1] + f.fit.shared[2]) for f in fits]
    gain = f"gains of {min(gains):.2f} to {max(gains):.2f}"
    return f"{gain} and total lags of {min(lags):.2f} to {max(lags):.2f} s"


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:LISTED])
    return shown if len(names) <= LISTED else f"{shown} and {len(names) - LISTED} more runs"


def _spreads(fits: Sequence[ActuatorFit]) -> tuple[float, float]:
    """Largest distances between runs of gain and total lag, less what their errors allow, relative."""
    if len(fits) < 2:
        return 0.0, 0.0
    values = np.array([[f.fit.shared[0], f.fit.shared[1] + f.fit.shared[2]] for f in fits])
    errors = np.array([_gain_and_lag_std(f) for f in fits])
    middle = np.average(values, axis=0, weights=1 / errors**2)
    beyond = np.maximum(np.abs(values - middle) - 2 * errors, 0.0).max(axis=0) / np.abs(middle)
    return float(beyond[0]), float(beyond[1])


def _gain_and_lag_std(fit: ActuatorFit) -> tuple[float, float]:
    covariance = fit.fit.covariance
    lag = covariance[1, 1] + 2 * covariance[1, 2] + covariance[2, 2]
    return float(np.sqrt(covariance[0, 0])), float(np.sqrt(lag))


def _constants(model: SteeringModel, shape: Classification) -> str:
    parts = [f"gain {_known(model.gain, 1, '', 3)}", f"dead time {_known(model.dead_time, 1e3, ' ms', 0)}"]
    if shape == "underdamped":
        parts.append(f"natural frequency {_known(model.natural_frequency, 1, ' rad/s', 2)}")
        parts.append(f"damping ratio {_known(model.damping_ratio, 1, '', 2)}")
    elif model.time_constant_1.value is None or model.time_constant_2.value is None:
        parts.append(f"total lag {_known(model.total_lag, 1e3, ' ms', 0)}")
    else:
        first, second = model.time_constant_1.value, model.time_constant_2.value
        parts.append(f"lags {1e3 * first:.0f} ms and {1e3 * second:.0f} ms")
    return f"{', '.join(parts)} ({shape.replace('_', ' ')})".capitalize()


def _known(estimate: Estimate, factor: float, unit: str, digits: int) -> str:
    return "unknown" if estimate.value is None else f"{factor * estimate.value:.{digits}f}{unit}"


def _runs(number: int) -> str:
    return f"{number} run{'' if number == 1 else 's'}"


def _next(model: SteeringModel) -> str | None:
    doubtful = {
        "dead time": model.dead_time,
        "T1": model.time_constant_1,
        "T2": model.time_constant_2,
    }
    weak = [name for name, one in doubtful.items() if one.status != "identified"]
    if not weak:
        return None
    names = " and ".join(weak)
    return f"{names}: add rectangular pulses of 5 s and sines to 10 rad/s, which tell the lags apart"
