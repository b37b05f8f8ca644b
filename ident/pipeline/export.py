"""Write what ``ident export`` makes of a model: new files only, never in place of one that is there."""

from __future__ import annotations

from pathlib import Path

from ident.errors import UsageError
from ident.model_file import read_model
from ident.pipeline.files import atomic
from ident.pipeline.output_folder import refuse_inside_a_log
from ident.stages.export import tyre_files


def export_tyres(model: Path, out: Path, axle: str | None = None) -> list[Path]:
    """Write the tyres of a model as property files.

    Parameters
    ----------
    model : a ``model.yaml``
    out : the file of one axle; without ``axle`` both are written beside it, as ``out_front`` and ``out_rear``

    Returns
    -------
    what was written

    Raises
    ------
    UsageError
        If a file is there already, or cannot be written.
    BadRecipe, NotIdentifiable
        If the model cannot be read, or holds no tyres of a property file.
    """
    found = tyre_files(read_model(model), str(model))
    wanted = {axle: out} if axle else {one: out.with_stem(f"{out.stem}_{one}") for one in found}
    refuse_inside_a_log(out.parent)
    for path in wanted.values():
        if path.exists():
            raise UsageError(f"{path} exists and stays as it is: name another file with --out")
    for one, path in wanted.items():
        with atomic(path) as temporary:
            temporary.write_bytes(found[one])
    return list(wanted.values())
