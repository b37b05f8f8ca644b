"""The whole command on sets that are driven for it: logs are written, read, and taken through the loop.

    python studies/improve_whole.py [--seeds 60] [--jobs 2] [--hours H] [--only sound|EFFECT]

Each set is a truck of its own with four runs of a campaign, measured at the rates of real sensors and written
as MCAP; the command reads them with a channel map of its own guessing. Cells: a sound truck, and a truck with
one effect of the catalogue at its usual size. Told of each:

* the verdict, and the size with its interval beside the true one;
* the error of held-out runs before and after, over what the generating model leaves of the same samples:
  measured minus what the sensors would have read without noise;
* the verdict from the same logs on a common time base of 50 Hz instead of 100 Hz.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from generator.injected_sensors import Reading  # noqa: E402
from generator.undeclared import (  # noqa: E402
    SETS,
    driven_run,
    generate_undeclared,
    hidden_runs,
    hidden_truck,
)
from improve_kept import Row, grow, kept_rows  # noqa: E402
from improve_null import limits  # noqa: E402
from improve_power import SIGNALS  # noqa: E402
from improve_runs import TYPICAL, Injected, true_parameters, typical  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from ruamel.yaml import YAML  # noqa: E402

from ident.results import ImproveResult  # noqa: E402
from ident.signals.run import load_runs  # noqa: E402
from ident.stages.improve import improve  # noqa: E402
from ident.stages.improve_settings import ImproveSettings  # noqa: E402
from ident.stages.inputs import InputSettings  # noqa: E402
from ident.stages.output import Context, StageOutput  # noqa: E402

Array = NDArray[np.float64]

KEPT = HERE / "results" / "improve_whole.jsonl"
SOUND = "sound"
DRIVEN = ("there_and_back", "sweep_fast", "steps", "slow_circles")
RATES = ("100 Hz", "50 Hz")
ALLOWED = 1.1  # held-out error over that of the true model
WORSE = 1.01  # after over before, of a signal: beyond, it is worse


@dataclass(frozen=True)
class TrueRun:
    """A run as it was: its start [ns since 1970], and what each sensor would have read without noise."""

    start: int
    readings: Mapping[str, Reading]


def cells(seeds: int, only: Sequence[str] | None = None) -> Iterator[list[str | int]]:
    """Yield all sets, the first seeds of everything first; five sound trucks to one of each effect."""
    for seed in range(1, seeds + 1):
        yield from (
            [name, seed] for name in (SOUND, *(TYPICAL if seed % 5 == 1 else ())) if not only or name in only
        )


def one_set(cell: Sequence[str | int]) -> Iterable[Row]:
    """Write the logs of one set, run the command at both rates, and hold its answer against the truth."""
    name, seed = str(cell[0]), int(cell[1])
    injected = [] if name == SOUND else [_injected(name, seed)]
    with tempfile.TemporaryDirectory() as folder:
        logs, readings = written(Path(folder), injected, seed)
        began = time.perf_counter()
        outputs = [_improved(logs, rate) for rate in RATES]
        seconds = (time.perf_counter() - began) / len(RATES)
        starts = {one.name: one.start_ns for one in load_runs([logs]).runs}
    told = [
        described(one.result, floors(one.tables["improve_held_out"], readings, starts)) for one in outputs
    ]
    return [
        {"truth": true_parameters(injected), "seconds": round(seconds, 1), **told[0], "at_50_hz": told[1]}
    ]


def _injected(name: str, seed: int) -> Injected:
    return typical(name, 1.0, SIGNALS[name][seed % len(SIGNALS[name])] if name in SIGNALS else None)


def written(folder: Path, injected: Sequence[Injected], seed: int) -> tuple[Path, dict[str, TrueRun]]:
    """Write the logs of a truck with these effects; return their folder, and what each run's sensors read."""
    one, answers = SETS[0], folder / "answers.yaml"
    listed = [
        {"name": i.name, "parameters": dict(i.values), **({"of": i.of} if i.of else {})} for i in injected
    ]
    YAML(typ="safe", pure=True).dump({one: listed}, answers)
    (logs,) = generate_undeclared(folder, seed, [one], answers)
    truth, made = hidden_truck(one, seed, answers), {}
    for run in hidden_runs(one, seed):
        if run.plan in DRIVEN:
            made[run.name] = TrueRun(run.start, driven_run(run, *truth, seed, one).readings)
        else:
            shutil.rmtree(logs / run.name)
    return logs, made


def inputs_at(rate: str) -> InputSettings:
    """Return settings of a common time base such as "50 Hz"."""
    return InputSettings.model_validate({"align": {"rate": rate}})


def _improved(logs: Path, rate: str) -> StageOutput[ImproveResult]:
    context = Context(command="study", date="2026-01-01T00:00:00Z")
    return improve([logs], inputs_at(rate), ImproveSettings(), context)


