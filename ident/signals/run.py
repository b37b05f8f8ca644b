"""LOGS -> RUNS: each run with its signals in SI units on one clock, and the health of its log.

A run's time is zero at the earliest stamp of any of its signals. Samples are sorted by stamp; of samples
with the same stamp the last is kept; values that are not finite are left out. All of that is counted.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ident.errors import UnusableLog
from ident.glossary import SIGNALS
from ident.logs import Columns, FieldError, Log, RunPath, find_runs, open_log
from ident.results import Damage, LogFile, Refusal, RunHealth, SignalHealth, TopicHealth
from ident.signals.applied import AppliedFiles
from ident.signals.channel_map import Channel, ChannelMap, scale
from ident.signals.clocks import clock_notes
from ident.signals.derivative import slope
from ident.signals.health import signal_health, topic_health
from ident.signals.latency import latencies
from ident.signals.signal import LoadedLogs, Run, Signal
from ident.signals.stamps import Clock, TopicTimes, choose_clock, topic_times
from ident.vehicle import Vehicle

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
AT_REFERENCE_POINT = {"position_x", "position_y", "longitudinal_velocity", "lateral_velocity"}

__all__ = ["LoadedLogs", "Run", "Signal", "load_runs", "read_run"]


def load_runs(
    logs: Sequence[Path],
    *,
    channels: Sequence[Path] | None = None,
    vehicle: Path | None = None,
    every_topic: bool = False,
    choose: Callable[[list[RunPath]], list[RunPath]] = list,
    progress: Progress = lambda _what, _done, _total: None,
) -> LoadedLogs:
    """Read all runs under the given paths.

    Parameters
    ----------
    channels : channel maps of which the best fitting is used for each run; None: look for them
    vehicle : vehicle file; None: look for one
    every_topic : say of the topics that no signal needs, too, whether they could be decoded
    choose : the runs to be read, of those that lie there
    progress : is told what is being read, how many runs are done and how many there are

    Raises
    ------
    UnusableLog
        If there is no log, or none of them can be read.
    BadRecipe
        If a channel map or vehicle file is wrong; this is found before any log is read.
    """
    paths = choose(find_runs(logs))
    applied = AppliedFiles(channels, vehicle)
    applied.check(paths)
    runs: list[Run] = []
    files: list[LogFile] = []
    unreadable: list[Refusal] = []
    for done, path in enumerate(paths):
        progress(f"reading {path.name}", done, len(paths))
        try:
            log = open_log(path.path, path.files)
        except UnusableLog as error:
            unreadable.append(Refusal(path.name, str(error)))
            continue
        runs.append(_load(path, log, applied, every_topic=every_topic))
        files += [_log_file(file, path) for file in log.files]
        log.close()
    progress("reading", len(paths), len(paths))
    if not runs:
        raise UnusableLog(_none_readable(unreadable))
    warnings = [f"{refusal.what} was left out: {refusal.reason}" for refusal in unreadable]
    return LoadedLogs(runs, unreadable, files, warnings)


def _none_readable(unreadable: Sequence[Refusal]) -> str:
    first = unreadable[0].reason
    return (
        first if len(unreadable) == 1 else f"none of {len(unreadable)} logs can be read, the first: {first}"
    )


def _log_file(file: Path, run: RunPath) -> LogFile:
    with file.open("rb") as opened:
        digest = hashlib.file_digest(opened, "sha256").hexdigest()
    inside = run.root.is_dir() and run.root != run.path
    name = str(file.relative_to(run.root)) if inside else str(file.relative_to(run.path.parent))
    return LogFile(name, digest, file.stat().st_size)


# --- one run --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Source:
    """The columns of one topic, with the times for either choice of stamp."""

    columns: Columns
    times: Mapping[str, TopicTimes]


def _load(path: RunPath, log: Log, applied: AppliedFiles, *, every_topic: bool) -> Run:
    if every_topic:
        log.check()
    present = [topic.name for topic in log.topics if topic.messages]
    channel_map, channels_name = applied.map_for(path, present)
    vehicle, vehicle_name = applied.vehicle_for(path)
    run = read_run(path.name, log, channel_map, vehicle)
    sources = {name: health.source for name, health in run.health.signals.items()}
    late = latencies(run.signals, vehicle, sources)
    damage = [*run.health.damage, *(_undecodable(log, run.health.damage) if every_topic else ())]
    health = replace(run.health, channels=channels_name, vehicle=vehicle_name, latencies=late, damage=damage)
    return replace(run, health=health)


def _undecodable(log: Log, known: Sequence[Damage]) -> Iterator[Damage]:
    """Topics whose messages cannot be decoded, with the reason, unless it is known."""
    for topic in log.topics:
        try:
            log.fields(topic.name)
        except FieldError as error:
            text = f"{topic.name}: {error}"
            if topic.messages and all(item.what != text for item in known):
                yield Damage(text)


def read_run(name: str, log: Log, channel_map: ChannelMap, vehicle: Vehicle | None) -> Run:
    """Read the signals of one log that a channel map names, and their health but for latencies."""
    present = {topic.name for topic in log.topics if topic.messages}
    damage: list[Damage] = []
    chosen = channel_map.choose(_finder(log, present, damage))
    sources, clock = _read_sources(log, chosen, damage)
    damage[:0] = log.damage  # all that is known once the topics were read
    zero, end = _extent(log, chosen, sources, clock)
    signals, healths = _make_signals(chosen, sources, zero, vehicle, damage)
    health = RunHealth(
        name=name,
        format=log.format,
        start=_iso(zero) if zero else "",
        duration=(end - zero) / 1e9,
        channels=channel_map.source,
        vehicle="none",
        topics=_topic_healths(log, sources, clock, zero),
        signals=healths,
        missing=[name for name in channel_map.signals if name not in signals],
        clocks=[*clock.notes, *clock_notes({name: s.times["header"] for name, s in sources.items()}, zero)],
        damage=damage,
    )
    return Run(name, zero, health.duration, signals, vehicle, health)


def _finder(log: Log, present: set[str], damage: list[Damage]) -> Callable[[Channel], bool]:
    """Return whether a log has a channel; a field that cannot be read is said in ``damage``."""

    def has(channel: Channel) -> bool:
        if channel.topic not in present or channel.field is None:
            return False
        try:
            parts = log.expand(channel.topic, channel.field)
        except FieldError as error:
            problem = f"{channel.topic}: {error}"
        else:
            if (len(parts) == 4) == (channel.as_ is not None):
                return True
            problem = f"{channel.topic}: {channel.field} is " + (
                "no orientation: leave out 'as'" if channel.as_ else "an orientation: add 'as: yaw'"
            )
        if all(item.what != problem for item in damage):
            damage.append(Damage(problem))
        return False

    return has


def _read_sources(
    log: Log, chosen: Mapping[str, Channel], damage: list[Damage]
) -> tuple[dict[str, _Source], Clock]:
    """Decode each topic once for all its signals."""
    wanted: dict[str, list[str]] = {}
    for channel in chosen.values():
        if channel.topic is not None and channel.field is not None:
            fields = wanted.setdefault(channel.topic, [])
            fields += [field for field in _fields(log, channel) if field not in fields]
    columns = log.read(wanted)
    clock = choose_clock(columns)
    sources: dict[str, _Source] = {}
    for topic, read in columns.items():
        damage += read.damage
        times, wrong = topic_times(topic, read, clock, "header")
        damage += wrong
        log_times, _ = topic_times(topic, read, clock, "log")
        sources[topic] = _Source(read, {"header": times, "log": log_times})
    return sources, clock


def _fields(log: Log, channel: Channel) -> list[str]:
    """The field of a channel, and for an orientation the covariance that says whether it is one."""
    topic, name = str(channel.topic), str(channel.field)
    unknown = f"{name}_covariance[0]"
    if channel.as_ is not None and unknown in log.fields(topic):
        return [name, unknown]
    return [name]


def _extent(
    log: Log, chosen: Mapping[str, Channel], sources: Mapping[str, _Source], clock: Clock
) -> tuple[int, int]:
    """First and last time of the signals, or of all topics where no signal is mapped [ns]."""
    used = [sources[c.topic].times[c.stamp] for c in chosen.values() if c.topic is not None]
    times = [each.stamps[each.keep] for each in used]
    if not any(len(each) for each in times):
        times = [log.times(topic.name) - clock.offset for topic in log.topics]
    times = [each for each in times if len(each)]
    if not times:
        return 0, 0
    return int(min(each.min() for each in times)), int(max(each.max() for each in times))


def _iso(nanoseconds: int) -> str:
    try:
        return datetime.fromtimestamp(nanoseconds // 10**6 / 1000, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return f"{nanoseconds} ns"


def _topic_healths(log: Log, sources: Mapping[str, _Source], clock: Clock, zero: int) -> list[TopicHealth]:
    healths = []
    for topic in log.topics:
        if topic.name in sources:
            times = sources[topic.name].times["header"]
        else:
            stamps = log.times(topic.name) - clock.offset
            times = TopicTimes(stamps, np.ones(len(stamps), dtype=np.bool_), stamps, "log")
        health = topic_health(topic.name, topic.type, times, zero)
        healths.append(replace(health, messages=topic.messages))
    return healths


# --- signals --------------------------------------------------------------------------------------


def _make_signals(
    chosen: Mapping[str, Channel],
    sources: Mapping[str, _Source],
    zero: int,
    vehicle: Vehicle | None,
    damage: list[Damage],
) -> tuple[dict[str, Signal], dict[str, SignalHealth]]:
    signals: dict[str, Signal] = {}
    healths: dict[str, SignalHealth] = {}
    for name, channel in chosen.items():
        if channel.topic is None:
            continue
        signal, not_finite = _make_signal(name, channel, sources[channel.topic], zero, vehicle)
        if not len(signal.values):
            damage.append(Damage(f"{name}: {channel.topic}.{channel.field} holds no finite value"))
            continue
        signals[name] = signal
        source = f"{channel.topic}.{channel.field}"
        healths[name] = signal_health(name, signal.unit, source, signal.values, not_finite)
    for name, channel in chosen.items():
        base = channel.derivative_of
        if base in signals and base is not None:
            signals[name] = signal = _derive(name, signals[base])
            source = f"derivative of {base}"
            healths[name] = signal_health(name, signal.unit, source, signal.values, 0)
    return signals, healths


def _make_signal(
    name: str, channel: Channel, source: _Source, zero: int, vehicle: Vehicle | None
) -> tuple[Signal, int]:
    times = source.times[channel.stamp]
    values, raw = _values(name, channel, source.columns)
    finite = np.isfinite(values)
    use = times.keep & finite
    stamps, values, arrival = times.stamps[use], values[use], times.arrival[use]
    order = np.argsort(stamps, kind="stable")
    last = np.append(np.diff(stamps[order]) > 0, True)[: len(order)]
    order = order[last]
    values = values[order]
    if SIGNALS[name].between == "angle":
        values = np.unwrap(values)
    default = vehicle.reference_point if vehicle and name in AT_REFERENCE_POINT else None
    signal = Signal(
        name=name,
        time=(stamps[order] - zero) / 1e9,
        values=values,
        unit="1" if raw else SIGNALS[name].unit,
        arrival=(arrival[order] - zero) / 1e9 if times.kind == "header" else None,
        raw=raw,
        at=channel.at or default,
    )
    return signal, int(np.count_nonzero(times.keep & ~finite))


def _values(name: str, channel: Channel, columns: Columns) -> tuple[Array, bool]:
    field = str(channel.field)
    if channel.as_ is not None:
        return scale(name, channel)[0] * _angle(channel.as_, field, columns), False
    values = columns.values[field]
    if channel.equals is not None:
        return np.where(np.isnan(values), np.nan, values == channel.equals), False
    factor, raw = scale(name, channel)
    return values * factor, raw


def _angle(which: str, field: str, columns: Columns) -> Array:
    """Yaw or roll of a quaternion [rad] (z-y-x order); NaN where it is no orientation."""
    x, y, z, w = (columns.values[f"{field}.{part}"] for part in "xyzw")
    norm = x * x + y * y + z * z + w * w
    if which == "yaw":
        angle = np.arctan2(2 * (w * z + x * y), norm - 2 * (y * y + z * z))
    else:
        angle = np.arctan2(2 * (w * x + y * z), norm - 2 * (x * x + y * y))
    unknown = columns.values.get(f"{field}_covariance[0]", np.zeros(len(x))) == -1
    return np.where(unknown | (np.abs(norm - 1) > 0.1), np.nan, angle)


def _derive(name: str, base: Signal) -> Signal:
    time, values = slope(base.time, base.values)
    return Signal(name, time, values, SIGNALS[name].unit, None, base.raw, base.at)
