"""What the logs hold and what is wrong with them: blocks that the page of every stage can show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.report import figures
from ident.report.condense import Line
from ident.report.numbers import NONE, count, duration, percent, shorten, significant, with_unit
from ident.report.page import Block, Cell, Code, Column, Details, Facts, Figure, Lines, Table, Text, Tone
from ident.results import Damage, Provenance, RunHealth, TopicHealth

MOST_TOPICS_DRAWN = 40
NARROWEST = 1 / 600
"""A gap is drawn at least so wide, in parts of the run, and nearer ones are drawn as one."""


def brief(runs: Sequence[RunHealth]) -> Cell:
    """Say in one line what is wrong with the topics that are used."""
    gaps = sum(len(topic.gaps) for run in runs for topic in used_topics(run))
    lost = sum(topic.lost or 0 for run in runs for topic in used_topics(run))
    damaged = sum(bool(run.damage) for run in runs)
    parts = [f"{count(gaps, 'gap')} ({count(lost, 'message')} lost)" if gaps else "no gaps"]
    parts.append(f"{count(damaged, 'run')} damaged" if damaged else "no damage")
    tone: Tone = "bad" if damaged else "caution" if gaps else "good"
    return Cell(", ".join(parts), tone=tone)


def used_topics(run: RunHealth) -> list[TopicHealth]:
    """Give the topics that a mapped signal comes from."""
    sources = [signal.source for signal in run.signals.values()]
    return [topic for topic in run.topics if any(_comes_from(source, topic.name) for source in sources)]


def _comes_from(source: str, topic: str) -> bool:
    return source == topic or source.startswith((f"{topic}.", f"{topic}["))


def runs_table(runs: Sequence[RunHealth]) -> Table:
    """Give one row a run."""
    columns = [
        Column("run", wrap=True),
        Column("format"),
        Column("start"),
        Column("duration", "number"),
        Column("signals", "number"),
        Column("gaps", "number"),
        Column("longest gap", "number"),
        Column("lost", "number"),
        Column("damage", wrap=True),
        Column("channel map", wrap=True),
        Column("vehicle file", wrap=True),
    ]
    return Table(columns, [_run_row(run) for run in runs], download="runs.csv", scroll=len(runs) > 15)


def _run_row(run: RunHealth) -> list[Cell]:
    gaps = [gap.seconds for topic in used_topics(run) for gap in topic.gaps]
    lost = sum(topic.lost or 0 for topic in used_topics(run))
    return [
        Cell(run.name),
        Cell(run.format),
        Cell(moment(run.start)),
        Cell(duration(run.duration), raw=run.duration),
        Cell(str(len(run.signals))),
        Cell(str(len(gaps)), tone="caution" if gaps else "plain"),
        Cell(with_unit(max(gaps), "s"), raw=max(gaps)) if gaps else Cell(NONE),
        Cell(str(lost), tone="caution" if lost else "plain"),
        Cell("; ".join(map(damage_text, run.damage)), tone="bad") if run.damage else Cell("none"),
        Cell(run.channels),
        Cell(run.vehicle or NONE),
    ]


def moment(text: str) -> str:
    """Write an ISO 8601 time as people do."""
    return text.replace("T", " ").replace("+00:00", " UTC").replace("Z", " UTC")


def damage_text(damage: Damage) -> str:
    """Say what was lost, with the counts that are known."""
    lost = [
        count(damage.messages_lost, "message") if damage.messages_lost is not None else "",
        with_unit(damage.seconds_lost, "s") if damage.seconds_lost is not None else "",
        count(damage.bytes_lost, "byte") if damage.bytes_lost is not None else "",
    ]
    known = ", ".join(part for part in lost if part)
    return f"{damage.what} (lost: {known})" if known else damage.what


def run_details(run: RunHealth, *, unfolded: bool = False) -> Details:
    """Give everything known of one run, behind one line."""
    blocks: list[Block] = [signals_table(run)]
    if run.missing:
        blocks.append(Lines([("Not in this run:", ", ".join(run.missing).replace("_", " "))]))
    blocks.append(topics_table(run))
    figure = gap_figure(run)
    if figure:
        blocks.append(figure)
    if run.latencies:
        blocks.append(latency_table(run))
    remarks = [("Clock:", text) for text in run.clocks]
    remarks += [("Damage:", damage_text(damage)) for damage in run.damage]
    if remarks:
        blocks.append(Lines(remarks))
    gaps = sum(len(topic.gaps) for topic in used_topics(run))
    line = f"{run.name}: {duration(run.duration)}, {count(len(run.signals), 'signal')}, {count(gaps, 'gap')}"
    if run.damage:
        line += f", damaged: {run.damage[0].what}"
    return Details(line, blocks, open=unfolded)


def topics_table(run: RunHealth) -> Table:
    """Give one row a topic: how it was recorded."""
    columns = [
        Column("topic", code=True, wrap=True),
        Column("type", code=True, wrap=True),
        Column("messages", "number"),
        Column("rate [1/s]", "number"),
        Column("jitter", "number"),
        Column("gaps", "number"),
        Column("longest [s]", "number"),
        Column("lost", "number"),
        Column("stamp"),
        Column("out of order", "number"),
        Column("repeated", "number"),
        Column("delay [ms]", "number"),
        Column("delay 95 % [ms]", "number"),
    ]
    rows = [_topic_row(topic) for topic in run.topics]
    notes = [
        "jitter: spread of the period in parts of the period",
        "delay: log time minus header stamp, median and 95 % point",
    ]
    return Table(columns, rows, caption="Topics", notes=notes, download="topics.csv", scroll=len(rows) > 15)


def _topic_row(topic: TopicHealth) -> list[Cell]:
    longest = max((gap.seconds for gap in topic.gaps), default=None)
    return [
        Cell(topic.name),
        Cell(topic.type),
        Cell(str(topic.messages)),
        Cell(significant(topic.rate), raw=topic.rate),
        Cell(NONE if topic.jitter is None else f"{topic.jitter * 100:.1f}\u00a0%", raw=topic.jitter),
        Cell(str(len(topic.gaps)), tone="caution" if topic.gaps else "plain"),
        Cell(significant(longest), raw=longest),
        Cell(NONE if topic.lost is None else str(topic.lost), tone="caution" if topic.lost else "plain"),
        Cell(topic.stamp),
        _counted(topic.out_of_order),
        _counted(topic.repeated_stamps),
        _milliseconds(topic.arrival_delay),
        _milliseconds(topic.arrival_delay_p95),
    ]


def _counted(number: int) -> Cell:
    return Cell(str(number), tone="caution" if number else "plain")


def _milliseconds(seconds: float | None) -> Cell:
    return Cell(NONE) if seconds is None else Cell(significant(seconds * 1e3), raw=seconds * 1e3)


def signals_table(run: RunHealth) -> Table:
    """Give one row a signal: where it comes from and what it looks like."""
    columns = [
        Column("signal"),
        Column("from", code=True, wrap=True),
        Column("samples", "number"),
        Column("lowest", "number"),
        Column("highest", "number"),
        Column("unit"),
        Column("resolution", "number"),
        Column("repeated values", "number"),
        Column("not finite", "number"),
    ]
    rows = [
        [
            Cell(name.replace("_", " ")),
            Cell(signal.source),
            Cell(str(signal.samples)),
            Cell(significant(signal.low), raw=signal.low),
            Cell(significant(signal.high), raw=signal.high),
            Cell(NONE if signal.unit == "1" else signal.unit),
            Cell(significant(signal.resolution), raw=signal.resolution),
            Cell(percent(signal.repeated), raw=signal.repeated),
            _counted(signal.not_finite),
        ]
        for name, signal in run.signals.items()
    ]
    return Table(columns, rows, caption="Signals", download="signals.csv")


def latency_table(run: RunHealth) -> Table:
    """Give one row a pair of signals that measure the same thing in two ways."""
    columns = [
        Column("signal"),
        Column("against"),
        Column("late by [ms]", "number"),
        Column("95 % interval [ms]", "number"),
        Column("status"),
    ]
    rows = []
    for latency in run.latencies:
        delay = latency.delay
        interval = NONE
        if delay.low is not None and delay.high is not None:
            interval = f"{significant(delay.low * 1e3)} … {significant(delay.high * 1e3)}"
        rows.append(
            [
                Cell(latency.signal.replace("_", " ")),
                Cell(latency.reference.replace("_", " ")),
                _milliseconds(delay.value),
                Cell(interval),
                Cell(delay.status.replace("_", " "), detail=delay.reason),
            ]
        )
    return Table(
        columns, rows, caption="Latencies", notes=["measured, not corrected"], download="latencies.csv"
    )


def gap_figure(run: RunHealth) -> Figure | None:
    """Draw when which topic was silent, None where no topic was."""
    silent = [topic for topic in run.topics if topic.gaps]
    if not silent or run.duration <= 0:
        return None
    drawn = sorted(silent, key=lambda topic: -sum(gap.seconds for gap in topic.gaps))[:MOST_TOPICS_DRAWN]
    traces = [_gap_trace(topic, index, run.duration) for index, topic in enumerate(drawn)]
    marks = [figures.level(index, "grid", along="y") for index in range(len(drawn))]
    panel = figures.Panel(
        "",
        traces,
        x="time since the start of the run [s]",
        y="",
        x_range=(0.0, run.duration),
        categories=[shorten(topic.name, 30) for topic in drawn],
        marks=marks,
    )
    layout = figures.Layout(columns=1, row_height=76 + 20 * len(drawn), left=200, legend=False)
    spec, height = figures.grid([panel], layout)
    width = with_unit(run.duration * NARROWEST, "s", 2)
    caption = f"A bar is a stretch without messages, drawn at least {width} wide."
    if len(silent) > len(drawn):
        caption += (
            f" The {len(drawn)} topics with the most of it; {len(silent) - len(drawn)} more are in the table."
        )
    return Figure(spec, height, "Where messages are missing", caption)


def _gap_trace(topic: TopicHealth, row: int, length: float) -> figures.Trace:
    pieces = merged([(gap.start, gap.start + gap.seconds) for gap in topic.gaps], length * NARROWEST)
    time = np.array([value for begin, end in pieces for value in (begin, end, np.nan)])
    trace = figures.line(Line(time, np.where(np.isnan(time), np.nan, row)), "bad_line", topic.name, width=9)
    return {**trace, "hovertemplate": "%{x:.3f} s<extra></extra>"}


def merged(stretches: Sequence[tuple[float, float]], width: float) -> list[tuple[float, float]]:
    """Widen stretches to ``width`` about their middles and join those that touch."""
    joined: list[tuple[float, float]] = []
    for begin, end in sorted(stretches):
        extra = max(0.0, width - (end - begin)) / 2
        low, high = begin - extra, end + extra
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(high, joined[-1][1]))
        else:
            joined.append((low, high))
    return joined


def provenance_blocks(provenance: Provenance) -> list[Block]:
    """Say what an output was made from and how to make it again."""
    facts = Facts(
        [
            ("version", f"ident {provenance.version}"),
            ("made", moment(provenance.date)),
            ("seed", str(provenance.seed)),
        ]
    )
    files = Table(
        [
            Column("file", code=True, wrap=True),
            Column("bytes", "number"),
            Column("sha256", code=True, wrap=True),
        ],
        [[Cell(file.path), Cell(str(file.bytes)), Cell(file.sha256)] for file in provenance.files],
        caption="Files read",
        download="files.csv",
        scroll=len(provenance.files) > 10,
    )
    applied = Table(
        [Column("run", wrap=True), Column("channel map, vehicle file and recipe that applied", wrap=True)],
        [[Cell(run), Cell(what)] for run, what in provenance.applied.items()],
        download="applied.csv",
        scroll=len(provenance.applied) > 10,
    )
    read: Block = files if provenance.files else Text("No log was read.", "muted")
    return [Code(provenance.command), facts, *([applied] if provenance.applied else []), read]
