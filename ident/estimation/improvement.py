"""The loop: what is left, where it points, which effect takes it away; one effect after another.

Each round tests everything that the present fits have not got, over all layers together (the gate and the
screen), fits the candidates that the screen names in full, and adds the one of the largest likelihood. It
stops at the first round in which nothing is left, which keeps the level of the whole.

An effect is added only if it is physically possible and no generic term of the same layer does clearly better
than it: where one does, what is there has no name in the catalogue, and the loop ends. But a truck may lack
several things at once, and then a term can do better only because it takes in part of the others. Where
effects of the catalogue still stand out beside the term, the loop goes on, and the two are compared again at
its end, with all that was added (:func:`_contested`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ident.estimation.candidate_set import Classes, candidate_set
from ident.estimation.layer import SIZE, DoesNotFit, Layer, LayerFit
from ident.estimation.residual_tests import Screen, Screened, screen
from ident.estimation.rival_term import EFFECT, RIVAL, duel, rival_fit, rival_of, stands_out

Array = NDArray[np.float64]

SURVIVORS = 5
MOST_EFFECTS = 8

BEHIND, KEPT = 50.0, 0.5  # 2 log likelihood, and part of the gain: further behind the best is out of reach

CONTRADICTS = 5.0  # standard errors of what the sensors say by themselves
PRACTICAL = 0.2  # of it

Known = Mapping[str, tuple[float, float]]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Tried:
    """One candidate of a round.

    screened : its score; fit : in full, None where it was not fitted
    gain : 2 log likelihood over the fit without it, by the noise of the best
    why_not : why it was not added, None where it was
    """

    key: str
    screened: Screened
    fit: LayerFit | None = None
    gain: float | None = None
    in_class: bool = False
    why_not: str | None = None


@dataclass(frozen=True)
class Round:
    """One round of the loop.

    layer : in which something was tried, None where nothing was left
    rival : the generic term of that layer that gains most
    contested : whether the rival did clearly better than what was added, as long as other things were missing
    """

    screen: Screen
    layer: str | None
    tried: tuple[Tried, ...]
    added: str | None
    members: tuple[str, ...]
    rival: Screened | None
    why: str
    contested: bool = False


@dataclass
class Improvement:
    """What the loop has come to.

    base, fits : layer -> fit without effects, and with all that were added
    rounds : in order; the gate of the last one is that of the final fits
    added : (layer, key) in order; dropped : keys that were taken back, since they did not hold
    """

    layers: Mapping[str, Layer]
    base: dict[str, LayerFit]
    fits: dict[str, LayerFit]
    rounds: list[Round] = field(default_factory=list)
    added: list[tuple[str, str]] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)

    def shorter(self, layer: str, fit: LayerFit) -> LayerFit:
        """A fit of a layer without the last of its effects."""
        kept = fit.keys[:-1]
        return self.layers[layer].fitted(kept, start=self.base[layer]) if kept else self.base[layer]

    def with_fit(self, layer: str, fit: LayerFit) -> Improvement:
        """The same with another fit of a layer."""
        return replace(self, fits={**self.fits, layer: fit})

    def take_back(self, layer: str, fit: LayerFit) -> None:
        """Go on with a fit that has fewer effects."""
        gone = [key for key in self.fits[layer].keys if key not in fit.keys]
        self.fits[layer] = fit
        self.added = [one for one in self.added if one[0] != layer or one[1] not in gone]
        self.dropped += gone

    @property
    def passes(self) -> bool:
        """Whether nothing is left."""
        return not self.rounds[-1].screen.rejected

    def members(self, key: str) -> tuple[str, ...]:
        """The class of an effect that was added, itself first."""
        return next(one.members for one in self.rounds if one.added == key)


def improve_layers(
    layers: Sequence[Layer],
    *,
    level: float,
    draws: int,
    seed: int,
    effects: Sequence[str] | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
    survivors: int = SURVIVORS,
    most_effects: int = MOST_EFFECTS,
    progress: Progress = lambda _what, _done, _total: None,
) -> Improvement:
    """Run the loop.

    Parameters
    ----------
    effects : names that may be added; all that are built where None
    known : key of an effect -> its size and standard error as the sensors tell it among themselves; a fit
        that contradicts that is a stand-in for something else
    survivors : of the screen, that are fitted in full; most_effects : that are added
    """
    progress("fit the base model", 0, most_effects)
    base = {layer.name: layer.fitted() for layer in layers}
    found = Improvement({layer.name: layer for layer in layers}, base, dict(base))
    for number in range(most_effects + 1):
        progress(f"test what is left, round {number + 1}", number, most_effects)
        looked = screen(
            [fit.scores() for fit in found.fits.values()], level=level, draws=draws, seed=seed + number
        )
        if not looked.rejected:
            found.rounds.append(
                Round(looked, None, (), None, (), None, "nothing is left that noise does not explain")
            )
            break
        if number == most_effects:
            why = f"something is left after {most_effects} effects"
            found.rounds.append(Round(looked, _layer_of(looked), (), None, (), None, why))
            break
        one = _round(found, looked, effects, survivors, known or {})
        found.rounds.append(one)
        if one.added is None or one.layer is None:
            break
        fit = next(t.fit for t in one.tried if t.key == one.added)
        found.fits[one.layer] = fit  # type: ignore[assignment]
        found.added.append((one.layer, one.added))
    _without_contested(found)
    return found


def _layer_of(looked: Screen) -> str | None:
    return looked.strongest.layer if looked.strongest else None


def _signals(looked: Screen, layer: str) -> tuple[str, ...]:
    return next(one.scores.signals for one in looked.layers if one.scores.layer == layer)


def _round(
    found: Improvement, looked: Screen, effects: Sequence[str] | None, survivors: int, known: Known
) -> Round:
    """Fit what the screen names, in the layer in which most is left, and choose."""
    layer = _where(looked)
    fit = found.fits[layer]
    own = [one for one in looked.groups if one.layer == layer and one.untestable is None]
    candidates = [one for one in own if one.effect is not None and (effects is None or one.effect in effects)]
    candidates.sort(key=lambda one: -one.statistic)
    alone = all(one.p_value > looked.level for one in own if one.shape is not None)
    tried: list[Tried] = []
    for one in candidates:
        p_value = one.p_marginal if alone else one.p_value
        why_not = None if fit.is_far else _not_worth(one, p_value, found.layers[layer], looked.level)
        if why_not is None and sum(t.why_not is None for t in tried) >= survivors:
            why_not = f"its score is below those of the {survivors} that were fitted"
        tried.append(Tried(one.key, one, why_not=why_not))
    alone = alone or all(one.why_not is not None for one in tried)
    tried = _with_foremost(tried, own, found.layers[layer], looked.level)
    tried = [_fitted(t, found.layers[layer], fit, known) if t.why_not is None else t for t in tried]
    return _chosen(
        found, looked, layer, tried, rival_of(own, _signals(looked, layer), looked.level, alone), known
    )


def _with_foremost(
    tried: Sequence[Tried], own: Sequence[Screened], layer: Layer, level: float
) -> list[Tried]:
    """Fit also what stands out by itself, and gains more in one step than all others and any generic term.

    An effect that is large and acts in few places scatters its own score, since one step is far from enough:
    beside all that is looked at together it may then seem to be nothing.
    """
    most = max((one.gain for one in own if one.effect is None), default=0.0)
    most = max(most, *(one.screened.gain for one in tried if one.why_not is None), 0.0)

    def worth(one: Screened) -> bool:
        return one.gain > most and _not_worth(one, one.p_marginal, layer, level) is None

    return [replace(one, why_not=None) if worth(one.screened) else one for one in tried]


def _where(looked: Screen) -> str:
    """The layer in which most is left for certain."""
    first = looked.strongest
    assert first is not None
    sure = [one for one in looked.groups if one.untestable is None and one.p_value <= looked.level]
    return max(sure, key=lambda one: one.statistic / max(one.freedom, 1), default=first).layer


def _not_worth(one: Screened, p_value: float, layer: Layer, level: float) -> str | None:
    """Why a candidate is not fitted in full, None where it is.

    p_value : by which it must stand out: that of all that was looked at together; its own where nothing but
        the size of residuals does so by that. What is left for certain has no direction then, and its own
        likelihood decides.
    """
    if p_value > level:
        return f"its score does not stand out (p = {one.p_value:.2g}, all that was looked at together)"
    if layer.effect(one.key).positive and one.freedom == 1 and one.size[0] < 0:
        return "its size would have to be negative"
    return None


def _fitted(one: Tried, layer: Layer, fit: LayerFit, known: Known) -> Tried:
    """Fit a candidate with all that is there already, from the best of its shapes."""
    shape, size = one.screened.shape, one.screened.size[0]
    start = {**(shape.at if shape is not None else {}), **({SIZE: size} if np.isfinite(size) else {})}
    try:
        made = layer.fitted((*fit.keys, one.key), start=fit, shapes={one.key: [start]})
    except DoesNotFit as error:
        return replace(one, why_not=str(error))
    return replace(one, fit=made, why_not=_impossible(made, one.key, layer, known))


def _impossible(fit: LayerFit, key: str, layer: Layer, known: Known) -> str | None:
    """Why an effect cannot be of the size that a fit gives it, None where it can."""
    told = fit.is_allowed().get(key)
    if told is None and key in known:
        value, std = known[key]
        size, unit = fit.size(key), layer.effect(key).unit
        if abs(size - value) > CONTRADICTS * std + PRACTICAL * abs(value):
            return f"{size:.3g} {unit}, while the sensors alone say {value:.3g} ± {1.96 * std:.1g} {unit}"
    return told


def _chosen(
    found: Improvement,
    looked: Screen,
    layer: str,
    tried: list[Tried],
    rival: Screened | None,
    known: Known,
) -> Round:
    possible = [one for one in tried if one.fit is not None and one.why_not is None]
    if not possible:
        why = "something is left, and no effect of the catalogue that could be fitted explains it"
        return Round(looked, layer, tuple(tried), None, (), rival, why)
    fits = {one.key: one.fit for one in possible if one.fit is not None}
    rough = {key: float(fit.likelihood(fit).values.sum()) for key, fit in fits.items()}
    like = fits[max(rough, key=lambda key: rough[key])].renoised()
    before = found.fits[layer].likelihood(like)
    behind = {key: max(rough.values()) - one for key, one in rough.items()}
    far = max(BEHIND, (1 - KEPT) * (max(rough.values()) - float(found.fits[layer].likelihood().values.sum())))
    likelihoods = {key: fit.likelihood(like, roughly=behind[key] > far) for key, fit in fits.items()}
    gains = {key: float(one.values.sum() - before.values.sum()) for key, one in likelihoods.items()}
    freedom = {key: fit.freedom for key, fit in fits.items()}
    against = rival_fit(found.layers[layer], found.fits[layer], rival)
    classes = candidate_set(likelihoods, freedom, base=before, level=looked.level)
    best = classes.best
    tried = [_judged(one, gains, classes, best) for one in tried]
    contested = False
    if against is not None and rival is not None:
        fought = duel(fits[best], against[1], like, before, looked.level)
        contested = fought.members == (RIVAL,)
        if contested and not stands_out(against[1], looked):
            return _unnamed(looked, layer, tried, rival, best)
    tried.sort(key=lambda one: (one.gain is None, -(one.gain or 0.0), -one.screened.statistic))
    threshold = float(chi2.isf(looked.level, max(1, freedom[best] - found.fits[layer].freedom)))
    if gains[best] < threshold:
        why = f"no effect of the catalogue explains it: the nearest, {best}, gains {gains[best]:.1f}"
        undone = tuple(
            replace(one, why_not=one.why_not or "it gains nothing fitted in full") for one in tried
        )
        return Round(looked, layer, undone, None, (), rival, why)
    members = (best, *(key for key in classes.members if key != best))
    fit = like if like.keys == fits[best].keys else fits[best].renoised()
    if (told := _impossible(fit, best, found.layers[layer], known)) is not None:
        rest = [replace(one, why_not=told, gain=None) if one.key == best else one for one in tried]
        again = [
            replace(one, why_not=None) if one.gain is not None and one.fit is not None else one
            for one in rest
        ]
        return _chosen(found, looked, layer, again, rival, known)
    tried = [replace(one, fit=fit) if one.key == best else one for one in tried]
    why = _reason(best, members, gains)
    return Round(looked, layer, tuple(tried), best, members, rival, why, contested)


def _without_contested(found: Improvement) -> None:
    """Take back the first effect that its rival still beats, and all that was added after it in its layer.

    What other layers were given stays, and so do its rounds.
    """
    for number, one in enumerate(found.rounds):
        if not one.contested or one.layer is None or one.added is None or one.rival is None:
            continue
        if not _contested(found, one, one.layer, one.added, one.rival):
            continue
        layer, keys = found.layers[one.layer], found.fits[one.layer].keys
        kept = keys[: keys.index(one.added)]
        gone = set(keys) - set(kept)
        base = found.base[one.layer]
        found.fits[one.layer] = layer.fitted(kept, start=base) if kept else base
        found.added = [each for each in found.added if each[0] != one.layer or each[1] not in gone]
        elsewhere = [each for each in found.rounds[number + 1 :] if each.added and each.layer != one.layer]
        found.rounds[number:] = [
            *elsewhere,
            _unnamed(one.screen, one.layer, one.tried, one.rival, one.added),
        ]
        return


def _contested(found: Improvement, one: Round, layer: str, key: str, rival: Screened) -> bool:
    """Whether a generic term is still the better one where an effect stands, now that all else is there.

    Where nothing is left: if all that was added since does not do clearly better than the term alone, or the
    term does clearly better in the place of the effect. Where something is left, which the term may take in
    as well: if it does clearly better in the place of the effect, and the effect adds nothing clear to it.
    """
    fit = found.fits[layer]
    base, level = found.base[layer].likelihood(fit), one.screen.level
    others = [other for other in fit.keys if other != key]
    if found.passes:
        alone = rival_fit(found.layers[layer], fit, rival, fit.keys[: fit.keys.index(key)])
        if alone is not None and duel(fit, alone[1], fit, base, level).members != (EFFECT,):
            return True
    instead = rival_fit(found.layers[layer], fit, rival, others)
    if instead is None or duel(fit, instead[1], fit, base, level).members != (RIVAL,):
        return False
    both = None if found.passes else rival_fit(found.layers[layer], fit, rival, fit.keys)
    return both is None or duel(both[1], instead[1], fit, base, level).members != (EFFECT,)


def _unnamed(looked: Screen, layer: str, tried: Sequence[Tried], rival: Screened, best: str) -> Round:
    """A generic term does better than the best effect: what is there has no name in the catalogue."""
    told = f"{rival.key} explains clearly more"
    undone = tuple(
        replace(one, why_not=told if one.key == best else one.why_not or told, in_class=False)
        for one in tried
    )
    why = f"{told} than {best}, the nearest in the catalogue"
    return Round(looked, layer, undone, None, (), rival, why)


def _judged(one: Tried, gains: Mapping[str, float], classes: Classes, best: str) -> Tried:
    if one.key not in gains:
        return one
    gain = gains[one.key]
    inside = one.key in classes.members
    why = None
    if one.key != best:
        behind = gains[best] - gain
        why = (
            f"cannot be told from {best} (2 log likelihood {behind:.1f} below it)"
            if inside
            else f"2 log likelihood {behind:.1f} below {best}"
        )
    return replace(one, gain=gain, in_class=inside, why_not=why)


def _reason(best: str, members: Sequence[str], gains: Mapping[str, float]) -> str:
    told = f"{best} gains {gains[best]:.0f} in 2 log likelihood"
    others = [key for key in members if key != best]
    if others:
        return f"{told}; these data cannot tell it from {', '.join(others)}"
    rest = sorted((value for key, value in gains.items() if key != best), reverse=True)
    return f"{told}, the next {rest[0]:.0f}" if rest else told


def with_term(found: Improvement) -> tuple[str, Screened] | None:
    """Add the generic term that explains most of what is left; -> its layer and score, if any does."""
    gate = found.rounds[-1].screen
    layer = found.rounds[-1].layer or _layer_of(gate)
    if layer is None:
        return None
    own = [one for one in gate.groups if one.layer == layer and one.untestable is None]
    rival = rival_of(own, _signals(gate, layer), gate.level)
    made = rival_fit(found.layers[layer], found.fits[layer], rival)
    if rival is None or made is None:
        return None
    found.layers = {**found.layers, layer: made[0]}
    found.fits[layer] = made[1].renoised()
    return layer, rival
