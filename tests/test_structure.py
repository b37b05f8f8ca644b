"""The rules that keep the project easy to find one's way in, checked on the source itself."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "ident"
MODULES = sorted(PACKAGE.rglob("*.py"))

BASE = {"errors", "glossary", "results", "vehicle", "model_file", "units", "yaml_file"}
LAYERS = {
    "logs",
    "record",
    "signals",
    "experiments",
    "dynamics",
    "estimation",
    "control",
    "stages",
    "report",
    "pipeline",
    "cli",
}
MAY_IMPORT = {
    "logs": {"base"},
    "record": {"base"},
    "signals": {"logs", "base"},
    "experiments": {"signals", "base"},
    "dynamics": {"base"},
    "estimation": {"dynamics", "base"},
    "control": {"dynamics", "base"},
    "report": {"base"},
    "stages": {"logs", "signals", "experiments", "dynamics", "estimation", "control", "base"},
    "pipeline": {"stages", "report", "record", "base"},
    "cli": {"pipeline", "base"},
    "base": {"base"},
}
HEAVY = {
    "numpy", "pandas", "scipy", "numba", "plotly", "rerun", "pydantic", "pint", "pyarrow", "rosbags",
    "jinja2", "mcap", "control", "matplotlib", "sympy", "ruamel", "rich", "cyclonedds",
}  # fmt: skip
LONGEST_MODULE = 450
LONGEST_BODY = 50


def layer_of(path: Path) -> str:
    inside = path.relative_to(PACKAGE)
    if len(inside.parts) > 1:
        return "base" if inside.parts[0] in BASE else inside.parts[0]
    return "package" if path.stem == "__init__" else "base"


def imported_names(path: Path) -> set[str]:
    """Every module that a file imports, anywhere in it, in full: "ident.logs.open"."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def imported_layers(path: Path) -> set[str]:
    parts = [name.split(".") for name in imported_names(path)]
    inner = {part[1] for part in parts if part[0] == "ident" and len(part) > 1}
    return {"base" if name in BASE else name for name in inner} & {*LAYERS, "base"}


def top_packages(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported_names(path)}


def committed() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False, text=True)
    if listed.returncode != 0:
        pytest.skip("not a git repository: the committed files are not known")
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = function.body[1:] if ast.get_docstring(function) and len(function.body) > 1 else function.body
    return (function.end_lineno or 0) - body[0].lineno + 1


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_imports_only_what_its_layer_may(path: Path) -> None:
    layer = layer_of(path)
    if layer == "package":
        assert not imported_layers(path), "ident/__init__.py imports nothing of ident"
        return
    assert imported_layers(path) - {layer} <= MAY_IMPORT[layer]


def test_every_module_belongs_to_a_layer_that_the_rules_know() -> None:
    assert {layer_of(path) for path in MODULES} - {"package", "base"} <= LAYERS
    assert {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"} <= BASE


def test_imports_inside_the_package_are_written_in_full() -> None:
    relative = [
        name_of(path)
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.level > 0
    ]
    assert relative == []


def test_the_import_rules_see_imports_inside_functions(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text("def f():\n    from ident import logs\n    import ident.report.html\n", encoding="utf-8")
    assert imported_layers(path) == {"logs", "report"}


def test_only_the_recording_imports_rerun() -> None:
    found = {name_of(path) for path in MODULES if "rerun" in top_packages(path)}
    assert all(name.startswith("ident/report/recording/") for name in found)


def test_only_the_report_imports_plotly() -> None:
    assert {layer_of(path) for path in MODULES if "plotly" in top_packages(path)} <= {"report"}


def test_only_one_module_imports_cyclone_dds() -> None:
    found = {name_of(path) for path in MODULES if "cyclonedds" in top_packages(path)}
    assert found == {"ident/record/cyclone.py"}


def test_the_truck_of_the_sample_logs_shares_no_code_with_the_models() -> None:
    paths = sorted((ROOT / "sample_logs").rglob("*.py"))
    assert paths, "sample_logs/generate.py is missing"
    assert [name_of(path) for path in paths if "ident" in top_packages(path)] == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["steering", "--help"],
        ["tyres", "--help"],
        ["evaluate", "--help"],
        ["improve", "--help"],
        ["run", "--help"],
        ["record", "--help"],
        ["steering"],
        ["run", "recipe.yaml"],
        ["nonsense"],
    ],
)
def test_help_and_usage_errors_load_nothing_heavy(arguments: list[str]) -> None:
    program = (
        "import sys\n"
        "from ident.cli import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "finally:\n    print('LOADED', *sorted({name.split('.')[0] for name in sys.modules}))\n"
    )
    command = [sys.executable, "-c", program, *arguments]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    loaded = set(ended.stdout.rpartition("LOADED ")[2].split())
    assert "click" in loaded
    assert loaded & HEAVY == set()


@pytest.mark.parametrize("path", [*MODULES, *sorted((ROOT / "sample_logs").rglob("*.py"))], ids=name_of)
def test_modules_and_functions_stay_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_MODULE
    long = {function.name: body_lines(function) for function in functions(path)}
    assert {name: lines for name, lines in long.items() if lines > LONGEST_BODY} == {}


def test_no_path_of_one_machine_is_committed() -> None:
    machine_path = re.compile(rb"/(?:home|Users|root|work|opt|tmp/v)/[\w.]")
    found = [
        f"{name_of(path)}: {match.group().decode()}"
        for path in committed()
        if b"\0" not in (data := path.read_bytes())
        for match in machine_path.finditer(data)
    ]
    assert found == []


# --- what is installed -------------------------------------------------------------------------------


def locked(path: Path) -> dict[str, str]:
    """Name -> version of a lock file in which every requirement stands once and has hashes."""
    entries = re.split(r"\n(?=\S)", path.read_text(encoding="utf-8").strip())
    assert all("--hash=sha256:" in entry for entry in entries)
    pins = [re.match(r"([\w.-]+)==([\w.!+]+)", entry) for entry in entries]
    assert all(pins)
    names = [canonicalize_name(pin[1]) for pin in pins if pin]
    assert len(set(names)) == len(names)
    return dict(zip(names, (pin[2] for pin in pins if pin), strict=True))


def project() -> dict[str, dict[str, object]]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def unmet(requirements: list[str], lock: dict[str, str]) -> list[str]:
    parsed = [Requirement(text) for text in requirements]
    return [str(r) for r in parsed if lock.get(canonicalize_name(r.name), "0") not in r.specifier]


def test_the_locks_hold_what_the_project_requires() -> None:
    told = project()
    build = told["build-system"]["requires"]
    assert build == told["dependency-groups"]["build"]
    run = [*told["project"]["dependencies"], *build]
    assert unmet(run, locked(ROOT / "requirements.lock")) == []
    assert (
        unmet(
            [*run, *told["project"]["optional-dependencies"]["dev"]], locked(ROOT / "requirements-dev.lock")
        )
        == []
    )


def test_both_locks_name_the_same_versions() -> None:
    run, dev = (locked(ROOT / name) for name in ("requirements.lock", "requirements-dev.lock"))
    assert run.items() <= dev.items()


def test_the_locks_name_no_place_to_download_from() -> None:
    for name in ("requirements.lock", "requirements-dev.lock"):
        text = (ROOT / name).read_text(encoding="utf-8")
        assert re.findall(r"^\s*-(?!-hash)\S+|https?:\S+|file:\S+| @ ", text, flags=re.MULTILINE) == []
