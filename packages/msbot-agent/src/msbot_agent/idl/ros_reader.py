"""Reads ROS 2 interface files: `.msg` and `.srv` (the ROS 2 design article on interface definition)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import field

from msbot_agent.idl.model import (
    BASICS,
    LARGEST_ARRAY,
    Array,
    Basic,
    Constant,
    Definitions,
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
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.lazy import dataclass

Finder = Callable[[Name, SourceLocation], None]
"""Adds a type that a file needs; raises ConfigError when it cannot be found."""

_WORDS = {name: name for name in BASICS} | {"byte": "uint8", "char": "uint8"}
_GONE = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}
_LINE = re.compile(
    r"(?P<type>[A-Za-z]\w*(?:/\w+){0,2})(?P<text_bound><=\d+)?(?P<brackets>\[(?:<=)?\d*\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<equals>=)?\s*(?P<value>.*)"
)
EMPTY = Member("structure_needs_at_least_one_member", Basic("uint8"))
"""What ROS 2 puts into a message without fields, since DDS does not allow a struct without members."""


@dataclass(slots=True)
class _Content:
    members: list[Member] = field(default_factory=list)
    constants: list[Constant] = field(default_factory=list)


def read_ros(text: str, file: str, name: Name, into: Definitions, find: Finder) -> None:
    """Read one file.

    Args:
        text: the file.
        file: its name, for messages.
        name: what it defines: `(package, "msg" | "srv", name)`.
        into: where the definitions are added.
        find: adds the types it uses.

    Raises:
        ConfigError: a mistake, with line, column, and what would be right.
    """
    parts = [_Content()]
    comments: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        words, _, comment = _split_comment(line)
        if words.strip() == "---":
            parts.append(_Content())
        elif words.strip():
            shown = " ".join(comments) or comment
            _line(words.rstrip(), SourceLocation(file, number, 1), name, parts[-1], into=into, find=find, comment=shown)
            comments = []
            continue
        if comment:
            comments.append(comment)
        elif not words.strip():
            comments = []
    wanted = 2 if name[1] == "srv" else 1
    if len(parts) != wanted:
        what = "a request and a response, with one line --- between them" if wanted == 2 else "no line ---"
        raise SourceLocation(file, 1, 1).error(f"this file must have {what}")
    if wanted == 1:
        _take(parts[0], name, SourceLocation(file, 1, 1), into)
        return
    for part, ending in zip(parts, ("_Request", "_Response"), strict=True):
        _take(part, (*name[:-1], name[-1] + ending), SourceLocation(file, 1, 1), into)


def _take(content: _Content, name: Name, place: SourceLocation, into: Definitions) -> None:
    members = tuple(content.members) or (EMPTY,)
    into.add(Struct(name, members, constants=tuple(content.constants), is_ros=True), place)


def _split_comment(line: str) -> tuple[str, str, str]:
    quote = ""
    for index, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#":
            return line[:index], "#", line[index + 1 :].strip()
    return line, "", ""


def _line(
    words: str, place: SourceLocation, name: Name, content: _Content, *, into: Definitions, find: Finder, comment: str
) -> None:
    indent = len(words) - len(words.lstrip())
    place = SourceLocation(place.file, place.line, indent + 1)
    found = _LINE.fullmatch(words.strip())
    if found is None:
        raise place.error("a line is TYPE NAME, TYPE NAME DEFAULT, or TYPE NAME=VALUE")
    kind = _type(found, place, name, into, find)
    field_name, value = found["name"], found["value"].strip()
    if any(field_name == member.name for member in content.members) or any(
        field_name == constant.name[-1] for constant in content.constants
    ):
        raise place.error(f"there is a {field_name} already")
    if found["equals"]:
        if not isinstance(kind, Basic | StringType):
            raise place.error("a constant is a number, a boolean or a text")
        constant = _value(kind, value, place)
        assert not isinstance(constant, list)
        content.constants.append(Constant((*name, field_name), kind, constant, comment))
        return
    if not field_name.islower():
        raise place.error(f"names of fields are written small: {field_name.lower()}")
    default = None if not value else _value(kind, value, place)
    content.members.append(Member(field_name, kind, comment, default))


def _type(found: re.Match[str], place: SourceLocation, name: Name, into: Definitions, find: Finder) -> Type:
    word = found["type"]
    kind: Type
    if word == "wstring":
        raise place.error("wstring is not supported; use string")
    if word in _GONE:
        raise place.error(f"{word} is a type of ROS 1; in ROS 2 it is {_GONE[word]}")
    if word == "string":
        kind = StringType(_bound(found["text_bound"], place))
    elif found["text_bound"]:
        raise place.error(f"only a string can have the bound {found['text_bound']}")
    elif word in _WORDS:
        kind = Basic(_WORDS[word])
    else:
        kind = Reference(_full_name(word, name))
        if kind.name not in into.structs:
            find(kind.name, place)
    brackets = found["brackets"]
    if not brackets:
        return kind
    inside = brackets[1:-1]
    if not inside:
        return Sequence(kind)
    bound = _bound(inside, place)
    if inside.startswith("<="):
        return Sequence(kind, bound)
    assert bound is not None
    return Array(kind, bound)


def _full_name(word: str, name: Name) -> Name:
    parts = word.split("/")
    if parts == ["Header"]:
        return ("std_msgs", "msg", "Header")
    if len(parts) == 1:
        return (name[0], "msg", parts[0])
    if len(parts) == 2:
        return (parts[0], "msg", parts[1])
    return (parts[0], parts[1], parts[2])


def _bound(text: str | None, place: SourceLocation) -> int | None:
    if not text:
        return None
    number = int(text.removeprefix("<=")) if text.removeprefix("<=") else 0
    if not 1 <= number <= LARGEST_ARRAY:
        raise place.error(f"a bound must be 1 to {LARGEST_ARRAY}, not {number}")
    return number


def _value(kind: Type, text: str, place: SourceLocation) -> Value | list[Value]:
    match kind:
        case StringType():
            return text[1:-1] if text[:1] in ("'", '"') and text[-1:] == text[:1] and len(text) > 1 else text
        case Basic("bool"):
            known = {"true": True, "false": False, "1": True, "0": False}
            if text.casefold() not in known:
                raise place.error(f"a boolean is true or false, not {text}")
            return known[text.casefold()]
        case Basic("float32" | "float64"):
            try:
                return float(text)
            except ValueError:
                raise place.error(f"a number is needed, not {text}") from None
        case Basic(word):
            try:
                number = int(text, 0)
            except ValueError:
                raise place.error(f"a whole number is needed, not {text}") from None
            bits, signed = int(word.lstrip("uint")), word.startswith("i")
            least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
            if not least <= number <= most:
                raise place.error(f"{word} goes from {least} to {most}, so it cannot be {number}")
            return number
        case Sequence(element) | Array(element):
            try:
                values = read_json(text.replace("'", '"').replace("True", "true").replace("False", "false"))
            except ValueError:
                raise place.error(f"a list is written [1, 2, 3], not {text}") from None
            if not isinstance(values, list):
                raise place.error(f"a list is written [1, 2, 3], not {text}")
            if isinstance(kind, Array) and len(values) != kind.length:
                raise place.error(f"{kind.length} values are needed, not {len(values)}")
            found: list[Value] = []
            for value in values:
                one = _value(element, str(value), place)
                assert not isinstance(one, list)
                found.append(one)
            return found
        case _:
            raise place.error("a nested message has no default here")
