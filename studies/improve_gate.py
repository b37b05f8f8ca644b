"""How often the gate fires on noise, by the kind of noise and the amount of data, and how often it finds an
effect.

    python studies/improve_gate.py [--trucks 25] [--sets 20] [--out studies/results/improve_gate.json]

Each truck has its own runs and directions; its sets share them, and the whitening of its first noise. The
study can be stopped and goes on where it was: what is done is in the file.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from score_sets import NOISES, Truck, drawn, truck, whitened

from ident.estimation.detectable import detectable_sizes
from ident.estimation.residual_tests import screen

AMOUNTS = {"8 runs of 40 s": (8, 40.0), "3 runs of 20 s": (3, 20.0)}
EFFECTS = ("relaxation", "rate limit", "latency yaw_rate", "roll")


def false_alarms(of: Truck, kind: str, sets: int, seed: int) -> list[float]:
    """P-values of the gate on noise alone."""
    random = np.random.default_rng(seed)
    rows = whitened(of, drawn(random, of, kind))
    return [screen([rows.scores(drawn(random, of, kind))], seed=k).p_value for k in range(sets)]


def found(of: Truck, kind: str, sets: int, seed: int) -> dict[str, float]:
    """Share of sets in which the gate fires on an effect as large as it says that it finds, at power 0.85."""
    random = np.random.default_rng(seed)
    noise = drawn(random, of, kind)
    rows = whitened(of, noise)
    sizes = detectable_sizes(screen([rows.scores(noise)]))
    directions, groups = of.directions
    out = {}
    for group in groups:
        size = sizes.get(("motion", group.key), np.inf)
        if group.key in EFFECTS and np.isfinite(size):
            column = group.shapes[len(group.shapes) // 2].columns[0]
            added = size * directions[:, column].reshape(2, -1).T
            tests = [screen([rows.scores(drawn(random, of, kind) + added)], seed=k) for k in range(sets)]
            out[group.key] = float(np.mean([one.rejected for one in tests]))
    return out


def main() -> None:
    """Run what is not done yet and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--trucks", type=int, default=25)
    options.add_argument("--sets", type=int, default=20)
    options.add_argument("--out", type=Path, default=Path("studies/results/improve_gate.json"))
    given = options.parse_args()
    done = json.loads(given.out.read_text()) if given.out.exists() else {}
    for amount, (runs, seconds) in AMOUNTS.items():
        for number in range(given.trucks):
            of = None
            for kind in NOISES:
                key = f"{amount} | {kind} | {number}"
                if key in done:
                    continue
                of = of or truck(np.random.default_rng(number), runs, seconds)
                done[key] = {"p_values": false_alarms(of, kind, given.sets, 1000 + number)}
                if number < 3:
                    done[key]["found"] = found(of, kind, given.sets, 5000 + number)
                given.out.parent.mkdir(parents=True, exist_ok=True)
                given.out.write_text(json.dumps(done, indent=1))
    _tell(done)


def _tell(done: dict[str, dict[str, object]]) -> None:
    for amount in AMOUNTS:
        for kind in NOISES:
            own = [value for key, value in done.items() if key.startswith(f"{amount} | {kind} |")]
            p_values = np.array([p for one in own for p in one["p_values"]])
            power = [share for one in own for share in one.get("found", {}).values()]
            seen = f"{np.mean(power):.2f}" if power else "-"
            print(
                f"{amount:16s} {kind:18s} n = {p_values.size:5d}: fires at 5 % in "
                f"{np.mean(p_values <= 0.05):.3f}, at 1 % in {np.mean(p_values <= 0.01):.3f}; finds in {seen}"
            )


if __name__ == "__main__":
    main()
