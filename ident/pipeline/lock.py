"""One run at a time on one output folder; a killed run's lock is gone with its process."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from ident.errors import UsageError

KEPT = ".ident"
"""Folder inside the outputs with what ``ident`` knows of them."""


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of an output folder; a folder that is still empty at the end is removed.

    Raises
    ------
    UsageError
        If another run holds it, or the folder cannot be made.
    """
    before = [each for each in (folder, *folder.parents) if not each.exists()]
    path = folder / KEPT / "lock"
    try:
        handle = _acquire(path)
    except BlockingIOError as error:
        raise UsageError(
            f"another run is writing to {folder}: wait for it, or name another folder with --out"
        ) from error
    except OSError as error:
        raise UsageError(
            f"cannot write {folder}: {error.strerror or error}: give another folder with --out"
        ) from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)
        _remove_empty([path.parent, *before])


def _acquire(path: Path) -> int:
    """Lock a file that is still the one of this name once it is locked."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # the folder was removed by a run that has just ended
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_same(handle, path):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _is_same(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()
