"""Run `ident run` many times on one output folder and kill it: at random moments, or before a file operation.

A process of its own: everything is imported once, and each run is a fork of it that has no threads yet.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import control  # noqa: F401 -- so that no run spends its time on imports
import pandas as pd

from ident.cli import main
from ident.pipeline import run, stages  # noqa: F401
from ident.pipeline.hashes import code_version
from ident.report import html, recording  # noqa: F401
from ident.stages import info, split, steering  # noqa: F401

OPERATIONS = ("replace", "unlink", "fsync", "mkdir", "rmdir", "link")
DATE = re.compile(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\+00:00| UTC)")
KILLED = -signal.SIGKILL
SHORTER = 0.8  # of the time that kills are drawn from, after a run that came to its end


def ident_run(recipe: Path, logs: Path, out: Path) -> None:
    """Call the program as a user does; it ends the process."""
    main(["run", str(recipe), str(logs), "--out", str(out), "--quiet"])


def forked(task: Callable[[], None], kill_after: float | None = None) -> int:
    """Run a task in a process of its own; return its exit code, or -9 where it was killed."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            task()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            sys.stdout.flush()
            os._exit(code)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_before(operation: int, task: Callable[[], None]) -> None:
    """Run a task in this process, and kill it before its n-th operation on files."""
    count = 0

    def counted(true: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **options: object) -> object:
            nonlocal count
            count += 1
            if count == operation:
                os.kill(os.getpid(), signal.SIGKILL)
            return true(*arguments, **options)

        return call

    for name in OPERATIONS:
        setattr(os, name, counted(getattr(os, name)))
    task()


def contents(out: Path) -> dict[str, object]:
    """Give what a user finds in the outputs, without dates; of a recording only that it is there."""
    found: dict[str, object] = {}
    for path in sorted(each for each in out.rglob("*") if each.is_file()):
        name = str(path.relative_to(out))
        if path.suffix == ".parquet":
            found[name] = pd.read_parquet(path).to_json(double_precision=15)
        elif name.startswith(".ident/"):
            seal = json.loads(path.read_bytes())
            dated = name in {
                ".ident/report.json",
                ".ident/recording.json",
            }  # made from results with their dates
            found[name] = [sorted(seal["files"]), None if dated else seal["made_from"]]
        elif path.suffix == ".rrd":
            found[name] = path.stat().st_size > 0
        else:
            found[name] = DATE.sub(b"", path.read_bytes()).decode()
    return found


def random_kills(
    recipe: Path, logs: Path, out: Path, *, seed: int, rounds: int, kills: int
) -> dict[str, object]:
    """Kill at random moments, several times in a row, then finish undisturbed; compare with a run alone.

    Where a run came to its end before it was killed, the machine is quicker than it was: the moments are
    drawn from a shorter time, and the run is begun again.
    """
    draw = random.Random(seed)

    def task() -> None:
        ident_run(recipe, logs, out)

    begin = time.monotonic()
    code = forked(task)
    seconds = time.monotonic() - begin
    expected = contents(out)
    codes, differing = [], []
    for _ in range(rounds):
        shutil.rmtree(out)
        killed = 0
        while killed < kills:
            if forked(task, draw.uniform(0, seconds)) == KILLED:
                killed += 1
            else:
                seconds *= SHORTER
                shutil.rmtree(out)
        codes.append(forked(task))
        got = contents(out)
        differing.append([name for name in sorted({*expected, *got}) if expected.get(name) != got.get(name)])
    return {
        "undisturbed": code,
        "seconds": seconds,
        "codes": codes,
        "differing": differing,
        "files": list(expected),
    }


def kills_at_operations(recipe: Path, logs: Path, out: Path, *, every: int, first: int) -> dict[str, object]:
    """Kill before every n-th operation on files, then finish undisturbed; compare with a run alone."""

    def task() -> None:
        ident_run(recipe, logs, out)

    code = forked(task)
    expected = contents(out)
    differing: dict[int, list[str]] = {}
    operation, killed = first, KILLED
    while killed == KILLED:
        shutil.rmtree(out, ignore_errors=True)
        killed = forked(lambda n=operation: killed_before(n, task))
        finished = forked(task)
        got = contents(out)
        wrong = [name for name in sorted({*expected, *got}) if expected.get(name) != got.get(name)]
        if wrong or finished != code:
            differing[operation] = [f"exit code {finished}", *wrong]
        operation += every
    return {"undisturbed": code, "last": operation - every, "differing": differing, "files": list(expected)}


if __name__ == "__main__":
    for of_results in (True, False):
        code_version(of_results=of_results)
    html.plotly_script()
    how, *places = sys.argv[1:4]
    paths = [Path(place) for place in sys.argv[2:5]]
    options = json.loads(sys.argv[5])
    todo = {"random": random_kills, "operations": kills_at_operations}[how]
    print(json.dumps(todo(*paths, **options)))  # noqa: T201 -- read by the test
