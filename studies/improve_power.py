"""How often the loop finds an effect, gives it the right name, and how well it tells its size.

    python studies/improve_power.py [--seeds 4] [--hours H] [--part inside|outside|few|none] [--only EFFECT]

Each set is one campaign of eight runs by a truck with one effect, measured and taken through the loop over
the layer in which the effect acts. Cells:

* inside: each effect of the catalogue that is injected at 0.5, 1 and 2 times its usual size;
* outside: effects that the catalogue of the loop lacks, at 1 and 3 times, where any name is a wrong one;
* few: effects of the motion, at their usual size, in one run of the campaign alone, which tells some of them
  from others and some not: a single name must be the right one;
* none: a sound truck, where anything is a false alarm.

Even seeds drive the truck of the sample logs, odd ones a truck drawn at random. A set is *detected* where the
first gate rejects; *top-1* where what is added first is the truth; *in class* where the truth is added or in
the class of something that is added. What is judged is the decision of the loop as it stands at the end.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from improve_kept import Row, grow, kept_rows  # noqa: E402
from improve_runs import (  # noqa: E402
    OUTSIDE,
    TYPICAL,
    Injected,
    actuator_runs,
    drive_campaign,
    measured,
    motion_data,
    motion_layer,
    speeds,
    true_parameters,
    typical,
)

from ident.estimation.actuator_layer import ActuatorLayer  # noqa: E402
from ident.estimation.improvement import Improvement, Round, improve_layers  # noqa: E402
from ident.estimation.layer import Layer  # noqa: E402
from ident.results import Estimate  # noqa: E402
from ident.stages.improve import verdict_of  # noqa: E402
from ident.stages.improve_told import found_effects  # noqa: E402

KEPT = HERE / "results" / "improve_power.jsonl"
LEVEL, DRAWS = 0.05, 999
FACTORS = {"inside": (1.0, 2.0, 0.5), "outside": (1.0, 3.0), "few": (1.0,), "none": (0.0,)}
VERDICTS = ("adequate", "named", "equivalent", "unexplained")
ACTUATOR = (
    *("steering_column_play", "steering_rate_limit", "steering_dead_zone", "steering_friction"),
    *("steering_resonance", "command_quantisation", "command_hold", "speed_dependent_steering"),
    *("steering_asymmetry", "request_saturation"),
)
"""Effects that act between the request and the measured angle."""
SIGNALS = {
    "sensor_bias": ("yaw_rate", "lateral_acceleration", "lateral_velocity"),
    "sensor_latency": ("yaw_rate", "lateral_acceleration", "imu"),
}
"""What an effect may act on, where there is more than one; each seed takes the next."""
ALONE = ("slow_circles", "sweep_slow", "weave", "ramp_steer")
"""Runs of the campaign, of which one is all that there is."""
NAMED = {"road_bank", "antenna_offset"}
"""Effects of ``OUTSIDE`` that the loop has a name for."""


# --- one set ---------------------------------------------------------------------------------------


def cells(parts: Sequence[str], seeds: int, only: Sequence[str] | None = None) -> Iterator[list[Any]]:
    """Yield all sets: (part, effect, factor, seed), the first seeds and usual sizes of everything first."""
    motion = [name for name in TYPICAL if name not in ACTUATOR]
    names = {
        "inside": list(TYPICAL),
        "outside": list(OUTSIDE),
        "few": [f"{name} in {run}" for run in ALONE for name in motion],
        "none": ["motion", "actuator"],
    }
    for seed, rank in product(range(1, seeds + 1), range(max(len(one) for one in FACTORS.values()))):
        for part in parts:
            for factor in FACTORS[part][rank : rank + 1]:
                yield from (
                    [part, name, factor, seed]
                    for name in names[part]
                    if not only or name.partition(" in ")[0] in only
                )


def one_set(cell: Sequence[Any], runs: Sequence[str] | None = None) -> Iterable[Row]:
    """Drive, measure, run the loop; what it says, beside what is true.

    runs : of the campaign, all unless said
    """
    part, name, factor, seed = cell
    name, _, alone = name.partition(" in ")
    runs = [alone] if alone else runs
    injected = [] if part == "none" else [_injected(name, factor, seed)]
    began = time.perf_counter()
    try:
        layer = layer_of(injected, seed, actuator=name in (*ACTUATOR, "actuator"), names=runs)
        base = time.perf_counter()
        found = improve_layers([layer], level=LEVEL, draws=DRAWS, seed=seed)
        row = described(found, injected)
    except Exception as error:  # noqa: BLE001 - a set that fails is a result, too: it is told in the table
        return [{"error": f"{type(error).__name__}: {error}"}]
    return [{**row, "seconds": round(time.perf_counter() - base, 1), "made": round(base - began, 1)}]


def _injected(name: str, factor: float, seed: int) -> Injected:
    of = SIGNALS[name][seed % len(SIGNALS[name])] if name in SIGNALS else None
    return typical(name, factor, of)


def layer_of(
    injected: Sequence[Injected], seed: int, *, actuator: bool, names: Sequence[str] | None = None
) -> Layer:
    """Drive and measure a campaign; the actuator of it, or its motion."""
    driven = drive_campaign(injected, seed, truck="another" if seed % 2 else None, runs=names)
    runs = measured(driven, seed)
    if actuator:
        return ActuatorLayer(
            actuator_runs(runs, driven.truth),
            steering_ratio=driven.truth.planar.steering_ratio,
            speed=speeds(runs, driven.truth),
        )
    return motion_layer(motion_data(runs, driven.truth))


def described(found: Improvement, injected: Sequence[Injected]) -> Row:
    """What the loop came to."""
    true = true_parameters(injected)
    effects = found_effects(found, [])
    verdict, why = verdict_of(found)
    first, last = found.rounds[0].screen, found.rounds[-1].screen
    return {
        "truth": true,
        "verdict": verdict,
        "why": why,
        "same_in_runs": {one.key: one.same_in_runs_p for one in effects},
        "p_first": first.p_value,
        "strongest": first.strongest.key if first.strongest else None,
        "added": [key for _, key in found.added],
        "members": {key: list(found.members(key)) for _, key in found.added},
        "passes": found.passes,
        "rivals": [one.rival.key if one.rival else None for one in found.rounds],
        "rounds": [one.why for one in found.rounds],
        "left": last.strongest.key if last.strongest else None,
        "p_last": last.p_value,
        "scores": [_scores(one) for one in found.rounds],
        "estimates": {one.key: {n: _plain(e) for n, e in one.parameters.items()} for one in effects},
    }


def _scores(one: Round) -> list[list[Any]]:
    """Best candidates and generic terms of a round: key, statistic, gain."""
    gains = {tried.key: tried.gain for tried in one.tried}
    listed = sorted((g for g in one.screen.groups if g.untestable is None), key=lambda g: -g.statistic)[:8]
    return [[g.key, round(g.statistic, 1), gains.get(g.key)] for g in listed]


def _plain(one: Estimate) -> list[float | None]:
    return [one.value, one.std, one.low, one.high]


# --- what it comes to ------------------------------------------------------------------------------


def keys_of(row: Row) -> tuple[set[str], set[str]]:
    """What is true, and everything that the loop holds possible."""
    return set(row["truth"]), {key for members in row["members"].values() for key in members}


def summary(rows: Sequence[Row]) -> str:
    """Return one line for each effect and size."""
    failed = [row for row in rows if "error" in row]
    whole = [row for row in rows if "error" not in row]
    lines = [_inside(whole), _outside(whole), _few(whole), _none(whole)]
    lines += [f"{len(failed)} sets failed:" if failed else ""]
    lines += [f"  {row['cell']}: {row['error']}" for row in failed]
    return "\n".join(line for line in lines if line)


def _cells_of(rows: Sequence[Row], part: str) -> dict[tuple[str, float], list[Row]]:
    made: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        kind, name, factor, _ = row["cell"]
        if kind == part:
            made.setdefault((name, factor), []).append(row)
    return dict(sorted(made.items()))


def _inside(rows: Sequence[Row]) -> str:
    heads = (*("found", "top-1", "class", "size"), *("adeq.", "named", "equiv.", "unexpl.", "covers"))
    lines = [f"{'inside the catalogue':30}{'x':>4}{'n':>4}" + "".join(f"{head:>8}" for head in heads)]
    for (name, factor), own in _cells_of(rows, "inside").items():
        hit = [row for row in own if row["p_first"] <= LEVEL]
        top = sum(row["added"][:1] == list(row["truth"])[:1] for row in hit)
        inside = sum(bool(keys_of(row)[0] & keys_of(row)[1]) for row in hit)
        sizes = [len(row["members"][key]) for row in hit for key in row["added"][:1]]
        verdicts = [row["verdict"] for row in own]
        counts = "".join(f"{verdicts.count(one):>8}" for one in VERDICTS)
        held = [one for row in own if (one := holds(row)) is not None]
        lines.append(
            f"{name:30}{factor:>4g}{len(own):>4}{len(hit):>8}{top:>8}{inside:>8}"
            f"{np.median(sizes) if sizes else np.nan:>8.1f}{counts}{f'{sum(held)}/{len(held)}':>8}"
        )
    return "\n".join(lines) if len(lines) > 1 else ""


def holds(row: Row) -> bool | None:
    """Whether the interval of the size holds the truth, None where the truth was not added."""
    (key, parameters), *_ = row["truth"].items()
    size, value = next(iter(parameters.items()))
    own = row["estimates"].get(key, {})
    told = own.get(size) or next(iter(own.values()), None)
    if told is None or told[2] is None:
        return None
    return bool(told[2] <= value <= told[3])


def _outside(rows: Sequence[Row]) -> str:
    lines = [
        f"{'outside of it':30}{'x':>4}{'n':>4}{'found':>7}{'adeq.':>7}{'wrongly named':>15}{'unexpl.':>9}"
    ]
    for (name, factor), own in _cells_of(rows, "outside").items():
        wrong = [row for row in own if row["verdict"] in ("named", "equivalent") and wrong_names(row)]
        names = sorted({"+".join(wrong_names(row)) for row in wrong})
        verdicts = [row["verdict"] for row in own]
        hit = sum(row["p_first"] <= LEVEL for row in own)
        lines.append(
            f"{name:30}{factor:>4g}{len(own):>4}{hit:>7}{verdicts.count('adequate'):>7}{len(wrong):>15}"
            f"{verdicts.count('unexplained'):>9}  {', '.join(names)}"
        )
    return "\n".join(lines) if len(lines) > 1 else ""


def _few(rows: Sequence[Row]) -> str:
    """One line for each run that is all there is: what is named, singly, wrongly; the largest class."""
    rows = [row for row in rows if row["cell"][0] == "few"]
    heads = ("n", "found", "in class", "single", "wrong", "largest")
    lines = [f"{'one run alone':30}" + "".join(f"{head:>10}" for head in heads)]
    lines += [_one_run(run, [row for row in rows if row["cell"][1].endswith(f" in {run}")]) for run in ALONE]
    return "\n".join(lines) if rows else ""


def _one_run(run: str, rows: Sequence[Row]) -> str:
    hit = [row for row in rows if row["verdict"] in ("named", "equivalent")]
    single = [row for row in hit if all(len(one) == 1 for one in row["members"].values())]
    wrong = [row for row in hit if wrong_names(row)]
    inside = sum(bool(keys_of(row)[0] & keys_of(row)[1]) for row in hit)
    largest = max((len(one) for row in hit for one in row["members"].values()), default=0)
    names = [f"{row['cell'][1].partition(' in ')[0]} as {'+'.join(wrong_names(row))}" for row in wrong]
    found = sum(row["p_first"] <= LEVEL for row in rows)
    counts = (len(rows), found, inside, len(single), len(wrong), largest)
    return f"{run:30}" + "".join(f"{count:>10}" for count in counts) + f"  {', '.join(names)}"


def wrong_names(row: Row) -> list[str]:
    """What was added without the truth in its class: every such name is a wrong one, beside a right one, too.

    What is outside the catalogue may have a name in the loop, whatever signal that is told of.
    """
    true = set(row["truth"])
    if row["cell"][0] == "outside":
        true &= NAMED
        return [k for k, of in row["members"].items() if not true & {one.split()[0] for one in of}]
    return [key for key, members in row["members"].items() if not true & set(members)]


def _none(rows: Sequence[Row]) -> str:
    lines = []
    for (name, _), own in _cells_of(rows, "none").items():
        fired = sum(row["p_first"] <= LEVEL for row in own)
        wrong = sorted({"+".join(row["added"]) for row in own if row["added"]})
        lines.append(f"sound truck, {name}: n = {len(own)}, gate fires {fired}; {', '.join(wrong)}")
    return "\n".join(lines)


def main() -> None:
    """Run the sets that are not yet there, then print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4, help="of each cell")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--hours", type=float, help="after which nothing new is begun")
    parser.add_argument("--part", choices=list(FACTORS), action="append", help="all of them unless said")
    parser.add_argument("--only", action="append", help="of the effects")
    parser.add_argument("--kept", type=Path, default=KEPT)
    given = parser.parse_args()
    todo = cells(given.part or list(FACTORS), given.seeds, given.only)
    grow(given.kept, todo, one_set, jobs=given.jobs, hours=given.hours)
    print(summary(kept_rows(given.kept)))


if __name__ == "__main__":
    main()
