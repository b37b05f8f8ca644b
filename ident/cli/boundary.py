"""The one place where an error becomes a line on standard error and an exit code."""

from __future__ import annotations

import contextlib
import io
import sys
import traceback
from typing import Any

import click

from ident.cli.terminal import one_line
from ident.errors import IdentError

INTERNAL_ERROR = 1
INTERRUPTED = 130

_DEBUG = "ident.debug"


class ErrorBoundary(click.Group):
    """A group whose commands end in one line and the exit code of ``ident.errors``, never in a traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        _write_what_the_terminal_can_show()
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, BrokenPipeError):
            raise
        except (KeyboardInterrupt, click.Abort):
            click.echo("ident: interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except IdentError as error:
            _show_traceback(ctx)
            for line in error.lines:
                click.echo(f"ident: {one_line(line)}", err=True)
            ctx.exit(error.exit_code)
        except Exception as error:  # noqa: BLE001 the boundary: whatever was not foreseen ends here
            shown = _show_traceback(ctx)
            hint = "" if shown else " (--debug shows where)"
            click.echo(
                f"ident: internal error: {type(error).__name__}: {one_line(str(error))}{hint}", err=True
            )
            ctx.exit(INTERNAL_ERROR)


def remember_debug(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Keep ``--debug`` where the boundary finds it."""
    ctx.meta[_DEBUG] = value


def _show_traceback(ctx: click.Context) -> bool:
    shown = bool(ctx.meta.get(_DEBUG, False))
    if shown:
        click.echo(traceback.format_exc(), err=True)
    return shown


def _write_what_the_terminal_can_show() -> None:
    """Keep a terminal without, say, "±" from ending the program: it gets "?" instead."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            with contextlib.suppress(ValueError):
                stream.reconfigure(errors="replace")
