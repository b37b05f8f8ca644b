"""Damaged files of every format, ten thousands of each: only values and the project's own errors come out.

    python studies/fuzz_logs.py [--count 100000] [--kind KIND] [--hours H] [--table]

A mutation is a seed (``tests/helpers/log_corpus.py``: small files of a format, by name) after one to
three changes (``fuzz_mutations.py``: bits and bytes flipped, cut off, inserted, removed, blanked, swapped,
repeated, spliced with another seed, and telling numbers written where lengths may stand). Everything that can
be read of it is read (``fuzz_targets.py``): all topics, all their fields. A defect is

* any error that is not the project's own;
* a process that dies; more than ``CPU_CAP`` seconds of processor time; no answer within ``WALL_CAP`` seconds;
* a peak of memory more than ``MEMORY_CAP`` bytes above what the process held before;
* results that contradict each other, and a file that is changed, or any new file beside it.

Mutations are read in forked processes, a batch at a time. Each batch is a row of
``results/fuzz_logs.jsonl``: what is there is not done again, so the number grows over sittings. The bytes of
a defect are kept in ``results/fuzz_found``.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NoReturn

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "tests" / "helpers")]

from fuzz_mutations import mutation  # noqa: E402
from fuzz_targets import outcome  # noqa: E402
from improve_kept import Row, grow, kept_rows  # noqa: E402
from log_corpus import SEEDS, seeds  # noqa: E402

KEPT = HERE / "results" / "fuzz_logs.jsonl"
FOUND = HERE / "results" / "fuzz_found"
BATCH = 2000
CPU_CAP = 2.0
WALL_CAP = 120.0
MEMORY_CAP = 64 << 20
ADDRESS_CAP = 1 << 30
FINE = ("read", "damaged", "refused")

Files = dict[str, bytes]


def run_batch(kind: str, numbers: Sequence[int], found: Path = FOUND) -> Row:
    """Read the mutations of these numbers; return how many ended how, and the defects."""
    ends: Counter[str] = Counter()
    defects: list[dict[str, Any]] = []
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=_memory()) as name:
        folder = Path(name)
        files = [seed.files for seed in seeds(kind, folder)]
        for number, end in read_apart(kind, numbers, lambda n: mutation(n, kind, files)[1], folder, files):
            ends[end if end in FINE else "defect"] += 1
            if end not in FINE:
                done, bad = mutation(number, kind, files)
                defects.append({"number": number, "done": done, "what": end})
                _keep(found, f"{kind}_{number}", bad)
    return {
        "kind": kind, "first": numbers[0], "count": len(numbers), **{end: ends[end] for end in FINE},
        "defects": defects, "seconds": round(time.perf_counter() - begun, 1),
    }  # fmt: skip


def _memory() -> str | None:
    """A folder in memory, where there is one."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # noqa: S108 (a fresh folder in it)


def _keep(found: Path, name: str, files: Files) -> None:
    folder = found / name
    folder.mkdir(parents=True, exist_ok=True)
    for each, data in files.items():
        (folder / each.replace("/", ".")).write_bytes(data)


def read_apart(
    kind: str,
    numbers: Sequence[int],
    case: Callable[[int], Files],
    folder: Path,
    sound: Sequence[Files] = (),
) -> Iterator[tuple[int, str]]:
    """Read files in processes of their own, one after another; one that dies is followed by another.

    Parameters
    ----------
    case : makes the files of a number
    folder : to read them in; sound : files that are read first, so that what is kept of them is not counted

    Yields
    ------
    Each number with how it ended: one of ``FINE``, or what is wrong.
    """
    left = list(numbers)
    while left:
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(reading)
            with os.fdopen(writing, "w") as out:
                _read_all(kind, map(case, left), sound, folder, out)
        os.close(writing)
        with os.fdopen(reading) as answers:
            late = False
            for end in _lines(answers):
                if end is None:
                    late = True
                    os.kill(process, signal.SIGKILL)
                    break
                yield left.pop(0), end
        _, status = os.waitpid(process, 0)
        if left and not (os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0):
            yield left.pop(0), "no answer" if late else _death(status, folder)


