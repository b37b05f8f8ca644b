"""The actuator layer of the loop: request to measured angle, with the effects that enter there.

The base model is the linear actuator (2.25), fitted by maximum likelihood. Unlike the steering stage, which
refuses a model that is poor, this layer keeps the best linear fit whatever it leaves over: what it leaves is
what the loop is about. Noise is autoregressive; where its correlation time would pass ``LONGEST_NOISE``, what
is left is not noise but a finding, and the noise is taken as AR(1) of that time: an autoregression of higher
order with its poles there would all but hide what is slow, and the fit would follow what is fast and small.

Full fits of effects begin from several sizes, and, where the rate is limited, also from an actuator that does
what it is asked: a linear fit to an actuator that hardly ever gets there is far from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ident.errors import NotIdentifiable
from ident.estimation.actuator_effects import ACTUATOR_EFFECTS, SLACK, EffectsProblem, with_effects
from ident.estimation.actuator_fit import JITTER_LIMIT, fit_roughly
from ident.estimation.actuator_layer_fit import LONGEST_NOISE, ActuatorLayerFit, named_effects
from ident.estimation.actuator_likelihood import (
    BIAS,
    DEAD_TIME,
    GAIN,
    RATIO,
    SUM,
    ActuatorRecord,
    with_repeats,
    without_unknown_head,
)
from ident.estimation.actuator_runs import FEWEST_SAMPLES, FIRST_DEAD_TIME, RunRecords
from ident.estimation.actuator_scores import Bins, record_likelihood
from ident.estimation.actuator_terms import STEP, pushes, stepped
from ident.estimation.elimination import damped_solution, with_priors
from ident.estimation.layer import EffectCard, HeldOut, LayerFit
from ident.estimation.noise import AutoRegression, ContinuousAr1, Linearised, NoiseModel, NoiseShape
from ident.estimation.noise_fit import fit_autoregression, fit_continuous_ar1
from ident.estimation.output_error import WHITE, Fit, first_look, fit_output_error
from ident.estimation.vehicle_records import Samples
from ident.results import Refusal

Array = NDArray[np.float64]

MARGIN = 0.05  # [s] on the dead time of the linear fit, for that of a fit with effects
STEERING_RATIO = 20.0  # of a heavy truck, where it is not stated
POOR = 0.3  # left over, of the measured angle
LIMIT, PLAY = "steering_rate_limit", "steering_column_play"
OBEDIENT = ((1.0, 0.1), (1.0, 0.3))  # gain and sum of lags [s] of an actuator that does what it is asked
FIRST_RATIO = 0.1
GUESSES = 3  # sizes of an effect to begin from, where none are given
FIRST_LOOK, SECOND_LOOK = 3, 8  # iterations
SECOND_STARTS = 2  # of each beginning
LOCAL_ITERATIONS = 8
PLACES = (-0.4, 0.4)  # within the play, beside its middle, to begin from
MOST_CORRELATED = 0.99
QUIET = 1e-6  # noise over amplitude of data without any


class ActuatorLayer:
    """Request and measured angle of some runs; see :class:`~ident.estimation.layer.Layer`."""

    name = "actuator"

    def __init__(
        self,
        runs: Sequence[RunRecords],
        *,
        signal: str = "steering_wheel_angle",
        steering_ratio: float = STEERING_RATIO,
        speed: Mapping[str, Samples] | None = None,
        start: Array | None = None,
    ) -> None:
        """Take the runs: at least one, each with excitation.

        signal : that is measured, steering_wheel_angle or road_wheel_angle
        steering_ratio : from the steering wheel to the road wheels, for bounds and usual sizes only
        speed : of each run [m/s], where known
        start : (K, L, a1, rho) near the linear actuator, such as of the steering stage; else searched for

        Raises
        ------
        NotIdentifiable
            If the measured angle does not follow the request at all.
        """
        self.signal = signal
        self.scale = steering_ratio if signal == "steering_wheel_angle" else 1.0
        self.speed = dict(speed or {})
        self.jitter = max(run.jitter for run in runs)
        self._rough, self._records = _usable(runs, start)
        self.all_runs = list(self._records)
        self.runs = list(self._records)
        self.not_testable: list[Refusal] = []
        self.terms: tuple[str, ...] = ()

    def without(self, runs: Sequence[str]) -> ActuatorLayer:
        """See :class:`~ident.estimation.layer.Layer`; what is left out can still be asked for as held out."""
        rest = object.__new__(ActuatorLayer)
        rest.__dict__.update({key: value for key, value in vars(self).items() if key != "_base"})
        rest.runs = [name for name in self.runs if name not in runs]
        return rest

    def _records_of(self, runs: Sequence[str]) -> list[ActuatorRecord]:
        """Records of some runs, each with the place of its run among them."""
        return [replace(r, run=index) for index, name in enumerate(runs) for r in self._records[name]]

    def _problem(self, keys: Sequence[str]) -> EffectsProblem:
        return self._problem_of(self.runs, keys)

    def _problem_of(self, runs: Sequence[str], keys: Sequence[str]) -> EffectsProblem:
        """Some runs with effects and generic terms."""
        effects = named_effects([key for key in keys if key not in self.terms])
        terms = [key for key in keys if key in self.terms]
        return EffectsProblem(self._records_of(runs), len(runs), effects, scale=self.scale, terms=terms)

    @cached_property
    def _base(self) -> ActuatorLayerFit:
        """The linear actuator."""
        problem = self._problem(())
        linear = np.concatenate([self._rough, np.zeros(problem.runs)])
        return self._finished(problem, linear, problem.start(linear), WHITE, None)

    def fitted(
        self,
        keys: Sequence[str] = (),
        *,
        start: LayerFit | None = None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]] | None = None,
    ) -> ActuatorLayerFit:
        """See :class:`~ident.estimation.layer.Layer`."""
        if not keys:
            return self._base
        given = start if isinstance(start, ActuatorLayerFit) and start.keys else None
        problem = self._problem(keys)
        begun = self._begun(keys, given, shapes or {})
        shared = with_effects(begun.shared, problem, begun.sizes, skewed=begun.skewed)
        local = problem.start(shared) if begun.local is None else begun.local
        if PLAY in keys:
            pairs = zip(problem.records, local, strict=True)
            local = [_settled(problem, r, shared, self._base.fit.noise, one)[0] for r, one in pairs]
        return self._finished(problem, shared, local, self._base.fit.noise.shape, self._base)

    def _begun(
        self,
        keys: Sequence[str],
        given: ActuatorLayerFit | None,
        shapes: Mapping[str, Sequence[Mapping[str, float]]],
    ) -> _Begun:
        """Parameters near the best fit: the effects join one after another, each from several sizes."""
        own = given.sizes() if given is not None else {}
        there = [key for key in own if key in keys]
        rest = [key for key in ACTUATOR_EFFECTS if key in keys and key not in there]
        base = self._base
        new = rest or given is None
        begins = [_Begun(base.fit.shared, base.fit.local, own, skewed=False)] if new else []
        if given is not None:
            same = given.fit.local if given.runs == tuple(self.runs) else None
            begins.append(_Begun(self._linear_part(given), same, own, skewed=given.problem.limited))
        elif LIMIT in rest and base.rms()[self.signal] > POOR * self._spread:
            begins += [_Begun(_obedient(base.fit.shared, *x), None, own, skewed=False) for x in OBEDIENT]
        if not rest:
            return self._best(there, begins, [{}])
        for key in rest:
            there.append(key)
            begins = [self._best(there, begins, [{key: size} for size in self._sizes(key, shapes)])]
        return begins[0]

    def _best(
        self, names: Sequence[str], begins: Sequence[_Begun], sizes: Sequence[Mapping[str, float]]
    ) -> _Begun:
        """The best of all beginnings after some iterations; what joins the known effects has these sizes."""
        problem, noise = self._problem(names), self._base.fit.noise
        looks = []
        for begin in begins:
            for side in (1.0, -1.0) if problem.limited and not begin.skewed else (1.0,):
                own = []
                for size in sizes:
                    both = {**begin.sizes, **size}
                    x = with_effects(begin.shared, problem, both, skewed=begin.skewed, side=side)
                    local = problem.start(x) if begin.local is None else begin.local
                    x = problem.inside(x)
                    own.append(first_look(problem, x, local, noise=noise, iterations=FIRST_LOOK))
                looks += sorted(own, key=lambda look: look[0])[:SECOND_STARTS]
        looks = [first_look(problem, x, y, noise=noise, iterations=SECOND_LOOK) for _, x, y in looks]
        _, shared, local = min(looks, key=lambda look: look[0])
        return _Begun(shared[: problem.first_size], local, problem.sizes(shared), skewed=problem.limited)

    def _sizes(self, key: str, shapes: Mapping[str, Sequence[Mapping[str, float]]]) -> list[float]:
        """Sizes of an effect to begin from: none at all, and those given, else some of the screen's."""
        (effect,) = named_effects([key])
        guessed = effect.sizes(self._base.excitation)
        some = [guessed[i] for i in np.linspace(0, len(guessed) - 1, GUESSES).astype(int)]
        nothing = effect.size.high if effect.place == "rate" else effect.size.low
        tried = [shape[effect.size.name] for shape in shapes.get(key, ()) if effect.size.name in shape]
        tried = [*tried, *some] if self._base.is_far or not tried else tried
        return [self.scale * nothing, *tried]

    @property
    def _spread(self) -> float:
        """Root mean square of the measured angle about the mean of each record."""
        own = [r.measured - r.measured.mean() for r in self._base.problem.records]
        return float(np.sqrt(np.mean(np.concatenate(own) ** 2)))

    def _linear_part(self, start: ActuatorLayerFit) -> Array:
        """(K, L, a1, shape, biases of the runs here) of a fit of perhaps other runs."""
        bias = _biases(start, self.runs)
        return np.concatenate([start.fit.shared[:BIAS], bias])

    def _finished(
        self,
        problem: EffectsProblem,
        shared: Array,
        local: Sequence[Array],
        shape: NoiseShape,
        base: ActuatorLayerFit | None,
    ) -> ActuatorLayerFit:
        fit = fit_output_error(problem, shared, local, identify_noise=self._identify, shape=shape)
        speed = tuple(self.speed.get(self.runs[record.run]) for record in problem.records)
        return ActuatorLayerFit(
            tuple(self.runs), self.signal, speed, problem, _with_floor(fit, problem), base
        )

    def _identify(self, records: Sequence[Linearised], like: NoiseShape | None) -> NoiseShape:
        """Colour of the noise under a fit, its correlation time capped."""
        if self.jitter > JITTER_LIMIT:
            return ContinuousAr1(min(fit_continuous_ar1(records, like).correlation_time, LONGEST_NOISE))
        period = float(np.median(np.concatenate([np.diff(record.times) for record in records])))
        slowest = float(np.exp(-period / LONGEST_NOISE))
        capped = AutoRegression(np.array([slowest]))
        if like is not None and like.close_to(capped):
            return like
        begun = AutoRegression(np.array([_neighbours(records)]))
        if fit_autoregression(records, begun).largest_pole() > slowest:
            return capped
        shape = fit_autoregression(records, like)
        return capped if shape.largest_pole() > slowest else shape

    def with_term(self, key: str, at: Mapping[str, float], fit: LayerFit) -> ActuatorLayer | None:
        """See :class:`~ident.estimation.layer.Layer`; its function is that of the angle of the fit."""
        fit = _own(fit)
        runs = list(self._records)
        problem, shared, local = self._at(fit, runs)
        if key == STEP:
            run, time = runs.index(fit.runs[int(at["run"])]), at["time"]
            parts = stepped(problem.records, run, time)
        else:
            speed = [self.speed.get(runs[record.run]) for record in problem.records]
            parts = pushes(problem, shared, local, speed).get(key, [])
        if not parts:
            return None
        added = [
            replace(r, terms={**r.terms, key: one}) for r, one in zip(problem.records, parts, strict=True)
        ]
        made = object.__new__(ActuatorLayer)
        made.__dict__.update(vars(self))
        made._records = {name: [r for r in added if runs[r.run] == name] for name in runs}
        made.terms = tuple(dict.fromkeys([*self.terms, key]))
        return made

    def _at(self, fit: ActuatorLayerFit, runs: Sequence[str]) -> tuple[EffectsProblem, Array, list[Array]]:
        """Some runs with the model of a fit, its parameters, and the local ones that suit it best."""
        problem = self._problem_of(runs, fit.keys)
        sizes = fit.fit.shared[fit.problem.first_size :]
        shared = np.concatenate([fit.fit.shared[:BIAS], _biases(fit, runs), sizes])
        if tuple(runs) == fit.runs:
            return problem, shared, list(fit.fit.local)
        return problem, shared, [_settled(problem, r, shared, fit.fit.noise)[0] for r in problem.records]

    def held_out(self, fit: LayerFit, runs: Sequence[str]) -> HeldOut:
        """See :class:`~ident.estimation.layer.Layer`; the bias of a new run is the mean of the fit's runs."""
        fit = _own(fit)
        problem, records = self._problem_of(runs, fit.keys), self._records_of(runs)
        sizes = fit.fit.shared[fit.problem.first_size :]
        shared = np.concatenate([fit.fit.shared[:BIAS], _biases(fit, runs), sizes])
        parts = [_settled(problem, record, shared, fit.fit.noise)[1] for record in records]
        bins = Bins(records)
        errors = np.concatenate([part.residual for part in parts])
        measured = np.concatenate([record.measured for record in records])
        run = np.concatenate([np.full(r.times.size, r.run, dtype=np.intp) for r in records])
        return HeldOut(
            errors={self.signal: errors},
            modelled={self.signal: measured - errors},
            run={self.signal: run},
            time={self.signal: np.concatenate([record.times for record in records])},
            likelihood=record_likelihood(bins, parts, fit.fit.noise),
        )

    def effect(self, key: str) -> EffectCard:
        """See :class:`~ident.estimation.layer.Layer`."""
        (effect,) = named_effects([key])
        return EffectCard(
            name=effect.name,
            enters="A",
            of=None,
            size=effect.size.name,
            unit=effect.size.unit,
            typical=self.scale * effect.size.typical,
            equation=effect.equation,
            meaning=effect.meaning,
            meanings={effect.size.name: effect.size.meaning},
            shown_by=effect.shown_by,
            positive=False,  # a full fit says whether it is possible: its direction is no derivative
        )


