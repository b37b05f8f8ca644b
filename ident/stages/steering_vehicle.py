"""Which runs are looked at where the logs are of several vehicles: those of one of them.

Runs under different vehicle files are of different vehicles, and so are runs with such a file and runs
without. Where no run has one, all are taken for the same vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence

from ident.experiments.steering_data import PAIRS, steering_run
from ident.results import Pair, Refusal
from ident.signals.run import Run

OTHER_FILE = "its vehicle file says another vehicle: take its runs by themselves"
NO_FILE = "no vehicle file says that it is of the same vehicle: put one above its log too"


def runs_of_one_vehicle(runs: Sequence[Run], pair: Pair | None) -> tuple[list[Run], list[Refusal]]:
    """Return the runs of the vehicle that most usable runs are of, and why the others are left out.

    Parameters
    ----------
    pair : whose request must excite a run for it to be usable, None: either
    """
    if all(run.vehicle == runs[0].vehicle for run in runs):
        return list(runs), []
    usable = [run.vehicle for run in runs if _is_excited(run, pair)]
    if not usable:
        return list(runs), []  # no steering is identified from any: the reasons of all are told
    most = max(usable, key=usable.count)
    others = [
        Refusal(run.name, NO_FILE if run.vehicle is None else OTHER_FILE)
        for run in runs
        if run.vehicle != most
    ]
    return [run for run in runs if run.vehicle == most], others


def _is_excited(run: Run, pair: Pair | None) -> bool:
    found = [steering_run(run, one) for one in ([pair] if pair else PAIRS)]
    return any(not isinstance(one, str) and bool(one.excited) for one in found)
