"""Many messages in one block of bytes, taken apart by numpy and not one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import overload

import numpy as np
from numpy.typing import NDArray

from ident.logs.compression import Buffer

Bytes = NDArray[np.uint8]
LOST = -1


class Payloads(Sequence[bytes | None]):
    """Messages that lie one behind the other in ``block``.

    Parameters
    ----------
    block : their bytes, without gaps
    sizes : (n,) size of each [bytes], -1 where a message is lost
    """

    def __init__(self, block: Bytes, sizes: NDArray[np.int64]) -> None:
        self.block = block
        self.sizes = sizes
        held = np.maximum(sizes, 0)
        self.begins = np.cumsum(held) - held

    @classmethod
    def of(cls, messages: Sequence[bytes | None]) -> Payloads:
        """Put messages into one block, unless they are in one."""
        if isinstance(messages, Payloads):
            return messages
        sizes = np.array([LOST if data is None else len(data) for data in messages], dtype=np.int64)
        block = b"".join(messages if (sizes >= 0).all() else filter(None, messages))  # type: ignore[arg-type]
        return cls(np.frombuffer(block, np.uint8), sizes)

    def __len__(self) -> int:
        return len(self.sizes)

    @overload
    def __getitem__(self, row: int) -> bytes | None: ...
    @overload
    def __getitem__(self, row: slice) -> Sequence[bytes | None]: ...
    def __getitem__(self, row: int | slice) -> bytes | Sequence[bytes | None] | None:
        if isinstance(row, slice):
            return [self[each] for each in range(*row.indices(len(self)))]
        begin, size = int(self.begins[row]), int(self.sizes[row])
        return None if size < 0 else self.block[begin : begin + size].tobytes()

    def __iter__(self) -> Iterator[bytes | None]:
        return (self[row] for row in range(len(self)))

    @property
    def present(self) -> NDArray[np.bool_]:
        """(n,) whether a message is there."""
        return self.sizes >= 0

    def kept(self) -> Payloads:
        """Leave out the messages that are lost."""
        present = self.present
        return self if present.all() else Payloads(self.block, self.sizes[present])

    def rows(self, chosen: NDArray[np.intp]) -> Payloads:
        """Copy these messages."""
        sizes = self.sizes[chosen]
        return Payloads(slices(self.block, self.begins[chosen], np.maximum(sizes, 0)), sizes)

    def table(self, rows: NDArray[np.intp]) -> Bytes:
        """Bytes of messages of one size, (rows, size)."""
        size = int(self.sizes[rows[0]])
        begin = int(self.begins[rows[0]])
        if len(rows) * size and np.array_equal(self.begins[rows], begin + size * np.arange(len(rows))):
            return self.block[begin : begin + len(rows) * size].reshape(len(rows), size)
        return equal_slices(self.block, self.begins[rows], size)

    def begin_with(self, head: bytes) -> NDArray[np.bool_]:
        """(n,) whether a message begins with these 4 bytes."""
        found = np.zeros(len(self), dtype=np.bool_)
        long = self.sizes >= len(head)
        heads = equal_slices(self.block, self.begins[long], len(head))
        found[long] = heads.view("<u4")[:, 0] == int.from_bytes(head, "little")
        return found


def equal_slices(data: Bytes | Buffer, begins: NDArray[np.int64], size: int) -> Bytes:
    """Copy slices of one size, (n, size); none may begin before or end behind the data."""
    if not size or not len(begins):
        return np.empty((len(begins), size), np.uint8)
    kind = np.dtype((np.void, size))
    anywhere = np.ndarray((len(data) - size + 1,), kind, data, 0, (1,))
    return anywhere[begins].view(np.uint8).reshape(len(begins), size)


def slices(data: Bytes | Buffer, begins: NDArray[np.int64], sizes: NDArray[np.int64]) -> Bytes:
    """Copy slices of any sizes, one behind the other; none may lie outside the data."""
    if not len(begins):
        return np.empty(0, np.uint8)
    if (sizes == sizes[0]).all():
        return equal_slices(data, begins, int(sizes[0])).reshape(-1)
    view = data.data if isinstance(data, np.ndarray) else memoryview(data)
    ends = begins + sizes
    pairs = zip(begins.tolist(), ends.tolist(), strict=True)
    return np.frombuffer(b"".join([view[begin:end] for begin, end in pairs]), np.uint8)
