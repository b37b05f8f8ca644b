"""OUT/run.rrd: what every stage has to show over time, for the Rerun viewer.

Each stage gives a part: its entities below /<stage>, a tab for each of its views, its answer in words. One
part alone has its views as tabs; several have a tab each, that of the stage that was run in front. All is
on one timeline in seconds since the start of each run. The views have a dark ground of their own, so that
the colours (those of the report's dark form) can be read in either theme of the viewer. This is the only
module that imports rerun.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ident.glossary import SIGNALS
from ident.report.condense import Array, Line, broken, contiguous
from ident.report.numbers import plain, shorten, significant
from ident.report.outline import Outline, outline_of
from ident.report.palette import DARK
from ident.report.poses import Poses
from ident.report.responses import Signals, cut_out, signals_of
from ident.report.summary import describe_steering, describe_tyres
from ident.report.tyre_signals import by_agreement, compared, measured_signals, poses, runs_of
from ident.report.tyre_signals import modelled as driven
from ident.results import Experiment, ExperimentKind, Provenance, SteeringResult, TyresResult

TIMELINE = "time"
MOST_TABS = 20
"""With more experiments than this each run has one tab, and its first so many experiments are tabs in it."""
MOST_IN_ALL = 200
"""So many experiments have tabs in all runs together; each run has at least one: the viewer slows down."""
RANK: dict[ExperimentKind, int] = {"step": 0, "pulse": 0, "sine": 1, "other": 2}
ANGLES = ("request", "measured", "modelled")
MARGIN = 0.5
"""Shown before and after an experiment [s]."""
MOST_SIGNALS = 3
SIDES = ("front_right", "front_left")
ABOVE = 0.05
"""How far above the ground what is simulated is drawn, so that it is seen [m]."""
HEIGHT_NEAR = 25.0
"""Of the eye above a truck that it follows [m]."""
POSE_PERIOD = 0.05
"""One pose of the truck is shown in each so many seconds [s]."""


@dataclass(frozen=True)
class Part:
    """What one stage puts into the recording.

    text : its answer, as on the terminal
    styles : logs names, colours and what does not move; data : sends what does
    """

    stage: str
    title: str
    provenance: Provenance
    text: str
    tabs: Sequence[rrb.Container | rrb.View]
    styles: Callable[[rr.RecordingStream], None]
    data: Callable[[rr.RecordingStream], None]


def write_recording(path: Path, parts: Sequence[Part], shown: str) -> None:
    """Write the parts of all stages with their blueprint, which opens at the stage ``shown``."""
    first = next(part for part in parts if part.stage == shown)
    recording = rr.RecordingStream("ident", recording_id=recording_id(first.provenance))
    recording.save(path)
    recording.send_blueprint(_blueprint(parts, parts.index(first)), make_active=True, make_default=True)
    for part in parts:
        recording.log(f"/{part.stage}/result", rr.TextDocument(part.text), static=True, strict=True)
        part.styles(recording)
    recording.flush()  # layout and colours stand before the data, so that a viewer has them from the start
    for part in parts:
        part.data(recording)
    recording.flush()
    recording.disconnect()


def _blueprint(parts: Sequence[Part], active: int) -> rrb.Blueprint:
    inside = [
        [*part.tabs, rrb.TextDocumentView(origin=f"/{part.stage}/result", name="result")] for part in parts
    ]
    if len(parts) == 1:
        tabs = rrb.Tabs(*inside[0], active_tab=0)
    else:
        named = zip(parts, inside, strict=True)
        outer = [rrb.Tabs(*views, active_tab=0, name=part.title) for part, views in named]
        tabs = rrb.Tabs(*outer, active_tab=active)
    return rrb.Blueprint(
        tabs,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def recording_id(provenance: Provenance) -> str:
    """Name a recording after what it was made from, so that the same run gives the same name."""
    made_from = [provenance.version, provenance.command, *(file.sha256 for file in provenance.files)]
    return hashlib.sha256("\n".join(made_from).encode(errors="replace")).hexdigest()[:32]


def origin(stage: str, run: str) -> str:
    """Give the entity under which a stage's signals of a run are, its name as one escaped part."""
    return f"/{stage}/{rr.escape_entity_path_part(plain(run) or 'run')}"


def _log_style(recording: rr.RecordingStream, entity: str, role: str, name: str, width: float) -> None:
    held = rr.components.InterpolationMode.StepAfter if name.startswith("request ") else None
    style = rr.SeriesLines(colors=[_rgb(DARK[role])], names=name, widths=width, interpolation_mode=held)
    recording.log(entity, style, static=True, strict=True)


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


