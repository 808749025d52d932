"""A message as people type it in one text: `{mode: slow, tip: {x: 1, y: 0}, joints: [0, 90], log: ''}`. Pure.

This is the flow style of YAML (1.2, chapter 7.4), which `ros2 topic pub` and `ros2 service call` take; JSON is a part
of it. What YAML reads as something else than a message's values (null, tags, anchors, comments) is refused. In
difference to YAML, no blank is needed behind the colon of a plain name: `{x:1}`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence

from msbot_agent.text.sentence import printable
from msbot_xrce.errors import ConfigError

DEEPEST = 20
"""Braces and brackets inside each other."""
LONGEST_SHOWN = 60
"""Of a text with a mistake, in letters."""

_BLANK = " \t\r\n"
_BLANKS = re.compile(rf"[{_BLANK}]*")
_NAME = re.compile(r"([A-Za-z_][\w.]*)\s*:")
_PLAIN = re.compile(r"[^,\[\]{}]*")
_BREAK = re.compile(r"[\n\r]")
"""Where YAML folds a text."""
_NUMBER = re.compile(r"[-+]?(0x[0-9a-fA-F]+|([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?)", re.ASCII)
_ESCAPE = re.compile(r"\\(x[0-9a-fA-F]{2}|u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|.|$)", re.DOTALL)
_ESCAPED = {
    "0": "\0", "a": "\a", "b": "\b", "t": "\t", "n": "\n", "v": "\v", "f": "\f", "r": "\r", "e": "\x1b",
    " ": " ", '"': '"', "/": "/", "\\": "\\", "N": "\x85", "_": "\xa0", "L": "\u2028", "P": "\u2029",
}  # fmt: skip
"""YAML 1.2, 5.7; JSON's are among them."""
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})


class Plain(str):
    """A word without quotes: a number, a truth value or a text, whatever the field takes."""

    __slots__ = ()


Value = dict[str, "Value"] | list["Value"] | str


def is_message(word: str) -> bool:
    """Whether a word is a whole message, and not one value."""
    return word.lstrip(_BLANK).startswith("{")


def typed_values(words: Sequence[str], fields: Sequence[str] = ()) -> list[str]:
    """The values that an operation takes, for what somebody typed: values, `FIELD=VALUE`, or a whole message.

    Args:
        words: what was typed.
        fields: the names of the message's fields, where they are known: then `field: value` is a message, too.

    Raises:
        ConfigError: it looks like a message, and is none.
    """
    if len(words) == 1 and is_message(words[0]):
        return values_of(words[0])
    if whole := next(filter(is_message, words), None):
        raise ConfigError(f"{_shown(whole)} is a whole message: write it alone, in quotes, without further values")
    if len(words) == 1:
        name, colon, value = words[0].partition(": ")
        if colon and name.strip() in fields:
            return list(_leaves(name.strip(), _Reader(value).only_value()))
    return list(words)


def values_of(text: str) -> list[str]:
    """The `FIELD=VALUE` of a message in one text; a field inside another is `pose.x`, a list JSON.

    Raises:
        ConfigError: it is no message.
    """
    return [leaf for name, value in read_message_text(text).items() for leaf in _leaves(name, value)]


def read_message_text(text: str) -> dict[str, Value]:
    """The fields of a message in one text.

    Raises:
        ConfigError: it is no message; the text says where.
    """
    return _Reader(text).whole()


