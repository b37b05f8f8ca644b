"""The frequency response of the steering stage: which experiments tell it, and the bandwidth check.

Every sine gives one point. What is neither step nor sine gives a spectrum; a chirp, of which slow pieces pass
for sines, is put together again first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.actuator_fit import MISFIT_REASON
from ident.estimation.actuator_likelihood import DEAD_TIME, GAIN, RATIO, SUM
from ident.estimation.actuator_runs import RunsFit
from ident.estimation.bandwidth import check_bandwidth, model_response
from ident.estimation.broadband import h1
from ident.estimation.frequency_response import (
    Excerpt,
    Plant,
    Response,
    SineFit,
    fit_sine,
    prepare_sine,
    sine_noise,
)
from ident.estimation.noise import NoiseShape
from ident.estimation.output_error import Fit
from ident.experiments.found import Found
from ident.experiments.steering_data import SteeringRun
from ident.experiments.stretches import Stretch, jitter_of
from ident.results import Bandwidth, Experiment, FrequencyPoint, SteeringResult

USE = "frequency_response"
BROADBAND_SHARE = 0.5  # of a part's length that is no sine, from which its sines are pieces of a chirp
CURVE_POINTS = 121
DRAWN = 4.0
NEXT_TO = 0.6  # [s] at most between two pieces of one part; shorter ones than 0.5 s are no experiments


@dataclass(frozen=True)
class _Part:
    """A piece of a request that gives one sine or one spectrum.

    members : indices into the experiments of the result
    frequency : of the sine [rad/s], None for a spectrum
    """

    run: str
    excerpt: Excerpt
    members: tuple[int, ...]
    frequency: float | None = None
    amplitude: float | None = None


def with_frequency_response(
    result: SteeringResult, data: Sequence[SteeringRun], fit: RunsFit
) -> SteeringResult:
    """Add the frequency response and the bandwidth check, and say which experiments they used.

    Parameters
    ----------
    result : with ``experiments`` in the order of runs, stretches and time, as ``list_experiments`` gives them
    """
    points, parts, why_not = frequency_points(data, fit)
    bandwidth = check_bandwidth(points, fit.common.fit, plant_of(fit.common.fit))
    return replace(
        result,
        experiments=_marked(result.experiments, parts, why_not, fit),
        frequency_response=sorted(points, key=lambda one: (one.frequency, one.run, one.start)),
        model_response=model_response(fit.common.fit, _drawn(points, bandwidth)),
        bandwidth=bandwidth if result.adequate else _doubted(bandwidth),
    )


def frequency_points(
    data: Sequence[SteeringRun], fit: RunsFit
) -> tuple[list[FrequencyPoint], list[_Part], dict[int, str]]:
    """Return all points, the parts they come from, and experiment -> why it gives none."""
    plant = plant_of(fit.common.fit)
    parts = [one for one in _parts(data) if one.run not in fit.excluded]
    jitter = max(jitter_of(run.measured.time) for run in data)
    sines = [one for one in parts if one.frequency is not None]
    like = None if fit.common.misfit else fit.common.fit.noise.shape
    points, why_not = _sine_points(sines, plant, jitter, like)
    for part in parts:
        if part.frequency is None:
            _add_spectrum(part, plant, points, why_not)
    return points, parts, why_not


def plant_of(fit: Fit) -> Plant:
    """Return the transfer function of a fit."""
    gain, dead_time, total, ratio = (float(fit.shared[i]) for i in (GAIN, DEAD_TIME, SUM, RATIO))
    return Plant(gain, dead_time, total, ratio * total**2)


def _drawn(points: Sequence[FrequencyPoint], bandwidth: Bandwidth) -> NDArray[np.float64]:
    """Frequencies of the model's curve: all that was measured, and DRAWN times around the bandwidth."""
    middle = bandwidth.bode.value or 1.0
    measured = [one.frequency for one in points]
    low = min([middle / DRAWN, *(one / 1.3 for one in measured)])
    high = max([middle * DRAWN, *(one * 1.3 for one in measured)])
    return np.asarray(np.geomspace(low, high, CURVE_POINTS), dtype=np.float64)


def _doubted(bandwidth: Bandwidth) -> Bandwidth:
    """Return the same, the model's bandwidth no better than weak."""
    if bandwidth.bode.status != "identified":
        return bandwidth
    return replace(bandwidth, bode=replace(bandwidth.bode, status="weak", reason=MISFIT_REASON))


