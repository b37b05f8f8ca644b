"""`ident init`: a channel map and a vehicle file, guessed from the logs, with the evidence for each guess.

What stands in the two texts is for an engineer to check: each line carries, as a comment, why the topic was
taken and what the data say about it. What a log cannot tell (the mass) is left to be filled in.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.errors import NotIdentifiable, UnusableLog
from ident.glossary import SIGNALS
from ident.logs import FieldError, Log, find_runs, open_log
from ident.signals.channel_map import Channel, ChannelMap
from ident.signals.evidence import Finding, findings
from ident.signals.guess import Guess, guesses
from ident.signals.run import Run, read_run
from ident.stages.output import Context

MOST_RUNS = 12
MIN_FINITE = 0.5
GRAVITY = 9.80665
AT_REAR_AXLE = 0.4
_SAFE = re.compile(r"[A-Za-z0-9_/][A-Za-z0-9_./\-\[\]]*")


@dataclass(frozen=True)
class InitTexts:
    """The two files; ``found`` are the signals that the channel map names, ``notes`` what was skipped."""

    channels: str
    vehicle: str
    found: list[str]
    notes: list[str]


@dataclass
class _Survey:
    """What the topics of all logs may be, and how much of each guess is finite and moves."""

    found: dict[tuple[str, str, str], Guess]
    finite: dict[tuple[str, str, str], float]
    moves: dict[tuple[str, str, str], bool]
    gravity: dict[str, float]
    topics: dict[str, str]
    notes: list[str]


def init(logs: Sequence[Path], context: Context) -> InitTexts:
    """Guess a channel map and a vehicle file.

    Raises
    ------
    UnusableLog
        If there is no log, or none of them can be read.
    NotIdentifiable
        If no topic looks like any signal.
    """
    paths = find_runs(logs)[:MOST_RUNS]
    opened: dict[str, Log] = {}
    notes: list[str] = []
    for done, path in enumerate(paths):
        context.progress(f"looking into {path.name}", done, len(paths))
        try:
            opened[path.name] = open_log(path.path, path.files)
        except UnusableLog as error:
            notes.append(str(error))
    if not opened:
        raise UnusableLog(notes[0])
    survey = _Survey({}, {}, {}, {}, {}, notes)
    for log in opened.values():
        _look(log, survey)
    chosen, others = _choose(survey)
    if not chosen:
        raise NotIdentifiable(_nothing_found(survey))
    runs = _read(opened, chosen)
    context.progress("looking", len(paths), len(paths))
    evidence = findings(runs)
    chosen = {name: _with_unit(guess, evidence.get(name, [])) for name, guess in chosen.items()}
    channels = "\n".join(_channel_lines(chosen, others, evidence, survey)) + "\n"
    vehicle = "\n".join(_vehicle_lines(evidence)) + "\n"
    return InitTexts(channels, vehicle, list(chosen), survey.notes)


# --- looking --------------------------------------------------------------------------------------


def _look(log: Log, survey: _Survey) -> None:
    for topic in log.topics:
        if not topic.messages:
            continue
        survey.topics.setdefault(topic.name, topic.type)
        try:
            fields = log.fields(topic.name)
            possible = guesses(topic.name, topic.type, fields)
            _look_at_values(log, topic.name, fields, possible, survey)
        except FieldError as error:
            survey.notes.append(f"{topic.name}: {error}")


def _look_at_values(
    log: Log, topic: str, fields: Mapping[str, str], possible: Sequence[Guess], survey: _Survey
) -> None:
    if not possible:
        return
    extra = [name for name in ("linear_acceleration.z", "orientation_covariance[0]") if name in fields]
    columns = log.columns(topic, list(dict.fromkeys([*(guess.field for guess in possible), *extra])))
    if "linear_acceleration.z" in columns.values:
        vertical = columns.values["linear_acceleration.z"]
        if np.isfinite(vertical).any():
            survey.gravity.setdefault(topic, float(np.nanmean(vertical)))
    unknown = columns.values.get("orientation_covariance[0]", np.zeros(len(columns.log_time))) == -1
    for guess in possible:
        key = (guess.signal, guess.topic, guess.field)
        values = columns.values.get(guess.field, columns.values.get(f"{guess.field}.z"))
        if values is None or not len(values):
            continue
        finite = np.isfinite(values) & ~(unknown & (guess.field == "orientation"))
        moves = bool(finite.any() and np.ptp(values[finite]) > 0)
        survey.found[key] = guess
        survey.finite[key] = max(survey.finite.get(key, 0.0), float(finite.mean()))
        survey.moves[key] = survey.moves.get(key, False) or moves


def _choose(survey: _Survey) -> tuple[dict[str, Guess], dict[str, list[Guess]]]:
    """The best guess of each signal, in the order of the glossary, and the others."""
    chosen: dict[str, Guess] = {}
    others: dict[str, list[Guess]] = {}
    for name in SIGNALS:
        good = [
            guess
            for key, guess in survey.found.items()
            if guess.signal == name and survey.finite[key] >= MIN_FINITE and survey.moves[key]
        ]
        ranked = sorted(good, key=lambda guess: (-guess.score, guess.topic, guess.field))
        if ranked:
            chosen[name], others[name] = ranked[0], ranked[1:]
    return chosen, others


def _nothing_found(survey: _Survey) -> str:
    some = ", ".join(f"{name} ({kind})" for name, kind in list(survey.topics.items())[:8]) or "none"
    return f"no topic looks like a signal (topics: {some}): write channels.yaml by hand"


def _read(opened: Mapping[str, Log], chosen: Mapping[str, Guess]) -> list[Run]:
    channel_map = ChannelMap("guessed", {name: [_channel(guess)] for name, guess in chosen.items()})
    runs = []
    for name, log in opened.items():
        with closing(log):
            runs.append(read_run(name, log, channel_map, None))
    return runs


def _channel(guess: Guess) -> Channel:
    unit = None if guess.as_ or guess.equals is not None else guess.unit
    entry = {
        "topic": guess.topic,
        "field": guess.field,
        "unit": unit,
        "as": guess.as_,
        "equals": guess.equals,
    }
    return Channel.model_validate(entry)


def _with_unit(guess: Guess, found: Sequence[Finding]) -> Guess:
    """Take the unit that the data show, where it is not the one assumed."""
    unit = next((finding.unit for finding in found if finding.unit is not None), None)
    return replace(guess, unit=unit) if unit and guess.unit != "raw" and not guess.as_ else guess


# --- writing --------------------------------------------------------------------------------------


def _channel_lines(
    chosen: Mapping[str, Guess],
    others: Mapping[str, Sequence[Guess]],
    evidence: Mapping[str, Sequence[Finding]],
    survey: _Survey,
) -> Iterator[str]:
    yield "# Channel map guessed by `ident init`. Check every line; what stands after # is the evidence."
    for topic, gravity in survey.gravity.items():
        yield f"# {_comment(_gravity(topic, gravity))}"
    yield "signals:"
    for name, guess in chosen.items():
        yield f"  {name}: {_entry(guess)}  # {_comment(guess.why)}"
        for finding in evidence.get(name, []):
            yield f"    # {_comment(finding.text)}"
        for other in others[name]:
            yield f"    # or: {_comment(_entry(other))}"
    taken = {guess.topic for guess in chosen.values()} | {g.topic for gs in others.values() for g in gs}
    rest = [f"{name} ({kind})" for name, kind in survey.topics.items() if name not in taken]
    if rest:
        yield "# Not used:"
        yield from (f"#   {_comment(each)}" for each in rest)


def _gravity(topic: str, gravity: float) -> str:
    text = f"{topic}: mean of linear_acceleration.z {gravity:.2f}"
    if abs(gravity - GRAVITY) < 1:
        return f"{text}, gravity: z is up, m/s^2"
    if abs(gravity + GRAVITY) < 1:
        return f"{text}: Z IS DOWN, so yaw rate and lateral acceleration have the wrong sign"
    if abs(abs(gravity) - 1) < 0.1:
        return f"{text}: in g, use unit: g_0"
    return f"{text}: no gravity in it"


def _entry(guess: Guess) -> str:
    parts = [f"topic: {_quoted(guess.topic)}", f"field: {_quoted(guess.field)}"]
    if guess.as_:
        parts.append(f"as: {guess.as_}")
    elif guess.equals is not None:
        parts.append(f"equals: {guess.equals:g}")
    else:
        parts.append(f'unit: "{guess.unit}"' if guess.unit == "1" else f"unit: {guess.unit}")
    return "{" + ", ".join(parts) + "}"


def _quoted(name: str) -> str:
    """A name from a log as a YAML scalar; in double quotes, as in JSON, where it is not plain."""
    return name if _SAFE.fullmatch(name) and not name.isdigit() and "[" not in name else json.dumps(name)


def _comment(text: str) -> str:
    return "".join(char if char.isprintable() else " " for char in text)


def _vehicle_lines(evidence: Mapping[str, Sequence[Finding]]) -> Iterator[str]:
    yield "# Vehicle file begun by `ident init`. Fill in what is known and take its # away; all is optional."
    yield "# mass: 12500 kg               # not in the logs: weigh it"
    yield "# yaw_inertia: 50000 kg m^2     # not in the logs; a fit needs the mass, and can estimate this"
    yield "# cg_to_front_axle: 2.4 m      # from the axle loads"
    yield "# cg_to_rear_axle: 2.1 m"
    for name in ("road_wheel_angle", "road_wheel_angle_left", "steering_wheel_angle"):
        for finding in evidence.get(name, []):
            if finding.unit is not None:
                yield f"#   {_comment(finding.text)}"
    yield "# track: 2.0 m"
    yield "# cg_height: 1.1 m             # with the track: the two-track model is fitted, too"
    yield "# axles: {rear: {number: 2, spacing: 1.35 m}}   # a tandem; distances are to its middle"
    yield from _ratio_lines(evidence.get("steering_wheel_angle", []))
    yield from _point_lines(evidence.get("lateral_velocity", []))
    yield "# imu_position: [0 m, 0 m, 0 m]   # from the CG: x forward, y left, z up"


def _ratio_lines(found: Sequence[Finding]) -> Iterator[str]:
    ratio = next((each for each in found if each.unit is None and each.value is not None), None)
    if ratio is not None and ratio.value is not None:
        yield f"steering_ratio: {ratio.value:.2f}   # {_comment(ratio.text)}"
    else:
        yield "# steering_ratio: 20.5           # steering wheel over road wheel"


def _point_lines(found: Sequence[Finding]) -> Iterator[str]:
    point = next((each for each in found if each.value is not None), None)
    if point is None or point.value is None:
        yield "# reference_point: rear_axle      # the point of logged poses and velocities: rear_axle or cg"
        return
    guess = "reference_point: rear_axle" if abs(point.value) < AT_REAR_AXLE else "# reference_point: cg"
    yield f"{guess}   # {_comment(point.text)}"