class _Reader:
    """Reads one text from its start to its end."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    def whole(self) -> dict[str, Value]:
        self._skip_blanks()
        if self._next != "{":
            raise self._wrong("it does not begin with {")
        found = self._mapping(1)
        self._end()
        return found

    def only_value(self) -> Value:
        """One value; a plain one goes on to the end."""
        self._skip_blanks()
        if self._next not in ("{", "[", "'", '"'):
            return Plain(self._text[self._at :].strip(_BLANK))
        found = self._value(1)
        self._end()
        return found

    def _end(self) -> None:
        self._skip_blanks()
        if self._next:
            raise self._wrong("the message has ended before")

    @property
    def _next(self) -> str:
        """The character that comes; empty at the end."""
        return self._text[self._at : self._at + 1]

    def _skip_blanks(self) -> None:
        blanks = _BLANKS.match(self._text, self._at)
        assert blanks is not None
        self._at = blanks.end()

    def _wrong(self, words: str) -> ConfigError:
        where = f"character {self._at + 1}" if self._next else "the end"
        return ConfigError(f"{_shown(self._text)}: {words}, at {where}; write {{field: value, field: value}}")

    def _mapping(self, depth: int) -> dict[str, Value]:
        found: dict[str, Value] = {}
        for _ in self._items("}", depth):
            name = self._name()
            if name in found:
                raise self._wrong(f"{printable(name)} stands twice")
            self._skip_blanks()
            found[name] = self._value(depth)
        return found

    def _list(self, depth: int) -> list[Value]:
        return [self._value(depth) for _ in self._items("]", depth)]

    def _items(self, end: str, depth: int) -> Iterator[None]:
        """One step for each thing between brackets; the reader stands before it."""
        if depth > DEEPEST:
            raise self._wrong(f"more than {DEEPEST} brackets are inside each other")
        self._at += 1
        while True:
            self._skip_blanks()
            if self._next == end:
                break
            yield
            self._skip_blanks()
            if self._next not in (",", end):
                raise self._wrong(f"a {end} or a comma is missing")
            if self._next == ",":
                self._at += 1
        self._at += 1

    def _name(self) -> str:
        if self._next in ("'", '"'):
            name = self._quoted()
            self._skip_blanks()
            if self._next != ":":
                raise self._wrong("a colon is missing behind the name of a field")
            self._at += 1
            return name
        plain = _NAME.match(self._text, self._at)
        if plain is None:
            raise self._wrong("the name of a field and a colon are missing")
        self._at = plain.end()
        return plain[1]

    def _value(self, depth: int) -> Value:
        match self._next:
            case "{":
                return self._mapping(depth + 1)
            case "[":
                return self._list(depth + 1)
            case "'" | '"':
                return self._quoted()
        return self._plain()

    def _quoted(self) -> str:
        quote = self._next
        # In single quotes two of them are one; in double quotes a backslash escapes.
        form = r"'((?:[^']|'')*)'" if quote == "'" else r'"((?:[^"\\]|\\.)*)"'
        found = re.compile(form, re.DOTALL).match(self._text, self._at)
        if found is None:
            raise self._wrong(f"the closing {quote} is missing behind this one")
        if _BREAK.search(found[1]):
            raise self._wrong("a text with a line break stands in double quotes, with \\n in it")
        text = found[1].replace("''", "'") if quote == "'" else _ESCAPE.sub(self._escaped, found[1])
        try:
            text = text.encode("utf-16", "surrogatepass").decode("utf-16")  # JSON has letters in two halves
        except UnicodeDecodeError:
            raise self._wrong("half of a letter stands alone") from None
        self._at = found.end()
        return text

    def _escaped(self, found: re.Match[str]) -> str:
        code = found[1]
        if len(code) > 1:
            number = int(code[1:], 16)
            if number > 0x10FFFF:
                raise self._wrong(f"\\{code} is no letter of Unicode")
            return chr(number)
        if code not in _ESCAPED:
            raise self._wrong(f"\\{printable(code)} means nothing in a text; a backslash is \\\\")
        return _ESCAPED[code]

    def _plain(self) -> Plain:
        found = _PLAIN.match(self._text, self._at)
        assert found is not None
        text = found[0].strip(_BLANK)
        if text in _NULLS:
            raise self._wrong("a value is missing; an empty text is ''")
        # What YAML gives a meaning of its own.
        if (
            text[0] in "&*!|>%@`#\"'"
            or re.match(r"[-:]$|[-?:]\s", text, re.ASCII)
            or re.search(r":(\s|$)|\s#", text, re.ASCII)
            or text.startswith(("...", "---"))
            or _BREAK.search(text)
        ):
            raise self._wrong(f"write {printable(text)} in quotes")
        self._at = found.end()
        if self._next in ("{", "["):
            raise self._wrong("a text with brackets stands in quotes")
        return Plain(text)


def _leaves(way: str, value: Value) -> Iterator[str]:
    """`FIELD=VALUE` for each value, with the way to it; a list is one."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield from _leaves(f"{way}.{name}", one)
    else:
        yield f"{way}={json.dumps(_for_list(value)) if isinstance(value, list) else value}"


def _for_list(value: Value) -> object:
    """What stands in a list, in which JSON tells texts from numbers."""
    if isinstance(value, list):
        return [_for_list(one) for one in value]
    if isinstance(value, dict):
        return {name: _for_list(one) for name, one in value.items()}
    if not isinstance(value, Plain):
        return value
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    if _NUMBER.fullmatch(value) is None:
        return str(value)
    return int(value, 16) if "x" in value else float(value) if set(value) & set(".eE") else int(value)


def _shown(text: str) -> str:
    short = text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
    return f"'{printable(short)}'"
