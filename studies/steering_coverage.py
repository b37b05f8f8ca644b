"""Do the intervals of the steering parameters hold, and are they as narrow as the data allows?

    python studies/steering_coverage.py [--seeds 200] [--jobs 2]

The four steering runs of the sample logs (a lost command, a lost measurement, a gap, a step hidden before the
log begins, coloured and quantised noise) are generated again for each seed and identified together. For each
parameter the study gives how often the 99 % and the 95 % interval hold the truth, and the width of the
interval over that of the Cramér-Rao bound. Every finished seed is kept in studies/results/, so a study that
was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "sample_logs")]

import numpy as np  # noqa: E402
from bound import PARAMETERS, bound  # noqa: E402
from generator.steering import STEERING_TESTS, SteeringSignals, steering_signals  # noqa: E402
from generator.truth import load_truth  # noqa: E402
from scipy.stats import norm  # noqa: E402

from ident.estimation.actuator_fit import steering_model  # noqa: E402
from ident.estimation.actuator_runs import RunRecords, fit_together  # noqa: E402
from ident.experiments.stretches import find_stretches, jitter_of  # noqa: E402
from ident.stages.steering import actuator_record  # noqa: E402

KEPT = HERE / "results" / "steering_coverage.jsonl"
Z_99, Z_95 = norm.ppf(0.995), norm.ppf(0.975)


def records(name: str, signals: SteeringSignals) -> RunRecords:
    """Return the records of a run, found in it as in a log."""
    stretches = find_stretches(signals.request_time, signals.request, signals.angle_time, signals.angle)
    excited = [actuator_record(stretch) for stretch in stretches if stretch.excited]
    return RunRecords(name, excited, jitter_of(signals.angle_time))


def one_seed(seed: int) -> dict[str, object]:
    """Identify the steering runs of one seed; values, standard errors and the bound of each parameter."""
    truth = load_truth().steering
    runs = {name: steering_signals(name, truth, seed) for name in STEERING_TESTS}
    fit, _, hidden = fit_together([records(name, signals) for name, signals in runs.items()])
    model = steering_model(fit.fit)
    estimates = [getattr(model, name) for name in PARAMETERS]
    return {
        "seed": seed,
        "value": [one.value for one in estimates],
        "std": [one.std for one in estimates],
        "interval_95": [[one.low, one.high] for one in estimates],
        "bound": [float(x) for x in np.sqrt(np.diag(bound(list(runs.values()), truth)))],
        "hidden": len(hidden),
        "converged": bool(fit.fit.converged),
    }


def summary(results: list[dict[str, object]]) -> str:
    """Coverage and relative width of every parameter."""
    truth = load_truth().steering.actuator
    value, std, bounds = (
        np.array([r[key] for r in results], dtype=float) for key in ("value", "std", "bound")
    )
    interval = np.array([r["interval_95"] for r in results], dtype=float)
    lines = [f"n = {len(results)}, converged {sum(bool(r['converged']) for r in results)}"]
    lines.append(
        f"{'':18}{'99 % cover':>11}{'95 % cover':>11}{'width/bound':>12}{'spread/bound':>13}{'bias/std':>9}"
    )
    for i, name in enumerate(PARAMETERS):
        true = float(np.real(getattr(truth, name)))
        error = value[:, i] - true
        cover_99 = np.mean(np.abs(error) <= Z_99 * std[:, i])
        cover_95 = np.mean((interval[:, i, 0] <= true) & (true <= interval[:, i, 1]))
        width = (interval[:, i, 1] - interval[:, i, 0]) / (2 * Z_95 * bounds[:, i])
        spread, bias = value[:, i].std(ddof=1) / bounds[:, i].mean(), error.mean() / value[:, i].std(ddof=1)
        lines.append(
            f"{name:18}{cover_99:>11.3f}{cover_95:>11.3f}{width.max():>12.3f}{spread:>13.3f}{bias:>9.3f}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the seeds that are not yet there, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    KEPT.parent.mkdir(exist_ok=True)
    kept = [json.loads(line) for line in KEPT.read_text().splitlines()] if KEPT.exists() else []
    left = [seed for seed in range(1, options.seeds + 1) if seed not in {one["seed"] for one in kept}]
    with ProcessPoolExecutor(options.jobs) as pool, KEPT.open("a") as file:
        for result in pool.map(one_seed, left):
            file.write(json.dumps(result) + "\n")
            file.flush()
            kept.append(result)
    print(summary(kept))


if __name__ == "__main__":
    main()
