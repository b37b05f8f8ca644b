"""Figures of handling, measured and simulated by the same functions on the same data.

The figures are in the style of ISO 14792 (steady cornering) and ISO 14793 (transient driving). The tests of
those standards have prescribed manoeuvres; these figures come from whatever was driven.

The outputs of a model take the place of the measured signals, at the same stamps. Where and when the driving
is steady, and where steps are, is decided by the measured steering and speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ident.estimation.evaluation import Prediction, Segments
from ident.estimation.handling import (
    Drive,
    Figure,
    SteadyStates,
    drives,
    end_of_linear_range,
    speed_classes,
    std_of_difference,
    steady,
    steady_states,
    understeer_gradient,
    yaw_rate_gain,
)
from ident.estimation.handling_transient import (
    DELAY_AT,
    FREQUENCIES,
    equivalent_delay,
    find_steps,
    response,
    response_time,
    stretches,
)
from ident.estimation.tyre_fit import Body
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.results import Characteristic, Estimate

Mask = NDArray[np.bool_]
Style = Literal["ISO 14792", "ISO 14793"]

TOLERANCE = 0.1
Z = 1.96
UNITS = {"yaw_rate": "1/s", "lateral_acceleration": "m/s^2/rad"}


@dataclass(frozen=True)
class _Plan:
    """What is computed of any motion, decided by the measured one.

    steady : of each stretch; steps : of each stretch; speeds : of the steady gain
    classes : class of speed of the spectra -> mean speed in it
    """

    wheelbase: float
    steady: list[Mask]
    steps: list[list[int]]
    speeds: list[float]
    classes: dict[float, float]
    is_felt: bool


def characteristics(
    segments: Segments,
    predictions: Mapping[str, Prediction],
    body: Body,
    tolerance: Mapping[str, float] | float = TOLERANCE,
) -> list[Characteristic]:
    """Figures of handling of the vehicle and of each model.

    Parameters
    ----------
    segments : whole stretches, which must not overlap
    predictions : model -> what it predicts on them
    tolerance : relative, of all figures or by how their names begin; of a phase it is the difference [rad],
        because 0.1 rad across the response is as large as 10 % along it

    Notes
    -----
    A figure that the measured motion does not tell is not identifiable, with the reason. Whether a model is
    within the tolerance is left open where the difference is not certain enough to say; what driving that is
    not steady, or noise of the steering, adds to both figures alike is not in their difference.
    """
    measured = drives(segments.records, body)
    if not measured:
        return []
    plan = _plan(measured, body.wheelbase)
    own = _figures(measured, plan)
    simulated = {
        name: _figures(drives(_as_records(segments, one), body), plan) for name, one in predictions.items()
    }
    return [
        _characteristic(
            name, style, known, {model: figures[name][1] for model, figures in simulated.items()}, tolerance
        )
        for name, (style, known) in own.items()
    ]


def _as_records(segments: Segments, prediction: Prediction) -> list[MotionRecord]:
    """The segments with the outputs of a model in place of the measured signals, at the same stamps."""
    offsets = segments.windows.offsets
    made = []
    for number, record in enumerate(segments.records):
        own = slice(int(offsets[number]), int(offsets[number + 1]))
        measured = {
            name: Samples(one.times, np.interp(one.times, record.times, prediction.outputs[name][own]))
            for name, one in record.measured.items()
            if name in prediction.outputs
        }
        made.append(replace(record, measured=measured))
    return made


def _plan(measured: Sequence[Drive], wheelbase: float) -> _Plan:
    masks = [steady(one, wheelbase) for one in measured]
    found = stretches(measured)
    most = max(found, key=lambda speed: len(found[speed]), default=None)
    kept = {
        one: float(np.mean([drive.speed[part].mean() for drive, part in found[one]]))
        for one in sorted(found)
        if one == most or any(_is_known(found[one], at) for at in FREQUENCIES)
    }
    return _Plan(
        wheelbase,
        masks,
        [find_steps(one) for one in measured],
        speed_classes(steady_states(measured, masks)),
        kept,
        all(one.is_felt for one in measured),
    )


def _is_known(parts: Sequence[tuple[Drive, slice]], frequency: float) -> bool:
    return response(parts, "yaw_rate", frequency).reason is None


def _figures(motion: Sequence[Drive], plan: _Plan) -> dict[str, tuple[Style, Figure]]:
    """Name -> style and estimate."""
    states = steady_states(motion, plan.steady)
    made: dict[str, tuple[Style, Figure]] = {}
    for name, one in _of_steady_cornering(states, plan).items():
        made[name] = ("ISO 14792", one)
    for name, one in _of_transients(motion, plan).items():
        made[name] = ("ISO 14793", one)
    return made


def _of_steady_cornering(states: SteadyStates, plan: _Plan) -> dict[str, Figure]:
    gains = {
        f"steady yaw-rate gain at {speed:g} m/s": yaw_rate_gain(states, plan.wheelbase, speed)
        for speed in plan.speeds
    }
    return {
        "understeer gradient": understeer_gradient(states, plan.wheelbase),
        **gains,
        "end of the linear range": end_of_linear_range(states, plan.wheelbase),
    }


def _of_transients(motion: Sequence[Drive], plan: _Plan) -> dict[str, Figure]:
    made: dict[str, Figure] = {}
    found = stretches(motion)
    signals = ("yaw_rate", "lateral_acceleration") if plan.is_felt else ("yaw_rate",)
    for number, speed in plan.classes.items():
        for signal in signals:
            words = signal.replace("_", " ")
            for at in FREQUENCIES:
                where = f"at {at:g} Hz, {speed:.1f} m/s"
                gain, phase = response(found[number], signal, at).estimates(UNITS[signal])
                made[f"{words} gain {where}"] = gain
                made[f"{words} phase {where}"] = phase
        delay = equivalent_delay(response(found[number], "yaw_rate", DELAY_AT))
        made[f"equivalent yaw-rate delay at {speed:.1f} m/s"] = delay
    if any(plan.steps):
        made["response time of the yaw rate to steps"] = response_time(motion, plan.steps)
    return made


def _characteristic(
    name: str,
    style: Style,
    measured: Figure,
    simulated: dict[str, Figure],
    tolerance: Mapping[str, float] | float,
) -> Characteristic:
    allowed = tolerance if isinstance(tolerance, float | int) else _for_name(name, tolerance)
    told = {model: _agrees(measured, one, allowed) for model, one in simulated.items()}
    within = {model: verdict for model, verdict in told.items() if verdict is not None}
    plain = {model: _plain(one) for model, one in simulated.items()}
    return Characteristic(name, style, _plain(measured), plain, float(allowed), within)


def _plain(one: Figure) -> Estimate:
    return Estimate(one.value, one.std, one.low, one.high, one.unit, one.status, one.reason)


def _for_name(name: str, tolerance: Mapping[str, float]) -> float:
    """Of the keys that the name begins with the longest counts."""
    fitting = [key for key in tolerance if name.startswith(key)]
    return tolerance[max(fitting, key=len)] if fitting else TOLERANCE


def _agrees(measured: Figure, simulated: Figure, tolerance: float) -> bool | None:
    """Whether two figures are within a tolerance of each other; None where their errors leave it open."""
    if measured.value is None or simulated.value is None:
        return None
    allowed = tolerance * (1.0 if measured.unit == "rad" else abs(measured.value))
    difference = abs(simulated.value - measured.value)
    doubt = Z * std_of_difference(measured, simulated)
    if difference <= allowed:
        return None if doubt > allowed else True
    return False if difference - doubt > allowed else None