@dataclass(frozen=True)
class _Begun:
    """Where a fit begins.

    shared : (K, L, a1, shape, biases); local : one array a record, None where they are to be begun too
    sizes : of effects that are known already; skewed : whether the shape is the skew
    """

    shared: Array
    local: list[Array] | None
    sizes: Mapping[str, float]
    skewed: bool


def _usable(runs: Sequence[RunRecords], start: Array | None) -> tuple[Array, dict[str, list[ActuatorRecord]]]:
    """Rough (K, L, a1, rho) and the records of each run after their unknown heads; runs without any left out.

    The heads are cut once for all fits, so that all are compared on the same samples.
    """
    whole = _headed(runs, FIRST_DEAD_TIME)
    listed = [replace(r, run=i) for i, records in enumerate(whole.values()) for r in records]
    if not listed:
        raise NotIdentifiable(
            f"every stretch of request and measured angle is shorter than {FIRST_DEAD_TIME:.1f} s "
            f"and {FEWEST_SAMPLES} samples: record longer runs"
        )
    biases = np.zeros(len(whole))
    begin = None if start is None else np.concatenate([np.asarray(start, dtype=np.float64)[:BIAS], biases])
    rough = fit_roughly(listed, start=begin).fit.shared[:BIAS]
    dead_time = float(np.clip(rough[DEAD_TIME] + MARGIN, 0.0, FIRST_DEAD_TIME))
    return rough, _headed(runs, dead_time)


