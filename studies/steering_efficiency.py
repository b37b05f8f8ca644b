"""Does the likelihood reach the Cramér-Rao bound, and what do the step methods reach?

    python studies/steering_efficiency.py [--sets 1000] [--jobs 2]

Two parts, on data of the generator's exact actuator with the command held at a random phase of the samples:

* the likelihood on three rectangular pulses (5 s on, 2 s off), both sampled at 50 Hz, with white and with
  AR(1) 0.9 noise of 0.5 and 2 % of the step, from no start but the data: spread of the estimates over the
  bound, bias in standard deviations, coverage of the 95 % intervals;
* the reference of one step seen for 3 s at 50 Hz with white noise: bound and step methods side by side.

Every finished set is kept in studies/results/, so a study that was interrupted goes on where it stopped.
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
from bound import PARAMETERS, bound, derivatives  # noqa: E402
from generator.actuator import WheelState, held_response  # noqa: E402
from generator.sensors import errors  # noqa: E402
from generator.steering import SteeringSignals  # noqa: E402
from generator.truth import Actuator, Channel, Sensor, Steering  # noqa: E402

from ident.errors import NotIdentifiable  # noqa: E402
from ident.estimation.actuator_fit import steering_model  # noqa: E402
from ident.estimation.actuator_runs import RunRecords, fit_together  # noqa: E402
from ident.estimation.step_methods import modified_harriott, modified_harriott_iterated  # noqa: E402
from ident.estimation.step_response import StepRecord  # noqa: E402
from ident.experiments.stretches import find_stretches  # noqa: E402
from ident.stages.steering import actuator_record  # noqa: E402

KEPT = HERE / "results" / "steering_efficiency.jsonl"
ACTUATOR = Actuator(gain=1.0, dead_time=0.12, time_constant_1=0.25, time_constant_2=0.08)
TRUE = np.array([float(np.real(getattr(ACTUATOR, name))) for name in PARAMETERS])
PERIOD = 0.02
ON, OFF, PULSES = 5.0, 2.0, 3
CELLS = [(colour, share) for colour in ("white", "ar1") for share in (0.005, 0.02)]
METHODS = {"modified_harriott": modified_harriott, "iterated": modified_harriott_iterated}


def steering(colour: str, share: float) -> Steering:
    """Actuator and sensor of one cell; the step is 1 rad."""
    noise = {"white_std": share} if colour == "white" else {"noise_std": share, "noise_ar": (0.9,)}
    angle = Sensor(1 / PERIOD, 0.0, {"angle": Channel(**noise)})
    return Steering(ACTUATOR, Sensor(1 / PERIOD, 0.0, {}), angle)


def signals(
    truth: Steering, pulses: int, before: float, after: float, random: np.random.Generator
) -> SteeringSignals:
    """Pulses of 1 rad at 50 Hz; the last one, or the only step, is seen for ``after`` seconds."""
    end = before + (pulses - 1) * (ON + OFF) + after
    sent_time = np.arange(-1.0, end, PERIOD) + random.uniform(0, PERIOD)
    since = sent_time - before
    sent = np.where((since >= 0) & (since % (ON + OFF) < ON), 1.0, 0.0)
    time = np.arange(0.0, end, PERIOD)
    rest = WheelState(float(sent_time[0]), 0.0, 0.0, 0.0)
    true, _ = held_response(truth.actuator, sent_time, sent, time, rest)
    measured = true + errors(truth.angle.channels["angle"], time.size, random)
    heard = sent_time >= 0
    return SteeringSignals(sent_time, sent, sent_time[heard], sent[heard], time, measured, true)


def one_set(task: tuple[str, float, int]) -> dict[str, object]:
    """Identify one set of pulses; estimates, intervals and the bound."""
    colour, share, seed = task
    truth = steering(colour, share)
    data = signals(truth, PULSES, OFF, ON + OFF, np.random.default_rng([seed, CELLS.index((colour, share))]))
    stretches = find_stretches(data.request_time, data.request, data.angle_time, data.angle)
    fit, _, _ = fit_together([RunRecords("pulses", [actuator_record(stretch) for stretch in stretches])])
    model = steering_model(fit.fit)
    estimates = [getattr(model, name) for name in PARAMETERS]
    return {
        "cell": [colour, share],
        "seed": seed,
        "value": [one.value for one in estimates],
        "interval": [[one.low, one.high] for one in estimates],
        "bound": [float(x) for x in np.sqrt(np.diag(bound([data], truth)))],
    }


def likelihood_table(kept: list[dict[str, object]]) -> str:
    """Spread over bound, bias over spread and coverage, a row each cell and parameter."""
    lines = [
        (
            f"{'noise':6}{'size':>7}{'n':>6}  {'parameter':16}"
            f"{'spread/bound':>13}{'bias/std':>10}{'95 % cover':>11}"
        )
    ]
    for colour, share in CELLS:
        own = [one for one in kept if one["cell"] == [colour, share]]
        if len(own) < 2:
            continue
        value, bounds = (np.array([one[key] for one in own], dtype=float) for key in ("value", "bound"))
        interval = np.array([one["interval"] for one in own], dtype=float)
        for i, name in enumerate(PARAMETERS):
            spread = np.nanstd(value[:, i], ddof=1)
            bias = (np.nanmean(value[:, i]) - TRUE[i]) / spread
            inside = np.mean((interval[:, i, 0] <= TRUE[i]) & (TRUE[i] <= interval[:, i, 1]))
            lines.append(
                f"{colour:6}{100 * share:>6.1f}%{len(own):>6}  {name:16}"
                f"{spread / np.sqrt(np.mean(bounds[:, i] ** 2)):>13.3f}{bias:>10.3f}{inside:>11.3f}"
            )
    return "\n".join(lines)


def step_table(sets: int) -> str:
    """Standard deviations of L [ms], T1 and T2 [%] on one step seen for 3 s, beside the bound."""
    lines = [f"one step, 3 s, 50 Hz, white noise, n = {sets}: standard deviation of L [ms] / T1 [%] / T2 [%]"]
    for share in (0.005, 0.02):
        truth = steering("white", share)
        random = np.random.default_rng(0)
        data = [signals(truth, 1, 0.5, 3.0, random) for _ in range(sets)]
        after = data[0].angle_time >= 0.5
        information = derivatives(data[0], ACTUATOR)[after] / share
        smallest = np.sqrt(np.diag(np.linalg.inv(information.T @ information)))
        lines.append(f"{100 * share:.1f} %  bound              {_row(smallest)}")
        for name, method in METHODS.items():
            found, refused = [], 0
            for one in data:
                start = one.sent_time[np.argmax(one.sent > 0)]
                try:
                    model = method(StepRecord(one.angle_time - start, one.angle, 1.0))
                except NotIdentifiable:
                    refused += 1
                    continue
                found.append([model.gain, model.dead_time, model.time_constant_1, model.time_constant_2])
            values = np.array(found, dtype=float)
            bias = " / ".join(f"{x:+.1f}" for x in _scaled(values.mean(axis=0) - TRUE))
            lines.append(
                f"{100 * share:.1f} %  {name:18} {_row(values.std(axis=0))}   bias {bias}   refused {refused}"
            )
    return "\n".join(lines)


def _scaled(error: np.ndarray) -> np.ndarray:
    return np.array([1e3 * error[1], 100 * error[2] / TRUE[2], 100 * error[3] / TRUE[3]])


def _row(spread: np.ndarray) -> str:
    return " / ".join(f"{x:.1f}" for x in _scaled(spread))


def main() -> None:
    """Run the sets that are not yet there, then print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    KEPT.parent.mkdir(exist_ok=True)
    kept = [json.loads(line) for line in KEPT.read_text().splitlines()] if KEPT.exists() else []
    done = {(*one["cell"], one["seed"]) for one in kept}
    tasks = [(*cell, seed) for seed in range(options.sets) for cell in CELLS]
    left = [task for task in tasks if task not in done]
    with ProcessPoolExecutor(options.jobs) as pool, KEPT.open("a") as file:
        for result in pool.map(one_set, left, chunksize=4):
            file.write(json.dumps(result) + "\n")
            file.flush()
            kept.append(result)
    print(likelihood_table(kept))
    print(step_table(options.sets))


if __name__ == "__main__":
    main()
