"""Generated modules on disk: derived and compiled once a model structure and machine, then only loaded.

A module lies in a folder of its own, named by a hash of the model's equations and of the generator's source;
Numba's compiled code lies beside it. A file is written once, by atomic rename, and never changed: a changed
time stamp would throw the compiled code away. Its first line holds the hash of the rest, so that a file that
was cut short or altered is noticed, put aside and written again.

The folder is ``IDENT_CACHE`` where that is set, else the user's cache directory.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType

import numba
import sympy
from platformdirs import user_cache_path

GENERATOR = ("code.py", "derivation.py", "driver_text.py", "printing.py")
MODULE = "model.py"
SEAL = "# sha256 "


def cached_module(fingerprint: str, make: Callable[[], str]) -> tuple[ModuleType, bool]:
    """The compiled module of a model.

    Parameters
    ----------
    fingerprint : hash of the model's equations
    make : gives the module's text; called only where the cache does not hold it

    Returns
    -------
    module, made : the module, and whether its text was made in this call
    """
    key = sha256((fingerprint + _generator_version()).encode()).hexdigest()[:32]
    folder, made = _folder(key), False
    if not _intact(folder / MODULE):
        _write(folder, make())
        made = True
    try:
        return _load(folder, key), made
    except Exception:  # noqa: BLE001 - whatever a damaged file raises while it is unpickled
        shutil.rmtree(folder, ignore_errors=True)
        _write(folder, make())
        return _load(folder, key), True


@cache
def _generator_version() -> str:
    """Hash of everything but the model that decides on the text."""
    here = Path(__file__).parent
    texts = "".join((here / name).read_text(encoding="utf-8") for name in GENERATOR)
    return sha256(f"{texts}{sympy.__version__}{numba.__version__}".encode()).hexdigest()


def cache_folder() -> Path:
    """Where generated modules are kept."""
    told = os.environ.get("IDENT_CACHE")
    return Path(told).absolute() if told else user_cache_path("ident", appauthor=False)


@cache
def _private_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="ident-models-"))


def _folder(key: str) -> Path:
    """The folder of one model; in a private one where the cache cannot be written."""
    folder = cache_folder() / "models" / key
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return _private_folder() / key
    return folder if os.access(folder, os.W_OK) else _private_folder() / key


def _intact(path: Path) -> bool:
    try:
        seal, _, text = path.read_text(encoding="utf-8").partition("\n")
    except (OSError, UnicodeDecodeError):
        return False
    return seal == SEAL + sha256(text.encode()).hexdigest()


def _write(folder: Path, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=folder, suffix=".tmp")
    with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"{SEAL}{sha256(text.encode()).hexdigest()}\n{text}")
    _publish(Path(temporary), folder / MODULE)


def _publish(written: Path, target: Path) -> None:
    """Give a finished file its name; where another process was first, its intact file stays untouched."""
    try:
        os.link(written, target)
    except FileExistsError:
        if not _intact(target):
            written.replace(target)
    except OSError:  # a file system without hard links
        written.replace(target)
    written.unlink(missing_ok=True)


def _load(folder: Path, key: str) -> ModuleType:
    """Run the module; each of its functions is compiled or comes from Numba's cache at this moment."""
    name = f"ident_model_{key}"
    spec = importlib.util.spec_from_file_location(name, folder / MODULE)
    if spec is None or spec.loader is None:
        raise ImportError(f"{folder / MODULE} is no module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