def floors(
    held_out: pd.DataFrame, truth: Mapping[str, TrueRun], starts: Mapping[str, int]
) -> dict[str, float]:
    """Root mean square of measured minus true in the held-out samples of each signal.

    held_out : a row a sample, its time from the start of its run; starts : of the runs [ns since 1970]
    """
    errors: dict[str, list[Array]] = {}
    for (run, signal), rows in held_out.groupby(["run", "signal"], observed=True):
        true = truth[run.rpartition("/")[2]]
        if signal in true.readings:
            time_of_it = rows["time"].to_numpy() + 1e-9 * (starts[run] - true.start)
            error = rows["measured"].to_numpy() - true.readings[signal](time_of_it)
            errors.setdefault(signal, []).append(wrapped(error) if signal == "heading" else error)
    return {signal: float(np.sqrt(np.mean(np.concatenate(e) ** 2))) for signal, e in errors.items()}


def wrapped(angle: Array) -> Array:
    """Return an angle [rad] within half a turn of zero."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def described(result: ImproveResult, floor: Mapping[str, float]) -> Row:
    """What the command says, with its held-out errors over those of the true model."""
    before, after = result.error.before, result.error.after
    return {
        "verdict": result.verdict,
        "added": [one.key for one in result.effects],
        "members": {one.key: list(one.members) for one in result.effects},
        "sizes": {
            one.key: {n: [e.value, e.low, e.high] for n, e in one.parameters.items()}
            for one in result.effects
        },
        "over_floor": {s: after[s].value / floor[s] for s in after if s in floor},
        "over_before": {s: after[s].value / before[s].value for s in after},
        "confirmed": None if result.confirmation is None else result.confirmation.confirmed,
    }


def summary(rows: Sequence[Row]) -> str:
    """Return the false alarms, then one line for each effect, then what holds for all."""
    sound = [row for row in rows if row["cell"][0] == SOUND]
    wrong = [row for row in sound if row["verdict"] != "adequate"]
    low, high = limits(len(wrong), max(len(sound), 1))
    lines = [f"sound trucks: {len(wrong)} of {len(sound)} not adequate ({low:.3f} to {high:.3f})"]
    lines += [f"  {row['cell']}: {row['verdict']} {row['added']}" for row in wrong]
    lines += [
        f"  {row['cell']} at 50 Hz: {row['at_50_hz']['verdict']} {row['at_50_hz']['added']}"
        for row in sound
        if row["at_50_hz"]["verdict"] != "adequate"
    ]
    for name in TYPICAL:
        own = [row for row in rows if row["cell"][0] == name]
        if own:
            lines.append(_line(name, own))
    same = [row["verdict"] == row["at_50_hz"]["verdict"] for row in rows]
    lines.append(f"same verdict at 50 Hz: {sum(same)} of {len(same)}")
    accepted = [row for row in rows if row["added"] and row["verdict"] in ("named", "equivalent")]
    worse = [row["cell"] for row in accepted if max(row["over_before"].values()) > WORSE]
    lines.append(
        f"accepted: {len(accepted)}; a signal of held-out runs worse than before: {len(worse)} {worse}"
    )
    lines.append(_over_floor(rows))
    return "\n".join(lines)


def _over_floor(rows: Sequence[Row]) -> str:
    """Held-out errors over those of the true model: their median, how many are near it, the worst."""
    each = [(one, signal, row["cell"]) for row in rows for signal, one in row["over_floor"].items()]
    median = np.median([np.median(list(row["over_floor"].values())) for row in rows])
    near = sum(one <= ALLOWED for one, _, _ in each)
    worst, signal, cell = max(each)
    return (
        f"held-out error over that of the true model: median {median:.3f}; at most {ALLOWED} in {near} of "
        f"{len(each)} signals; largest {worst:.2f} ({signal}, {cell})"
    )


def _line(name: str, rows: Sequence[Row]) -> str:
    inside = [bool(set(row["truth"]) & {k for m in row["members"].values() for k in m}) for row in rows]
    held = [held_of(row) for row in rows]
    verdicts = ", ".join(f"{v} {n}" for v in VERDICTS if (n := sum(row["verdict"] == v for row in rows)))
    covers = f"{sum(h is True for h in held)} of {sum(h is not None for h in held)}"
    return f"{name:28} n = {len(rows)}: {verdicts}; truth in a class {sum(inside)}; interval holds {covers}"


VERDICTS = ("named", "equivalent", "unexplained", "adequate")


def held_of(row: Row) -> bool | None:
    """Whether the interval of the size holds the truth, None where it was not added."""
    (key, parameters), *_ = row["truth"].items()
    size, value = next(iter(parameters.items()))
    told = row["sizes"].get(key, {})
    one = told.get(size) or next(iter(told.values()), None)
    return None if one is None or one[1] is None else bool(one[1] <= value <= one[2])


def main() -> None:
    """Run the sets that are not yet there, then print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--hours", type=float, help="after which nothing new is begun")
    parser.add_argument("--only", action="append", help="sound, or of the effects")
    parser.add_argument("--kept", type=Path, default=KEPT)
    given = parser.parse_args()
    grow(given.kept, cells(given.seeds, given.only), one_set, jobs=given.jobs, hours=given.hours)
    print(summary(kept_rows(given.kept)))


if __name__ == "__main__":
    main()
