"""`ident info` in plain text, for the terminal.

Names come from logs: control characters in them are shown, not sent to the terminal.
"""

from __future__ import annotations

from collections.abc import Iterator

from ident.results import Damage, InfoResult, Latency, RunHealth, TopicHealth

WIDTH = 100
MOST_DAMAGE = 8
SMALLEST_LATENCY = 0.005


def describe(result: InfoResult) -> str:
    """Summarise what the logs hold: runs, signals, what is missing, gaps and damage."""
    runs = len(result.runs)
    lines = [f"{runs} run{'s' if runs != 1 else ''}, {_seconds(sum(run.duration for run in result.runs))}"]
    for run in result.runs:
        lines += ["", *_describe_run(run)]
    if result.unreadable:
        lines += ["", "could not be read:"]
        lines += [f"  {refusal.what}: {refusal.reason}" for refusal in result.unreadable]
    return "\n".join(_printable(line) for line in lines)


def _describe_run(run: RunHealth) -> Iterator[str]:
    when = f"{_seconds(run.duration)} from {run.start}" if run.start else "no messages"
    yield f"{run.name}: {when}, {run.format}"
    yield f"  files     channels: {run.channels}; vehicle: {run.vehicle}"
    yield from _listed("signals", [_signal(name, run) for name in run.signals])
    yield from _listed("missing", run.missing)
    if not run.signals and run.start:
        yield "  signals   none: `ident init LOGS` guesses a channel map"
        yield from _listed("topics", [f"{t.name} ({t.type}, {t.messages} messages)" for t in run.topics])
    yield from _listed("gaps", [text for topic in run.topics if (text := _gaps(topic))])
    yield from _listed("order", [text for topic in run.topics if (text := _order(topic))])
    yield from _listed("late", [_latency(late) for late in run.latencies if _matters(late)])
    for note in run.clocks:
        yield f"  clocks    {note}"
    for damage in run.damage[:MOST_DAMAGE]:
        yield f"  damage    {_damage(damage)}"
    if len(run.damage) > MOST_DAMAGE:
        yield f"  damage    and {len(run.damage) - MOST_DAMAGE} more, all of them in info.json"


def _signal(name: str, run: RunHealth) -> str:
    source = run.signals[name].source
    rate = next((topic.rate for topic in run.topics if source.startswith(f"{topic.name}.")), None)
    return f"{name} {rate:.3g}/s" if rate else name


def _gaps(topic: TopicHealth) -> str:
    if not topic.gaps:
        return ""
    longest = max(gap.seconds for gap in topic.gaps)
    lost = f", {topic.lost} messages" if topic.lost else ""
    return f"{topic.name} {len(topic.gaps)} (longest {longest:.3g} s{lost})"


def _order(topic: TopicHealth) -> str:
    found = [
        f"{count} {what}"
        for count, what in ((topic.out_of_order, "out of order"), (topic.repeated_stamps, "repeated stamps"))
        if count
    ]
    return f"{topic.name} {' and '.join(found)}" if found else ""


def _matters(late: Latency) -> bool:
    """Whether a latency is surely not zero, and long enough to care."""
    delay = late.delay
    if delay.value is None or delay.low is None or delay.high is None:
        return False
    return abs(delay.value) > SMALLEST_LATENCY and not delay.low <= 0 <= delay.high


def _latency(late: Latency) -> str:
    value, low, high = (1e3 * (part or 0.0) for part in (late.delay.value, late.delay.low, late.delay.high))
    weak = f"; {late.delay.reason}" if late.delay.reason else ""
    return f"{late.signal} {value:.0f} ms against {late.reference} ({low:.0f} to {high:.0f} ms{weak})"


def _damage(damage: Damage) -> str:
    lost = [
        text
        for value, text in (
            (damage.messages_lost, f"{damage.messages_lost} messages"),
            (damage.seconds_lost, f"{damage.seconds_lost or 0:.3g} s"),
            (damage.bytes_lost, f"{damage.bytes_lost} bytes"),
        )
        if value
    ]
    return f"{damage.what}: {', '.join(lost)} lost" if lost else damage.what


def _listed(title: str, items: list[str]) -> Iterator[str]:
    """Put items on lines of at most ``WIDTH`` characters, the title before the first."""
    line = f"  {title:<10}"
    begun = False
    for item in items:
        if begun and len(line) + 2 + len(item) > WIDTH:
            yield line + ","
            line, begun = " " * 12, False
        line += f", {item}" if begun else item
        begun = True
    if begun:
        yield line


def _seconds(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 600 else f"{seconds / 60:.1f} min"


def _printable(line: str) -> str:
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in line)
