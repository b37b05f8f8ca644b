"""Write an identified model in the forms of other programs."""

from __future__ import annotations

from ident.dynamics.tyres.pac2002_axle import FITTED
from ident.dynamics.tyres.pac2002_coefficients import with_scaling
from ident.errors import BadRecipe, NotIdentifiable
from ident.glossary import AXLES
from ident.model_file import Model, TyresPart
from ident.stages.tyre_files import PAC2002, property_file_of

EXPORTED = "only PAC2002 tyres fitted to a property file can be written as one"
HOW = (
    "name the file in vehicle.yaml (tyres: file.tir) and run `ident tyres`, with pac2002 among the kinds "
    "that the recipe asks for"
)


def tyre_files(model: Model, source: str) -> dict[str, bytes]:
    """Property file of each axle with the scaling factors of the fit, every other line as it was.

    Parameters
    ----------
    source : what the messages begin with, mostly the path of the model

    Returns
    -------
    axle -> content of its file; both axles have one, for their factors differ

    Raises
    ------
    NotIdentifiable
        If the model holds no tyres, or such of another kind.
    BadRecipe
        If its property file is missing or not the one that was fitted, or a factor has no value.
    """
    tyres = _of_files(model, source)
    held = {axle: one for one in tyres.property_files or [] for axle in one.number}
    made = {}
    for axle in AXLES:
        if axle not in held:
            raise BadRecipe(f"{source}: holds no property file of the {axle} tyres: {HOW}")
        factors = _factors(tyres, axle, source)
        made[axle] = with_scaling(property_file_of(held[axle], source), factors).to_bytes()
    return made


def _of_files(model: Model, source: str) -> TyresPart:
    """The PAC2002 tyres of a model: those that go on, or those beside them."""
    there = [one for one in (model.tyres, model.property_tyres) if one is not None]
    own = next((one for one in there if one.kind == PAC2002), None)
    if own is None:
        holds = f"its tyres are {there[0].kind}" if there else "holds no tyres"
        raise NotIdentifiable(f"{source}: {holds}, {EXPORTED}: {HOW}")
    return own


def _factors(tyres: TyresPart, axle: str, source: str) -> dict[str, float]:
    own = tyres.front if axle == "front" else tyres.rear
    made = {}
    for name in FITTED:
        value = own[name].value if name in own else None
        if value is None:
            raise BadRecipe(f"{source}: tyres.{axle}.{name} is missing, need its value")
        made[name] = value
    return made
