"""The measured motion of a run, cleaned: what the model's outputs are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.experiments.held_samples import held, without_held
from ident.experiments.jumps import Jumps, heading_jumps, position_jumps
from ident.experiments.plausibility import yaw_rate_is_derived
from ident.signals.alignment import interpolate, longest_bridge, low_pass
from ident.signals.signal import Run, Signal
from ident.vehicle import Vehicle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MEASURED = ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading", "position_x", "position_y")
POSITION = ("position_x", "position_y")
AT_REFERENCE = (*POSITION, "lateral_velocity")
LARGEST = {"yaw_rate": 3.0, "lateral_acceleration": 30.0, "lateral_velocity": 20.0}
THIN_ABOVE = 1.5  # times the rate of the grid
NEAR_JUMP = 0.1  # [s], the derivative is taken over 0.15 s
MOST_CUT = 0.3  # share of the time that the cuts of one signal may cost


@dataclass(frozen=True)
class Reference:
    """What the samples are judged against.

    grid : (m,) uniform [s]; angle, speed : (m,) road-wheel angle [rad], speed [m/s], NaN where unknown
    """

    grid: Array
    angle: Array
    speed: Array
    vehicle: Vehicle | None
    least_speed: float
    rate: float
    max_gap: float

    def speed_at(self, times: Array) -> Array:
        """Speed (n,) at samples, NaN where unknown [m/s]."""
        return interpolate(self.grid, self.speed, times, self.max_gap)

    def moving(self, times: Array) -> Mask:
        """Where (n,) the vehicle moves fast enough."""
        return np.asarray(np.nan_to_num(self.speed_at(times)) >= self.least_speed)

    def turning_at(self, times: Array) -> Array | None:
        """Yaw rate (n,) that the steering makes expect, v tan(δ)/L; None without the wheelbase."""
        wheelbase = self.vehicle.wheelbase if self.vehicle else None
        if wheelbase is None:
            return None
        return interpolate(self.grid, self.speed * np.tan(self.angle) / wheelbase, times, self.max_gap)


@dataclass(frozen=True)
class Measured:
    """The measured signals of a run.

    cuts : (n, 2) from, to [s]: jumps that no window may reach across
    reference_x : x of the point that position and velocity refer to, from the CG [m]
    reference_known : whether that point was stated, or nothing refers to it
    """

    signals: list[Signal]
    cuts: Array
    reference_x: float
    reference_known: bool
    rejected: list[str]
    notes: list[str]


def measured_signals(run: Run, wrong: Mapping[str, str], reference: Reference) -> Measured:
    """Clean the measured motion of a run.

    Parameters
    ----------
    wrong : signal -> why it is not used
    """
    signals, rejected = _kept(run, wrong, reference)
    reference_x, notes, misplaced = _reference_x(run, signals)
    rejected += [f"{name}: {reason}" for name, reason in misplaced.items()]
    signals = {name: signal for name, signal in signals.items() if name not in misplaced}
    if "lateral_velocity" in signals:
        signals |= _moved(signals, reference_x, run.vehicle)
    derived = signals.pop("yaw_rate") if yaw_rate_is_derived(run) and "yaw_rate" in signals else None
    cuts = []
    for clean in (_clean_heading, _clean_position):
        told, cut, jumps = clean(signals, reference)
        rejected += told
        cuts.append(cut)
        if clean is _clean_heading and derived is not None:
            rejected += _with_derived(signals, derived, jumps)
    thinned = [_thinned(signal, reference.rate, reference.max_gap) for signal in signals.values()]
    known = all(signal.at is not None for signal in thinned if signal.name in AT_REFERENCE)
    return Measured(thinned, np.concatenate(cuts), reference_x, known, rejected, notes)


def _kept(run: Run, wrong: Mapping[str, str], reference: Reference) -> tuple[dict[str, Signal], list[str]]:
    """Signals in a unit, without held samples and without impossible values."""
    signals: dict[str, Signal] = {}
    told = []
    for name in MEASURED:
        signal = run.signals.get(name)
        if signal is None or name in wrong:
            continue
        if signal.raw:
            told.append(f"{name}: a raw count: give its unit in channels.yaml")
            continue
        if name not in POSITION:
            signal, note = without_held(signal, reference.moving(signal.time), rest_counts=False)
            told += [note] if note else []
        signals[name], note = _possible(signal)
        told += [note] if note else []
    if not _is_position(signals):
        lost = [name for name in POSITION if signals.pop(name, None) is not None]
        told += [f"{name}: left out, x and y of a position need the same stamps" for name in lost]
        return signals, told
    return signals | _without_held_position(signals, reference), told


def _is_position(signals: Mapping[str, Signal]) -> bool:
    return all(name in signals for name in POSITION) and np.array_equal(
        signals[POSITION[0]].time, signals[POSITION[1]].time
    )


def _possible(signal: Signal) -> tuple[Signal, str | None]:
    largest = LARGEST.get(signal.name, np.inf)
    fine = np.abs(signal.values) <= largest
    count = int(np.count_nonzero(~fine))
    if not count:
        return signal, None
    worst = float(np.max(np.abs(signal.values)))
    note = (
        f"{signal.name}: {count} samples up to {worst:.3g} {signal.unit} left out, need at most {largest:g}"
    )
    return _select(signal, fine), note


def _select(signal: Signal, mask: Mask) -> Signal:
    arrival = None if signal.arrival is None else signal.arrival[mask]
    return replace(signal, time=signal.time[mask], values=signal.values[mask], arrival=arrival)


def _without_held_position(signals: Mapping[str, Signal], reference: Reference) -> dict[str, Signal]:
    """A position is held where both parts are."""
    x, y = (signals[name] for name in POSITION)
    moving = reference.moving(x.time)
    together = held(x.values, moving) | held(y.values, moving)
    drop = together & (np.diff(x.values, prepend=np.nan) == 0) & (np.diff(y.values, prepend=np.nan) == 0)
    return {name: _select(signals[name], ~drop) for name in POSITION}


# --- the point that pose and velocity refer to ----------------------------------------------------


def _reference_x(run: Run, signals: Mapping[str, Signal]) -> tuple[float, list[str], dict[str, str]]:
    """Its x from the CG [m], what was assumed, and what cannot be used without knowing it."""
    there = [name for name in AT_REFERENCE if name in signals]
    if not there:
        return 0.0, [], {}
    at = signals[there[0]].at
    if at is None:
        note = (
            "the point that position and lateral velocity refer to is not said (state reference_point in "
            "vehicle.yaml)"
        )
        return 0.0, [note], {}
    if at == "cg":
        return 0.0, [], {}
    rear = run.vehicle.cg_to_rear_axle if run.vehicle else None
    if rear is None:
        reason = "refers to the rear axle, and cg_to_rear_axle is not known: state it in vehicle.yaml"
        return 0.0, [], dict.fromkeys(there, reason)
    return -rear, [], {}


def _moved(signals: Mapping[str, Signal], reference_x: float, vehicle: Vehicle | None) -> dict[str, Signal]:
    """Lateral velocity at the point of the position: v_y,P = v_y,Q + (x_P - x_Q) r."""
    signal, rate = signals["lateral_velocity"], signals.get("yaw_rate")
    rear = (vehicle.cg_to_rear_axle if vehicle else None) or 0.0
    own = -rear if signal.at == "rear_axle" else 0.0
    if signal.at is None or own == reference_x or rate is None:
        return {}
    turning = np.interp(signal.time, rate.time, low_pass(rate.time, rate.values, 25.0, 0.2))
    return {"lateral_velocity": replace(signal, values=signal.values + (reference_x - own) * turning)}


# --- jumps ----------------------------------------------------------------------------------------


Cleaned = tuple[list[str], Array, Array]  # what is told, the cuts (n, 2) [s], when there are jumps (m,) [s]
NOTHING: Cleaned = ([], np.empty((0, 2)), np.empty(0))


def _clean_heading(signals: dict[str, Signal], reference: Reference) -> Cleaned:
    """Take outliers out of the heading, or the whole of it."""
    heading = signals.get("heading")
    if heading is None or len(heading.time) < 3:
        return NOTHING
    turning = _turning(signals, heading.time, reference)
    found = heading_jumps(heading, reference.moving(heading.time), turning)
    return (*_apply(signals, ("heading",), found, reference), found.times(heading.time))


def _clean_position(signals: dict[str, Signal], reference: Reference) -> Cleaned:
    """Take outliers out of the position, or the whole of it."""
    if POSITION[0] not in signals or len(signals[POSITION[0]].time) < 3:
        return NOTHING
    x, y = (signals[name] for name in POSITION)
    found = position_jumps(x, y.values, reference.moving(x.time), _velocity(signals, x.time, reference))
    return (*_apply(signals, POSITION, found, reference), found.times(x.time))


def _with_derived(signals: dict[str, Signal], rate: Signal, jumps: Array) -> list[str]:
    """Use a yaw rate that is the derivative of the heading only where the heading itself is not compared.

    Both together would count the same samples twice. Near a jump of the heading it is no rate.
    """
    if "heading" in signals:
        return ["yaw_rate: not compared, it is the derivative of the heading, which is"]
    after = np.searchsorted(jumps, rate.time - NEAR_JUMP)
    before = np.searchsorted(jumps, rate.time + NEAR_JUMP)
    signals["yaw_rate"] = _select(rate, before == after)
    return [f"yaw_rate: {np.count_nonzero(before != after)} samples near jumps of the heading left out"]


def _turning(signals: Mapping[str, Signal], times: Array, reference: Reference) -> Array | None:
    """Yaw rate at samples, measured or by the steering; None where neither is known."""
    rate = signals.get("yaw_rate")
    if rate is None:
        return reference.turning_at(times)
    return interpolate(rate.time, rate.values, times, longest_bridge(rate, reference.max_gap))


def _velocity(
    signals: Mapping[str, Signal], times: Array, reference: Reference
) -> tuple[Array, Array] | None:
    heading = signals.get("heading")
    if heading is None:
        return None
    speed = reference.speed_at(times)
    direction = interpolate(heading.time, heading.values, times, longest_bridge(heading, reference.max_gap))
    return speed * np.cos(direction), speed * np.sin(direction)


def _apply(
    signals: dict[str, Signal], names: tuple[str, ...], found: Jumps, reference: Reference
) -> tuple[list[str], Array]:
    """Take out outliers; where the cuts would cost too much, leave the signals out instead."""
    unit = signals[names[0]].unit
    what = " and ".join(names)
    told = []
    count = int(np.count_nonzero(found.outlier))
    if count:
        told.append(f"{what}: {count} samples stand alone and were left out")
    if not len(found.cuts):
        signals |= {name: _select(signals[name], ~found.outlier) for name in names if count}
        return told, found.cuts
    jumps = f"{_jumps(found.cuts)}, the largest {found.largest:.3g} {unit} at {found.at:.1f} s"
    if _cost(found.cuts, reference) > MOST_CUT:
        for name in names:
            del signals[name]
        return [f"{what}: {jumps}: too many to cut the run there, left out"], np.empty((0, 2))
    signals |= {name: _select(signals[name], ~found.outlier) for name in names}
    return [*told, f"{what}: {jumps}: windows end there"], found.cuts


def _jumps(cuts: Array) -> str:
    if len(cuts) == 1:
        return "1 jump"
    return f"{len(cuts)} jumps, half of them {np.median(np.diff(cuts[:, 0])):.2g} s apart or less"


def _cost(cuts: Array, reference: Reference, shortest: float = 3.0) -> float:
    """Share of the moving time that lies in pieces shorter than ``shortest`` [s] between cuts."""
    moving = reference.grid[np.nan_to_num(reference.speed) >= reference.least_speed]
    if not len(moving):
        return 0.0
    edges = np.concatenate([[moving[0]], cuts[:, 1], [moving[-1]]])
    lengths = np.diff(np.sort(edges))
    return float(np.sum(lengths[lengths < shortest]) / max(np.sum(lengths), 1e-9))


def _thinned(signal: Signal, rate: float, max_gap: float) -> Signal:
    """Low-pass and thin a signal that is much faster than the grid."""
    if len(signal.time) < 3:
        return signal
    own = 1 / float(np.median(np.diff(signal.time)))
    every = round(own / rate)
    if own < THIN_ABOVE * rate or every < 2:
        return signal
    filtered = low_pass(signal.time, signal.values, own / every, longest_bridge(signal, max_gap))
    keep = np.arange(len(signal.time)) % every == 0
    return _select(replace(signal, values=filtered), keep)