def _headed(runs: Sequence[RunRecords], dead_time: float) -> dict[str, list[ActuatorRecord]]:
    made = {run.name: [without_unknown_head(record, dead_time) for record in run.records] for run in runs}
    long = {
        name: [with_repeats(r) for r in records if r.times.size >= FEWEST_SAMPLES]
        for name, records in made.items()
    }
    return {name: records for name, records in long.items() if records}


def _neighbours(records: Sequence[Linearised]) -> float:
    """Correlation of neighbouring residuals, within what a search can begin from."""
    neighbours = sum(float(r.residual[1:] @ r.residual[:-1]) for r in records)
    square = sum(float(r.residual @ r.residual) for r in records)
    return float(np.clip(neighbours / square if square > 0 else 0.0, -MOST_CORRELATED, MOST_CORRELATED))


def _obedient(linear: Array, gain: float, total: float) -> Array:
    """The linear fit's dead time and biases with another gain and sum of lags."""
    made = linear.copy()
    made[[GAIN, SUM, RATIO]] = gain, total, FIRST_RATIO
    made[DEAD_TIME] = max(made[DEAD_TIME], 0.0)
    return made


def _own(fit: LayerFit) -> ActuatorLayerFit:
    """The same, known to be of the actuator."""
    if not isinstance(fit, ActuatorLayerFit):
        raise TypeError("a fit of another layer")
    return fit


