"""The part of the steering: request, measured and modelled angle, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.report.condense import Array, Line, broken, contiguous
from ident.report.numbers import plain, shorten, significant
from ident.report.recording.parts import MOST_TABS, Part, log_style, origin, send, series
from ident.report.responses import Signals, cut_out, signals_of
from ident.report.summary import describe_steering
from ident.results import Experiment, ExperimentKind, SteeringResult

MOST_IN_ALL = 200
"""So many experiments have tabs in all runs together; each run has at least one: the viewer slows down."""
RANK: dict[ExperimentKind, int] = {"step": 0, "pulse": 0, "sine": 1, "other": 2}
ANGLES = ("request", "measured", "modelled")
MARGIN = 0.5
"""Shown before and after an experiment [s]."""


def steering_part(result: SteeringResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show request, measured and modelled angle and residual: the experiments first, then whole runs.

    With few experiments each has a tab; with many each run has one, with its experiments inside.

    Parameters
    ----------
    tables : "steering" and "steering_request", as ``ident.report.pages.steering`` describes them
    """
    runs = signals_of(tables["steering"], tables["steering_request"])

    def styles(recording: rr.RecordingStream) -> None:
        for run in runs:
            for role in (*ANGLES, "residual"):
                width = 2.5 if role == "measured" else 1.5
                log_style(recording, f"{origin('steering', run)}/{role}", role, f"{role} [rad]", width)

    def data(recording: rr.RecordingStream) -> None:
        for run, signals in runs.items():
            for role, line in _steering_lines(signals).items():
                send(recording, f"{origin('steering', run)}/{role}", line)

    tabs = _steering_tabs(result.experiments, runs)
    return Part("steering", "Steering", result.provenance, describe_steering(result), tabs, styles, data)


def _steering_lines(signals: Signals) -> dict[str, Line]:
    sent = contiguous(signals.request_time, signals.request_part.astype(np.int64))
    seen = contiguous(signals.time, signals.part.astype(np.int64))
    return {
        "request": broken(signals.request_time, signals.request, sent),
        "measured": broken(signals.time, signals.measured, seen),
        "modelled": broken(signals.time, signals.modelled, seen),
        "residual": broken(signals.time, signals.measured - signals.modelled, seen),
    }


def _steering_tabs(
    experiments: Sequence[Experiment], runs: dict[str, Signals]
) -> list[rrb.Container | rrb.View]:
    found = ordered([experiment for experiment in experiments if experiment.run in runs])
    if len(found) <= MOST_TABS:
        tabs = [_experiment_tab(one, runs[one.run], several=len(runs) > 1) for one in found]
        return [*tabs, *(_run_tab(name, signals, []) for name, signals in runs.items())]
    most = min(MOST_TABS, max(1, MOST_IN_ALL // len(runs)))
    return [
        _run_tab(name, runs[name], [experiment for experiment in found if experiment.run == name][:most])
        for name in by_interest(found, list(runs))
    ]


def ordered(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Sort experiments: those in use first, then steps and pulses, sines, others, each in their order."""
    return sorted(experiments, key=lambda found: (not found.used_by, RANK[found.kind]))


def by_interest(experiments: Sequence[Experiment], runs: Sequence[str]) -> list[str]:
    """Sort runs by the first of their experiments in the order given; runs without any come last."""
    first = dict.fromkeys(experiment.run for experiment in experiments)
    return [*first, *(run for run in runs if run not in first)]


def experiment_title(experiment: Experiment, *, several: bool) -> str:
    """Name an experiment: what, how large, when, and in which run where there are several."""
    parts: list[str] = [experiment.kind]
    if experiment.frequency is not None:
        parts.append(f"{significant(experiment.frequency)} rad/s")
    if experiment.amplitude is not None:
        parts.append(f"{significant(experiment.amplitude)} rad")
    parts.append(f"at {experiment.start:.1f} s")
    title = " ".join(parts)
    return f"{title}, {shorten(plain(experiment.run), 24)}" if several else title


def _experiment_tab(experiment: Experiment, signals: Signals, *, several: bool) -> rrb.Vertical:
    span = (experiment.start - MARGIN, experiment.end + MARGIN)
    return _angles(experiment.run, signals, span, name=experiment_title(experiment, several=several))


def _run_tab(name: str, signals: Signals, experiments: Sequence[Experiment]) -> rrb.Container:
    times: Array = np.concatenate([signals.time, signals.request_time])
    span = (float(times.min()), float(times.max())) if times.size else (0.0, 1.0)
    title = shorten(plain(name), 40)
    if not experiments:
        return _angles(name, signals, span, name=title)
    inside = [_experiment_tab(experiment, signals, several=False) for experiment in experiments]
    whole = _angles(name, signals, span, name="whole run")
    return rrb.Tabs(whole, *inside, active_tab=0, name=title)


def _angles(run: str, signals: Signals, span: tuple[float, float], *, name: str) -> rrb.Vertical:
    """Show the angles above and the residual below over a span of the run's time [s]."""
    shown, root = cut_out(signals, *span, zero=0.0), origin("steering", run)
    angles = series(root, span, "angle [rad]", {role: getattr(shown, role) for role in ANGLES})
    residual = series(root, span, "residual [rad]", {"residual": shown.residual})
    return rrb.Vertical(angles, residual, row_shares=[2.4, 1.0], name=name)
