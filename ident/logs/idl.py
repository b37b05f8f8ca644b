"""OMG IDL 4.2 -> SCHEMA: the definitions that DDS recordings carry, or that lie beside them.

Structs (with a base), enums (read as their number), typedefs, constants, nested modules, bounded and
unbounded strings and sequences, arrays, and the annotations that change how a message is laid out:
``@final``, ``@appendable``, ``@mutable``, ``@extensibility``, ``@optional``, ``@bit_bound``, ``@id``,
``@hashid``, ``@autoid`` (DDS-XTypes 1.3, 7.3; a type without one of the first is appendable, 7.3.3.1). Bit
masks are read as their number. Unions, maps, bit sets and wide text are not read: a message that holds one is
refused by name. A definition that cannot be read costs only the types that are made of it.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from ident.logs.record import FieldError
from ident.logs.schema import Kind, Many, Member, Number, Schema, Struct, Text, Unknown, innermost, normal

_COMMENT = re.compile(
    r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/|^[ \t]*#[^\n]*|^=+[ \t]*$|^IDL:[^\n]*', re.DOTALL | re.MULTILINE
)
_TOKEN = re.compile(
    r"""\s*(?:(?P<text>L?"(?:\\.|[^"\\])*"|L?'(?:\\.|[^'\\])+')|(?P<number>\d[\w.]*)"""
    r"""|(?P<word>(?:::)?[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*)|(?P<sign>[^\s\w]))"""
)
_INTEGERS = {
    ("short",): "int16", ("long",): "int32", ("long", "long"): "int64",
    ("unsigned", "short"): "uint16", ("unsigned", "long"): "uint32", ("unsigned", "long", "long"): "uint64",
}  # fmt: skip
WIDE = Unknown("wide text is not read: writers differ in it")
_SIMPLE: dict[str, Kind] = {
    **{f"{sign}int{bits}": Number(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "float": Number("float32"), "double": Number("float64"), "boolean": Number("bool"),
    "octet": Number("uint8"), "char": Number("uint8"), "wchar": WIDE,
}  # fmt: skip
_EXTENSIBILITY = {"final", "appendable", "mutable"}
_ID_BITS = 0x0FFFFFFF
_UNSIGNED = ((8, "uint8"), (16, "uint16"), (32, "uint32"), (64, "uint64"))
_MOST_TOKENS = 200_000


@dataclass
class _Type:
    """A struct as it is read; a member without an id has that of the one before it and one more."""

    members: list[Member] = field(default_factory=list)
    extensibility: str = "appendable"
    base: str | None = None


@lru_cache(maxsize=1024)
def idl_schema(kind: str, text: str, *, guess: bool = False) -> Schema:
    """Read IDL and pick the type of a topic out of it.

    Parameters
    ----------
    guess : where no type is called ``kind``, take the only one that no other is made of

    Raises
    ------
    FieldError
        If it cannot be read, or does not define the type or what it is made of.
    """
    parser = _parsed(text)
    root = parser.find_root(kind, guess=guess)
    types = {name: parser.members_of(name) for name in parser.structs}
    return Schema(root, types, parser.names_of("appendable"), parser.names_of("mutable")).check()


@lru_cache(maxsize=64)
def _parsed(text: str) -> _Parser:
    parser = _Parser(text)
    try:
        parser.definitions("")
    except (IndexError, ValueError, RecursionError) as error:
        parser.problems.setdefault("", _reason(error))
    return parser


class _Parser:
    """Recursive descent over the tokens; names are full, parted by ``::``."""

    def __init__(self, text: str) -> None:
        text = _COMMENT.sub(lambda match: match[1] or " ", text)
        self._tokens = list(_tokens(text))
        self._at = 0
        self.structs: dict[str, _Type] = {}
        self.problems: dict[str, str] = {}
        self._aliases: dict[str, Kind] = {}
        self._constants: dict[str, int | float] = {}

    # --- results ----------------------------------------------------------------------------------

    def find_root(self, kind: str, *, guess: bool) -> str:
        """Return the struct that a topic's type names; ``FieldError`` where there is none."""
        same = [name for name in self.structs if normal(name) == normal(kind)]
        last = normal(kind).rpartition("/")[2]
        near = [name for name in self.structs if normal(name).rpartition("/")[2] == last]
        if same or len(near) == 1:
            return (same or near)[0]
        used = {inner.name for type_ in self.structs.values() for inner in _structs(type_)}
        outer = [name for name in self.structs if name not in used]
        if guess and len(outer) == 1:
            return outer[0]
        problems = [why for name, why in self.problems.items() if not name or normal(name) == normal(kind)]
        if problems:
            raise FieldError(f"definition of {kind} cannot be read as IDL: {problems[-1][:160]}")
        raise FieldError(
            f"the definition does not define {kind}, only {', '.join(self.structs) or 'nothing'}"
        )

    def names_of(self, extensibility: str) -> frozenset[str]:
        """Names of the structs of one extensibility."""
        return frozenset(n for n, type_ in self.structs.items() if type_.extensibility == extensibility)

    def members_of(self, name: str) -> list[Member]:
        """Members of a struct, those of its base first, each with its id."""
        type_ = self.structs[name]
        seen = {name}
        members = list(type_.members)
        while type_.base is not None:
            if type_.base in seen or type_.base not in self.structs:
                return [Member(name, Unknown(f"its base {type_.base} is not defined"))]
            seen.add(type_.base)
            type_ = self.structs[type_.base]
            members = [*type_.members, *members]
        return list(_numbered(members))

    # --- definitions ------------------------------------------------------------------------------

    def definitions(self, scope: str, outer: Mapping[str, str] | None = None) -> None:
        """Read definitions up to the end of the text or of a module, annotated with ``outer``."""
        inherited = {key: value for key, value in (outer or {}).items() if key == "autoid"}
        while self._at < len(self._tokens) and self._peek() != "}":
            notes = {**inherited, **self._annotations()}
            word = self._next()
            if word == "module":
                name = self._next()
                self._expect("{")
                self.definitions(f"{scope}{name}::", notes)
                self._expect("}")
            else:
                begin = self._at
                try:
                    self._definition(word, scope, notes)
                except (ValueError, KeyError, IndexError) as error:
                    self._pass_over(begin, scope, _reason(error))
            self._accept(";")

    def _definition(self, word: str, scope: str, notes: dict[str, str]) -> None:
        if word == "struct":
            self._struct(scope, notes)
        elif word == "enum":
            self._enum(scope, notes)
        elif word == "bitmask":
            self._bitmask(scope, notes)
        elif word == "typedef":
            kind = self._kind(scope)
            for name, declared in self._declarators(kind, scope):
                self._aliases[scope + name] = declared
        elif word == "const":
            self._constant(scope)
        else:
            self._skip(word, scope)

    def _pass_over(self, begin: int, scope: str, reason: str) -> None:
        """Go on behind a definition that cannot be read; what is made of it is refused with the reason."""
        self._at = begin
        name = scope + self._peek()
        self.structs.pop(name, None)
        self.problems[name] = self.problems[""] = reason
        self._aliases[name] = Unknown(f"its definition cannot be read as IDL: {reason[:120]}")
        self._to_semicolon()

    def _struct(self, scope: str, notes: dict[str, str]) -> None:
        name = self._next()
        if self._peek() == ";":  # a forward declaration
            return
        chosen = notes.get("extensibility", "").lower() or next((n for n in notes if n in _EXTENSIBILITY), "")
        type_ = _Type(extensibility=chosen or "appendable")
        if self._accept(":"):
            base = self._next()
            type_.base = self._resolve(base, scope, self.structs) or base
        self.structs[scope + name] = type_
        self._expect("{")
        hashed = notes.get("autoid", "sequential").lower() != "sequential"
        while not self._accept("}"):
            notes = self._annotations()
            optional = notes.get("optional", "false").lower() != "false"
            kind = self._kind(scope)
            for member, declared in self._declarators(kind, scope):
                number = self._member_id(member, notes, scope, hashed=hashed)
                type_.members.append(Member(member, declared, optional, number))
            self._expect(";")

    def _member_id(self, name: str, notes: dict[str, str], scope: str, *, hashed: bool) -> int | None:
        """Id that a member is given by its annotations; that of a hash as in DDS-XTypes 1.3, 7.3.1.2.1.1."""
        if "id" in notes:
            value = self._evaluate([notes["id"]], scope)
            if value is None:
                raise ValueError(f"the id of {name} is not known")
            return int(value) & _ID_BITS
        if "hashid" in notes or hashed:
            text = notes.get("hashid", "").strip('"') or name
            digest = hashlib.md5(text.encode(), usedforsecurity=False).digest()
            return int.from_bytes(digest[:4], "little") & _ID_BITS
        return None

    def _enum(self, scope: str, notes: dict[str, str]) -> None:
        name = self._next()
        bits = int(notes.get("bit_bound", "32"))
        self._expect("{")
        value = 0
        while not self._accept("}"):
            extra = self._annotations()
            value = int(extra["value"], 0) if "value" in extra else value
            self._constants[scope + self._next()] = value
            value += 1
            self._accept(",")
        self._aliases[scope + name] = Number(f"int{8 if bits <= 8 else 16 if bits <= 16 else 32}", enum=True)

    def _bitmask(self, scope: str, notes: dict[str, str]) -> None:
        name, bits = self._next(), int(notes.get("bit_bound", "32"))
        self._expect("{")
        self._until("}")
        kinds = [kind for most, kind in _UNSIGNED if bits <= most]
        if not kinds:
            raise ValueError(f"bitmask {name} has {bits} bits, need at most 64")
        self._aliases[scope + name] = Number(kinds[0], enum=True)

    def _constant(self, scope: str) -> None:
        self._kind(scope)
        name = self._next()
        self._expect("=")
        words = []
        while self._peek() != ";":
            words.append(self._next())
        value = self._evaluate(words, scope)
        if value is not None:
            self._constants[scope + name] = value

    def _skip(self, word: str, scope: str) -> None:
        """Pass over a definition that is not read; types that refer to it are refused."""
        known = word in {"union", "bitset", "interface", "exception", "valuetype", "native"}
        if not known and word != "@":
            raise ValueError(f"{word!r} where a definition is needed")
        self._aliases[scope + self._peek()] = Unknown(f"{word} {self._peek()} is not read")
        self._to_semicolon()

    def _to_semicolon(self) -> None:
        """Go to the end of a definition, or of the module that it is the last of."""
        depth = 0
        while self._at < len(self._tokens) and (depth or self._peek() not in {";", "}"}):
            depth += {"{": 1, "}": -1}.get(self._next(), 0)

    # --- types ------------------------------------------------------------------------------------

    def _kind(self, scope: str) -> Kind:
        word = self._next()
        if word in {"string", "wstring"}:
            if self._accept("<"):
                self._until(">")
            return Text() if word == "string" else WIDE
        if word in {"sequence", "map"}:
            return self._template(word, scope)
        if word in {"short", "long", "unsigned"}:
            return self._integer(word)
        return _SIMPLE.get(word) or self._named(word, scope)

    def _named(self, word: str, scope: str) -> Kind:
        """Return what a typedef, an enum or a struct of this name is."""
        alias = self._resolve(word, scope, self._aliases)
        if alias is not None:
            return self._aliases[alias]
        return Struct(_public(self._resolve(word, scope, self.structs) or word))

    def _integer(self, word: str) -> Kind:
        words = [word]
        while self._peek() in {"short", "long", "double"}:
            words.append(self._next())
        if words == ["long", "double"]:
            return Unknown("a long double is not read")
        return Number(_INTEGERS[tuple(words)])

    def _template(self, word: str, scope: str) -> Kind:
        self._expect("<")
        self._annotations()
        kind = self._kind(scope)
        self._until(">")
        return Many(kind) if word == "sequence" else Unknown("a map is not read")

    def _declarators(self, kind: Kind, scope: str) -> Iterator[tuple[str, Kind]]:
        """Yield the names that follow a type, each with its array sizes: ``a, b[3][2]``."""
        while True:
            name = self._next()
            sizes = []
            while self._accept("["):
                size = self._evaluate(self._until("]"), scope)
                if size is None:
                    raise ValueError(f"the size of {name} is not known")
                sizes.append(int(size))
            declared = kind
            for size in reversed(sizes):
                declared = Many(declared, size)
            yield name.removeprefix("_"), declared
            if not self._accept(","):
                return

    def _resolve(self, name: str, scope: str, known: Mapping[str, object]) -> str | None:
        """Find a name from the inner scope outwards."""
        if name.startswith("::"):
            return name[2:] if name[2:] in known else None
        while True:
            if scope + name in known:
                return scope + name
            if not scope:
                return None
            scope = scope.removesuffix("::").rpartition("::")[0]
            scope += "::" if scope else ""

    def _evaluate(self, words: list[str], scope: str) -> int | float | None:
        """Value of a constant expression, None where it is none of numbers."""
        parts = []
        for word in words:
            found = self._resolve(word, scope, self._constants)
            parts.append(str(self._constants[found]) if found is not None else word)
        text = "".join(parts)
        if not re.fullmatch(r"[\w.+\-*/%()<>|&~^]{1,200}", text) or "**" in text:
            return None
        try:
            return _value(ast.parse(text.replace("/", "//"), mode="eval").body)
        except (SyntaxError, ValueError, ZeroDivisionError, OverflowError):
            return None

    # --- tokens -----------------------------------------------------------------------------------

    def _annotations(self) -> dict[str, str]:
        """Read ``@name`` and ``@name(value)``; the value of several words is run together."""
        found: dict[str, str] = {}
        while self._peek() == "@" and self._peek(1) != "annotation":
            self._next()
            name = self._next()
            found[name] = "".join(self._until(")")) if self._accept("(") else ""
        return found

    def _until(self, last: str) -> list[str]:
        words, depth = [], 0
        while depth or self._peek() != last:
            word = self._next()
            depth += {"(": 1, ")": -1}.get(word, 0)
            words.append(word)
        self._next()
        return words

    def _peek(self, ahead: int = 0) -> str:
        return self._tokens[self._at + ahead] if self._at + ahead < len(self._tokens) else ""

    def _next(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1]

    def _accept(self, word: str) -> bool:
        found = self._peek() == word
        self._at += found
        return found

    def _expect(self, word: str) -> None:
        found = self._next()
        if found != word:
            raise ValueError(f"{found!r} where {word!r} is needed")


def _reason(error: Exception) -> str:
    return "it ends early" if isinstance(error, IndexError) else str(error)


def _numbered(members: list[Member]) -> Iterator[Member]:
    """Give each member without an id one more than that of the one before it, the first 0."""
    number = 0
    for member in members:
        number = number if member.id is None else member.id
        yield replace(member, id=number)
        number = (number + 1) & _ID_BITS


def _structs(type_: _Type) -> Iterator[Struct]:
    kinds = (innermost(member.kind) for member in type_.members)
    yield from (kind for kind in kinds if isinstance(kind, Struct))
    if type_.base is not None:
        yield Struct(type_.base)


def idl_text_beside(path: Path) -> str:
    """Return the text of all IDL files in the folder of a recording."""
    files = sorted(path.parent.glob("*.idl"))
    return "\n".join(file.read_text(encoding="utf-8", errors="replace") for file in files)


def _tokens(text: str) -> Iterator[str]:
    position = 0
    for _ in range(_MOST_TOKENS):
        match = _TOKEN.match(text, position)
        if match is None:
            return
        yield match[match.lastgroup or 0]
        position = match.end()
    raise FieldError(f"a definition of more than {_MOST_TOKENS} words is not read")


def _value(node: ast.expr) -> int | float:
    """Value of an expression of numbers."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return node.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_value(node.operand)
    if isinstance(node, ast.BinOp):
        left, right = _value(node.left), _value(node.right)
        if isinstance(node.op, ast.LShift) and 0 <= right < 64:
            return int(left) << int(right)
        simple = {ast.Add: left + right, ast.Sub: left - right, ast.Mult: left * right}
        if type(node.op) in simple:
            return simple[type(node.op)]
        if isinstance(node.op, ast.FloorDiv):
            return left // right
    raise ValueError("no constant of numbers")


def _public(name: str) -> str:
    return name.removeprefix("::")
