"""``ident export``."""

from __future__ import annotations

from pathlib import Path

import click

from ident.cli.options import debug_option, quiet_option
from ident.cli.terminal import printable


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.option(
    "--to",
    "form",
    type=click.Choice(["tir"]),
    required=True,
    help="Form: tir, property files of PAC2002 tyres with the scaling factors of the fit.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to write; without --axle two, with _front and _rear in their names.",
)
@click.option("--axle", type=click.Choice(["front", "rear"]), help="Write the tyre of this axle alone.")
@quiet_option
@debug_option
def export(model: Path, form: str, out: Path, axle: str | None, quiet: bool) -> None:  # noqa: ARG001 - one form
    """Write the tyres of MODEL, a model.yaml, in the form of other programs.

    A property file stays as it was but for its scaling factors. Each axle has factors of its own, so that
    one file becomes two. Files that exist are never overwritten.

    \b
    Example:
      ident export reports/my_logs/model.yaml --to tir --out fitted.tir
      ident export model.yaml --to tir --axle front --out steer.tir
    """
    from ident.pipeline.export import export_tyres

    written = export_tyres(model, out, axle)
    if not quiet:
        click.echo(printable("\n".join(map(str, written))))