def _lines(answers: IO[str]) -> Iterator[str | None]:
    """Yield lines as they come; None where none came in time."""
    kept = ""
    while True:
        if not select.select([answers], [], [], WALL_CAP)[0]:
            yield None
        got = os.read(answers.fileno(), 1 << 16).decode()
        if not got:
            return
        *lines, kept = (kept + got).split("\n")
        yield from (json.loads(line) for line in lines)


def _death(status: int, folder: Path) -> str:
    where = folder.with_suffix(".trace")
    text = where.read_text(errors="replace") if where.exists() else ""
    frames = [line.strip() for line in text.splitlines() if "/ident/" in line][:2]
    if not os.WIFSIGNALED(status):
        return f"ended with {os.waitstatus_to_exitcode(status)} {frames}"
    what = signal.Signals(os.WTERMSIG(status)).name
    return f"more than {CPU_CAP} s {frames}" if what == "SIGPROF" else f"{what} {frames}"


def _read_all(
    kind: str, cases: Iterable[Files], sound: Sequence[Files], folder: Path, out: IO[str]
) -> NoReturn:
    """Read files until some take too much memory, and end the process."""
    trace = folder.with_suffix(".trace").open("w")
    faulthandler.enable(trace)
    faulthandler.register(signal.SIGPROF, trace, all_threads=True, chain=True)
    _limit_memory()
    place = folder / "read"
    tempfile.tempdir = str(folder)
    for each in sound:  # what is kept for good, such as the standard types, is not held against a mutation
        _end_of(kind, each, place)
    for damaged in cases:
        _reset_peak()
        held = _peak()
        signal.setitimer(signal.ITIMER_PROF, CPU_CAP)
        end = _end_of(kind, damaged, place)
        signal.setitimer(signal.ITIMER_PROF, 0)
        grown = _peak() - held
        if grown > MEMORY_CAP:
            end = f"{grown >> 20} MiB more memory, then: {end}"
        print(json.dumps(end), file=out, flush=True)
        if grown > MEMORY_CAP:
            break
    out.close()
    folder.with_suffix(".trace").unlink()
    os._exit(0)


def _end_of(kind: str, files: Files, place: Path) -> str:
    place.mkdir(exist_ok=True)
    try:
        return outcome(kind, files, place)
    except Exception as error:  # noqa: BLE001 (whatever comes out is what is looked for)
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "/ident/" in f.filename]
        at = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "outside"
        return f"{type(error).__name__} at {at}: {error}"[:300]
    finally:
        shutil.rmtree(place)


def _limit_memory() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ADDRESS_CAP, size + ADDRESS_CAP))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _reset_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


# --- rows -----------------------------------------------------------------------------------------


def make(cell: Sequence[Any]) -> list[Row]:
    """Return the row of a batch."""
    kind, batch = cell
    return [{"cell": list(cell), **run_batch(kind, range(batch * BATCH, (batch + 1) * BATCH))}]


def table(rows: Sequence[Row]) -> str:
    """One line a format: mutations, how they ended, and how many defects there are."""
    lines = [
        "| format | mutations | read whole | read in part | refused | defects | minutes |",
        "|---|" + "---:|" * 6,
    ]
    for kind in SEEDS:
        mine = [row for row in rows if row["kind"] == kind]
        sums = [sum(row[key] for row in mine) for key in ("count", "read", "damaged", "refused")]
        defects = sum(len(row["defects"]) for row in mine)
        minutes = sum(row["seconds"] for row in mine) / 60
        lines.append(f"| {kind} | {' | '.join(map(str, sums))} | {defects} | {minutes:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Read mutations until there are enough, or the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100_000, help="mutations of each format")
    parser.add_argument("--kind", choices=list(SEEDS), help="one format only")
    parser.add_argument("--hours", type=float, help="after which no new batch is begun")
    parser.add_argument("--table", action="store_true", help="say what was found until now")
    chosen = parser.parse_args()
    if not chosen.table:
        kinds = [chosen.kind] if chosen.kind else list(SEEDS)
        cells = [(kind, batch) for batch in range(-(-chosen.count // BATCH)) for kind in kinds]
        grow(KEPT, cells, make, hours=chosen.hours)
    rows = kept_rows(KEPT)
    print(table(rows))
    for row in rows:
        for defect in row["defects"]:
            print(row["kind"], defect["number"], defect["done"], defect["what"])


if __name__ == "__main__":
    main()
