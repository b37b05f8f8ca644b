from __future__ import annotations

import shlex
from pathlib import Path

from ident.pipeline.options import RunOptions, command_line


def test_gives_the_command_that_was_asked_for() -> None:
    assert command_line("steering", [Path("logs/a")], RunOptions()) == "ident steering logs/a"


def test_keeps_every_option_that_changes_an_output() -> None:
    options = RunOptions(Path("r.yaml"), ("auto", "c.yaml"), Path("v.yaml"), Path("out"))
    assert command_line("info", [Path("a"), Path("b")], options) == (
        "ident info a b --recipe r.yaml --channels auto --channels c.yaml --vehicle v.yaml --out out"
    )


def test_quotes_names_for_the_shell() -> None:
    command = command_line("steering", [Path("my logs/$(touch x)")], RunOptions())
    assert shlex.split(command) == ["ident", "steering", "my logs/$(touch x)"]
