"""What files hold, as sha256, without reading gigabytes each time; and the code that makes results.

A hash is remembered with everything that the file system changes when it writes a file: size, times of
content and of inode, inode and device. A file that changed within the last seconds is not remembered,
because a second change could leave its times as they are.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import secrets
import time
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from platformdirs import user_cache_path

import ident

SETTLED = 2.0  # [s] after which a file that has not changed is remembered
MOST = 50_000  # files that are remembered
NUMERICS = ("numpy", "scipy", "numba", "sympy", "pandas", "pyarrow", "pint")
PACKAGE = Path(ident.__file__).parent
SHOWING = ("report", "cli")
"""What no stage may import: a change there changes no result."""


class Hashes:
    """Hashes of files, remembered in the user's cache; ``save`` writes what was learnt."""

    def __init__(self, remembered: Path | None = None) -> None:
        self._path = remembered or _cache_folder() / "hashes.json"
        self._known = _read(self._path)
        self._learnt: dict[str, list[str]] = {}

    def of(self, path: Path) -> str:
        """Hash of a file, "unreadable" where it cannot be read."""
        place = str(path.resolve())
        try:
            state = _state(path)
            known = self._learnt.get(place) or self._known.get(place)
            if known and known[0] == state:
                return known[1]
            digest = sha256_of(path)
            if _state(path) == state and _is_settled(path):
                self._learnt[place] = [state, digest]
        except OSError:
            return "unreadable"
        return digest

    def save(self) -> None:
        """Remember; a cache that cannot be written costs time only."""
        if not self._learnt:
            return
        kept = {**_read(self._path), **self._learnt}
        text = json.dumps(dict(list(kept.items())[-MOST:]))
        temporary = self._path.with_name(f".{secrets.token_hex(6)}")
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(self._path)
        self._learnt = {}


def sha256_of(path: Path) -> str:
    """Read a file and hash it."""
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


@cache
def code_version(*, of_results: bool) -> str:
    """Version, and hash of the source that is installed and of what it computes with.

    Parameters
    ----------
    of_results : leave out what only shows results
    """
    digest = hashlib.sha256(" ".join([platform.python_version(), *map(_installed, NUMERICS)]).encode())
    for path in sorted(PACKAGE.rglob("*")):
        place = path.relative_to(PACKAGE)
        if "__pycache__" in place.parts or not path.is_file() or (of_results and place.parts[0] in SHOWING):
            continue
        digest.update(f"{place.as_posix()}\0{sha256_of(path)}\0".encode())
    return f"{ident.__version__} {digest.hexdigest()}"


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def _cache_folder() -> Path:
    told = os.environ.get("IDENT_CACHE")
    return Path(told).absolute() if told else user_cache_path("ident", appauthor=False)


def _state(path: Path) -> str:
    found = path.stat()
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino} {found.st_dev}"


def _is_settled(path: Path) -> bool:
    found = path.stat()
    return time.time() - max(found.st_mtime, found.st_ctime) > SETTLED


def _read(path: Path) -> dict[str, list[str]]:
    """Read what is remembered; what is not as it was written is forgotten."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {key: pair for key, pair in found.items() if _is_pair(pair)} if isinstance(found, dict) else {}


def _is_pair(found: object) -> bool:
    return isinstance(found, list) and len(found) == 2 and all(isinstance(part, str) for part in found)
