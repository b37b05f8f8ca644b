"""``ident steering``."""

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
def steering(logs: tuple[Path, ...], options: RunOptions, show: Show) -> None:
    """Identify the steering transfer function from the steps, pulses and sines in LOGS.

    Gain, dead time and time constants with 95 % intervals, from the requested to the measured angle.

    \b
    Example:
      ident steering sample_logs/
      ident steering drive_0.mcap drive_1.mcap --channels channels.yaml --out reports/steering --open
    """
    run_and_show("steering", logs, options, show)
