"""What the validation concludes: claims of the source, margins with the found effects, levels of logs."""

from __future__ import annotations

from collections.abc import Sequence

from ident.glossary import controller_name
from ident.report.numbers import NONE, estimate_interval, estimate_value, shorten, significant, unit_text
from ident.report.page import Block, Column, Table, Text, Tone
from ident.report.page import Cell as Entry
from ident.report.pages.validate_tables import share_entry
from ident.report.tyre_parameters import displayed
from ident.report.validated import HOLDS, LEVELS, level_unit, levels_by_run, measure_of, scenario_name
from ident.results import Estimate
from ident.results.validate import Claim, LoggedLevel, MarginLoss


def claims(found: Sequence[Claim]) -> Block:
    """Give each claim of the source with whether it holds, and why it is said."""
    if not found:
        return Text("No claim could be examined: that takes two controllers that were driven.", "muted")
    rows = [
        [
            Entry(HOLDS[one.holds][0], tone=HOLDS[one.holds][1], badge=True),
            Entry(one.claim),
            Entry(one.evidence),
        ]
        for one in found
    ]
    columns = [Column("verdict"), Column("claim of the source", wrap=True), Column("evidence", wrap=True)]
    return Table(columns, rows, download="validate_claims.csv")


def differences(found: Sequence[Claim]) -> Table | None:
    """Give every difference behind the claims with its interval, None where there is none."""
    rows = [
        [Entry(one.claim), Entry(measure), Entry(against), *_difference(estimate)]
        for one in found
        for measure, against, estimate in zip(_measures(one), _against(one), one.difference, strict=True)
    ]
    if not rows:
        return None
    columns = [
        Column("claim", wrap=True),
        Column("measure"),
        Column("against"),
        Column("difference", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
    ]
    notes = ["the controller of the claim less the other, median over the same starts; below zero: less"]
    return Table(columns, rows, notes=notes, download="validate_differences.csv", scroll=len(rows) > 16)


def _measures(one: Claim) -> list[str]:
    """Name the measure of each difference of a claim, a dash where that is not told."""
    told = [measure_of(name).name for name in one.measures]
    return told if len(told) == len(one.difference) else [NONE] * len(one.difference)


def _against(one: Claim) -> list[str]:
    """Name what each difference of a claim is to, a dash where that is not told."""
    told = [controller_name(name) for name in one.against]
    return told if len(told) == len(one.difference) else [NONE] * len(one.difference)


def _difference(estimate: Estimate) -> list[Entry]:
    own = displayed(estimate)
    return [
        Entry(estimate_value(own), raw=own.value, detail=estimate.reason),
        Entry(estimate_interval(own)),
        Entry(unit_text(own.unit)),
    ]


def margins(found: Sequence[MarginLoss]) -> Block:
    """Give each controller without and with the effects that were found, those that lose first."""
    if not found:
        return Text("No effect was found that could be simulated: run ident improve LOGS first.", "muted")
    columns = [
        Column("margin"),
        Column("controller"),
        Column("scenario"),
        Column("effects", wrap=True),
        Column("came through [%]: without", "number"),
        Column("with", "number"),
        Column("|e_y| max [m]: without", "number"),
        Column("with", "number"),
    ]
    rows = [_margin_row(one) for one in sorted(found, key=lambda one: not one.is_lost)]
    notes = [
        "the controllers do not know of the effects; the simulated truck has them",
        "|e_y| max: from an undisturbed start",
    ]
    return Table(columns, rows, notes=notes, download="validate_margins.csv", scroll=len(rows) > 16)


def _margin_row(one: MarginLoss) -> list[Entry]:
    said: tuple[str, Tone] = ("✗\u00a0lost", "bad") if one.is_lost else ("kept", "good")
    return [
        Entry(said[0], tone=said[1], badge=True),
        Entry(controller_name(one.controller)),
        Entry(scenario_name(one.scenario)),
        Entry(", ".join(effect.replace("_", " ") for effect in one.effects)),
        share_entry(one.completed_without),
        share_entry(one.completed_with),
        Entry(significant(one.lateral_error_max_without), raw=one.lateral_error_max_without),
        Entry(significant(one.lateral_error_max_with), raw=one.lateral_error_max_with),
    ]


def levels(found: Sequence[LoggedLevel]) -> Table:
    """Give each level of each logged run: whether it agrees, and each signal with what was allowed."""
    columns = [
        Column("run", wrap=True),
        Column("level"),
        Column("agrees"),
        Column("RMS difference (allowed)", wrap=True),
        Column("why", wrap=True),
    ]
    rows = [_level_row(one) for own in levels_by_run(found).values() for one in own]
    return Table(columns, rows, download="validate_levels.csv", scroll=len(rows) > 16)


def _level_row(one: LoggedLevel) -> list[Entry]:
    agrees: dict[bool | None, tuple[str, Tone]] = {
        True: ("agrees", "good"),
        False: ("✗\u00a0differs", "bad"),
        None: ("not reached", "muted"),
    }
    said, tone = agrees[one.agrees]
    who = None if one.controller is None else controller_name(one.controller)
    sizes = [level_text(name, size, one.allowed.get(name)) for name, size in one.rms.items()]
    return [
        Entry(shorten(one.run, 60), raw=one.run),
        Entry(f"{one.level}: {LEVELS[one.level]}", detail=who),
        Entry(said, tone=tone, badge=True),
        Entry("; ".join(sizes) or NONE),
        Entry(one.reason or NONE, tone="plain" if one.reason else "muted"),
    ]


def level_text(signal: str, size: float, allowed: float | None) -> str:
    """Give the difference of one signal, with what is allowed."""
    factor, unit = level_unit(signal)
    told = f"{signal.replace('_', ' ')} {significant(factor * size, 2)}"
    told += f"\u00a0{unit}" if unit else ""
    if allowed is None:
        return told
    mark = "✗\u00a0" if size > allowed else ""
    return f"{mark}{told} ({significant(factor * allowed, 2)})"
