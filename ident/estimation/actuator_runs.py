"""One actuator from many runs: the common fit, every run alone, and what does not belong.

The common fit takes two passes, because how much of a record that begins in motion can be used depends on
the dead time. Afterwards the assumption that a record's first command took effect at most one sample before
its stamp is tested against what the fit found; where it fails, nothing is assumed and the fit is repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import ActuatorFit, fit_actuator, fit_roughly
from ident.estimation.actuator_likelihood import (
    BIAS,
    DEAD_TIME,
    DEAD_TIME_RANGE,
    GAIN,
    ActuatorRecord,
    without_unknown_head,
)

Array = NDArray[np.float64]

FIRST_DEAD_TIME = 1.0  # [s] assumed at most, before anything is known
MARGIN = 0.02  # [s] on the dead time in the second pass
FEWEST_SAMPLES = 10
CERTAIN = 3.0  # standard deviations beyond which something is certain
SHIFT = 3  # place of the early start among the local parameters
POOR_VAF = 0.5  # explained by a run's own fit: the request was hardly acted on
FAIR_VAF = 0.9  # below this a run is left out where the rest is smooth and another run is good
GOOD_VAF = 0.95
SMOOTH = 0.1  # root mean square of second differences over that of the residual; AR(1) of 0.9 has 0.26
LARGEST_GAIN_ERROR = 0.2  # relative; a gain less certain than that is no answer to the request
SMALLEST_VAF = 0.05
NO_ANSWER = 0.5  # of the gain of the other runs
AT_THE_END = 1e-3  # [s]


@dataclass(frozen=True)
class RunRecords:
    """The records of one run; the ``run`` index of the records is set here and not by the caller."""

    name: str
    records: list[ActuatorRecord]
    jitter: float = 0.0


@dataclass(frozen=True)
class HiddenStart:
    """A record whose first command took effect ``early`` [s] before its first stamp."""

    run: str
    record: int
    early: float


@dataclass(frozen=True)
class RunsFit:
    """What ``identify_runs`` returns.

    common : the fit over all runs of ``used``, in that order
    used : names of the runs; places : run and record number of every record of the common fit
    alone : run -> its own fit, or the reason why it has none
    excluded : run -> why it was left out of the common fit
    """

    common: ActuatorFit
    used: list[str]
    places: list[tuple[str, int]]
    alone: Mapping[str, ActuatorFit | str]
    excluded: Mapping[str, str] = field(default_factory=dict)
    hidden: Sequence[HiddenStart] = ()


def identify_runs(
    runs: Sequence[RunRecords], *, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> RunsFit:
    """Fit one actuator to all runs, and to each alone.

    Parameters
    ----------
    runs : at least one, each with excitation
    progress : called with the fits done and the fits in all

    Raises
    ------
    NotIdentifiable
        If the measured angle does not follow the request in the runs together.
    """
    total = len(runs) + 1
    together, trouble = _fit_if_possible(runs)
    progress(1, total)
    alone = {}
    for number, run in enumerate(runs):
        common = together[0] if together else None
        alone[run.name] = common if common and len(runs) == 1 else _alone(run, common)
        progress(number + 2, total)
    excluded = _foreign(alone)
    kept = [run for run in runs if run.name not in excluded]
    if excluded:
        together = fit_together(kept)
    if together is None:
        raise NotIdentifiable(trouble)
    common, places, hidden = together
    _refuse_no_answer(common)
    return RunsFit(common, [run.name for run in kept], places, alone, excluded, hidden)


def _fit_if_possible(
    runs: Sequence[RunRecords],
) -> tuple[tuple[ActuatorFit, list[tuple[str, int]], list[HiddenStart]] | None, str]:
    """The common fit, or None and why there is none: one run may spoil it for the others."""
    try:
        return fit_together(runs), ""
    except NotIdentifiable as error:
        return None, str(error)


def fit_together(
    runs: Sequence[RunRecords],
) -> tuple[ActuatorFit, list[tuple[str, int]], list[HiddenStart]]:
    """Fit one actuator to all runs: two passes, then a third where a start was hidden.

    Returns
    -------
    the fit, the place (run, number of the record) of each of its records, the hidden starts
    """
    jitter = max(run.jitter for run in runs)
    records, _ = _usable(runs, FIRST_DEAD_TIME)
    first = fit_roughly(records)
    dead_time = _longest_dead_time(first)
    records, places = _usable(runs, dead_time)
    fit = fit_actuator(records, start=first.fit.shared, jitter=jitter)
    hidden = _hidden(fit, places)
    if hidden:
        late = {(one.run, one.record) for one in hidden}
        records = [
            replace(record, start_uncertainty=np.inf) if place in late else record
            for record, place in zip(records, places, strict=True)
        ]
        fit = fit_actuator(records, start=fit.fit.shared, jitter=jitter, shape=fit.fit.noise.shape)
        hidden = [HiddenStart(h.run, h.record, _early(fit, places.index((h.run, h.record)))) for h in hidden]
    return fit, places, hidden


def _usable(
    runs: Sequence[RunRecords], dead_time: float
) -> tuple[list[ActuatorRecord], list[tuple[str, int]]]:
    """All records with enough samples after the unknown head, with their run's index."""
    records, places = [], []
    for index, run in enumerate(runs):
        for number, record in enumerate(run.records):
            usable = without_unknown_head(record, dead_time)
            if usable.times.size >= FEWEST_SAMPLES:
                records.append(replace(usable, run=index))
                places.append((run.name, number))
    if not records:
        raise NotIdentifiable(
            f"every stretch of request and measured angle is shorter than {dead_time:.1f} s "
            f"and {FEWEST_SAMPLES} samples: record longer runs"
        )
    return records, places


