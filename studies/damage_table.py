"""What is saved of damaged logs: by ident, rosbags and mcap, beside what the bytes still hold.

    python studies/damage_table.py [--out docs/damaged_logs.md]

One recording of 1200 messages in every format (1000 in CSV and Parquet, which hold one topic), damaged in
every way (``tests/helpers/damaged_logs.py``, which also says from the bytes alone how many messages can be
saved: of a Parquet file without its end, which describes it, none). A message counts as read where its log
time and its value are those that were recorded; what came out otherwise is told as wrong. rosbags gets a
folder with a sound metadata.yaml where the format has one, mcap the better of its two readers in the order of
the file; what they read before they stop with an error counts.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "tests" / "helpers")]

from damaged_logs import FORMATS, Case, beside, cases, file_name, ros1_payload, truth  # noqa: E402
from log_files import write_bag  # noqa: E402
from mcap.reader import NonSeekingReader, SeekingReader  # noqa: E402
from rosbags.highlevel import AnyReader  # noqa: E402

from ident.errors import IdentError  # noqa: E402
from ident.logs import FieldError, open_log  # noqa: E402
from ident.results import Damage  # noqa: E402

OTHERS = ("mcap", "sqlite", "ros1")  # formats that rosbags or mcap read
PAGE = HERE.parent / "docs" / "damaged_logs.md"
KEPT = HERE / "results" / "damage_table.jsonl"
FIELD = {"SteeringWheelAngle": "angle", "TwistStamped": "twist.linear.x"}


@dataclass(frozen=True)
class Recovered:
    """How many messages were read as they were recorded, and how many otherwise; ``said`` of the losses."""

    right: int
    wrong: int
    said: Sequence[Damage] = ()


def by_ident(path: Path, case: Case) -> Recovered:
    """Read a file; check that it is not changed, nor anything beside it."""
    before = _state(path)
    try:
        log = open_log(path)
    except IdentError as error:
        return Recovered(0, 0, [Damage(str(error).removeprefix(f"{path.parent}/"))])
    log.check()
    read: Counter[tuple[str, int, str]] = Counter()
    damage = list(log.damage)
    for topic in log.topics:
        try:
            known = topic.type.replace("::", "/").rpartition("/")[2]
            field = FIELD.get(known) or next(iter(log.fields(topic.name)))
            columns = log.columns(topic.name, [field])
        except FieldError as error:
            damage.append(Damage(str(error)))
            continue
        damage += columns.damage
        pairs = zip(columns.log_time.tolist(), columns.values[field].tolist(), strict=True)
        recorded = topic.name.removesuffix(f" ({topic.type})")  # one of two types of a name
        read.update((recorded, time, repr(value)) for time, value in pairs)
    log.close()
    if _state(path) != before:
        raise RuntimeError(f"{path} or its folder was changed")
    known = Counter(truth(case.messages))
    right = (read & known).total()
    without = sum(count for key, count in (read - known).items() if key[2] == "nan")  # a row, but no value
    return Recovered(right, read.total() - right - without, damage)


def _state(path: Path) -> dict[str, tuple[str, int]]:
    files = sorted(path.parent.iterdir())
    return {f.name: (hashlib.sha256(f.read_bytes()).hexdigest(), f.stat().st_mtime_ns) for f in files}


def by_rosbags(path: Path, case: Case) -> Recovered:
    """Read with AnyReader, raw: payloads are compared."""

    def read() -> Iterator[tuple[str, int, bytes]]:
        with AnyReader([path if path.name.startswith("run.bag") else path.parent]) as reader:
            for connection, time, data in reader.messages():
                yield connection.topic, time, bytes(data)

    return _compared(read(), case, ros1=path.name.startswith("run.bag"))


def by_mcap(path: Path, case: Case) -> Recovered | None:
    """Read with the reader that seeks and with the one that does not; the better of them."""
    if path.suffix != ".mcap":
        return None

    def read(reader: type[SeekingReader | NonSeekingReader]) -> Iterator[tuple[str, int, bytes]]:
        with path.open("rb") as file:
            found = reader(file, validate_crcs=True).iter_messages(log_time_order=False)
            for _, channel, message in found:
                yield channel.topic, message.log_time, message.data

    found = [_compared(read(reader), case) for reader in (SeekingReader, NonSeekingReader)]
    return max(found, key=lambda each: each.right)


def _compared(messages: Iterator[tuple[str, int, bytes]], case: Case, *, ros1: bool = False) -> Recovered:
    read: Counter[tuple[str, int, bytes]] = Counter()
    stopped = ""
    try:
        for each in messages:
            read[each] += 1
    except Exception as error:  # noqa: BLE001 (readers of others may raise anything)
        stopped = f"{type(error).__name__}: {error}"
    known = Counter((m.topic, m.time, ros1_payload(m) if ros1 else m.data) for m in case.messages)
    right = (read & known).total()
    return Recovered(right, read.total() - right, [Damage(stopped)] if stopped else [])


READERS: dict[str, Callable[[Path, Case], Recovered | None]] = {
    "ident": by_ident, "rosbags": by_rosbags, "mcap": by_mcap
}  # fmt: skip


# --- rows -----------------------------------------------------------------------------------------


def rows(kind: str) -> Iterator[dict[str, object]]:
    """One row a damage: what exists, what can be saved, what each reader reads."""
    with tempfile.TemporaryDirectory(prefix="damage-") as name:
        folder = Path(name)
        for number, (damage, case) in enumerate(cases(kind, folder).items()):
            row: dict[str, object] = {
                "format": kind, "damage": damage, "recorded": len(case.messages), "can": case.can_be_saved
            }  # fmt: skip
            for reader, read in READERS.items():
                if reader != "ident" and not kind.startswith(OTHERS):
                    continue
                place = folder / f"{number}_{reader}" / "run"
                path = _placed(place, kind, case, with_metadata=reader == "rosbags")
                found = read(path, case)
                if found is not None:
                    row[reader] = {"right": found.right, "wrong": found.wrong}
                if reader == "ident" and found is not None:
                    row["said"] = [_losses(each) for each in found.said]
            yield row


def _placed(place: Path, kind: str, case: Case, *, with_metadata: bool) -> Path:
    """Write a damaged file; for a reader that needs it, beside the metadata.yaml of the sound one."""
    if with_metadata and not kind.startswith("ros1"):
        place.parent.mkdir()
        write_bag(place, case.messages, sqlite=kind == "sqlite")
    else:
        place.mkdir(parents=True)
    for name, data in beside(kind).items():
        (place / name).write_bytes(data)
    path = place / (case.name or file_name(kind))
    path.write_bytes(case.data)
    return path


def _losses(damage: Damage) -> str:
    counts = {
        "messages": damage.messages_lost, "bytes": damage.bytes_lost,
        "s": None if damage.seconds_lost is None else round(damage.seconds_lost, 3),
    }  # fmt: skip
    told = ", ".join(f"{count} {unit}" for unit, count in counts.items() if count is not None)
    return damage.what + (f": {told}" if told else "")


def page(found: Sequence[dict[str, object]]) -> str:
    """The table as Markdown."""
    lines = [
        "# What is saved of damaged logs", "",
        "Made by `python studies/damage_table.py`; do not edit.", "",
        *[line for line in (__doc__ or "").splitlines()[4:] if line], "",
        "| format | damage | recorded | can be saved | ident | rosbags | mcap |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]  # fmt: skip
    for row in found:
        counts = " | ".join(_cell(row.get(reader)) for reader in READERS)
        lines.append(f"| {row['format']} | {row['damage']} | {row['recorded']} | {row['can']} | {counts} |")
    lines += ["", "What `ident` says of each loss:", "", "| format | damage | said |", "|---|---|---|"]
    for row in found:
        said = row.get("said")
        if isinstance(said, list) and said:
            text = "<br>".join(str(each).replace("|", "\\|") for each in said)
            lines.append(f"| {row['format']} | {row['damage']} | {text} |")
    return "\n".join([*lines, ""])


def _cell(counts: object) -> str:
    if not isinstance(counts, dict):
        return "–"
    return f"{counts['right']}" + (f" ({counts['wrong']} wrong)" if counts["wrong"] else "")


def main() -> None:
    """Make the table and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=PAGE)
    found = [row for kind in FORMATS for row in rows(kind)]
    KEPT.write_text("".join(f"{json.dumps(row)}\n" for row in found), encoding="utf-8")
    parser.parse_args().out.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
