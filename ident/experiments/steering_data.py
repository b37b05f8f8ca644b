"""The steering data of a run: request and measured angle on raw stamps, wherever the request is followed.

The two are either of the steering wheel or of the road wheel. Where a run tells that the controller was not
engaged, or that the driver overrode it, the actuator does not follow the request: those parts are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.experiments.find import find_experiments
from ident.experiments.found import Found
from ident.experiments.stretches import Stretch, find_stretches
from ident.glossary import STEERING_PAIRS
from ident.results import Pair
from ident.signals.run import Run, Signal

Array = NDArray[np.float64]

PAIRS: tuple[Pair, ...] = ("steering_wheel", "road_wheel")


@dataclass(frozen=True)
class SteeringRun:
    """One run with both signals of the pair.

    experiments : one list a stretch
    constant : whether the request never changes where it is followed
    """

    name: str
    request: Signal
    measured: Signal
    stretches: list[Stretch]
    experiments: list[list[Found]]

    @property
    def excited(self) -> list[int]:
        """Indices of the stretches in which the request excites the actuator."""
        return [i for i, stretch in enumerate(self.stretches) if stretch.excited]


def choose_pair(runs: Sequence[Run]) -> Pair:
    """Choose the pair that most runs have, the steering wheel's where both are as frequent.

    Raises
    ------
    NotIdentifiable
        If no run has both request and measured angle of either, saying what there is.
    """
    counts = {pair: sum(_has(run, pair) for run in runs) for pair in PAIRS}
    best = max(PAIRS, key=lambda pair: counts[pair])
    if counts[best]:
        return best
    wanted = [name for pair in PAIRS for name in STEERING_PAIRS[pair]]
    there = sorted({name for run in runs for name in wanted if name in run.signals})
    raise NotIdentifiable(
        f"no steering request with a measured angle in {_count(len(runs), 'run')}: found "
        f"{', '.join(there) or 'neither'}, need steering_wheel_request and steering_wheel_angle (or "
        "road_wheel_request and road_wheel_angle): name their topics in channels.yaml (`ident init` writes "
        "a first one)"
    )


def _has(run: Run, pair: Pair) -> bool:
    return all(name in run.signals for name in STEERING_PAIRS[pair])


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def steering_run(run: Run, pair: Pair) -> SteeringRun | str:
    """Steering data of a run, or the reason why it has none."""
    names = STEERING_PAIRS[pair]
    missing = [name for name in names if name not in run.signals]
    if missing:
        return f"no {' and no '.join(missing)}"
    request, measured = (run.signals[name] for name in names)
    raw = [signal.name for signal in (request, measured) if signal.raw]
    if raw:
        return f"{raw[0]} is a raw count: give its unit in channels.yaml"
    stretches = find_stretches(
        request.time, request.values, measured.time, measured.values, enabled=_followed(run)
    )
    if not stretches:
        return "request and measured angle never overlap while the request is followed"
    experiments = [find_experiments(stretch) for stretch in stretches]
    found = SteeringRun(run.name, request, measured, stretches, experiments)
    if found.excited and all(np.ptp(stretch.measured) == 0 for stretch in stretches):
        return f"the measured angle stays at {stretches[0].measured[0]:.4g} rad while the request changes"
    return found


def why_not_excited(run: SteeringRun) -> str:
    """Say why a run without excitation is of no use."""
    values = np.concatenate([stretch.command_values for stretch in run.stretches])
    low, high = float(values.min()), float(values.max())
    level = f"{low:.4g} rad" if low == high else f"constant in each part ({low:.4g} to {high:.4g} rad)"
    return f"the request is constant: {level}"


def _followed(run: Run) -> list[tuple[float, float]] | None:
    """Intervals in which the controller was engaged and the driver did not override it."""
    parts = [
        _true_between(run, name, invert=name == "driver_override") for name in ("engaged", "driver_override")
    ]
    told = [part for part in parts if part is not None]
    if not told:
        return None
    common = told[0]
    for other in told[1:]:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in other if max(a, c) < min(b, d)]
    return common


def _true_between(run: Run, name: str, *, invert: bool) -> list[tuple[float, float]] | None:
    signal = run.signals.get(name)
    if signal is None or signal.time.size == 0:
        return None
    on = (signal.values > 0.5) != invert
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    ends = np.append(signal.time, np.inf)
    return [(float(signal.time[a]), float(ends[b])) for a, b in edges.reshape(-1, 2)]
