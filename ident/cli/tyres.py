"""``ident tyres``."""

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
def tyres(logs: tuple[Path, ...], options: RunOptions, show: Show) -> None:
    """Identify the axle tyres from the runs in LOGS in which the vehicle turns.

    Cornering stiffness and more of linear, piecewise linear, brush and Magic Formula axles, yaw inertia,
    understeer gradient and characteristic speed, with 95 % intervals. The vehicle file must say the mass and
    where the axles are.

    \b
    Example:
      ident tyres sample_logs/planar/
      ident tyres drive_0.mcap drive_1.mcap --vehicle vehicle.yaml --out reports/tyres --open
    """
    run_and_show("tyres", logs, options, show)
