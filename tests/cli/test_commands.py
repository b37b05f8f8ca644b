from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from ident import __version__, errors
from ident.cli import main
from ident.cli.terminal import one_line, printable, progress_shown
from ident.pipeline.options import RunOptions

ROOT = Path(__file__).parents[2]


class FakePipeline:
    """Stands in for the pipeline: keeps what it was called with and does what it is told."""

    def __init__(self, folder: Path) -> None:
        self.outcome = SimpleNamespace(
            summary="gain 0.98 ± 0.01\nrun \x1b[2J",
            json='{"gain": "±"}\n',
            report=folder / "index.html",
            error=None,
        )
        self.error: BaseException | None = None
        self.called: tuple[str, tuple[Path, ...], RunOptions] | None = None

    def run_stage(self, stage: str, logs: tuple[Path, ...], options: RunOptions, progress: Any) -> Any:
        self.called = (stage, logs, options)
        progress("reading run_a", 0, 2)
        progress("reading run_a", 1, 2)
        if self.error is not None:
            raise self.error
        return self.outcome

    def run_recipe(self, recipe: Path, logs: tuple[Path, ...], options: RunOptions, progress: Any) -> Any:
        return self.run_stage(f"run {recipe}", logs, options, progress)

    def write_guesses(self, logs: tuple[Path, ...], out: Path, _: Any) -> Any:
        self.called = ("init", logs, RunOptions(out=out))
        return SimpleNamespace(
            channels=out / "channels.yaml",
            vehicle=out / "vehicle.yaml",
            found=["speed", "yaw_rate"],
            notes=["a: cut"],
        )


@pytest.fixture
def pipeline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakePipeline:
    fake = FakePipeline(tmp_path)
    run = SimpleNamespace(run_stage=fake.run_stage, run_recipe=fake.run_recipe)
    monkeypatch.setitem(sys.modules, "ident.pipeline.run", run)
    monkeypatch.setitem(sys.modules, "ident.pipeline.init", SimpleNamespace(write_guesses=fake.write_guesses))
    return fake


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments), prog_name="ident")


COMMANDS: list[tuple[str, click.Command]] = [("ident", main), *main.commands.items()]


# --- help ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "command"), COMMANDS)
def test_every_command_says_what_it_does_and_shows_an_example_that_parses(
    name: str, command: click.Command
) -> None:
    text = command.help or ""
    examples = re.findall(r"^\s+ident (.+)$", text.partition("Example:")[2], flags=re.MULTILINE)
    assert len(text.split("Example:")[0].split()) > 8, "no description"
    assert examples, "no example"
    for example in examples:
        shown, *arguments = shlex.split(example)
        assert shown == name or command is main
        given = main.commands[shown].make_context(shown, arguments).params
        assert any(given.get(name) for name in ("logs", "model", "topics", "everything"))


@pytest.mark.parametrize(("name", "command"), COMMANDS)
def test_every_option_is_explained(name: str, command: click.Command) -> None:
    options = [option for option in command.params if isinstance(option, click.Option)]
    assert options
    assert [option.name for option in options if not option.help] == []


def test_says_its_version() -> None:
    assert call("--version").output == f"ident {__version__}\n"