def _longest_dead_time(fit: ActuatorFit) -> float:
    spread = float(np.sqrt(fit.fit.covariance[DEAD_TIME, DEAD_TIME]))
    return float(np.clip(fit.fit.shared[DEAD_TIME] + 4 * spread + MARGIN, 0.0, FIRST_DEAD_TIME))


def _early(fit: ActuatorFit, number: int) -> float:
    return float(-fit.fit.local[number][SHIFT])


def _hidden(fit: ActuatorFit, places: Sequence[tuple[str, int]]) -> list[HiddenStart]:
    """Records whose first command was far earlier than one sample before its stamp."""
    return [
        HiddenStart(*places[number], _early(fit, number))
        for number, record in enumerate(fit.records)
        if abs(_early(fit, number)) > CERTAIN * record.start_uncertainty > 0
    ]


def _alone(run: RunRecords, common: ActuatorFit | None) -> ActuatorFit | str:
    """Fit one run, beginning with the common model where there is one."""
    try:
        if common is None:
            return fit_together([run])[0]
        records, _ = _usable([run], _longest_dead_time(common))
        start = None if common.misfit else np.append(common.fit.shared[:BIAS], 0.0)
        fit = fit_actuator(records, start=start, jitter=run.jitter, shape=common.fit.noise.shape)
        if start is not None and fit.vaf < GOOD_VAF:
            fit = max(fit, fit_actuator(records, jitter=run.jitter), key=lambda one: one.vaf)
    except NotIdentifiable as error:
        return str(error)
    return fit


def _foreign(alone: Mapping[str, ActuatorFit | str]) -> dict[str, str]:
    """Runs that no linear actuator describes while it describes another one well, and why."""
    fits = {name: fit for name, fit in alone.items() if isinstance(fit, ActuatorFit)}
    good = [_gain(fit)[0] for fit in fits.values() if fit.vaf >= GOOD_VAF and _gain(fit)[0] > 0]
    if not good:
        return {}
    reasons = {name: _why_foreign(fit, float(np.median(good))) for name, fit in fits.items()}
    reasons |= {name: fit for name, fit in alone.items() if isinstance(fit, str)}
    return {name: reason for name, reason in reasons.items() if reason}


