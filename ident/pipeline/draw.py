"""The report and the recording, drawn from what is stored; what is up to date is not drawn again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ident.pipeline.files import atomic
from ident.pipeline.hashes import code_version
from ident.pipeline.seal import MadeFrom
from ident.pipeline.stages import STAGES, Stage
from ident.pipeline.store import Store
from ident.stages.output import Progress

REPORT, RECORDING = "report", "recording"


def draw(store: Store, shown: str, progress: Progress) -> bool:
    """Draw the report and the recording where they are not up to date, both opening at the stage ``shown``.

    What is stored but not whole, or not as it was written, is left out.

    Returns
    -------
    drawn : whether anything was
    """
    stored = [name for name in STAGES if store.seals.read(name) is not None]
    answered = [name for name in stored if store.read_result(name) is not None]
    recorded = [name for name in answered if STAGES[name].record is not None]
    todo: list[Callable[[], None]] = []
    if recorded and not _is_up_to_date(store, RECORDING, recorded, _front(recorded, shown)):
        todo.append(lambda: _draw_recording(store, recorded, _front(recorded, shown)))
    if not _is_up_to_date(store, REPORT, stored, shown):
        todo.append(lambda: _draw_report(store, stored, shown))
    for number, step in enumerate(todo):
        progress("drawing the report", number, len(todo))
        step()
    if not recorded:
        store.seals.remove(RECORDING)
        (store.folder / "run.rrd").unlink(missing_ok=True)
    return bool(todo)


def _front(recorded: Sequence[str], shown: str) -> str:
    return shown if shown in recorded else recorded[-1]


def _is_up_to_date(store: Store, what: str, stages: Sequence[str], shown: str) -> bool:
    seal = store.seals.read(what)
    return seal is not None and seal.made_from == _made_from(store, stages, shown)


def _made_from(store: Store, stages: Sequence[str], shown: str) -> MadeFrom:
    needs = {name: store.seals.digest(name) for name in stages}
    return MadeFrom(code_version(of_results=False), settings={"shown": shown}, needs=needs)


def _draw_report(store: Store, stages: Sequence[str], shown: str) -> None:
    from ident.report.html import write_report
    from ident.report.pages.refused import refused_page

    made_from = _made_from(store, stages, shown)
    store.seals.remove(REPORT)
    pages = []
    for name in stages:
        stage, result = STAGES[name], store.read_result(name)
        if result is not None:
            pages.append(stage.page(result, store.read_tables(name, stage.tables)))
            continue
        seal = store.seals.read(name)
        if seal is not None and seal.refused is not None:
            pages.append(refused_page(name, stage.title, seal.refused))
    path = write_report(store.folder, pages, shown)
    store.seals.write(REPORT, made_from, files=[path])


def _draw_recording(store: Store, stages: Sequence[str], front: str) -> None:
    from ident.report.recording import write_recording

    made_from = _made_from(store, stages, front)
    store.seals.remove(RECORDING)
    found: Mapping[str, Stage] = {name: STAGES[name] for name in stages}
    parts = [
        stage.record(store.read_result(name), store.read_tables(name, stage.tables))
        for name, stage in found.items()
        if stage.record is not None
    ]
    path: Path = store.folder / "run.rrd"
    with atomic(path) as temporary:
        write_recording(temporary, parts, front)
    store.seals.write(RECORDING, made_from, files=[path])
