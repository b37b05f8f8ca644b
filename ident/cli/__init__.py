"""The command ``ident``; nothing heavy is imported before a command has something to do."""

from __future__ import annotations

import os

import click

from ident import __version__
from ident.cli.boundary import ErrorBoundary
from ident.cli.evaluate import evaluate
from ident.cli.export import export
from ident.cli.improve import improve
from ident.cli.info import info
from ident.cli.init import init
from ident.cli.record import record
from ident.cli.run import run
from ident.cli.steering import steering
from ident.cli.tyres import tyres
from ident.cli.validate import validate

# The matrices of a fit are many and small: a BLAS with threads spends its time waiting for them.
for _library in ("OPENBLAS", "MKL", "BLIS"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


@click.group(cls=ErrorBoundary, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="%(prog)s %(version)s")
def main() -> None:
    """Identify a vehicle model, with error bars, from the logs of an autonomous truck.

    LOGS are rosbag2 folders, single .mcap or .db3 files, or folders that hold such logs.

    \b
    Example:
      ident info my_logs/
      ident steering my_logs/
      ident tyres my_logs/
      ident evaluate my_logs/
      ident improve my_logs/
      ident validate my_logs/
      ident run my_truck.yaml my_logs/
      ident record --out drive.mcap /vehicle/velocity
      ident export reports/my_logs/model.yaml --to tir --out fitted.tir

    \b
    Exit codes: 0 done, 1 internal error, 2 usage, 3 no usable log or a bad recipe,
    4 the data cannot answer, 5 a requirement is not met, 130 interrupted.
    """


main.add_command(record)
main.add_command(init)
main.add_command(info)
main.add_command(steering)
main.add_command(tyres)
main.add_command(evaluate)
main.add_command(improve)
main.add_command(validate)
main.add_command(run)
main.add_command(export)
