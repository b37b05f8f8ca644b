"""SEEDS -> DAMAGED FILES: what a disk, a broken network or a hostile hand makes of a log.

Every change is drawn by a number: the same number gives the same bytes, as long as the seeds are the same.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence

MOST_BYTES = 1 << 20
LENGTHS = (0, 1, 2, 3, 0x7F, 0xFF, 0x7FFF, 0xFFFF, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)
LONG_LENGTHS = (*LENGTHS, 1 << 32, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
TOKENS = [
    *(b"nan", b"inf", b"-inf", b"1e999", b"9" * 40, b"-1", b"0x7f", b"1e-320", b"9223372036854775808"),
    *(b"\0", b"\n", b"\r\n", b'"', b"'", b",", b";", b"\t", b"=", b"#", b"\\", b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b"struct ", b"union ", b"sequence<", b"module m {", b"}", b"{", b"[", b"]", b"<", b">", b"(", b")"),
    *(
        b"::",
        b"@optional ",
        b"@mutable ",
        b"@value(",
        b"typedef ",
        b"enum ",
        b"const long ",
        b"string<",
        b"/*",
    ),
    *(b"MSG: ", b"====", b"string[] ", b"float64[999999999] ", b"int8[<=4294967296] ", b"time ", b"wstring "),
    *(
        b": ",
        b"- ",
        b"&a ",
        b"*a",
        b"!!python/object:os.system ",
        b"null",
        b"~",
        b"{a: [",
        b"1_000",
        b"2025-13-99",
    ),
    *(b"op=\x05", b"op=\x02", b"zstd", b"lz4", b"bz2", b"cdr", b"json", b"PAR1", b"\x28\xb5\x2f\xfd"),
    *(b'{"a":' * 50, b"[" * 200, b"(" * 200, b"-" * 300, b"1<<60*1<<60"),
]

Change = Callable[[random.Random, bytes], bytes]


def flip(rng: random.Random, data: bytes) -> bytes:
    """Change a few bits or bytes."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 8, 32))):
        place = rng.randrange(len(changed))
        changed[place] = (
            changed[place] ^ (1 << rng.randrange(8)) if rng.random() < 0.5 else rng.randrange(256)
        )
    return bytes(changed)


def truncate(rng: random.Random, data: bytes) -> bytes:
    """Leave out the end, now and then the beginning."""
    place = rng.randrange(len(data) + 1)
    return data[:place] if rng.random() < 0.9 else data[place:]


def insert(rng: random.Random, data: bytes) -> bytes:
    """Put bytes in: any, a token, or a piece of the file itself."""
    place = rng.randrange(len(data) + 1)
    return data[:place] + _piece(rng, data) + data[place:]


def replace(rng: random.Random, data: bytes) -> bytes:
    """Write other bytes over some, as many as were there."""
    place = rng.randrange(len(data))
    piece = _piece(rng, data)
    return (data[:place] + piece + data[place + len(piece) :])[: len(data)]


def remove(rng: random.Random, data: bytes) -> bytes:
    """Leave out bytes in the middle."""
    place = rng.randrange(len(data))
    return data[:place] + data[place + _size(rng, data) :]


def blank(rng: random.Random, data: bytes) -> bytes:
    """Fill a stretch with zeros or ones, as a lost sector."""
    place, size = rng.randrange(len(data)), _size(rng, data)
    stretch = len(data[place : place + size])
    return data[:place] + rng.choice((b"\0", b"\xff")) * stretch + data[place + stretch :]


def swap(rng: random.Random, data: bytes) -> bytes:
    """Exchange two neighbouring stretches."""
    a, b, c = sorted(rng.randrange(len(data) + 1) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def repeat(rng: random.Random, data: bytes) -> bytes:
    """Write a stretch twice, or very often."""
    place, size = rng.randrange(len(data)), _size(rng, data)
    times = rng.choice((2, 2, 3, 100))
    return data[:place] + data[place : place + size] * times + data[place + size :]


def lengths(rng: random.Random, data: bytes) -> bytes:
    """Put a telling number where a length may stand: where the number that stands there is short enough."""
    code = rng.choice(("<I", "<I", "<I", "<Q", "<Q", ">I", ">H", "<H", ">Q", "<B"))
    size = struct.calcsize(code)
    if len(data) < size:
        return data
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        place = rng.randrange(len(data) - size + 1)
        for _ in range(200):
            if 0 < struct.unpack_from(code, data, place)[0] <= len(data):
                break
            place = rng.randrange(len(data) - size + 1)
        number = rng.choice(LONG_LENGTHS if size == 8 else LENGTHS)
        near = struct.unpack_from(code, data, place)[0] + rng.choice((-1, 1, 2, 4, 8))
        struct.pack_into(code, changed, place, (near if rng.random() < 0.3 else number) % (1 << (8 * size)))
    return bytes(changed)


CHANGES: dict[str, Change] = {
    "flip": flip, "truncate": truncate, "insert": insert, "replace": replace, "remove": remove,
    "blank": blank, "swap": swap, "repeat": repeat, "lengths": lengths,
}  # fmt: skip
WEIGHTS = {"flip": 4, "lengths": 4}


def splice(rng: random.Random, one: bytes, other: bytes) -> bytes:
    """The beginning of one file and the end of another."""
    same = rng.randrange(min(len(one), len(other)) + 1)
    return one[:same] + other[same if rng.random() < 0.5 else rng.randrange(len(other) + 1) :]


def mutation(number: int, kind: str, seeds: Sequence[dict[str, bytes]]) -> tuple[str, dict[str, bytes]]:
    """Draw the damaged files of ``number``; return what was done and the files by their names."""
    rng = random.Random(f"{kind} {number}")  # noqa: S311 (not for secrets)
    files = dict(rng.choice(seeds))
    hit = next(iter(files)) if rng.random() < 0.7 else rng.choice(list(files))
    data, done = files[hit], []
    if rng.random() < 0.08:
        other = rng.choice(seeds)
        data, done = splice(rng, data, next(iter(other.values()))), ["splice"]
    names = list(CHANGES)
    weights = [WEIGHTS.get(name, 1) for name in names]
    for name in rng.choices(names, weights, k=rng.choice((1, 1, 1, 2, 3)) - bool(done)):
        if data:
            data = CHANGES[name](rng, data)[:MOST_BYTES]
            done.append(name)
    files[hit] = data
    return " and ".join(done) or "nothing", files


def _size(rng: random.Random, data: bytes) -> int:
    return rng.choice((1, 2, 4, 8, 16, 64, 512, 4096, max(len(data) // 4, 1)))


def _piece(rng: random.Random, data: bytes) -> bytes:
    drawn = rng.random()
    if drawn < 0.4:
        return rng.choice(TOKENS)
    if drawn < 0.7:
        return rng.randbytes(_size(rng, data))
    place = rng.randrange(len(data))
    return data[place : place + _size(rng, data)]
