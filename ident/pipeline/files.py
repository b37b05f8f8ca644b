"""Files that appear whole or not at all, and what JSON can hold.

A file is written beside its final name, forced to the disk, then renamed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ident.errors import UsageError

_LEFT_BEHIND = re.compile(r"\.[0-9a-f]{12}(\.\w+)?|\.index\.html\.\d+")


@contextlib.contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; what was written there becomes ``path`` at the end.

    Raises
    ------
    UsageError
        If the folder cannot be made or written, saying why.
    """
    temporary = path.with_name(f".{secrets.token_hex(6)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb+") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"cannot write {path}: {reason}: give another folder with --out") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def plain(value: Any, where: str = "") -> Any:
    """Turn dataclasses and mappings into what JSON can hold, refusing NaN and infinity by their place.

    Text that is not valid Unicode (the name of a file with stray bytes) gets its strays written out.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: plain(inner, f"{where}.{name}") for name, inner in fields}
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(inner, f"{where}.{key}") for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner, f"{where}[{index}]") for index, inner in enumerate(value)]
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{where.removeprefix('.')} is {value}, need a finite number or None")
    return value


def remove_left_behind(folder: Path) -> None:
    """Remove what a killed run had begun to write; call it only while no other can be writing here."""
    if not folder.is_dir():
        return
    for path in folder.iterdir():
        if _LEFT_BEHIND.fullmatch(path.name) and path.is_file():
            path.unlink()