def test_the_program_answers_from_a_shell() -> None:
    program = "from ident.cli import main; main(prog_name='ident')"
    ended = subprocess.run(
        [sys.executable, "-c", program, "--help"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "Usage: ident [OPTIONS] COMMAND" in ended.stdout
    assert ended.stderr == ""


# --- what arrives, and what is shown -------------------------------------------------------------------


def test_options_arrive_as_they_were_given(pipeline: FakePipeline) -> None:
    ended = call(
        *("steering", "a", "b/c.mcap", "--recipe", "r.yaml", "--channels", "auto", "--channels", "c.yaml"),
        *("--vehicle", "v.yaml", "--out", "o", "--seed", "3"),
    )
    assert ended.exit_code == 0
    options = RunOptions(Path("r.yaml"), ("auto", "c.yaml"), Path("v.yaml"), Path("o"), 3)
    assert pipeline.called == ("steering", (Path("a"), Path("b/c.mcap")), options)


def test_run_takes_the_recipe_before_the_logs(pipeline: FakePipeline) -> None:
    ended = call("run", "r.yaml", "a", "b", "--out", "o", "--json")
    assert ended.stdout == '{"gain": "±"}\n'
    assert pipeline.called == ("run r.yaml", (Path("a"), Path("b")), RunOptions(out=Path("o")))
    assert call("run", "r.yaml").exit_code == 2


def test_evaluate_takes_a_model_to_compare_with(pipeline: FakePipeline) -> None:
    call("evaluate", "a", "--against", "old/model.yaml")
    assert pipeline.called == ("evaluate", (Path("a"),), RunOptions(against=Path("old/model.yaml")))


def test_requirements_that_are_not_met_are_a_line_each_after_the_answer(pipeline: FakePipeline) -> None:
    pipeline.outcome.error = errors.RequirementNotMet("yaw rate: 0.03 rad/s", "heading:\n0.2 rad")
    ended = call("run", "r.yaml", "a")
    assert ended.exit_code == 5
    assert ended.stdout.startswith("gain 0.98 ± 0.01\n")
    assert ended.stderr.splitlines()[-2:] == ["ident: yaw rate: 0.03 rad/s", "ident: heading: 0.2 rad"]


def test_what_was_not_said_is_none(pipeline: FakePipeline) -> None:
    call("info", "a")
    assert pipeline.called == ("info", (Path("a"),), RunOptions())


def test_prints_the_summary_and_where_the_report_lies(pipeline: FakePipeline) -> None:
    ended = call("steering", "a")
    report = pipeline.outcome.report
    assert ended.stdout == f"gain 0.98 ± 0.01\nrun \\x1b[2J\n\nReport: {report}\n"
    assert ended.stderr == "reading run_a\n"


def test_json_stands_alone_on_standard_output(pipeline: FakePipeline) -> None:
    assert call("steering", "a", "--json").stdout == '{"gain": "±"}\n'


def test_quiet_prints_nothing_but_json_if_asked(pipeline: FakePipeline) -> None:
    assert call("steering", "a", "--quiet").output == ""
    assert call("steering", "a", "--quiet", "--json").output == '{"gain": "±"}\n'


def test_opens_the_report(pipeline: FakePipeline, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))
    call("info", "a", "--open")
    assert opened == [pipeline.outcome.report.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda _: False)
    assert "no browser found: open " in call("info", "a", "--open").stderr


def test_init_says_what_it_wrote_and_what_to_do_next(pipeline: FakePipeline) -> None:
    ended = call("init", "logs", "--out", "my truck")
    assert pipeline.called == ("init", (Path("logs"),), RunOptions(out=Path("my truck")))
    assert ended.stdout.splitlines()[:3] == [
        "left out: a: cut",
        "my truck/channels.yaml: 2 signals guessed: speed, yaw_rate",
        "my truck/vehicle.yaml: what the logs tell of the vehicle",
    ]
    follow_up = ended.stdout.splitlines()[-1].partition("ident ")[2]
    assert shlex.split(follow_up) == [
        *("info", "logs", "--channels", "my truck/channels.yaml", "--vehicle", "my truck/vehicle.yaml")
    ]
    assert call("init", "logs", "--quiet").output == ""


# --- errors ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        (errors.IdentError, 1),
        (errors.UsageError, 2),
        (errors.UnusableLog, 3),
        (errors.BadRecipe, 3),
        (errors.NotIdentifiable, 4),
        (errors.RequirementNotMet, 5),
    ],
)
def test_a_known_error_is_one_line_and_its_exit_code(
    pipeline: FakePipeline, error: type[Exception], exit_code: int
) -> None:
    pipeline.error = error("spans 0.1 rad,\n need 0.5 rad:\tdrive \x1b]0;title\x07 steps")
    ended = call("steering", "a", "--quiet")
    assert ended.exit_code == exit_code
    assert ended.stderr == "ident: spans 0.1 rad, need 0.5 rad: drive \\x1b]0;title\\x07 steps\n"
    assert ended.stdout == ""


def test_an_unknown_error_is_one_line_that_points_to_debug(pipeline: FakePipeline) -> None:
    pipeline.error = ZeroDivisionError("division\nby zero")
    ended = call("info", "a", "--quiet")
    assert ended.exit_code == 1
    assert (
        ended.stderr == "ident: internal error: ZeroDivisionError: division by zero (--debug shows where)\n"
    )


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), errors.BadRecipe("x")])
def test_debug_shows_where_an_error_comes_from(pipeline: FakePipeline, error: Exception) -> None:
    pipeline.error = error
    ended = call("info", "a", "--quiet", "--debug")
    assert ended.stderr.startswith("Traceback (most recent call last):")
    assert "in run_stage" in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("ident: ")
    assert "--debug" not in ended.stderr.splitlines()[-1]


def test_an_interrupt_ends_with_130(pipeline: FakePipeline) -> None:
    pipeline.error = KeyboardInterrupt()
    ended = call("steering", "a", "--quiet")
    assert (ended.exit_code, ended.stderr) == (130, "ident: interrupted\n")


@pytest.mark.parametrize("arguments", [["steering"], ["steering", "a", "--chanels", "c"], []])
def test_a_wrong_call_ends_with_2(arguments: list[str]) -> None:
    assert call(*arguments).exit_code == 2


# --- the terminal --------------------------------------------------------------------------------------


def test_writes_out_what_could_command_a_terminal() -> None:
    assert printable("\x1b[31mrot\x07\r\n\u202eabc\u009b") == "\\x1b[31mrot\\x07\\r\n\\u202eabc\\x9b"
    assert printable("Größe 0.1 ± 0.2\u202fµs²") == "Größe 0.1 ± 0.2\u202fµs²"


def test_keeps_an_error_short() -> None:
    assert len(one_line("x" * 10_000)) == 500


def test_progress_is_one_line_for_each_thing_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress_shown(quiet=False) as progress:
        for run in ("a", "b"):
            for done in range(3):
                progress(f"reading {run}", done, 2)
    assert capsys.readouterr() == ("", "reading a\nreading b\n")


def test_bars_on_a_terminal_take_text_from_a_log_as_text(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_shown(quiet=False) as progress:
        progress("reading [bold]a[/nonsense]", 1, 2)
        progress("reading [bold]a[/nonsense]", 2, 2)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "[bold]a[/nonsense]" in shown.err


# --- the README --------------------------------------------------------------------------------------


def test_the_readme_names_every_command_option_and_exit_code() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    options = {
        name for command in main.commands.values() for option in command.params for name in option.opts
    }
    known = {error.exit_code for error in vars(errors).values() if isinstance(error, type)} | {0, 130}
    others = {"run": "RECIPE LOGS...", "export": "MODEL", "record": "TOPIC..."}
    calls = dict.fromkeys(main.commands, "LOGS...") | others
    assert [name for name, logs in calls.items() if f"`ident {name} {logs}`" not in readme] == []
    assert [name for name in options if name.startswith("--") and f"`{name}" not in readme] == []
    assert [code for code in sorted(known) if f"\n| {code} | " not in readme] == []
