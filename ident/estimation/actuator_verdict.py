"""Whether one linear actuator describes the runs, in numbers and in a sentence.

Two things can be wrong with (2.25). It may leave much of the measured angle unexplained though that is no
noise, or the runs, or the steps of different sizes, may disagree on its parameters: then each is described by
a linear model of its own, and the differences follow the excitation. A disagreement that is certain but of no
consequence (less than the practical limits below) is told and does not make the model inadequate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.estimation.actuator_fit import ActuatorFit, agreement, doubted, steering_model
from ident.estimation.actuator_runs import POOR_VAF, RunsFit, is_smooth
from ident.results import AmplitudeFit, Classification, Estimate, RunFit, SteeringModel

Array = NDArray[np.float64]

ENOUGH_VAF = 0.998  # explained, where the rest is no noise: 4 % of the measured angle is left
NOISE_VAF = 0.2  # explained, where the rest is noise
SIGNIFICANT = 0.01
PRACTICAL_GAIN = 0.03  # relative spread
PRACTICAL_LAG = 0.1  # spread over the total lag
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


@dataclass(frozen=True)
class _Group:
    """Fits of parts of the data.

    values, errors : (n, 2) gain [-] and total lag [s] of each, and their standard errors
    p : p-value of the hypothesis that all are the same
    over : what tells one from the next
    """

    values: Array
    errors: Array
    p: float | None
    over: str

    @property
    def matters(self) -> bool:
        """Whether the parts differ for certain, and by more than what is of no consequence."""
        if self.p is None or self.p >= SIGNIFICANT:
            return False
        errors = np.maximum(self.errors, np.finfo(float).tiny)
        middle = np.average(self.values, axis=0, weights=(errors.min(axis=0) / errors) ** 2)
        beyond = np.maximum(np.abs(self.values - middle) - 2 * errors, 0.0).max(axis=0) / np.abs(middle)
        return bool(beyond[0] > PRACTICAL_GAIN or beyond[1] > PRACTICAL_LAG)

    def __str__(self) -> str:
        (gain, lag), (most_gain, most_lag) = self.values.min(axis=0), self.values.max(axis=0)
        spans = f"gains of {gain:.2f} to {most_gain:.2f} and total lags of {lag:.2f} to {most_lag:.2f} s"
        return f"{spans} from {self.over} to {self.over}"


def judge(
    fit: RunsFit,
    model: SteeringModel,
    shape: Classification,
    sizes: Sequence[AmplitudeFit] = (),
    amplitude_p: float | None = None,
) -> Judgement:
    """Put the result in one line.

    sizes, amplitude_p : the fits to the steps of each size, and whether they agree
    """
    groups = [_over_runs(fit), _over_sizes(sizes, amplitude_p)]
    p = groups[0].p
    differing = [str(group) for group in groups if group.matters]
    share = f"explains {100 * max(fit.common.vaf, 0):.1f} % of the measured angle in {_runs(len(fit.used))}"
    nonlinear = [name for name in fit.excluded if _own_vaf(fit, name) >= POOR_VAF]
    rest_is_noise = not fit.common.misfit and not is_smooth(fit.common)
    enough = NOISE_VAF if rest_is_noise else ENOUGH_VAF
    if fit.common.vaf >= enough and not differing and not nonlinear:
        noise = "" if fit.common.vaf >= ENOUGH_VAF else "; the rest is noise"
        verdict = f"{_constants(model, shape)}; {share}{noise}"
        return Judgement(verdict, adequate=True, agreement_p=p, next_step=_next(model))
    rest = "" if rest_is_noise else f"; the rest, {fit.common.rms:.2g} rad, is smooth and no noise"
    told = f"One linear model does not describe this actuator: it {share}{rest}"
    if differing:
        told += f", with {', and '.join(differing)}"
    if nonlinear:
        told += f"; {_listed(nonlinear)} no linear model follows"
    advice = (
        "compare the runs below by size and kind of excitation, and drive steps of three sizes: what changes "
        "with amplitude is a rate limit, a dead zone or play, which this linear model cannot have"
    )
    return Judgement(told, adequate=False, agreement_p=p, next_step=advice)


def _over_runs(fit: RunsFit) -> _Group:
    fits = [
        one for name, one in fit.alone.items() if isinstance(one, ActuatorFit) and name not in fit.excluded
    ]
    values = np.array([[f.fit.shared[0], f.fit.shared[1] + f.fit.shared[2]] for f in fits])
    errors = np.array([_gain_and_lag_std(f) for f in fits])
    return _Group(values, errors, agreement(fits), "run")


def _over_sizes(sizes: Sequence[AmplitudeFit], p: float | None) -> _Group:
    estimates = [(one.gain, one.total_lag) for one in sizes]
    values = np.array([[one.value for one in pair] for pair in estimates], dtype=np.float64)
    errors = np.array([[one.std for one in pair] for pair in estimates], dtype=np.float64)
    return _Group(values, errors, p, "size")


def _own_vaf(fit: RunsFit, name: str) -> float:
    alone = fit.alone[name]
    if isinstance(alone, ActuatorFit) and alone.fit.shared[0] > 0:
        return alone.vaf
    return 0.0


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:LISTED])
    return shown if len(names) <= LISTED else f"{shown} and {len(names) - LISTED} more runs"


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