def _biases(fit: ActuatorLayerFit, runs: Sequence[str]) -> Array:
    """(r,) bias of each run, the mean of all where the fit does not know it."""
    known = dict(zip(fit.runs, fit.fit.shared[BIAS : fit.problem.first_size].tolist(), strict=True))
    mean = float(np.mean(list(known.values())))
    return np.array([known.get(name, mean) for name in runs])


def _with_floor(fit: Fit, problem: EffectsProblem) -> Fit:
    """The fit with noise of a size that can be divided by."""
    amplitude = max(float(np.ptp(record.measured)) for record in problem.records)
    return replace(fit, noise=replace(fit.noise, std=max(fit.noise.std, QUIET * amplitude, 1e-12)))


def _settled(
    problem: EffectsProblem, record: ActuatorRecord, shared: Array, noise: NoiseModel, *begins: Array
) -> tuple[Array, Linearised]:
    """Local parameters of a record alone fitted, and the record there: the best from several beginnings.

    begins : beside those from rest in several places within the play
    """
    rest = problem.start_one(record, shared)
    starts = [*begins, rest]
    if problem.lags(shared).width > 0:
        for place in PLACES:
            moved = rest.copy()
            moved[SLACK] = place
            starts.append(moved)
    found = [_descended(problem, record, shared, noise, start) for start in starts]
    _, local, part = min(found, key=lambda one: one[0])
    return local, part


def _descended(
    problem: EffectsProblem, record: ActuatorRecord, shared: Array, noise: NoiseModel, local: Array
) -> tuple[float, Array, Linearised]:
    """Whitened sum of squares, local parameters and record after damped steps of the local parameters."""
    part = problem.linearise_one(record, shared, local)
    rows = _own_rows(part, noise)
    damping = 0.0
    for _ in range(LOCAL_ITERATIONS):
        tried = problem.inside_local(local + damped_solution(rows[:, :-1], rows[:, -1], damping))
        moved = problem.linearise_one(record, shared, tried)
        new_rows = _own_rows(moved, noise)
        if float(new_rows[:, -1] @ new_rows[:, -1]) < float(rows[:, -1] @ rows[:, -1]):
            local, part, rows, damping = tried, moved, new_rows, damping / 8
        else:
            damping = max(8 * damping, 1e-4)
    return float(rows[:, -1] @ rows[:, -1]), local, part


def _own_rows(part: Linearised, noise: NoiseModel) -> Array:
    """Whitened rows [local | residual] with those of the priors."""
    white = noise.shape.whiten(np.column_stack([part.local, part.residual]), part) / noise.std
    return with_priors(white, part.prior, part.prior_residual)
