"""``ident record``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ident.cli.options import debug_option, quiet_option
from ident.cli.terminal import one_line, printable
from ident.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Group

    from ident.pipeline.record import Status

_SHOWN_TOPICS = 20
_LINE_EVERY = 10.0


@click.command()
@click.argument("topics", nargs=-1, metavar="TOPIC...")
@click.option(
    "--domain", type=click.IntRange(0, 232), default=0, show_default=True, help="DDS domain to join."
)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The recording (.mcap).")
@click.option("--all", "everything", is_flag=True, help="Record all topics instead of TOPIC...")
@click.option("--exclude", multiple=True, metavar="TOPIC", help="Leave these out; names or globs.")
@click.option("--duration", metavar="TIME", help="Stop after this time, such as '10 min'; else at Ctrl-C.")
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
@quiet_option
@debug_option
def record(
    topics: tuple[str, ...],
    domain: int,
    out: Path,
    everything: bool,
    exclude: tuple[str, ...],
    duration: str | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Record live DDS topics, by names or globs, until Ctrl-C. Needs the extra `dds` (Cyclone DDS).

    What is recorded can be read at any moment. ROS 2 topics may be given by their ROS names. Writers that
    send no type information are refused by name, the others are recorded.

    \b
    Example:
      ident record --domain 0 --out drive.mcap /vehicle/velocity '/control/*'
      ident record --out drive.mcap --all --exclude '*image*' --duration '10 min'
    """
    if everything == bool(topics):
        raise UsageError("name topics to record, or say --all: ident record --out drive.mcap /odom")
    from ident.pipeline.record import missing_topics, record_topics

    with _followed(quiet) as (show, note):
        status = record_topics(
            domain, out, topics, exclude, duration=duration, overwrite=overwrite, show=show, note=note
        )
    for name in missing_topics(topics, status):
        click.echo(one_line(f"ident: {name}: no writer seen, nothing recorded of it"), err=True)
    if not quiet:
        click.echo(printable(_summary(out, status)))


def _summary(out: Path, status: Status) -> str:
    """Return what was recorded, a line a topic."""
    lines = [
        f"{each.topic}: {each.messages} messages, {each.messages / status.seconds:.1f}/s"
        + (f", {each.lost} lost" if each.lost else "")
        + (" (best effort: what was lost on the way is not counted)" if each.best_effort else "")
        for each in status.topics
    ]
    lines += [f"refused {topic} ({kind}): {why}" for topic, kind, why in status.refused]
    total = f"{out}: {status.messages} messages, {status.bytes / 1e6:.1f} MB in {status.seconds:.1f} s"
    lost = f"{status.lost} counted as lost"
    return "\n".join(
        [*lines, f"{total}, {lost}", f"Look at it with: {shlex.join(['ident', 'info', str(out)])}"]
    )


@contextmanager
def _followed(quiet: bool) -> Iterator[tuple[Callable[[Status], None], Callable[[str], None]]]:
    """Give what shows the progress and what tells events: a table on a terminal, lines elsewhere."""
    if quiet:
        yield lambda _: None, lambda _: None
    elif not sys.stderr.isatty():
        lines = _Lines()
        yield lines.show, lines.note
    else:
        from rich.console import Console
        from rich.live import Live

        with Live(console=Console(stderr=True), auto_refresh=False, transient=True) as live:
            yield (
                lambda status: live.update(_table(status), refresh=True),
                lambda text: live.console.print(one_line(text), markup=False, highlight=False),
            )


class _Lines:
    """A line each event, and one now and then of how it goes."""

    def __init__(self) -> None:
        self._shown = 0.0

    def note(self, text: str) -> None:
        click.echo(one_line(text), err=True)

    def show(self, status: Status) -> None:
        if status.seconds - self._shown >= _LINE_EVERY:
            self._shown = status.seconds
            self.note(_line(status))


def _line(status: Status) -> str:
    rate = sum(each.rate for each in status.topics)
    return (
        f"{status.seconds:.0f} s: {status.messages} messages, {rate:.0f}/s, {status.bytes / 1e6:.1f} MB, "
        f"{len(status.topics)} topics, {status.lost} lost"
    )


def _table(status: Status) -> Group:
    """Return how it goes, and the topics with the highest rates."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None)
    for name in ("topic", "messages", "1/s", "MB", "lost"):
        table.add_column(name, justify="left" if name == "topic" else "right")
    for each in sorted(status.topics, key=lambda topic: -topic.rate)[:_SHOWN_TOPICS]:
        numbers = (str(each.messages), f"{each.rate:.0f}", f"{each.bytes / 1e6:.1f}", str(each.lost))
        table.add_row(Text(printable(each.topic)), *numbers)
    return Group(Text(_line(status)), table)
