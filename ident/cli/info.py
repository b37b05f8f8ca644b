"""``ident info``."""

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
def info(logs: tuple[Path, ...], options: RunOptions, show: Show) -> None:
    """Say what is in LOGS: topics, rates, gaps, clocks, which signals map, what is damaged.

    \b
    Example:
      ident info sample_logs/
      ident info drive.mcap --json
    """
    run_and_show("info", logs, options, show)
