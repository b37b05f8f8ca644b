"""Rows of a study as lines of JSON: what is there is not made again, and a study that is stopped goes on."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

Row = dict[str, Any]
KEY = "cell"


def kept_rows(path: Path) -> list[Row]:
    """Return the rows of a file; a last line that was cut off while it was written is none."""
    if not path.exists():
        return []
    whole = path.read_text(encoding="utf-8").rpartition("\n")[0]
    return [json.loads(line) for line in whole.splitlines() if line]


def grow(
    path: Path,
    cells: Iterable[Sequence[Any]],
    make: Callable[[Sequence[Any]], Iterable[Row]],
    *,
    jobs: int = 1,
    hours: float | None = None,
) -> list[Row]:
    """Make the rows of all cells that have none yet, and write each cell's rows at once.

    Parameters
    ----------
    path : of the rows; each holds its cell as ``row["cell"]``
    cells : of strings and numbers, in the order of importance
    make : rows of one cell, of which there is one at least; a function of a module, for other processes
    jobs : at a time; hours : after which no new cell is begun

    Returns
    -------
    All rows of the file. An interrupt ends the study as if its time were over.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _mend(path)
    rows = kept_rows(path)
    done = {json.dumps(row[KEY]) for row in rows}
    left = [list(cell) for cell in cells if json.dumps(list(cell)) not in done]
    until = time.monotonic() + 3600.0 * hours if hours is not None else float("inf")
    with path.open("a", encoding="utf-8") as file, ProcessPoolExecutor(jobs, initializer=_deaf) as pool:
        running: dict[Future[list[Row]], list[Any]] = {}
        try:
            while left or running:
                while left and len(running) < jobs and time.monotonic() < until:
                    cell = left.pop(0)
                    running[pool.submit(_made, make, cell)] = cell
                if not running:
                    break
                for one in wait(running, return_when=FIRST_COMPLETED).done:
                    cell = running.pop(one)
                    own = [{KEY: cell, **row} for row in one.result()]
                    file.write("".join(json.dumps(row) + "\n" for row in own))
                    file.flush()
                    rows += own
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
    return rows


def _made(make: Callable[[Sequence[Any]], Iterable[Row]], cell: Sequence[Any]) -> list[Row]:
    return list(make(cell))


def _deaf() -> None:
    """Only the first process hears an interrupt."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _mend(path: Path) -> None:
    """Take away a last line that was cut off."""
    if path.exists():
        whole = path.read_text(encoding="utf-8")
        kept = whole[: whole.rfind("\n") + 1]
        if kept != whole:
            path.write_text(kept, encoding="utf-8")
