"""A part of the recording, how several are written, and what every part uses: names, lines, plots."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ident.report.condense import Array, Line
from ident.report.numbers import plain
from ident.report.palette import DARK
from ident.results import Provenance

TIMELINE = "time"
MOST_TABS = 20
"""With more tabs than this in one place the viewer slows down."""


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


def log_style(recording: rr.RecordingStream, entity: str, role: str, name: str, width: float) -> None:
    """Log how a line is drawn and what it is called; a request is held between its samples."""
    held = rr.components.InterpolationMode.StepAfter if name.startswith("request ") else None
    style = rr.SeriesLines(colors=[rgb(DARK[role])], names=name, widths=width, interpolation_mode=held)
    recording.log(entity, style, static=True, strict=True)


def send(recording: rr.RecordingStream, entity: str, line: Line) -> None:
    """Send a line's values to its entity."""
    if line.time.size:
        rr.send_columns(
            entity,
            indexes=[rr.TimeColumn(TIMELINE, duration=line.time)],
            columns=rr.Scalars.columns(scalars=line.value),
            recording=recording,
            strict=True,
        )


def rgb(colour: str) -> list[int]:
    """Give a colour such as "#00876a" as three numbers."""
    return [int(colour[index : index + 2], 16) for index in (1, 3, 5)]


def series(root: str, span: tuple[float, float], name: str, lines: Mapping[str, Line]) -> rrb.TimeSeriesView:
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
        background=rrb.archetypes.PlotBackground(color=rgb(DARK["surface"])),
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
