"""Measured wheel forces beside what the motion says: stiffness, scale, and what explains a difference.

The sum of the measured lateral forces of an axle is compared with the force that the motion needs (force
inversion, no tyre model) and, by a curve of the chosen kind, with the slip angle of the measured motion. A
difference has few causes, and the data tell many of them apart: a wrong mass shows in the vertical loads
too; a scale of the sensors is the same at all accelerations; what grows with the acceleration is of the
tyres or of the sensors' load; an offset is there at rest; moments that the bicycle lacks (aligning moments
of the tyres) need a larger force in front and a smaller one behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ident.estimation.measured_forces import Fitted, fit_curve, fit_scale
from ident.estimation.tyre_estimates import IDENTIFIED, WEAK
from ident.estimation.tyre_fit import Body, KindFit
from ident.glossary import AXLES
from ident.results import Estimate, ForceComparison, Status, TyreFit
from ident.signals.run import Run

Array = NDArray[np.float64]
Index = NDArray[np.intp]

SPACING = 0.05  # [s] between the compared instants
GENTLE = 4.0  # [m/s²] up to which models of this kind are judged apart
FEWEST = 100
FOLLOWS = 0.9  # correlation of force and motion, below which a run says little of either
SIDES = ("left", "right")
STIFFENS = ("cornering_stiffness", "LKY")  # parameters that the cornering stiffness goes with
AT_REST, LONG_ENOUGH = 0.3, 1.0  # [m/s], [s]
SAME_LOAD = 0.02  # relative
USUAL_TRAIL = (0.03, 0.08)  # [m]
LEAST_TILT = 0.05  # [rad] of the wheels: below, axes of the wheel and of the body are the same


@dataclass(frozen=True)
class Axle:
    """One axle at equally spaced instants, all runs one after another.

    run : (n,) index into ``names``; slip_angle [rad]; needed, measured [N]; acceleration [m/s²]
    angle : (n,) of its wheels [rad], zero behind
    """

    axle: str
    names: list[str]
    run: Index
    slip_angle: Array
    needed: Array
    measured: Array
    acceleration: Array
    angle: Array

    def part(self, keep: NDArray[np.bool_]) -> Axle:
        """Return the instants in ``keep``."""
        return Axle(
            axle=self.axle,
            names=self.names,
            run=self.run[keep],
            slip_angle=self.slip_angle[keep],
            needed=self.needed[keep],
            measured=self.measured[keep],
            acceleration=self.acceleration[keep],
            angle=self.angle[keep],
        )


def compare_forces(
    fit: TyreFit, fitted: KindFit, forces: pd.DataFrame, motion: pd.DataFrame, runs: Sequence[Run]
) -> list[ForceComparison]:
    """Compare every axle of which all wheels' lateral forces were measured.

    Parameters
    ----------
    fit, fitted : the chosen one, as it is told and as it is
    forces, motion : tables ``tyre_forces`` and ``tyres`` of the stage
    runs : all that were read, also those that are no part of the fit: the vehicle may stand still in them
    """
    found = [_axle(axle, forces, motion) for axle in AXLES]
    return [_compared(*_agreeing(one), fit, fitted, runs) for one in found if one.run.size >= FEWEST]


def _agreeing(one: Axle) -> tuple[Axle, list[str]]:
    """Leave out runs in which force and motion hardly follow each other, where another run does better."""
    follows = [_correlation(one.part(one.run == number)) for number in range(len(one.names))]
    kept = [number for number, each in enumerate(follows) if each >= FOLLOWS]
    if not kept:
        return one, []
    told = [
        f"{name} left out: there the force follows the motion with correlation {each:.2f} only"
        for number, (name, each) in enumerate(zip(one.names, follows, strict=True))
        if number not in kept
    ]
    rest = one.part(np.isin(one.run, kept))
    names = [one.names[number] for number in kept]
    return replace(rest, names=names, run=np.searchsorted(kept, rest.run)), told


def _correlation(one: Axle) -> float:
    constant = np.std(one.needed) == 0 or np.std(one.measured) == 0
    return 0.0 if constant else float(np.corrcoef(one.needed, one.measured)[0, 1])


def _axle(axle: str, forces: pd.DataFrame, motion: pd.DataFrame) -> Axle:
    own = forces[(forces["axle"] == axle) & forces["measured_force"].notna()]
    names = [str(name) for name in dict.fromkeys(own["run"])]
    parts = [_thinned(own[own["run"] == name]) for name in names]
    rows = pd.concat(parts) if parts else own
    angle = [_angle(motion[motion["run"] == n], part) for n, part in zip(names, parts, strict=True)]
    tilt = np.concatenate([np.zeros(0), *angle])
    return Axle(
        axle=axle,
        names=names,
        run=np.repeat(np.arange(len(names)), [len(part) for part in parts]).astype(np.intp),
        slip_angle=rows["slip_angle"].to_numpy(np.float64),
        needed=rows["force"].to_numpy(np.float64),
        measured=rows["measured_force"].to_numpy(np.float64),
        acceleration=rows["lateral_acceleration"].to_numpy(np.float64),
        angle=tilt if axle == "front" else np.zeros_like(tilt),
    )


def _thinned(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows at least about SPACING apart."""
    slot = np.floor(rows["time"].to_numpy() / SPACING + 1e-6)
    return rows[np.diff(slot, prepend=-1.0) > 0]


