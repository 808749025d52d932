"""Reads OMG IDL (version 4.2, the part that describes data): modules, structs, enums, typedefs, constants."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import field
from pathlib import Path

from msbot_agent.idl.cursor import Cursor, Expressions, TokenKind, scan
from msbot_agent.idl.directives import Conditions
from msbot_agent.idl.model import (
    LARGEST_ARRAY,
    Array,
    Basic,
    Constant,
    Definitions,
    Enum,
    Member,
    Name,
    Reference,
    Sequence,
    SourceLocation,
    StringType,
    Struct,
    Type,
    Value,
)
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

DEEPEST = 32
"""Deepest nesting of modules, types and included files."""
LARGEST_FILE = 1 << 20
"""Octets of a file with definitions."""

_WORDS_OF_TYPES = {
    ("boolean",): "bool", ("octet",): "uint8", ("char",): "uint8", ("uint8",): "uint8", ("int8",): "int8",
    ("short",): "int16", ("int16",): "int16", ("unsigned", "short"): "uint16", ("uint16",): "uint16",
    ("long",): "int32", ("int32",): "int32", ("unsigned", "long"): "uint32", ("uint32",): "uint32",
    ("long", "long"): "int64", ("int64",): "int64", ("unsigned", "long", "long"): "uint64", ("uint64",): "uint64",
    ("float",): "float32", ("double",): "float64",
}  # fmt: skip
_PARTS_OF_TYPES = {word for words in _WORDS_OF_TYPES for word in words}
_NOT_SUPPORTED = {
    "union": "a union", "bitset": "a bitset", "bitmask": "a bitmask", "map": "a map", "interface": "an interface",
    "valuetype": "a valuetype", "wstring": "a wide string", "wchar": "a wide character", "any": "any", "fixed": "fixed",
    "native": "a native type", "exception": "an exception",
}  # fmt: skip


def no_other(_: Name, __: SourceLocation) -> bool:
    """Where there are no types but those of files."""
    return False


def read_idl(
    text: str,
    file: str,
    into: Definitions,
    *,
    is_ros: bool = False,
    include: Iterable[Path] = (),
    defined: Iterable[str] = (),
    other: Callable[[Name, SourceLocation], bool] = no_other,
    hint: Callable[[Name], str] = lambda _: "",
) -> None:
    """Read one IDL file and those that it includes.

    Args:
        text: the file.
        file: its name, for messages and for finding included files beside it.
        into: where the definitions are added.
        is_ros: whether structs get type names as in ROS 2.
        include: where else included files are looked for.
        defined: what conditions take as defined.
        other: adds what a file that is nowhere would define, `(package, "msg", name)`; returns whether it could.
        hint: what may be meant by a file that is nowhere, as a question.

    Raises:
        ConfigError: a mistake, with line, column, and what would be right.
    """
    shared = _Shared(into, is_ros, tuple(include), dict.fromkeys(defined, ""), other, hint)
    _Reader(text, file, shared).read()


@dataclass(slots=True)
class _Shared:
    """What the files have in common that are read together."""

    into: Definitions
    is_ros: bool
    include: tuple[Path, ...]
    defined: dict[str, str]
    other: Callable[[Name, SourceLocation], bool]
    hint: Callable[[Name], str]
    typedefs: dict[Name, Type] = field(default_factory=dict)
    seen: set[Path] = field(default_factory=set)


class _Reader:
    """One file, word by word."""

    def __init__(self, text: str, file: str, shared: _Shared) -> None:
        self._words = Cursor(scan(text, file, Conditions(shared.defined)))
        self._expressions = Expressions(self._words, self._constant_named)
        self._file = file
        self._shared = shared
        self._into = shared.into
        self._is_ros = shared.is_ros
        self._typedefs = shared.typedefs
        self._seen = shared.seen
        self._scope: Name = ()

    def read(self) -> None:
        seen = Path(self._file)
        self._seen.add(seen)
        while self._words.peek.kind is not TokenKind.END:
            self._definition()

    # Definitions

    def _definition(self) -> None:
        word = self._words.peek
        if word.kind is TokenKind.DIRECTIVE:
            self._directive()
        elif self._annotations():
            return
        elif self._words.take_if("module"):
            self._module()
        elif self._words.take_if("struct"):
            self._struct(word.comment)
        elif self._words.take_if("enum"):
            self._enum(word.comment)
        elif self._words.take_if("typedef"):
            self._typedef()
        elif self._words.take_if("const"):
            self._constant(word.comment)
        elif not self._words.take_if(";"):
            what = _NOT_SUPPORTED.get(word.text)
            if what is not None:
                raise word.place.error(f"{what} is not supported; use a struct, an enum or a typedef")
            raise word.place.error(
                f"a definition begins with module, struct, enum, typedef or const, not {self._words.shown()}"
            )

    def _directive(self) -> None:
        word = self._words.take()
        name = word.text[1:].strip().removeprefix("include").split("//")[0].strip().strip('"<>')
        if len(self._seen) > DEEPEST:
            raise word.place.error(f"more than {DEEPEST} files are included")
        places = [folder / name for folder in (Path(self._file).parent, *self._shared.include)]
        path = next((one for one in places if one.exists()), places[0])
        if path in self._seen:
            return
        wanted = Path(name).with_suffix("").parts
        if not path.exists() and self._shared.other(wanted, word.place):
            return
        try:
            text = read_input_file(path, LARGEST_FILE, "a file with message definitions").decode("utf-8")
        except FileNotFoundError:
            where = ", ".join(str(one.parent) for one in dict.fromkeys(places))
            meant = self._shared.hint(wanted) if len(wanted) == 3 else ""  # PACKAGE/msg/NAME
            raise word.place.error(
                f"{name} is not there (looked into {where}){f'; {meant} Else' if meant else ':'} give the folder that "
                "it is in with --include"
            ) from None
        except (OSError, UnicodeDecodeError, ConfigError) as error:
            raise word.place.error(f"{path} cannot be read: {error}") from None
        _Reader(text, str(path), self._shared).read()

    def _annotations(self) -> bool:
        """Skip annotations; True when nothing follows."""
        while self._words.take_if("@"):
            name = self._words.need_name("an annotation")
            if name.text == "optional":
                raise name.place.error("@optional is not supported: classic CDR has no form for it")
            if self._words.take_if("("):
                depth = 1
                while depth:
                    word = self._words.take()
                    if word.kind is TokenKind.END:
                        raise word.place.error(f") is missing: the annotation @{name.text} is never closed")
                    depth += {"(": 1, ")": -1}.get(word.text, 0)
        return self._words.peek.kind is TokenKind.END

    def _module(self) -> None:
        name = self._words.need_name("the module")
        if len(self._scope) >= DEEPEST:
            raise name.place.error(f"modules are nested more than {DEEPEST} deep")
        self._words.expect("{")
        self._scope = (*self._scope, name.text)
        while not self._words.take_if("}"):
            if self._words.peek.kind is TokenKind.END:
                raise self._words.peek.place.error(f"}} is missing: module {name.text} is never closed")
            self._definition()
        self._scope = self._scope[:-1]
        self._words.take_if(";")

    def _struct(self, comment: str) -> None:
        name = self._words.need_name("the struct")
        if self._words.take_if(";"):
            return  # only a forward declaration
        members: list[Member] = []
        if self._words.take_if(":"):
            base = self._type()
            if not isinstance(base, Reference) or base.name not in self._into.structs:
                raise name.place.error(f"{name.text} can only be derived from a struct")
            members += self._into.structs[base.name].members
        self._words.expect("{")
        while not self._words.take_if("}"):
            if self._words.peek.kind is TokenKind.END:
                raise self._words.peek.place.error(f"}} is missing: struct {name.text} is never closed")
            members += self._member(members)
        self._words.expect(";")
        if not members:
            raise name.place.error(f"struct {name.text} has no members: DDS needs at least one")
        full = (*self._scope, name.text)
        self._into.add(Struct(full, tuple(members), comment, is_ros=self._is_ros), name.place)

    def _member(self, others: list[Member]) -> list[Member]:
        self._annotations()
        comment = self._words.peek.comment
        base = self._type()
        found: list[Member] = []
        while True:
            name = self._words.need_name("the member")
            if name.text in {member.name for member in (*others, *found)}:
                raise name.place.error(f"there is a member {name.text} already")
            found.append(Member(name.text, self._dimensions(base), comment))
            if not self._words.take_if(","):
                break
        self._words.expect(";")
        return found

    def _enum(self, comment: str) -> None:
        name = self._words.need_name("the enum")
        self._words.expect("{")
        members: dict[str, int] = {}
        number = 0
        while True:
            if self._words.has("@"):
                number = self._value_annotation(number)
            member = self._words.need_name("a member")
            if member.text in members:
                raise member.place.error(f"there is a member {member.text} already")
            if number in members.values():
                raise member.place.error(f"two members of {name.text} have the number {number}")
            members[member.text] = number
            number += 1
            if not self._words.take_if(","):
                break
        self._words.expect("}")
        self._words.expect(";")
        self._into.add(Enum((*self._scope, name.text), tuple(members.items()), comment), name.place)

    def _value_annotation(self, number: int) -> int:
        self._words.expect("@")
        name = self._words.need_name("an annotation")
        self._words.expect("(")
        value = self._expressions.number()
        self._words.expect(")")
        if name.text == "value":
            if not 0 <= value < 1 << 32:
                raise name.place.error("the number of a member must be 0 to 4294967295")
            return value
        return number

    def _typedef(self) -> None:
        base = self._type()
        while True:
            name = self._words.need_name("the typedef")
            full = (*self._scope, name.text)
            if full in self._typedefs:
                raise name.place.error(f"{name.text} is defined twice")
            self._typedefs[full] = self._dimensions(base)
            if not self._words.take_if(","):
                break
        self._words.expect(";")

    def _constant(self, comment: str) -> None:
        kind = self._type()
        name = self._words.need_name("the constant")
        self._words.expect("=")
        value: Value
        if isinstance(kind, StringType):
            if self._words.peek.kind is not TokenKind.TEXT:
                raise self._words.peek.place.error(f'a text in "quotes" is missing before {self._words.shown()}')
            value = self._words.take().text[1:-1]
        elif kind == Basic("bool"):
            word = self._words.need_name("TRUE or FALSE")
            if word.text.upper() not in ("TRUE", "FALSE"):
                raise word.place.error(f"a boolean is TRUE or FALSE, not {word.text}")
            value = word.text.upper() == "TRUE"
        elif kind in (Basic("float32"), Basic("float64")):
            value = self._float()
        elif isinstance(kind, Basic):
            value = self._expressions.number()
        else:
            raise name.place.error("a constant is a number, a boolean or a text")
        self._words.expect(";")
        self._into.add(Constant((*self._scope, name.text), kind, value, comment), name.place)

    # Types

    def _type(self, depth: int = 0) -> Type:
        word = self._words.peek
        if depth > DEEPEST:
            raise word.place.error(f"types are nested more than {DEEPEST} deep")
        if word.kind is not TokenKind.NAME and not self._words.has("::"):
            raise word.place.error(f"a type is missing before {self._words.shown()}")
        if self._words.take_if("sequence"):
            return self._sequence(depth)
        if self._words.take_if("string"):
            bound = None
            if self._words.take_if("<"):
                bound = self._bound()
                self._words.close_bracket()
            return StringType(bound)
        if word.text in _NOT_SUPPORTED:
            raise word.place.error(f"{_NOT_SUPPORTED[word.text]} is not supported")
        if word.text in _PARTS_OF_TYPES:
            return self._basic()
        return self._named()

    def _sequence(self, depth: int) -> Type:
        self._words.expect("<")
        element = self._type(depth + 1)
        bound = self._bound() if self._words.take_if(",") else None
        self._words.close_bracket()
        return Sequence(element, bound)

    def _basic(self) -> Type:
        first = self._words.peek
        words: list[str] = []
        while self._words.peek.kind is TokenKind.NAME and (*words, self._words.peek.text) in {
            known[: len(words) + 1] for known in _WORDS_OF_TYPES
        }:
            words.append(self._words.take().text)
        if tuple(words) == ("long",) and self._words.has("double"):
            raise first.place.error("long double is not supported; use double")
        found = _WORDS_OF_TYPES.get(tuple(words))
        if found is None:
            raise first.place.error(f"{' '.join(words) or first.text} is not a type; did you mean unsigned long?")
        return Basic(found)

    def _named(self) -> Type:
        name, place = self._words.scoped_name()
        for full in self._candidates(name):
            if full in self._typedefs:
                return self._typedefs[full]
            if full in self._into.structs or full in self._into.enums:
                return Reference(full)
        shown = "::".join(name)
        basic = [*(words[0] for words in _WORDS_OF_TYPES if len(words) == 1), "string"] if len(name) == 1 else []
        known = ["::".join(one) for one in (*self._into.structs, *self._into.enums, *self._typedefs)]
        ends = {one: one.rpartition("::")[2] for one in known}
        alike = nearest(name[-1], [*basic, *ends.values()])
        near = [one for one in (*basic, *known) if ends.get(one, one) in alike[:1]]
        meant = f"{did_you_mean(near)} It" if near else "it"
        raise place.error(f"there is no type {shown}; {meant} must be defined (or included) before it is used")

    def _constant_named(self, name: Name) -> int | None:
        for full in self._candidates(name):
            found = self._into.constants.get(full)
            if found is not None and isinstance(found.value, int):
                return int(found.value)
        return None

    def _candidates(self, name: Name) -> list[Name]:
        return [(*self._scope[:count], *name) for count in range(len(self._scope), -1, -1)]

    def _dimensions(self, base: Type) -> Type:
        lengths = []
        while self._words.take_if("["):
            lengths.append(self._bound())
            self._words.expect("]")
        for length in reversed(lengths):
            base = Array(base, length)
        return base

    def _bound(self) -> int:
        place = self._words.peek.place
        number = self._expressions.number(shifts=False)
        if not 1 <= number <= LARGEST_ARRAY:
            raise place.error(f"a bound must be 1 to {LARGEST_ARRAY}, not {number}")
        return number

    # Values

    def _float(self) -> float:
        sign = -1.0 if self._words.take_if("-") else 1.0
        word = self._words.take()
        if word.kind is not TokenKind.NUMBER:
            raise word.place.error(f"a number is missing before {word.text or TokenKind.END.value}")
        return sign * float(word.text.rstrip("fFdD"))
