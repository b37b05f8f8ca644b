"""A small writer of ASAM MDF 4.1 files, made from the standard: the description first, then the records.

That is the order in which loggers write that may lose their power: what is cut off are records. Nothing of
asammdf is used.
"""

import struct
from dataclasses import dataclass, field

import numpy as np

UNSIGNED, UNSIGNED_BIG, SIGNED, SIGNED_BIG, REAL, REAL_BIG = range(6)
COUNTERS_UNKNOWN, LENGTH_UNKNOWN = 0x01, 0x04


@dataclass
class Chan:
    """One channel: ``values`` as they are stored; ``linear`` (offset, factor) makes them physical.

    Values of which ``texts`` says what they mean stand for that.

    bits : of a bit field, (offset in the first byte, count); invalid : (n,) whether a value is invalid
    """

    name: str
    values: np.ndarray
    unit: str = ""
    linear: tuple[float, float] | None = None
    bits: tuple[int, int] | None = None
    invalid: np.ndarray | None = None
    sync: int = 0
    formula: str = ""
    texts: dict[float, str] = field(default_factory=dict)


@dataclass
class Group:
    name: str
    channels: list[Chan]  # the first with sync 1 is that of the times


@dataclass
class Block:
    kind: bytes
    links: list = field(default_factory=list)
    data: bytes = b""
    address: int = 0

    @property
    def size(self):
        return 24 + 8 * len(self.links) + len(self.data)

    def bytes(self):
        places = [0 if link is None else link.address for link in self.links]
        head = struct.pack("<4s4xQQ", self.kind, self.size, len(self.links))
        return head + struct.pack(f"<{len(places)}Q", *places) + self.data


def write_mdf(path, groups, start, *, unfinished=False, version=b"4.10"):
    """Write groups that start at ``start`` [ns since 1970]; ``unfinished``: as a recorder that was killed."""
    blocks, data = [], []
    first = None
    for group in reversed(groups):
        first = _group(group, first, blocks, data, unfinished=unfinished)
    head = Block(b"##HD", [first, *[None] * 5], struct.pack("<QhhBBBxdd", start, 0, 0, 0, 0, 0, 0.0, 0.0))
    ordered = [head, *blocks, *data]
    place = 64
    for block in ordered:
        block.address = place
        place += -(-block.size // 8) * 8
    flags = COUNTERS_UNKNOWN | LENGTH_UNKNOWN if unfinished else 0
    name = b"UnFinMF " if unfinished else b"MDF     "
    out = bytearray(struct.pack("<8s8s8s4xH30xHH", name, version.ljust(8), b"tests", 410, flags, 0))
    for block in ordered:
        out += bytes(block.address - len(out)) + block.bytes()
    if unfinished:  # the length of the last block was never written
        struct.pack_into("<Q", out, data[-1].address + 8, 24)
    path.write_bytes(bytes(out))
    return path


def _group(group, after, blocks, data, *, unfinished):
    """Blocks of a group; returns its DG block."""
    count = len(group.channels[0].values)
    flagged = [chan for chan in group.channels if chan.invalid is not None]
    columns, place, first = [], 0, None
    places = []
    for chan in group.channels:
        raw = np.ascontiguousarray(chan.values).view(np.uint8).reshape(count, -1)
        places.append(place)
        place += raw.shape[1]
        columns.append(raw)
    spare = np.zeros((count, -(-len(flagged) // 8)), np.uint8)
    for bit, chan in enumerate(flagged):
        spare[:, bit // 8] |= chan.invalid.astype(np.uint8) << (bit % 8)
    for chan, begin in reversed(list(zip(group.channels, places, strict=True))):
        bit = next((bit for bit, each in enumerate(flagged) if each is chan), None)
        first = _channel(chan, begin, bit, first, blocks)
    records = Block(b"##DT", [], np.hstack([*columns, spare]).tobytes())
    data.insert(0, records)
    sizes = struct.pack("<QQHH4xII", 0, 0 if unfinished else count, 0, 0, place, spare.shape[1])
    described = Block(b"##CG", [None, first, _text(group.name, blocks), None, None, None], sizes)
    top = Block(b"##DG", [after, described, records, None], bytes(8))
    blocks += [described, top]
    return top


def _channel(chan, begin, bit, after, blocks):
    kind = chan.values.dtype
    number = {"u": UNSIGNED, "i": SIGNED, "f": REAL}[kind.kind] + (kind.byteorder == ">")
    first_bit, bits = chan.bits or (0, 8 * kind.itemsize)
    flags = 0 if bit is None else 2
    described = (2 if chan.sync else 0, chan.sync, number, first_bit, begin, bits, flags, bit or 0, 0, 0)
    data = struct.pack("<BBBBIIIIBxH6d", *described, *[0.0] * 6)
    unit = _text(chan.unit, blocks) if chan.unit else None
    links = [after, None, _text(chan.name, blocks), None, _conversion(chan, blocks), None, unit, None]
    blocks.append(Block(b"##CN", links, data))
    return blocks[-1]


def _conversion(chan, blocks):
    if chan.formula:
        head = struct.pack("<BBHHHdd", 3, 0, 0, 1, 0, 0.0, 0.0)
        blocks.append(Block(b"##CC", [None, None, None, None, _text(chan.formula, blocks)], head))
        return blocks[-1]
    if chan.linear is None:
        return None
    head = struct.pack("<BBHHHdd2d", 1, 0, 0, 0, 2, 0.0, 0.0, *chan.linear)
    blocks.append(Block(b"##CC", [None] * 4, head))
    return _texts(chan.texts, blocks, blocks[-1]) if chan.texts else blocks[-1]


def _texts(texts, blocks, otherwise):
    count = len(texts)
    head = struct.pack(f"<BBHHHdd{count}d", 7, 0, 0, count + 1, count, 0.0, 0.0, *texts)
    places = [_text(text, blocks) for text in texts.values()]
    blocks.append(Block(b"##CC", [*[None] * 4, *places, otherwise], head))
    return blocks[-1]


def _text(text, blocks):
    data = text.encode() + b"\0"
    blocks.append(Block(b"##TX", [], data + bytes(-len(data) % 8)))
    return blocks[-1]