def _parts(data: Sequence[SteeringRun]) -> Iterator[_Part]:
    """All sines and broadband parts of all runs, in the order of the result's experiments."""
    first = 0
    for run in data:
        for stretch, found in zip(run.stretches, run.experiments, strict=True):
            for members in _together(found):
                yield from _of_members(run.name, stretch, found, members, first)
            first += len(found)


def _together(found: Sequence[Found]) -> list[list[int]]:
    """Indices of the experiments that are neither step nor pulse, those that touch in one list."""
    groups: list[list[int]] = []
    for index, one in enumerate(found):
        if one.kind in ("step", "pulse"):
            continue
        touches = groups and groups[-1][-1] == index - 1 and one.start - found[index - 1].end_time <= NEXT_TO
        if touches:
            groups[-1].append(index)
        else:
            groups.append([index])
    return groups


def _of_members(
    run: str, stretch: Stretch, found: Sequence[Found], members: Sequence[int], first: int
) -> Iterator[_Part]:
    """One spectrum of pieces that touch, or their sines where they are mostly sines."""
    lengths = {i: found[i].end_time - found[i].start for i in members}
    broad = sum(length for i, length in lengths.items() if not _is_sine(found[i]))
    if broad >= BROADBAND_SHARE * sum(lengths.values()):
        whole = _excerpt(stretch, found[members[0]].start, found[members[-1]].end_time)
        yield _Part(run, whole, tuple(first + i for i in members))
        return
    for i in members:
        one = found[i]
        excerpt = _excerpt(stretch, one.start, one.end_time)
        if _is_sine(one):
            yield _Part(run, excerpt, (first + i,), one.frequency, one.amplitude)
        else:
            yield _Part(run, excerpt, (first + i,))


def _is_sine(one: Found) -> bool:
    return one.kind == "sine" and not one.rejected


def _excerpt(stretch: Stretch, begin: float, end: float) -> Excerpt:
    return Excerpt(
        command_times=stretch.command_times,
        command_values=stretch.command_values,
        times=stretch.times,
        measured=stretch.measured,
        starts=stretch.starts,
        begin=begin,
        end=end,
    )


def _sine_points(
    sines: Sequence[_Part], plant: Plant, jitter: float, like: NoiseShape | None
) -> tuple[list[FrequencyPoint], dict[int, str]]:
    """Return the points of all sines, and experiment -> why it gives none."""
    prepared: list[tuple[_Part, SineFit]] = []
    why_not = {}
    for part in sines:
        try:
            prepared.append((part, prepare_sine(part.excerpt, part.frequency or 0.0, plant)))
        except NotIdentifiable as error:
            why_not[part.members[0]] = str(error)
    if not prepared:
        return [], why_not
    shape = sine_noise([fit for _, fit in prepared], jitter, like)
    return [_point(part, fit_sine(fit, plant, shape)) for part, fit in prepared], why_not


def _add_spectrum(part: _Part, plant: Plant, points: list[FrequencyPoint], why_not: dict[int, str]) -> None:
    try:
        points += [_point(part, one) for one in h1(part.excerpt, plant)]
    except NotIdentifiable as error:
        why_not.update(dict.fromkeys(part.members, str(error)))


def _point(part: _Part, response: Response) -> FrequencyPoint:
    second, third = (response.harmonics.get(order, (None, None)) for order in (2, 3))
    return FrequencyPoint(
        run=part.run,
        method="h1" if part.frequency is None else "sine",
        start=part.excerpt.begin,
        end=part.excerpt.end,
        frequency=response.frequency,
        amplitude=part.amplitude,
        gain=response.gain,
        gain_std=response.gain_std,
        phase=response.phase,
        phase_std=response.phase_std,
        harmonic_2=second[0],
        harmonic_2_std=second[1],
        harmonic_3=third[0],
        harmonic_3_std=third[1],
        coherence=response.coherence,
    )


def _marked(
    experiments: Sequence[Experiment], parts: Sequence[_Part], why_not: dict[int, str], fit: RunsFit
) -> list[Experiment]:
    """Say of every experiment whether the frequency response uses it, or why not."""
    members = {index for part in parts for index in part.members}
    marked = []
    for index, one in enumerate(experiments):
        reason = why_not.get(index, fit.excluded.get(one.run))
        if index in members and reason is None:
            marked.append(replace(one, used_by=[*one.used_by, USE]))
        elif one.kind in ("sine", "other") and reason is not None:
            marked.append(replace(one, rejected={**one.rejected, USE: reason}))
        else:
            marked.append(one)
    return marked
