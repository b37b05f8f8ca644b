"""Decompression that keeps what can be read of data that is cut off, and that no file can make burst.

What claims, or turns out, to hold more than ``MOST_EXPANSION`` times the bytes it takes is refused, but for
what is no more than ``SMALL``.
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import lz4.frame
import zstandard

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
LARGEST_CHUNK = 1 << 31
MOST_EXPANSION = 1000
SMALL = 16 << 20
_BLOCK = 1 << 20
_STEP = 1024  # of zstd 4 bytes can stand for 128 kB

Buffer = bytes | memoryview
_own = threading.local()


class Damaged(ValueError):
    """Compressed data does not unpack to what was written."""


class CutOff(Damaged):
    """Compressed data ends early; what came before is sound."""


def most_bytes(packed: int) -> int:
    """Return how many bytes ``packed`` bytes may unpack to."""
    return max(SMALL, MOST_EXPANSION * packed)


def decompress_chunk(
    data: Buffer, compression: str, size: int, crc: int, target: Callable[[int], memoryview]
) -> Buffer:
    """Unpack an MCAP chunk to its ``size`` bytes and check its CRC-32 (0: none was written).

    ``target`` gives a buffer of so many bytes, which is used where that is faster.
    """
    if size > min(most_bytes(len(data)), LARGEST_CHUNK):
        raise Damaged(f"claims to hold {size} bytes in {len(data)}")
    try:
        raw = _unpack(data, compression, size, target)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise Damaged(f"does not unpack ({error})") from error
    return checked(raw, size, crc)


def checked(raw: Buffer, size: int, crc: int) -> Buffer:
    """Return the data of a chunk; ``Damaged`` unless it has this size and CRC-32 (0: none was written)."""
    if len(raw) != size:
        raise Damaged(f"unpacks to {len(raw)} bytes instead of {size}")
    if crc and zlib.crc32(raw) != crc:
        raise Damaged("CRC does not match")
    return raw


def _unpack(data: Buffer, compression: str, size: int, target: Callable[[int], memoryview]) -> Buffer:
    if compression == "zstd":
        stated = zstandard.frame_content_size(data)
        if stated > size:
            raise Damaged(f"unpacks to more than {size} bytes")
        if stated == size > 0:
            raw = target(size)
            with _own_unpacker().stream_reader(data) as reader:
                return raw[: reader.readinto(raw)]
        return bytes(_own_unpacker().decompress(data, max_output_size=size))
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    if compression:
        raise Damaged(f"compression {compression!r} is not known")
    return data


def _own_unpacker() -> zstandard.ZstdDecompressor:
    """Return the one of this thread: making one takes as long as unpacking a small chunk."""
    found: zstandard.ZstdDecompressor | None = getattr(_own, "unpacker", None)
    if found is None:
        found = _own.unpacker = zstandard.ZstdDecompressor()
    return found


def salvage(data: Buffer, compression: str) -> Buffer:
    """Unpack the beginning of a chunk whose end is missing; empty where nothing can be read."""
    try:
        if compression == "zstd":
            return _until_cut_off(_zstd_pieces([data]))
        if compression == "lz4":
            most = most_bytes(len(data))
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
    except (Damaged, RuntimeError, EOFError, MemoryError):
        return b""
    return b"" if compression else data


def decompress_message(data: bytes) -> bytes | None:
    """Unpack one message of a bag with message compression, None where it is damaged."""
    try:
        return b"".join(_zstd_pieces([data]))
    except (Damaged, MemoryError):
        return None


def decompress_file(source: Path, target: Path) -> str | None:
    """Unpack a zstd file as far as it goes; return what stopped it, None where it is whole."""
    with source.open("rb") as packed, target.open("wb") as raw:
        try:
            for piece in _zstd_pieces(iter(lambda: packed.read(_BLOCK), b"")):
                raw.write(piece)
        except (Damaged, MemoryError) as error:
            return str(error)
    return None


def _zstd_pieces(blocks: Iterable[Buffer]) -> Iterator[bytes]:
    """Unpack one zstd frame after another, little by little; ``Damaged`` where that ends early."""
    unpacker = zstandard.ZstdDecompressor().decompressobj()
    taken = given = 0
    for block in blocks:
        for start in range(0, len(block), _STEP):
            rest = block[start : start + _STEP]
            taken += len(rest)
            while rest:
                if unpacker.eof:  # another frame follows
                    unpacker = zstandard.ZstdDecompressor().decompressobj()
                try:
                    piece = unpacker.decompress(rest)
                except zstandard.ZstdError as error:
                    raise Damaged(str(error)) from error
                rest = unpacker.unused_data
                given += len(piece)
                if given > most_bytes(taken):
                    raise Damaged(f"the first {taken} bytes unpack to {given}: too many to be a recording")
                yield piece
    if not unpacker.eof:
        raise CutOff("cut off")


def _until_cut_off(pieces: Iterator[bytes]) -> bytes:
    kept = []
    try:
        for piece in pieces:
            kept.append(piece)  # noqa: PERF402 (what came before the error is wanted)
    except CutOff:
        pass
    return b"".join(kept)
