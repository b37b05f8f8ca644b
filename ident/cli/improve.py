"""``ident improve``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.options import run_options
from ident.cli.stage import run_and_show

if TYPE_CHECKING:
    from ident.cli.options import Show
    from ident.pipeline.options import RunOptions


@click.command()
@run_options
def improve(logs: tuple[Path, ...], options: RunOptions, show: Show) -> None:
    """Find what the model of the truck in LOGS lacks, add it, and say how much error that takes away.

    What the identified model leaves is tested for anything that noise does not explain, traced to an effect
    of the catalogue, and that effect is added; repeated until nothing is left that the data can tell. The
    errors before and after are those on runs that took no part in the fit. Tyres and steering are
    identified first where that is not up to date; either may be missing.

    \b
    Example:
      ident improve my_logs/
      ident improve my_logs/ --recipe my_truck.yaml --out reports/improved --open
    """
    run_and_show("improve", logs, options, show)