def _series(root: str, span: tuple[float, float], name: str, lines: Mapping[str, Line]) -> rrb.TimeSeriesView:
    """Show lines, each at its entity below ``root``, over a span of the run's time [s]."""
    time = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=span[0]),
        end=rr.TimeRangeBoundary.absolute(seconds=span[1]),
    )
    return rrb.TimeSeriesView(
        name=name,
        origin=root,
        contents=[f"$origin/{entity}" for entity in lines],
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


# --- steering --------------------------------------------------------------------------------------


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
                _log_style(recording, f"{origin('steering', run)}/{role}", role, f"{role} [rad]", width)

    def data(recording: rr.RecordingStream) -> None:
        for run, signals in runs.items():
            for role, line in _steering_lines(signals).items():
                _send(recording, f"{origin('steering', run)}/{role}", line)

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
    angles = _series(root, span, "angle [rad]", {role: getattr(shown, role) for role in ANGLES})
    residual = _series(root, span, "residual [rad]", {"residual": shown.residual})
    return rrb.Vertical(angles, residual, row_shares=[2.4, 1.0], name=name)


# --- tyres -----------------------------------------------------------------------------------------


def tyres_part(result: TyresResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show the truck on its path, measured and simulated, beside the signals: a tab for each run.

    The runs that the model follows worst come first.

    Parameters
    ----------
    tables : "tyres", as ``ident.report.pages.tyres`` describes it
    """
    found = runs_of(tables["tyres"])
    ranked = by_agreement(result, list(found))[::-1]
    runs = {name: found[name] for name in [*ranked, *(name for name in found if name not in ranked)]}

    def styles(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            _log_still(recording, origin("tyres", run), rows, outline_of(result, run))

    def data(recording: rr.RecordingStream) -> None:
        for run, rows in runs.items():
            _send_motion(recording, origin("tyres", run), rows)
            _send_poses(recording, origin("tyres", run), rows, outline_of(result, run))

    tabs = [_motion_tab(run, rows) for run, rows in list(runs.items())[:MOST_TABS]]
    return Part("tyres", "Tyres", result.provenance, describe_tyres(result), tabs, styles, data)


def _log_still(recording: rr.RecordingStream, root: str, rows: pd.DataFrame, outline: Outline) -> None:
    """Log what stands still: paths, the outline of the truck in its own frame, colours of lines."""
    for signal in measured_signals(rows):
        unit = _unit(signal)
        for role in ("measured", "modelled", "residual"):
            width = 2.5 if role == "measured" else 1.5
            _log_style(recording, f"{root}/{signal}/{role}", role, f"{role} [{unit}]", width)
    for name in ("road_wheel_angle", "speed"):
        _log_style(recording, f"{root}/{name}", "request", f"{name.replace('_', ' ')} [{_unit(name)}]", 1.5)
    for way, pose in poses(rows).items():
        recording.log(f"{root}/path/{way}", _strips(_path(pose), way), static=True, strict=True)
        truck = f"{root}/truck/{way}"
        recording.log(f"{truck}/body", _strips(outline.body, way), static=True, strict=True)
        for side in SIDES:
            recording.log(f"{truck}/{side}", _strips([outline.wheel], way), static=True, strict=True)


def _strips(strips: Sequence[Array], way: str) -> rr.LineStrips3D:
    """Draw lines on the ground, those of the model thinner and above the measured ones."""
    height, width = (0.0, 2.2) if way == "measured" else (ABOVE, 1.1)
    flat = [np.column_stack([strip, np.full(len(strip), height)]) for strip in strips]
    return rr.LineStrips3D(flat, colors=[_rgb(DARK[way])], radii=rr.Radius.ui_points(width))


def _path(pose: Poses) -> list[Array]:
    return [
        np.column_stack([pose.x[part], pose.y[part]])
        for part in contiguous(pose.time, pose.window if pose.window.size else None)
    ]


def _send_motion(recording: rr.RecordingStream, root: str, rows: pd.DataFrame) -> None:
    for signal in measured_signals(rows):
        for role, line in compared(rows, signal)._asdict().items():
            _send(recording, f"{root}/{signal}/{role}", line)
    for name in ("road_wheel_angle", "speed"):
        _send(recording, f"{root}/{name}", driven(rows, name))


def _send_poses(recording: rr.RecordingStream, root: str, rows: pd.DataFrame, outline: Outline) -> None:
    """Send the truck as it moves, measured and simulated, with its front wheels turned."""
    steering = driven(rows, "road_wheel_angle")
    known = np.isfinite(steering.value)
    for way, pose in poses(rows).items():
        kept = _thinned(pose.time)
        time, truck = pose.time[kept], f"{root}/truck/{way}"
        time[0] = rows["time"].min()  # it stands at its first known place until it moves
        _send_turned(recording, truck, time, pose.heading[kept], np.column_stack([pose.x, pose.y])[kept])
        angle = np.interp(time, steering.time[known], steering.value[known]) if known.any() else 0.0 * time
        for side, centre in zip(SIDES, outline.front_wheels, strict=True):
            _send_turned(recording, f"{truck}/{side}", time, angle, np.tile(centre, (time.size, 1)))


def _thinned(time: Array) -> NDArray[np.int_]:
    """Choose the first sample in each ``POSE_PERIOD``."""
    _, first = np.unique(np.floor((time - time[0]) / POSE_PERIOD + 1e-6), return_index=True)
    return first


def _send_turned(recording: rr.RecordingStream, entity: str, time: Array, angle: Array, place: Array) -> None:
    """Send transforms: turned by (n,) angles [rad] about z, moved to (n, 2) places [m]."""
    zero = np.zeros(angle.size)
    turned = np.column_stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)])
    rr.send_columns(
        entity,
        indexes=[rr.TimeColumn(TIMELINE, duration=time)],
        columns=rr.Transform3D.columns(translation=np.column_stack([place, zero]), quaternion=turned),
        recording=recording,
        strict=True,
    )


def _motion_tab(run: str, rows: pd.DataFrame) -> rrb.Container:
    """Show the path from above with the truck near by below it, left of the signals."""
    root, time = origin("tyres", run), driven(rows, "speed").time
    span = (float(time.min()), float(time.max())) if time.size else (0.0, 1.0)
    signals = _signal_views(root, rows, span)
    found = poses(rows)
    title = shorten(plain(run), 40)
    if not found:
        return rrb.Vertical(signals, name=title)
    maps = rrb.Vertical(_map(root, found, near=False), _map(root, found, near=True), name="path")
    return rrb.Horizontal(maps, signals, column_shares=[1.0, 1.3], name=title)


def _unit(signal: str) -> str:
    return SIGNALS[signal].unit.replace("^2", "²")


def _signal_views(root: str, rows: pd.DataFrame, span: tuple[float, float]) -> rrb.Vertical:
    """Show the steering, then the first signals that were measured, each with its residual below."""
    steering = {"road_wheel_angle": driven(rows, "road_wheel_angle")}
    views, shares = [_series(root, span, "road-wheel angle [rad]", steering)], [1.2]
    for signal in measured_signals(rows)[:MOST_SIGNALS]:
        lines, unit = compared(rows, signal)._asdict(), _unit(signal)
        entities = {f"{signal}/{role}": line for role, line in lines.items()}
        residual = {f"{signal}/residual": entities.pop(f"{signal}/residual")}
        views.append(_series(root, span, f"{signal.replace('_', ' ')} [{unit}]", entities))
        views.append(_series(root, span, f"residual [{unit}]", residual))
        shares += [2.0, 1.0]
    return rrb.Vertical(*views, row_shares=shares, name="signals")


def _map(root: str, found: Mapping[str, Poses], *, near: bool) -> rrb.Spatial3DView:
    """Look from above: on the whole path, or near by at the truck, which the eye then follows."""
    x, y = (np.concatenate([getattr(pose, axis) for pose in found.values()]) for axis in ("x", "y"))
    middle = [(float(x.min()) + float(x.max())) / 2, (float(y.min()) + float(y.max())) / 2]
    height = HEIGHT_NEAR if near else max(HEIGHT_NEAR, 1.1 * float(max(np.ptp(x), np.ptp(y))))
    target = [float(x[0]), float(y[0])] if near else middle
    way = next(iter(found))
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=[*target, height],
        look_target=[*target, 0.0],
        eye_up=[0.0, 1.0, 0.0],
        tracking_entity=f"{root}/truck/{way}/body" if near else None,
    )
    return rrb.Spatial3DView(
        origin=root,
        contents=["$origin/path/**", "$origin/truck/**"],
        name="truck" if near else "path",
        background=_rgb(DARK["surface"]),
        line_grid=rrb.LineGrid3D(visible=True, spacing=10.0 if not near else 1.0, color=_rgb(DARK["grid"])),
        eye_controls=eye,
    )
