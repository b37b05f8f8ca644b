"""The part of the evaluation: the truck on its measured path, each model as its ghost, and the residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from ident.glossary import SIGNALS
from ident.report.condense import Line
from ident.report.evaluate_signals import (
    compares,
    measured,
    measured_signals,
    on_request,
    places,
    residual,
    simulated,
    simulated_by,
)
from ident.report.evaluated import by_agreement, model_name, roles, shown_model
from ident.report.numbers import plain, shorten
from ident.report.outline import outline_from
from ident.report.recording.motion import log_trucks, maps, send_trucks
from ident.report.recording.parts import MOST_TABS, Part, log_style, origin, send, series
from ident.report.summary import describe_evaluate
from ident.report.tyre_signals import runs_of
from ident.results import EvaluateResult

MOST_SIGNALS = 3
STAGE = "evaluate"


def evaluate_part(result: EvaluateResult, tables: Mapping[str, pd.DataFrame]) -> Part:
    """Show the truck with a ghost for each model beside the residuals: a tab for each held-out run.

    The runs that the chosen model follows worst come first.

    Parameters
    ----------
    tables : "evaluate", as ``ident.report.pages.evaluate`` describes it
    """
    found = runs_of(tables["evaluate"]) if "evaluate" in tables else {}
    ranked = by_agreement(result, list(found))[::-1]
    models = {run: _models(result, found[run]) for run in ranked}
    shape = outline_from(result.geometry)

    def styles(recording: rr.RecordingStream) -> None:
        for run in ranked:
            root, colours = origin(STAGE, run), {"measured": "measured", **models[run]}
            log_trucks(recording, root, places(found[run], list(models[run])), shape, colours)
            _log_styles(recording, root, _lines(result, found[run], list(models[run])), models[run])

    def data(recording: rr.RecordingStream) -> None:
        for run in ranked:
            root, rows, names = origin(STAGE, run), found[run], list(models[run])
            for entity, line in _lines(result, rows, names).items():
                send(recording, f"{root}/{entity}", line)
            steering, begin = measured(rows, "road_wheel_angle"), float(rows["time"].min())
            send_trucks(recording, root, places(rows, names), shape, steering, begin)

    tabs = [_tab(result, run, found[run], list(models[run])) for run in ranked[:MOST_TABS]]
    return Part(STAGE, "Evaluation", result.provenance, describe_evaluate(result), tabs, styles, data)


def _models(result: EvaluateResult, rows: pd.DataFrame) -> dict[str, str]:
    """Give the models of a run with their colours; that which is shown also as driven by the request."""
    colours, shown = roles(result), shown_model(result)
    found = {name: colours[name] for name in simulated_by(rows) if name in colours}
    asked = on_request(rows, shown.name) if shown else []
    return found | dict.fromkeys(asked, "request")


def _lines(result: EvaluateResult, rows: pd.DataFrame, models: Sequence[str]) -> dict[str, Line]:
    """Give every line of a run by its entity: measured, of the shown model, what each model leaves."""
    shown = shown_model(result)
    lines = {"road_wheel_angle/measured": measured(rows, "road_wheel_angle")}
    for signal in measured_signals(rows, models):
        lines[f"{signal}/measured"] = measured(rows, signal)
        own = [model for model in models if compares(rows, signal, [model])]
        if shown is not None and shown.name in own:
            lines[f"{signal}/{shown.name}"] = simulated(rows, signal, shown.name)
        lines |= {f"{signal}/residual/{model}": residual(rows, signal, model) for model in own}
    return {entity: line for entity, line in lines.items() if line.time.size}


def _log_styles(
    recording: rr.RecordingStream, root: str, lines: Mapping[str, Line], models: Mapping[str, str]
) -> None:
    for entity in lines:
        signal, *_, way = entity.split("/")
        told = f"{model_name(way)} [{_unit(signal)}]"
        role, width = ("measured", 2.5) if way == "measured" else (models[way], 1.5)
        log_style(recording, f"{root}/{entity}", role, told, width)


def _unit(signal: str) -> str:
    return SIGNALS[signal].unit.replace("^2", "²")


def _tab(result: EvaluateResult, run: str, rows: pd.DataFrame, models: Sequence[str]) -> rrb.Container:
    """Show the maps, where there are positions, left of the first signals with their residuals."""
    root, title = origin(STAGE, run), shorten(plain(run), 40)
    span = (float(rows["time"].min()), float(rows["time"].max()))
    signals = _views(root, _lines(result, rows, models), span)
    where = places(rows, models)
    if not where:
        return rrb.Vertical(signals, name=title)
    return rrb.Horizontal(maps(root, where), signals, column_shares=[1.0, 1.3], name=title)


def _views(root: str, lines: Mapping[str, Line], span: tuple[float, float]) -> rrb.Vertical:
    """Show the first signal as measured and as the shown model has it, then what each model leaves."""
    compared = list(dict.fromkeys(key.split("/")[0] for key in lines if "/residual/" in key))[:MOST_SIGNALS]
    views, shares = [], []
    for signal in compared:
        name, unit = signal.replace("_", " "), _unit(signal)
        own = {key: line for key, line in lines.items() if key.startswith(f"{signal}/")}
        left = {key: own.pop(key) for key in list(own) if "/residual/" in key}
        if signal == compared[0]:
            views.append(series(root, span, f"{name} [{unit}]", own))
            shares.append(1.6)
        views.append(series(root, span, f"{name}, residual [{unit}]", left))
        shares.append(1.0)
    return rrb.Vertical(*views, row_shares=shares, name="signals")
