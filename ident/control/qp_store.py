"""Quadratic programs in files: each solve of a controller can be kept, and solved again alone.

A file holds the program only (NumPy's .npz, no pickled objects), none of the controller that made it.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ident.control.qp import QuadraticProgram, Solution, Solver
from ident.errors import UnusableLog

MATRICES = ("P", "A", "G")
VECTORS = ("c", "b", "h_low", "h_high", "z_low", "z_high", "dependent")


def store(program: QuadraticProgram, path: Path) -> None:
    """Write a program; the folder must exist."""
    parts = {name: getattr(program, name) for name in VECTORS}
    for name in MATRICES:
        matrix = getattr(program, name)
        parts |= {f"{name}_{part}": getattr(matrix, part) for part in ("data", "indices", "indptr", "shape")}
    with path.open("wb") as file:
        np.savez_compressed(file, **parts)


def load(path: Path) -> QuadraticProgram:
    """Read a program.

    Raises
    ------
    UnusableLog
        If the file is not a stored program.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as parts:
            matrices = {name: _matrix(parts, name) for name in MATRICES}
            vectors = {name: parts[name] for name in VECTORS}
            return QuadraticProgram(**{**matrices, **vectors})
    except (OSError, EOFError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise UnusableLog(f"{path}: not a stored quadratic program ({error})") from error


def _matrix(parts: Mapping[str, Any], name: str) -> Any:
    arrays = tuple(parts[f"{name}_{part}"] for part in ("data", "indices", "indptr"))
    return sp.csc_matrix(arrays, shape=tuple(parts[f"{name}_shape"]))


def solve_alone(path: Path) -> tuple[QuadraticProgram, Solution]:
    """A stored program and its solution by a solver that has seen nothing else."""
    program = load(path)
    return program, Solver().solve(program)


def keeper(folder: Path, name: str) -> Callable[[QuadraticProgram], None]:
    """What a controller calls with each of its programs: writes <name>_00000.npz, <name>_00001.npz, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    count = 0

    def keep(program: QuadraticProgram) -> None:
        nonlocal count
        store(program, folder / f"{name}_{count:05d}.npz")
        count += 1

    return keep
