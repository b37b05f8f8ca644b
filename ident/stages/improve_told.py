"""What the loop found, as results: rounds, effects, sizes that would have shown, the next run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.effects.catalogue import CATALOGUE, not_built
from ident.dynamics.typeset import mathml
from ident.estimation.before_after import same_size, scatter_of_runs
from ident.estimation.detectable import detectable_sizes
from ident.estimation.improvement import Improvement, Round, Tried
from ident.estimation.layer import EffectCard, Layer, LayerFit, LayerScores
from ident.estimation.residual_tests import Screen, Screened
from ident.estimation.score_blocks import block_index
from ident.results import (
    Candidate,
    DetectableSize,
    Discovered,
    EffectEstimate,
    Estimate,
    FoundEffect,
    ImproveGate,
    ImproveStep,
    Localisation,
    NextExperiment,
    Refusal,
)
from ident.stages.improve_held_out import Compared
from ident.stages.improve_terms import equation_with_term, unit_of_term

Array = NDArray[np.float64]

Z = 1.959964
HALVES = 200  # half-samples of blocks in which a discovered term is looked for again
STRONGER_WHERE_SMALLER = ("steering_rate_limit",)
BLOCK = 10.0  # [s] of them
SEEN = 0.02  # of the power above noise, below which an equation is not listed


def step_of(one: Round, layers: Mapping[str, Layer]) -> ImproveStep:
    """One round."""
    gate = one.screen
    first = gate.strongest
    return ImproveStep(
        gate=ImproveGate(
            p_value=gate.p_value,
            rejected=gate.rejected,
            level=gate.level,
            strongest=first.key if first else "",
            layer=first.layer if first else next(iter(layers)),  # type: ignore[arg-type]
            tests=gate.tests,
            block=gate.block,
            draws=gate.draws,
        ),
        localisation=localisation(gate, one.layer) if one.layer else [],
        candidates=[_candidate(t, layers[one.layer]) for t in one.tried] if one.layer else [],
        added=one.added,
        why=one.why,
    )


def _candidate(one: Tried, layer: Layer) -> Candidate:
    card, screened = layer.effect(one.key), one.screened
    added = one.fit is not None and one.why_not is None
    parameters = one.fit.estimates()[one.key].parameters if added and one.fit else _one_step(card, screened)
    return Candidate(
        key=one.key,
        name=card.name,
        enters=card.enters,
        statistic=screened.statistic,
        freedom=screened.freedom,
        p_value=screened.p_value,
        gain=one.gain,
        in_class=one.in_class,
        parameters=parameters,
        why_not=one.why_not,
    )


def _one_step(card: EffectCard, screened: Screened) -> dict[str, Estimate]:
    """Size as its score tells it, without a fit."""
    value, std = screened.size
    if not (np.isfinite(value) and np.isfinite(std)):
        return {}
    return {card.size: Estimate(value, std, value - Z * std, value + Z * std, card.unit)}


def localisation(gate: Screen, layer: str | None) -> list[Localisation]:
    """Share of what the generic directions of a layer explain together, that each equation explains alone."""
    scores = next((one.scores for one in gate.layers if one.scores.layer == layer), None)
    if scores is None:
        return []
    columns: dict[str, list[int]] = {}
    for group in scores.groups:
        equation, colon, _ = group.key.partition(": ")
        if group.effect is None and colon:
            columns.setdefault(equation, []).extend(c for shape in group.shapes for c in shape.columns)
    everything = _explained(scores, [c for own in columns.values() for c in own])
    if everything <= 0:
        return []
    made = [
        Localisation(name, min(1.0, _explained(scores, own) / everything)) for name, own in columns.items()
    ]
    return sorted((one for one in made if one.share > SEEN), key=lambda one: -one.share)


def _explained(scores: LayerScores, columns: Sequence[int]) -> float:
    """2 log likelihood that these directions gain together."""
    own = list(columns)
    total, gram = scores.scores[:, own].sum(axis=0), scores.gram[np.ix_(own, own)]
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / np.outer(size, size)
    return float((total / size) @ np.linalg.pinv(scaled, rcond=1e-8, hermitian=True) @ (total / size))


def found_effects(found: Improvement, parts: Sequence[Compared]) -> list[FoundEffect]:
    """The effects that were added, in order."""
    made = []
    for layer_name, key in found.added:
        layer, fit = found.layers[layer_name], found.fits[layer_name]
        card, estimate = layer.effect(key), estimate_of(fit, key)
        round_ = next(one for one in found.rounds if one.added == key)
        tried = next(one for one in round_.tried if one.key == key)
        made.append(
            FoundEffect(
                key=key,
                name=card.name,
                enters=card.enters,
                members=list(found.members(key)),
                parameters=estimate.parameters,
                p_value=tried.screened.p_value,
                equation=equation_of(card),
                meaning=card.meaning,
                of=card.of,
                same_in_runs_p=_same_in_runs(fit, key),
                share=_share(parts, layer_name, found),
                meanings=dict(card.meanings),
            )
        )
    return made


def estimate_of(fit: LayerFit, key: str) -> EffectEstimate:
    """An effect of a fit, the interval of its size as wide as the scatter from run to run asks for."""
    told, factor = fit.estimates()[key], scatter_of_runs(*fit.sizes_by_run(key))
    size, one = next(iter(told.parameters.items()))
    return replace(told, parameters={**told.parameters, size: _widened(one, factor)})


def _widened(one: Estimate, factor: float) -> Estimate:
    if one.value is None or one.std is None or one.low is None or one.high is None:
        return one
    low, high = (one.value + factor * (end - one.value) for end in (one.low, one.high))
    return replace(one, std=factor * one.std, low=low, high=high)


def equation_of(card: EffectCard) -> str:
    """Typeset, nothing where there is no equation."""
    return "" if card.equation is None else mathml(card.equation)


def _same_in_runs(fit: LayerFit, key: str) -> float | None:
    sizes, stds = fit.sizes_by_run(key)
    return same_size(sizes, stds)


def _share(parts: Sequence[Compared], layer: str, found: Improvement) -> dict[str, float]:
    """Share of the noise-corrected error that all effects of the layer take away, signal by signal."""
    signals = set(found.fits[layer].noise())
    made = {}
    for part in parts:
        for signal, rows in part.rows.items():
            if signal not in signals:
                continue
            noise = part.noise[signal] ** 2
            before, after = (float(np.mean((rows[:, 2] - rows[:, k]) ** 2)) - noise for k in (3, 4))
            if before > 0:
                made[signal] = 1 - float(np.sqrt(max(after, 0.0) / before))
    return made


def minimum_detectable(gate: Screen, layers: Mapping[str, Layer]) -> dict[str, DetectableSize]:
    """Smallest size of each effect that these data would show."""
    held = {}
    for one in gate.layers:
        for group in one.scores.groups:
            if group.effect is not None:
                held[group.key] = _held_name(layers[one.scores.layer].effect(group.key), group.shapes[0].at)
    sizes = detectable_sizes(gate, {key: name for key, name in held.items() if name})
    made = {}
    for (layer, key), size in sizes.items():
        if np.isfinite(size) and _is_effect(gate, layer, key):
            card = layers[layer].effect(key)
            made[key] = DetectableSize(float(size), card.unit, card.typical)
    return made


def _held_name(card: EffectCard, at: Mapping[str, float]) -> str | None:
    return next((name for name in at if name.rpartition(".")[2] == card.size), None)


def _is_effect(gate: Screen, layer: str, key: str) -> bool:
    groups = next(one.scores.groups for one in gate.layers if one.scores.layer == layer)
    return any(group.key == key and group.effect is not None for group in groups)


def not_testable(found: Improvement, gate: Screen | None, missing: Mapping[str, str]) -> list[Refusal]:
    """Effects that nothing was said about, and why.

    missing : layer -> why it could not be looked at
    """
    told = [refusal for layer in found.layers.values() for refusal in layer.not_testable]
    if gate is not None:
        told += [
            Refusal(one.key, one.untestable)
            for one in gate.groups
            if one.untestable is not None and one.effect is not None
        ]
    for entry in CATALOGUE.values():
        if entry.built and not any(name in found.layers for name in entry.built):
            lacking = next((missing[name] for name in entry.built if name in missing), None)
            if lacking is not None:
                told.append(Refusal(entry.name, lacking))
    return told + [Refusal(entry.name, "not built yet") for entry in not_built()]


def next_experiment(found: Improvement, gate: Screen) -> NextExperiment | None:
    """The run that would separate what these data cannot, or show what they hide."""
    for layer_name, key in found.added:
        members = found.members(key)
        if len(members) > 1:
            runs = [found.layers[layer_name].effect(one).shown_by for one in members]
            return NextExperiment(
                drive="; ".join(dict.fromkeys(runs)),
                separates=list(members),
                why="these effects look alike in the runs so far, and differ there",
            )
    sizes = minimum_detectable(gate, found.layers)
    hidden = [(_over_usual(key, size), key) for key, size in sizes.items()]
    hidden = [(ratio, key) for ratio, key in hidden if ratio > 1]
    if not hidden:
        return None
    ratio, key = max(hidden)
    layer = next(layer for layer in found.layers.values() if _knows(layer, key))
    return NextExperiment(
        drive=layer.effect(key).shown_by,
        separates=[key],
        why=f"these data would show {key} only at {ratio:.1f} times its usual size",
    )


def _over_usual(key: str, size: DetectableSize) -> float:
    """How far what would show is beyond what is usual; a rate limit acts the more the smaller it is."""
    ratio = size.value / size.typical
    return 1 / ratio if key in STRONGER_WHERE_SMALLER else ratio


def _knows(layer: Layer, key: str) -> bool:
    try:
        layer.effect(key)
    except (KeyError, ValueError):
        return False
    return True


def discovered(
    found: Improvement, layer: str, score: Screened, parts: Sequence[Compared], seed: int
) -> Discovered:
    """The generic term that was fitted in place of what the catalogue lacks, and how stable its choice is."""
    gate = found.rounds[-1].screen
    scores = next(one.scores for one in gate.layers if one.scores.layer == layer)
    equation, _, term = score.key.partition(": ")
    value, std = found.fits[layer].term(score.key)
    unit = unit_of_term(equation, term)
    return Discovered(
        equation=equation,
        term=term,
        mathml=mathml(equation_with_term(equation, term)),
        coefficient=Estimate(value, std, value - Z * std, value + Z * std, unit),
        p_value=score.p_value,
        stability=_stability(scores, score.key, seed),
        share=_share(parts, layer, found),
    )


def _stability(scores: LayerScores, key: str, seed: int) -> float:
    """Share of half-samples of the data in which the same term explains most."""
    keys, columns = [], []
    for group in scores.groups:
        if group.effect is None and group.key.partition(": ")[0] not in scores.signals:
            for shape in group.shapes:
                keys.append(group.key)
                columns.append(shape.columns[0])
    random = np.random.default_rng(seed)
    block = block_index(scores.run, scores.time, BLOCK)
    count, chosen = int(block.max()) + 1, 0
    own, energy = scores.scores[:, columns], scores.energy[:, columns]
    for _ in range(HALVES):
        part = np.isin(block, random.permutation(count)[: (count + 1) // 2])
        told = energy[part].sum(axis=0)
        power = np.where(told > 0, own[part].sum(axis=0) ** 2 / np.maximum(told, 1e-300), 0.0)
        chosen += keys[int(np.argmax(power))] == key
    return chosen / HALVES
