"""Decompression that keeps what can be read of data that is cut off."""

from __future__ import annotations

import zlib
from pathlib import Path

import lz4.frame
import zstandard

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
LARGEST_CHUNK = 1 << 31
_BLOCK = 1 << 20


class Damaged(ValueError):
    """Compressed data does not unpack to what was written."""


def decompress_chunk(data: bytes, compression: str, size: int, crc: int) -> bytes:
    """Unpack an MCAP chunk to its ``size`` bytes and check its CRC-32 (0: none was written)."""
    if size > LARGEST_CHUNK:
        raise Damaged(f"claims to hold {size} bytes")
    try:
        raw = _unpack(data, compression, size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise Damaged(f"does not unpack ({error})") from error
    if len(raw) != size:
        raise Damaged(f"unpacks to {len(raw)} bytes instead of {size}")
    if crc and zlib.crc32(raw) != crc:
        raise Damaged("CRC does not match")
    return raw


def _unpack(data: bytes, compression: str, size: int) -> bytes:
    if compression == "zstd":
        if zstandard.frame_content_size(data) > size:
            raise Damaged(f"unpacks to more than {size} bytes")
        return bytes(zstandard.ZstdDecompressor().decompress(data, max_output_size=size))
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    if compression:
        raise Damaged(f"compression {compression!r} is not known")
    return data


def salvage(data: bytes, compression: str) -> bytes:
    """Unpack the beginning of a chunk whose end is missing; empty where nothing can be read."""
    try:
        if compression == "zstd":
            return bytes(zstandard.ZstdDecompressor().decompressobj().decompress(data))
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError):
        return b""
    return b"" if compression else data


def decompress_message(data: bytes) -> bytes | None:
    """Unpack one message of a bag with message compression, None where it is damaged."""
    try:
        return bytes(zstandard.ZstdDecompressor().decompressobj().decompress(data))
    except (zstandard.ZstdError, MemoryError):
        return None


def decompress_file(source: Path, target: Path) -> str | None:
    """Unpack a zstd file as far as it goes; return what stopped it, None where it is whole."""
    unpacker = zstandard.ZstdDecompressor().decompressobj()
    with source.open("rb") as packed, target.open("wb") as raw:
        while block := packed.read(_BLOCK):
            while block:
                if unpacker.eof:  # another frame follows
                    unpacker = zstandard.ZstdDecompressor().decompressobj()
                try:
                    raw.write(unpacker.decompress(block))
                except (zstandard.ZstdError, MemoryError) as error:
                    return str(error)
                block = unpacker.unused_data
    return None if unpacker.eof else "cut off"