def _angle(motion: pd.DataFrame, rows: pd.DataFrame) -> Array:
    return np.asarray(np.interp(rows["time"], motion["time"], motion["road_wheel_angle"]))


def _compared(
    one: Axle, left_out: Sequence[str], fit: TyreFit, fitted: KindFit, runs: Sequence[Run]
) -> ForceComparison:
    body = fitted.body
    free = [name for name in fitted.names if name.startswith(f"{one.axle}.")]
    start = [fitted.parameters[name] for name in free]
    found, through = (
        fit_curve(fitted.axles, one.axle, body, one.slip_angle, force, one.run, start)
        for force in (one.measured, one.needed)
    )
    scale = fit_scale(one.needed, one.measured, one.run)
    own = getattr(fit, one.axle)["cornering_stiffness"]
    number = next(k for k, name in enumerate(free) if name.rpartition(".")[2] in STIFFENS)
    each = fitted.stiffness(one.axle).value / start[number]
    return ForceComparison(
        axle=one.axle,  # type: ignore[arg-type]
        from_forces=_stiffness(found, number, each),
        from_motion=own,
        scale=_scale(scale),
        correlation=_correlation(one),
        reason="; ".join(
            [*_reasons(one, scale, body, runs), *_of_curves(found, through, own, number, each), *left_out]
        ),
    )


def _stiffness(found: Fitted, number: int, each: float) -> Estimate:
    """Cornering stiffness, ``each`` for every unit of the parameter that it goes with [N/rad]."""
    value, std = each * float(np.exp(found.estimates[number])), found.std(number)
    half = found.half_width(number)
    if std > WEAK:
        reason = f"known to {100 * std:.0f} % only: the slip angles hardly vary"
        return Estimate(value, value * std, None, None, "N/rad", "not_identifiable", reason)
    status: Status = "identified" if std <= IDENTIFIED else "weak"
    reason_weak = None if status == "identified" else f"known to {100 * std:.0f} %"
    ends = (value * float(np.exp(-half)), value * float(np.exp(half)))
    return Estimate(value, value * std, *ends, "N/rad", status, reason_weak)


def _scale(found: Fitted) -> Estimate:
    value, std, half = float(found.estimates[0]), found.std(0), found.half_width(0)
    if std > WEAK * abs(value):
        return Estimate(value, std, None, None, "1", "not_identifiable", "the forces hardly vary together")
    status: Status = "identified" if std <= IDENTIFIED * abs(value) else "weak"
    reason = None if status == "identified" else f"its error is {std:.2g}"
    return Estimate(value, std, value - half, value + half, "1", status, reason)


# --- what explains a difference -------------------------------------------------------------------


def _reasons(one: Axle, scale: Fitted, body: Body, runs: Sequence[Run]) -> list[str]:
    """Say what the data show, one clause each."""
    differs = abs(scale.estimates[0] - 1) > scale.half_width(0)
    said = [_of_scale(scale), *_growth(one)]
    if differs:
        said += [*_trail(one, scale, body), *_axes(one, scale)]
    return [*said, *_loads(one, body, runs, differs=differs), *_offsets(one, scale), *_at_rest(one, runs)]


def _of_scale(scale: Fitted) -> str:
    more, error = 100 * (float(scale.estimates[0]) - 1), 100 * scale.half_width(0)
    if abs(more) <= error:
        return f"the measured force is what the motion needs, within {error:.2g} %"
    what = "larger" if more > 0 else "smaller"
    return f"the measured force is {abs(more):.0f} ± {_error(error)} % {what} than the motion needs"


def _of_curves(found: Fitted, through: Fitted, own: Estimate, number: int, each: float) -> list[str]:
    """Part the ratio of both stiffnesses: the same curve through the needed forces lies between them."""
    if through.std(number) > WEAK or found.std(number) > WEAK or not own.value:
        return []
    middle = each * float(np.exp(through.estimates[number]))
    force, rest = each * float(np.exp(found.estimates[number])) / middle, middle / own.value
    told = f"{middle / 1e3:.1f} ± {_error(middle * through.half_width(number) / 1e3)} kN/rad"
    shares = f"of the stiffness ratio {force * rest:.2f} the forces themselves make {force:.2f}"
    offset = "whose slope at zero slip trades against the offset of the steering and the shape of the curve"
    return [
        f"the same curve through the forces that the motion needs gives {told}",
        f"{shares}, and {rest:.2f} lies between these points and the fit of the motion, {offset}",
    ]


