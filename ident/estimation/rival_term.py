"""The generic term beside an effect: where it does clearly better, what is there has no name."""

from __future__ import annotations

from collections.abc import Sequence

from ident.estimation.candidate_set import Classes, candidate_set
from ident.estimation.layer import DoesNotFit, Layer, LayerFit, Likelihood
from ident.estimation.residual_tests import Screen, Screened, screen

EFFECT, RIVAL = "effect", "rival"


def rival_of(
    own: Sequence[Screened], signals: Sequence[str], level: float, alone: bool = False
) -> Screened | None:
    """The generic term whose one step would gain most likelihood, in an equation and not in a sensor.

    Of those that stand out beside all that was looked at together, or ``alone``, by themselves.
    """
    generic = [
        one
        for one in own
        if one.effect is None
        and one.shape is not None
        and one.key.partition(": ")[0] not in signals
        and (one.p_marginal if alone else one.p_value) <= level
    ]
    return max(generic, key=lambda one: one.gain, default=None)


def rival_fit(
    layer: Layer, fit: LayerFit, rival: Screened | None, keys: Sequence[str] | None = None
) -> tuple[Layer, LayerFit] | None:
    """The best generic term in place of an effect, fitted in full, and the layer that knows it.

    keys : of the effects beside it, those of the fit unless given
    """
    if rival is None or rival.shape is None:
        return None
    with_it = layer.with_term(rival.key, rival.shape.at, fit)
    if with_it is None:
        return None
    try:
        return with_it, with_it.fitted((*(fit.keys if keys is None else keys), rival.key), start=fit)
    except DoesNotFit:
        return None


def duel(effect: LayerFit, rival: LayerFit, like: LayerFit, base: Likelihood, level: float) -> Classes:
    """Compare a fit with an effect and one with a generic term, under one noise."""
    return candidate_set(
        {EFFECT: effect.likelihood(like), RIVAL: rival.likelihood(like)},
        {EFFECT: effect.freedom, RIVAL: rival.freedom},
        base=base,
        level=level,
    )


def stands_out(fit: LayerFit, looked: Screen) -> bool:
    """Whether an effect of the catalogue is seen beside what is in a fit."""
    left = screen([fit.scores()], level=looked.level, draws=looked.draws)
    return any(
        one.effect is not None and one.untestable is None and one.p_value <= looked.level
        for one in left.groups
    )
