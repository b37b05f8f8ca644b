"""CDR as DDS-XTypes 1.3, 7.4 says it, written value by value; for what the oracle cannot write.

A writer may choose: short or extended headers of members in XCDR1, a length of its own or one that a member
begins with in XCDR2, the order of members, members that a reader does not know. ``Writer`` takes each choice.
"""

import random
import struct
from dataclasses import dataclass, field

from type_trees import NUMBERS, Arr, Choice, Num, Seq, Str

CODES = {
    "bool": "?", "uint8": "B", "int8": "b", "int16": "h", "int32": "i", "int64": "q", "uint16": "H",
    "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
ENCAPSULATIONS = {  # (version, form) -> second byte of the big-endian encapsulation
    (1, "final"): 0, (1, "appendable"): 0, (1, "mutable"): 2,
    (2, "final"): 6, (2, "appendable"): 8, (2, "mutable"): 10,
}  # fmt: skip


@dataclass
class Writer:
    """Writes one message at a time.

    short : whether XCDR1 headers are short where they can be
    dual : whether XCDR2 uses the length that a member begins with as that of its header
    enum_lengths : whether XCDR2 states the length in bytes of arrays of enums
    chance : shuffles the members of mutable types and puts members of its own between them, if there is one
    """

    version: int = 2
    order: str = "<"
    short: bool = False
    dual: bool = False
    enum_lengths: bool = True
    must_understand: bool = False
    chance: random.Random | None = None
    out: bytearray = field(default_factory=bytearray)
    origin: int = 0

    def message(self, kind, value):
        self.out, self.origin = bytearray(), 0
        self.write(kind, value)
        first = ENCAPSULATIONS[self.version, kind.extensibility] + (self.order == "<")
        return bytes([0, first, 0, 0]) + bytes(self.out)

    # --- values ---------------------------------------------------------------------------------------

    def write(self, kind, value):
        if isinstance(kind, Num):
            self.number(CODES[NUMBERS[kind.idl]], value)
        elif isinstance(kind, Choice):
            self.number({8: "b", 16: "h", 32: "i"}[kind.bits], value)
        elif isinstance(kind, Str):
            data = value.encode() + b"\0"
            self.number("I", len(data))
            self.out += data
        elif isinstance(kind, Seq):
            self.stating_length(kind, lambda: self.sequence(kind, value))
        elif isinstance(kind, Arr):
            self.stating_length(kind, lambda: self.rows(kind, value))
        else:
            self.struct(kind, value)

    def sequence(self, kind, value):
        self.number("I", len(value))
        for each in value:
            self.write(kind.of, each)

    def rows(self, kind, value):
        for each in value:
            if isinstance(kind.of, Arr):  # one array of several dimensions
                self.rows(kind.of, each)
            else:
                self.write(kind.of, each)

    def stating_length(self, kind, write):
        """Write an array or a sequence: in XCDR2 behind its length, unless it is one of numbers."""
        of = kind.of
        while isinstance(kind, Arr) and isinstance(of, Arr):
            of = of.of
        plain = isinstance(of, Num) or (isinstance(of, Choice) and not self.enum_lengths)
        self.delimited(write) if self.version == 2 and not plain else write()

    def struct(self, kind, value):
        if kind.extensibility == "mutable":
            self.delimited(lambda: self.list(kind, value)) if self.version == 2 else self.list(kind, value)
        elif kind.extensibility == "appendable" and self.version == 2:
            self.delimited(lambda: self.members(kind, value))
        else:
            self.members(kind, value)

    def members(self, kind, value):
        for each in kind.fields:
            if each.optional and self.version == 1:
                self.parameter(kind.ids()[each.name], each.of, value[each.name])
                continue
            if each.optional:
                self.number("?", value[each.name] is not None)
            if value[each.name] is not None:
                self.write(each.of, value[each.name])

    def list(self, kind, value):
        fields = [each for each in kind.fields if value[each.name] is not None]
        extra = []
        if self.chance is not None:
            self.chance.shuffle(fields)
            extra = [60_001 + k for k in range(self.chance.randint(0, 3))]
        for each in fields:
            if extra:
                self.parameter(extra.pop(), Arr(Num("octet"), 5), [1, 2, 3, 4, 5], unknown=True)
            self.parameter(kind.ids()[each.name], each.of, value[each.name])
        if self.version == 1:
            self.align(4)
            self.number("H", 0x3F02)
            self.number("H", 0)

    # --- headers --------------------------------------------------------------------------------------

    def parameter(self, number, kind, value, *, unknown=False):
        if self.version == 1:
            self.parameter_1(number, kind, value)
        else:
            self.parameter_2(number, kind, value, unknown=unknown)

    def parameter_1(self, number, kind, value):
        body = b"" if value is None else self.apart(kind, value)
        self.align(4)
        if self.short and number < 0x3F00 and len(body) < 0x10000:
            self.number("H", number)
            self.number("H", len(body))
        else:
            self.number("H", 0x3F01 | 0x4000)
            self.number("H", 8)
            self.number("I", number)
            self.number("I", len(body))
        self.out += body

    def parameter_2(self, number, kind, value, *, unknown):
        body = self.apart(kind, value)
        scalar = isinstance(kind, (Num, Choice))
        length_code = 4
        if scalar:
            length_code = {1: 0, 2: 1, 4: 2, 8: 3}[len(body)]
        elif self.dual:
            length_code = self.dual_code(kind)
        flag = (self.must_understand and not unknown) << 31
        self.number("I", flag | length_code << 28 | number)
        if length_code == 4:
            self.number("I", len(body))
        self.out += body

    def dual_code(self, kind):
        """Code of the length that a member begins with: in bytes, or in numbers of 4 or 8 bytes."""
        if isinstance(kind, Seq) and isinstance(kind.of, Num):
            return {1: 5, 2: 4, 4: 6, 8: 7}[struct.calcsize("<" + CODES[NUMBERS[kind.of.idl]])]
        if isinstance(kind, Seq):
            return 5 if self.enum_lengths or not isinstance(kind.of, Choice) else 4
        if isinstance(kind, Arr):
            while isinstance(kind, Arr):
                kind = kind.of
            return 4 if isinstance(kind, Num) or (isinstance(kind, Choice) and not self.enum_lengths) else 5
        return 5 if isinstance(kind, Str) else 4

    def apart(self, kind, value):
        """Bytes of a member as they lie behind its header, from where XCDR1 aligns anew."""
        inner = Writer(self.version, self.order, self.short, self.dual, self.enum_lengths)
        inner.must_understand, inner.chance = self.must_understand, self.chance
        inner.write(kind, value)
        return bytes(inner.out)

    def delimited(self, write):
        self.number("I", 0)
        begin = len(self.out)
        write()
        struct.pack_into(self.order + "I", self.out, begin - 4, len(self.out) - begin)

    # --- bytes ----------------------------------------------------------------------------------------

    def number(self, code, value):
        size = struct.calcsize("<" + code)
        self.align(min(size, 8 if self.version == 1 else 4))
        self.out += struct.pack(self.order + code, value)

    def align(self, size):
        self.out += bytes(-(len(self.out) - self.origin) % size)
