"""CDR -> WHOLE COLUMNS: numbers read from many messages at once.

One message is walked through (``ident.logs.layout``), and all others of the same size whose lengths, flags
and headers are the same are read by the same layout, with numpy: a column of a whole channel at a time where
the messages are alike, in groups where their strings and sequences differ in length, and one by one only
where no two are alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ident.logs.layout import ROS1, CdrError, Encoding, Layout, Path, Wanted, encoding_of, find_layout
from ident.logs.payloads import Payloads
from ident.logs.schema import Schema

MIN_WINDOW = 16
BLOCK = 64 << 20
__all__ = ["ROS1", "CdrError", "Encoding", "Path", "Read", "encoding_of", "find_layout", "read_columns"]


@dataclass
class Read:
    """Numbers read from messages.

    columns : path -> (n,) values, NaN (or 0 where whole numbers were asked for) where there is none
    good : (n,) whether the message could be decoded
    errors : reasons of those that could not, in no order
    """

    columns: dict[Path, NDArray[np.float64]]
    whole: dict[Path, NDArray[np.int64]]
    good: NDArray[np.bool_]
    errors: list[str]


def read_columns(
    messages: Sequence[bytes | None],
    schema: Schema,
    numbers: Mapping[Path, str],
    whole: Mapping[Path, str],
    encoding: Encoding | None = None,
) -> Read:
    """Read fields of all messages.

    Parameters
    ----------
    numbers, whole : path -> numpy type of the fields to read as float64 and as int64
    encoding : of all messages; None: that which each of them states
    """
    payloads = Payloads.of(messages)
    count = len(payloads)
    read = Read(
        {path: np.full(count, np.nan) for path in numbers},
        {path: np.zeros(count, np.int64) for path in whole},
        np.zeros(count, dtype=np.bool_),
        [],
    )
    wanted = _tree([*numbers, *whole])
    for size in np.unique(payloads.sizes[payloads.present]):
        rows = np.flatnonzero(payloads.sizes == size)
        block = max(BLOCK // max(int(size), 1), 1)
        for start in range(0, len(rows), block):
            part = rows[start : start + block]
            _read_equal_sizes(payloads, part, read, schema, wanted, {**numbers, **whole}, encoding)
    return read


def _tree(paths: Sequence[Path]) -> Wanted:
    tree: dict[str | int, dict] = {}  # type: ignore[type-arg]
    for path in paths:
        node = tree
        for step in path:
            node = node.setdefault(step, {})
    return tree


def _read_equal_sizes(
    messages: Payloads,
    rows: NDArray[np.intp],
    read: Read,
    schema: Schema,
    wanted: Wanted,
    types: Mapping[Path, str],
    encoding: Encoding | None,
) -> None:
    """Read messages of one size: find a layout, read all that share it, go on with the others.

    Only as many messages as seem worth it are compared with a layout, else messages of which each has a
    layout of its own would take a time that grows with the square of their number.
    """
    table = messages.table(rows)
    left = np.arange(len(rows))
    window = len(rows)
    while len(left):
        first = table[left[0]].tobytes()
        layout, problem = _layout_or_problem(first, schema, wanted, encoding)
        near = left[:window]
        guards = problem.guards if problem else layout.guards if layout else ()
        places = np.unique(np.array(guards, dtype=np.intp))
        stated = table[:, places] if len(near) == len(table) else table[near[:, None], places]
        same = (stated == table[left[0], places]).all(axis=1)
        chosen = near[same]
        if layout is None:
            read.errors += [str(problem)] * len(chosen)
        else:
            _take_columns(table, chosen, rows[chosen], layout, types, read)
        left = np.concatenate([near[~same], left[window:]])
        window = max(MIN_WINDOW, 4 * len(chosen))


def _layout_or_problem(
    data: bytes, schema: Schema, wanted: Wanted, encoding: Encoding | None
) -> tuple[Layout | None, CdrError | None]:
    try:
        return find_layout(data, schema, wanted, encoding or encoding_of(data)), None
    except CdrError as error:
        return None, error


def _take_columns(
    table: NDArray[np.uint8],
    chosen: NDArray[np.intp],
    rows: NDArray[np.intp],
    layout: Layout,
    types: Mapping[Path, str],
    read: Read,
) -> None:
    """Take the fields of the ``chosen`` rows of the table, which stand for ``rows`` of the channel."""
    read.good[rows] = True
    for path, offset in layout.places.items():
        kind = np.dtype(types[path])
        stored = np.dtype(np.uint8) if kind == np.bool_ else kind.newbyteorder(layout.order)
        column = np.ndarray((len(table),), stored, table, offset, (table.shape[1],))
        column = column if len(chosen) == len(table) else column[chosen]
        values = column != 0 if kind == np.bool_ else column
        if path in read.columns:
            read.columns[path][rows] = values
        if path in read.whole:
            read.whole[path][rows] = values