def _growth(one: Axle) -> list[str]:
    """Say whether the scale depends on the lateral acceleration."""
    gentle = np.abs(one.acceleration) < GENTLE
    enough = [int(np.count_nonzero(mask)) >= FEWEST for mask in (gentle, ~gentle)]
    if not all(enough):
        return [] if enough[1] else [f"all of it below {GENTLE:g} m/s²"]
    below, above = (_ratio(one.part(mask)) for mask in (gentle, ~gentle))
    told = f"{_percent(below)} below {GENTLE:g} m/s² and {_percent(above)} above it"
    apart = float(above.estimates[0] - below.estimates[0])
    if abs(apart) < np.hypot(above.half_width(0), below.half_width(0)):
        return [f"{told}: alike within their errors, as a wrong mass or scale of the sensors would be"]
    grows = "grows" if apart > 0 else "falls"
    return [f"{told}: it {grows} with the load on the outer wheel, which one scale or a wrong mass does not"]


def _error(size: float) -> str:
    return f"{size:.0f}" if size >= 10 else f"{size:.1g}"


def _ratio(one: Axle) -> Fitted:
    return fit_scale(one.needed, one.measured, one.run)


def _percent(found: Fitted) -> str:
    return f"{100 * (float(found.estimates[0]) - 1):+.0f} ± {_error(100 * found.half_width(0))} %"


def _trail(one: Axle, scale: Fitted, body: Body) -> list[str]:
    """Aligning moments t_p m a_y raise the front force by t_p/l_r, and lower the rear one by t_p/l_f."""
    more = float(scale.estimates[0]) - 1
    trail = more * body.cg_to_rear_axle if one.axle == "front" else -more * body.cg_to_front_axle
    if trail <= 0:
        return []
    low, high = USUAL_TRAIL
    share = "would explain it" if trail <= high else f"explains {100 * high / trail:.0f} % of it at most"
    need = f"all of it would need {trail:.2f} m"
    return [f"the pneumatic trail of tyres ({low:g} to {high:g} m), not in a bicycle, {share} ({need})"]


def _axes(one: Axle, scale: Fitted) -> list[str]:
    """Say what the scale were if the forces were across the body and not across the wheels."""
    if float(np.quantile(np.abs(one.angle), 0.95)) < LEAST_TILT:
        return []
    other = float(fit_scale(one.needed * np.cos(one.angle), one.measured, one.run).estimates[0])
    now = float(scale.estimates[0])
    better = "nearer to one" if abs(other - 1) < abs(now - 1) else "farther from one"
    return [f"were they forces across the body and not the wheels, the scale would be {other:.3f}, {better}"]


def _loads(one: Axle, body: Body, runs: Sequence[Run], *, differs: bool) -> list[str]:
    """Compare the measured vertical loads with those of the vehicle file."""
    loads = [load for run in runs if run.name in one.names and (load := _load(run, one.axle)) is not None]
    if not loads:
        unknown = f"vertical loads of the {one.axle} wheels are not logged: they would tell a wrong mass"
        return [unknown] if differs else []
    samples = [each[1] for each in loads]
    mean = float(np.average([each[0] for each in loads], weights=samples))
    stated = body.load(one.axle)
    told = f"the vertical loads add up to {mean:.0f} N, the vehicle file gives {stated:.0f} N"
    if abs(mean / stated - 1) < SAME_LOAD:
        return [f"{told}: its mass is not what is wrong"] if differs else [f"{told}: they agree"]
    return [f"{told}: its mass or the scale of the loads is {100 * (mean / stated - 1):+.0f} % off"]


def _load(run: Run, axle: str) -> tuple[float, int] | None:
    names = [f"{axle}_{side}_vertical_force" for side in SIDES]
    if any(name not in run.signals or run.signals[name].raw for name in names):
        return None
    sides = [float(np.nanmean(run.signals[name].values)) for name in names]
    return sum(sides), len(run.signals[names[0]].values)


def _offsets(one: Axle, scale: Fitted) -> list[str]:
    told = [f"{offset:+.0f} N in {name}" for name, offset in zip(one.names, scale.offsets, strict=True)]
    return [f"where the motion needs no force the wheels read {', '.join(told)}"]


def _at_rest(one: Axle, runs: Sequence[Run]) -> list[str]:
    """Forces of both wheels while the vehicle stands still."""
    for run in runs:
        found = [_standing(run, f"{one.axle}_{side}_lateral_force") for side in SIDES]
        if all(each is not None for each in found):
            left, right = (float(each) for each in found if each is not None)
            opposite = abs(left + right) < 0.5 * (abs(left) + abs(right)) and left * right < 0
            what = ", opposite: it cancels in the sum of the axle, not in one wheel" if opposite else ""
            return [
                f"at rest in {run.name} the left wheel reads {left:+.0f} N, the right {right:+.0f} N{what}"
            ]
    return []


def _standing(run: Run, name: str) -> float | None:
    """Mean of a signal while the vehicle stands still at the start of a run, None where it does not."""
    speed, signal = run.signals.get("speed"), run.signals.get(name)
    if speed is None or signal is None or speed.raw or signal.raw or not len(speed.time):
        return None
    moving = np.flatnonzero(np.abs(speed.values) > AT_REST)
    until = float(speed.time[moving[0]]) if moving.size else float(speed.time[-1])
    still = (signal.time >= speed.time[0]) & (signal.time < until)
    own = np.asarray(signal.values)[still]
    return float(np.mean(own)) if until - float(speed.time[0]) >= LONG_ENOUGH and own.size else None