def _gain(fit: ActuatorFit) -> tuple[float, float]:
    """Gain and its standard error."""
    return float(fit.fit.shared[GAIN]), float(np.sqrt(fit.fit.covariance[GAIN, GAIN]))


def _why_foreign(fit: ActuatorFit, usual: float) -> str | None:
    """Say why a run does not belong to those whose gain is ``usual``, None where it does."""
    gain, std = _gain(fit)
    share = f"{100 * max(fit.vaf, 0):.0f} % of the measured angle"
    if gain + CERTAIN * std < 0 and fit.vaf >= FAIR_VAF:
        return f"its angle turns against its request (gain {gain:.3g}): one of the two has the wrong sign"
    if fit.vaf < POOR_VAF and gain + CERTAIN * std < NO_ANSWER * usual:
        return f"no answer to its request: gain {gain:.2g} ± {std:.1g}, other runs have {usual:.3g}"
    if fit.vaf < FAIR_VAF and is_smooth(fit):
        told = f"no linear model follows it: its own best fit explains {share}"
        return f"{told}; was the request acted on?" if fit.vaf < POOR_VAF else told
    return None


def is_smooth(fit: ActuatorFit) -> bool:
    """Whether what a fit leaves is too smooth for noise: its second differences are far smaller."""
    roughness = np.concatenate([np.diff(residual, 2) for residual in fit.fit.residuals]) / np.sqrt(6)
    return bool(np.sqrt(np.mean(roughness**2)) < SMOOTH * fit.rms)


def _longest_hold(records: Sequence[ActuatorRecord]) -> float:
    """Longest time for which the command stays the same after a change [s]."""
    longest = 0.0
    for record in records:
        changes = np.flatnonzero(np.diff(record.command_values)) + 1
        edges = np.append(record.command_times[changes], record.times[-1])
        longest = max(longest, float(np.diff(edges).max(initial=0.0)))
    return longest


def _one_level(records: Sequence[ActuatorRecord]) -> bool:
    """Whether no run has a second level of the request."""
    levels: dict[int, list[Array]] = {}
    for record in records:
        levels.setdefault(record.run, []).append(record.command_values)
    return all(np.ptp(np.concatenate(values)) == 0 for values in levels.values())


def _refuse_no_answer(fit: ActuatorFit) -> None:
    gain, std = _gain(fit)
    dead_time = float(fit.fit.shared[DEAD_TIME])
    if _one_level(fit.records):
        raise NotIdentifiable(
            f"the request holds {fit.records[0].first:.4g} rad and nothing else: the gain and the offset of "
            "the measured angle cannot be told apart; record from before a step until after the next"
        )
    if std > LARGEST_GAIN_ERROR * abs(gain) and fit.vaf > POOR_VAF:
        raise NotIdentifiable(
            f"the answers never settle: gain {gain:.3g} ± {std:.2g}, need it to 20 %; the request is held "
            f"for {_longest_hold(fit.records):.2f} s at most: hold a step until the angle rests, such as 5 s"
        )
    if std > LARGEST_GAIN_ERROR * abs(gain) or fit.vaf < SMALLEST_VAF or gain <= 0:
        raise NotIdentifiable(
            f"the measured angle does not follow the request: gain {gain:.3g} ± {std:.2g}, "
            f"{100 * max(fit.vaf, 0):.0f} % of the measured angle explained, need a gain known to 20 %: "
            "check that the request was acted on, and drive larger steps"
        )
    if min(abs(dead_time - end) for end in DEAD_TIME_RANGE) < AT_THE_END:
        low, high = DEAD_TIME_RANGE
        raise NotIdentifiable(
            f"the dead time reaches {dead_time:.2f} s, the end of what is searched ({low:g} to {high:g} s): "
            "request and measured angle are stamped by different clocks; state align.latency of one of them"
        )
