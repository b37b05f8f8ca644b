"""Cyclone DDS as the writer of messages: its classes for the types of ``type_trees``."""

from typing import Optional

from cyclonedds.idl import Endianness, annotations, make_idl_enum, make_idl_struct, types
from type_trees import Arr, Choice, Num, Seq, Str

PLAIN = {
    "boolean": bool, "octet": types.byte, "char": types.char, "int8": types.int8, "short": types.int16,
    "long": types.int32, "long long": types.int64, "uint8": types.uint8, "unsigned short": types.uint16,
    "unsigned long": types.uint32, "unsigned long long": types.uint64, "float": types.float32,
    "double": types.float64,
}  # fmt: skip


class Oracle:
    """Classes of a struct and of all it is made of; ``serialize`` writes a value in any encoding."""

    def __init__(self, root):
        self._made = {}
        self._root = root
        self.type = self._kind(root)

    def serialize(self, value, *, version, big):
        endianness = Endianness.Big if big else Endianness.Little
        built = self._value(self._root, value)
        return built.serialize(endianness=endianness, use_version_2=version == 2)

    def _kind(self, kind):
        if isinstance(kind, Num):
            return PLAIN[kind.idl]
        if isinstance(kind, Str):
            return str if kind.bound is None else types.bounded_str[kind.bound]
        if isinstance(kind, Seq):
            inner = self._kind(kind.of)
            return types.sequence[inner] if kind.bound is None else types.sequence[inner, kind.bound]
        if isinstance(kind, Arr):
            return types.array[self._kind(kind.of), kind.size]
        if kind.name not in self._made:
            self._made[kind.name] = self._enum(kind) if isinstance(kind, Choice) else self._struct(kind)
        return self._made[kind.name]

    def _enum(self, kind):
        made = make_idl_enum(kind.name, kind.name, {f"K{kind.bits}_{k}": k for k in range(4)})
        return annotations.bit_bound(kind.bits)(made)

    def _struct(self, kind):
        fields, notes = {}, {}
        for each in kind.fields:
            inner = self._kind(each.of)
            fields[each.name] = Optional[inner] if each.optional else inner  # noqa: UP045 it knows no other
            if each.id is not None:
                notes[each.name] = {"id": each.id}
        made = make_idl_struct(kind.name, kind.name, fields, field_annotations=notes)
        return annotations.extensibility(kind.extensibility)(made)

    def _value(self, kind, value):
        if value is None or isinstance(kind, Str):
            return value
        if isinstance(kind, Num):
            return chr(value) if kind.idl == "char" else value
        if isinstance(kind, Choice):
            return self._made[kind.name](value)
        if isinstance(kind, (Seq, Arr)):
            octets = isinstance(kind, Arr) and kind.of in {Num("octet"), Num("uint8")}
            return bytes(value) if octets else [self._value(kind.of, each) for each in value]
        members = {each.name: self._value(each.of, value[each.name]) for each in kind.fields}
        return self._made[kind.name](**members)
