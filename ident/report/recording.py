"""OUT/run.rrd: request, measured, modelled and residual over time, for the Rerun viewer.

The recording holds every sample, on one timeline in seconds since the start of each run. Its blueprint
opens on the experiments, steps and sines first: a tab each, or with many of them a tab a run with the
experiments of that run inside. The views have a dark ground of their own, so that the colours (those
of the report's dark form) can be read in either theme of the viewer. This is the only module that
imports rerun.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.report.condense import Array, Line, broken, contiguous
from ident.report.numbers import plain, shorten, significant
from ident.report.palette import DARK
from ident.report.responses import Signals, cut_out, signals_of
from ident.report.summary import describe_steering
from ident.results import Experiment, ExperimentKind, Provenance, SteeringResult

TIMELINE = "time"
MOST_TABS = 20
"""With more experiments than this each run has one tab, and its first so many experiments are tabs in it."""
MOST_IN_ALL = 200
"""So many experiments have tabs in all runs together; each run has at least one: the viewer slows down."""
RANK: dict[ExperimentKind, int] = {"step": 0, "pulse": 0, "sine": 1, "other": 2}
ANGLES = ("request", "measured", "modelled")
MARGIN = 0.5
"""Shown before and after an experiment [s]."""


def write_recording(path: Path, result: SteeringResult, tables: Mapping[str, pd.DataFrame]) -> None:
    """Write the recording of the steering stage with its blueprint.

    Parameters
    ----------
    tables : "steering" and "steering_request", as ``ident.report.pages.steering`` describes them
    """
    runs = signals_of(tables["steering"], tables["steering_request"])
    recording = rr.RecordingStream("ident", recording_id=recording_id(result.provenance))
    recording.save(path)
    recording.send_blueprint(_blueprint(result.experiments, runs), make_active=True, make_default=True)
    recording.log("result", rr.TextDocument(describe_steering(result)), static=True, strict=True)
    for name in runs:
        _log_styles(recording, name)
    recording.flush()  # layout and colours stand before the data, so that a viewer has them from the start
    for name, signals in runs.items():
        _send_run(recording, name, signals)
    recording.flush()
    recording.disconnect()


def recording_id(provenance: Provenance) -> str:
    """Name a recording after what it was made from, so that the same run gives the same name."""
    made_from = [provenance.version, provenance.command, *(file.sha256 for file in provenance.files)]
    return hashlib.sha256("\n".join(made_from).encode(errors="replace")).hexdigest()[:32]


def origin(run: str) -> str:
    """Give the entity under which the signals of a run are, its name as one escaped part."""
    return f"/{rr.escape_entity_path_part(plain(run) or 'run')}"


def _log_styles(recording: rr.RecordingStream, run: str) -> None:
    for role in (*ANGLES, "residual"):
        style = rr.SeriesLines(
            colors=[_rgb(DARK[role])],
            names=f"{role} [rad]",
            widths=2.5 if role == "measured" else 1.5,
            interpolation_mode=rr.components.InterpolationMode.StepAfter if role == "request" else None,
        )
        recording.log(f"{origin(run)}/{role}", style, static=True, strict=True)


def _send_run(recording: rr.RecordingStream, run: str, signals: Signals) -> None:
    stretches = contiguous(signals.request_time, signals.request_part.astype(np.int64))
    _send(recording, f"{origin(run)}/request", broken(signals.request_time, signals.request, stretches))
    stretches = contiguous(signals.time, signals.part.astype(np.int64))
    for role, values in (
        ("measured", signals.measured),
        ("modelled", signals.modelled),
        ("residual", signals.measured - signals.modelled),
    ):
        _send(recording, f"{origin(run)}/{role}", broken(signals.time, values, stretches))


def _send(recording: rr.RecordingStream, entity: str, line: Line) -> None:
    if line.time.size:
        rr.send_columns(
            entity,
            indexes=[rr.TimeColumn(TIMELINE, duration=line.time)],
            columns=rr.Scalars.columns(scalars=line.value),
            recording=recording,
            strict=True,
        )


def _rgb(colour: str) -> list[int]:
    return [int(colour[index : index + 2], 16) for index in (1, 3, 5)]


def _blueprint(experiments: Sequence[Experiment], runs: dict[str, Signals]) -> rrb.Blueprint:
    found = ordered([experiment for experiment in experiments if experiment.run in runs])
    tabs: list[rrb.Container | rrb.View] = []
    if len(found) <= MOST_TABS:
        tabs += [_experiment_tab(one, runs[one.run], several=len(runs) > 1) for one in found]
        tabs += [_run_tab(name, signals, []) for name, signals in runs.items()]
    else:
        most = min(MOST_TABS, max(1, MOST_IN_ALL // len(runs)))
        tabs += [
            _run_tab(name, runs[name], [experiment for experiment in found if experiment.run == name][:most])
            for name in by_interest(found, list(runs))
        ]
    tabs.append(rrb.TextDocumentView(origin="/result", name="result"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


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
    return _views(experiment.run, signals, span, name=experiment_title(experiment, several=several))


def _run_tab(name: str, signals: Signals, experiments: Sequence[Experiment]) -> rrb.Container:
    times: Array = np.concatenate([signals.time, signals.request_time])
    span = (float(times.min()), float(times.max())) if times.size else (0.0, 1.0)
    title = shorten(plain(name), 40)
    if not experiments:
        return _views(name, signals, span, name=title)
    inside = [_experiment_tab(experiment, signals, several=False) for experiment in experiments]
    whole = _views(name, signals, span, name="whole run")
    return rrb.Tabs(whole, *inside, active_tab=0, name=title)


def _views(run: str, signals: Signals, span: tuple[float, float], *, name: str) -> rrb.Vertical:
    """Show the angles above and the residual below over a span of the run's time [s]."""
    shown = cut_out(signals, *span, zero=0.0)
    angles = _view(run, span, "angle [rad]", {role: getattr(shown, role) for role in ANGLES})
    residual = _view(run, span, "residual [rad]", {"residual": shown.residual})
    return rrb.Vertical(angles, residual, row_shares=[2.4, 1.0], name=name)


def _view(run: str, span: tuple[float, float], name: str, lines: Mapping[str, Line]) -> rrb.TimeSeriesView:
    time = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=span[0]),
        end=rr.TimeRangeBoundary.absolute(seconds=span[1]),
    )
    return rrb.TimeSeriesView(
        name=name,
        origin=origin(run),
        contents=[f"$origin/{role}" for role in lines],
        axis_x=rrb.TimeAxis(view_range=time),
        axis_y=rrb.ScalarAxis(range=value_range([line.value for line in lines.values()])),
        background=rrb.archetypes.PlotBackground(color=_rgb(DARK["surface"])),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
    )


def value_range(values: Sequence[Array]) -> tuple[float, float]:
    """Give a range that shows all finite values with some room; -1 … 1 where there are none."""
    finite = np.concatenate([array[np.isfinite(array)] for array in values])
    if finite.size == 0:
        return (-1.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    room = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return (low - room, high + room)
