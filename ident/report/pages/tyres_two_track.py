"""The two-track model on the page of the tyre stage: its tyres beside those of the bicycle, what is given."""

from __future__ import annotations

from ident.report.estimates import estimate_cells
from ident.report.numbers import NONE, estimate_value, significant, unit_text
from ident.report.page import Block, Cell, Column, Section, Table, Text
from ident.report.tyre_parameters import (
    KINDS,
    displayed,
    estimates,
    full_name,
    in_order,
    signal_head,
    signal_unit,
)
from ident.results import Estimate, FixedValue, TwoTrackFit, TyreFit, TyresResult


def two_track_sections(result: TyresResult) -> list[Section]:
    """Give the section of the two-track model, none where it was not fitted."""
    if result.two_track is None:
        return []
    fit = result.two_track
    bicycle = next(one for one in result.fits if one.kind == fit.kind)
    blocks: list[Block] = [Text(_told(fit)), _parameters(fit, bicycle), _errors(fit, bicycle), _chassis(fit)]
    return [Section("two_track", "Two tracks", blocks, "Two tracks")]


def _told(fit: TwoTrackFit) -> str:
    more = [f"{count} axles {name}" for name, count in fit.axles.items() if count > 1]
    more += [f"axle {number} {name} off the road" for name, number in fit.lifted.items()]
    axles = f" ({', '.join(more)})" if more else ""
    gain = significant(abs(fit.criterion_gain), 3)
    better = f"better by {gain}" if fit.criterion_gain > 0 else f"worse by {gain}"
    ended = "" if fit.converged else " The fit has not converged: its errors are not to be trusted."
    return (
        f"{KINDS[fit.kind]} tyres, fitted again on two tracks{axles}, to the same windows: the tyres of a "
        "bicycle hold what the moving load takes from them, and would count it twice here. Stiffness and "
        "force are those of all wheels of an axle at rest. Its criterion is "
        f"{better} than that of the bicycle with these tyres."
        f"{ended}"
    )


def _parameters(fit: TwoTrackFit, bicycle: TyreFit) -> Table:
    columns = [
        Column("parameter"),
        Column("value", "number"),
        Column("95 % interval", "number"),
        Column("unit"),
        Column("status"),
        Column("in the bicycle", "number"),
    ]
    own = {f"{axle}.{n}": v for axle in ("front", "rear") for n, v in getattr(fit, axle).items()}
    other = estimates(bicycle)
    rows = [
        [Cell(full_name(name)), *estimate_cells(one, displayed(one)), _plain(other.get(name))]
        for name, one in {**own, "yaw_inertia": fit.yaw_inertia}.items()
    ]
    notes = ["intervals: what the table of given values says is taken as exact"]
    return Table(columns, rows, notes=notes, download="two_track_parameters.csv")


def _plain(one: Estimate | None) -> Cell:
    if one is None:
        return Cell(NONE)
    shown = displayed(one)
    return Cell(estimate_value(shown), raw=shown.value)


def _errors(fit: TwoTrackFit, bicycle: TyreFit) -> Table:
    signals = in_order([*fit.rms, *bicycle.rms])
    columns = [Column("model"), *[Column(signal_head(name), "number") for name in signals]]
    rows = []
    for title, rms in (("bicycle", bicycle.rms), ("two tracks", fit.rms)):
        sizes = [rms[name] * signal_unit(name)[0] if name in rms else None for name in signals]
        rows.append([Cell(title), *(Cell(significant(size), raw=size) for size in sizes)])
    return Table(columns, rows, download="two_track_errors.csv")


def _chassis(fit: TwoTrackFit) -> Table:
    columns = [Column("taken as given"), Column("value", "number"), Column("unit"), Column("from")]
    rows = [
        [
            Cell(name.replace("_", " ")),
            Cell(significant(one.value), raw=one.value),
            Cell(unit_text(one.unit)),
            _source(one),
        ]
        for name, one in fit.chassis.items()
    ]
    return Table(columns, rows, download="two_track_given.csv")


def _source(one: FixedValue) -> Cell:
    return Cell(one.source, tone="caution" if one.source == "assumed" else "plain")
