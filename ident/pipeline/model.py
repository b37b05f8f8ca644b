"""``model.yaml`` put together from the parts that the stages have identified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ident.model_file import Model, model_from
from ident.pipeline.files import plain

Part = Mapping[str, Any]


def composed(parts: Mapping[str, Part], provenance: Mapping[str, Any]) -> Model:
    """Put the parts of the stages together, in their order.

    A key of a part replaces that key of the parts before it as a whole, but for ``noise`` (signal by signal)
    and the covariance: parameters of other parts stay, as fitted independently of them. The ratio of the
    steering stays where the actuator is fitted anew without one.

    Parameters
    ----------
    parts : stage -> what it has identified
    provenance : stage -> what that was made from

    Raises
    ------
    BadRecipe
        If the result could not be read as a model, naming the stage.
    """
    model = Model()
    for stage, part in parts.items():
        model = model_from(_joined(model, stage, part, provenance[stage]), f"model of {stage}")
    return model


def _joined(model: Model, stage: str, part: Part, provenance: Any) -> dict[str, Any]:
    known = {key: value for key, value in plain(model).items() if value not in (None, {}, [])}
    new = plain(part)
    return {
        **known,
        **new,
        "noise": known.get("noise", {}) | new.get("noise", {}),
        "provenance": known.get("provenance", {}) | {stage: plain(provenance)},
        **_steering(known, new),
        **_covariances(known, new),
    }


def _steering(known: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Keep the ratio where a later stage has fitted the same actuator anew, and no ratio."""
    before, after = known.get("steering"), new.get("steering")
    if before is None or after is None or after.get("ratio") is not None:
        return {}
    return (
        {"steering": {**after, "ratio": before.get("ratio")}}
        if after.get("pair") == before.get("pair")
        else {}
    )


def _covariances(known: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Put the covariance of what a stage has fitted after that of the parts it did not touch.

    A parameter belongs to the part that its name begins with: "tyres.front.cornering_stiffness" to "tyres".
    """
    before, after = known.get("parameters", []), new.get("parameters", [])
    kept = [
        index for index, name in enumerate(before) if name.partition(".")[0] not in new and name not in after
    ]
    rows = [[known["covariance"][i][j] for j in kept] + [0.0] * len(after) for i in kept]
    rows += [[0.0] * len(kept) + list(row) for row in new.get("covariance", [])]
    return {"parameters": [*(before[i] for i in kept), *after], "covariance": rows}
