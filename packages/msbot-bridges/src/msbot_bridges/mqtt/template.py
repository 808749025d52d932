"""The templates by which devices say where a value stands in a payload: `{{ value_json.temperature | float }}`.

Home Assistant has Jinja for them. What strangers publish runs no such language here: this is the small part of it that
devices use, without loops, statements, calls or attributes of objects, and each takes bounded time.
"""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from msbot_bridges.mqtt.json_payload import read_json
from msbot_xrce.errors import ConfigError

LONGEST = 500
"""Characters of a template."""
_DEEPEST = 20
_LONGEST_VALUE = 10_000

Names = Mapping[str, Any]
_Node = Callable[[Names], Any]
_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d+)?)|(?P<text>'[^'\\]*'|\"[^\"\\]*\")|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>==|!=|<=|>=|[-+*/()\[\].,|<>~]))"
)
_COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}
_CONSTANTS: Mapping[str, object] = {
    "true": True,
    "True": True,
    "false": False,
    "False": False,
    "none": None,
    "None": None,
}


class _Missing(Exception):
    """The payload has not what the template names."""


class Template:
    """A template, read once.

    Args:
        text: as the device has published it; empty: the payload as it is.

    Raises:
        ConfigError: it has something that is not understood here.
    """

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST:
            raise ConfigError(f"a template of {len(text)} characters; at most {LONGEST} are read")
        self.text = text
        self._pieces = _pieces(text)

    def render(self, value: str, **more: object) -> str | None:
        """What the template makes of a payload; None: it is not in there.

        Args:
            value: the payload, or what a command says.
            more: further names.
        """
        if not self._pieces:
            return value
        names = {"value": value, **more}
        try:
            made = [piece if isinstance(piece, str) else _text(piece(names)) for piece in self._pieces]
        except (_Missing, TypeError, ValueError, ArithmeticError, RecursionError):
            return None
        return "".join(made).strip()


def _pieces(text: str) -> Sequence[str | _Node]:
    if "{%" in text or "{#" in text:
        raise ConfigError(f"the template {text!r} has a statement; only expressions in {{{{ }}}} are understood")
    pieces: list[str | _Node] = []
    rest = text
    while "{{" in rest:
        before, _, rest = rest.partition("{{")
        inside, end, rest = rest.partition("}}")
        if not end:
            raise ConfigError(f"the template {text!r} has no }}}} at its end")
        pieces += [before] if before else []
        pieces.append(_Reader(inside.removeprefix("-").removesuffix("-").strip(), text).whole())
    return [*pieces, rest] if rest and pieces else pieces or ([text] if text else [])


def _text(value: object) -> str:
    if isinstance(value, dict | list):
        value = json.dumps(value)
    text = str(value)
    if len(text) > _LONGEST_VALUE:
        raise ValueError("too long")
    return text


class _Reader:
    """Reads one expression; each method reads one level of it and gives a function that works it out."""

    def __init__(self, text: str, whole: str) -> None:
        self._whole = whole
        self._tokens: list[tuple[str, str]] = []
        self._at = self._depth = 0
        end = 0
        while end < len(text.rstrip()):
            found = _TOKEN.match(text, end)
            if found is None:
                raise self._wrong(text[end:].strip())
            self._tokens.append((str(found.lastgroup), found[str(found.lastgroup)]))
            end = found.end()

    def whole(self) -> _Node:
        node = self._choice()
        if self._at < len(self._tokens):
            raise self._wrong(self._tokens[self._at][1])
        return node

    def _wrong(self, what: str) -> ConfigError:
        return ConfigError(f"the template {self._whole!r} is not understood at {what!r}")

    def _take(self, *wanted: str) -> str:
        if self._at < len(self._tokens) and self._tokens[self._at][0] in ("sign", "name"):
            word = self._tokens[self._at][1]
            if word in wanted:
                self._at += 1
                return word
        return ""

    def _expect(self, wanted: str) -> None:
        if not self._take(wanted):
            raise self._wrong(self._tokens[self._at][1] if self._at < len(self._tokens) else "its end")

    def _choice(self) -> _Node:
        """`A if CONDITION else B`"""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise self._wrong("(")
        node = self._or()
        if self._take("if"):
            condition = self._or()
            self._expect("else")
            then, other = node, self._choice()
            node = lambda names: then(names) if condition(names) else other(names)  # noqa: E731
        self._depth -= 1
        return node

    def _or(self) -> _Node:
        node = self._and()
        while self._take("or"):
            node = _both(node, self._and(), lambda one, other: one or other)
        return node

    def _and(self) -> _Node:
        node = self._not()
        while self._take("and"):
            node = _both(node, self._not(), lambda one, other: one and other)
        return node

    def _not(self) -> _Node:
        if self._take("not"):
            node = self._comparison()
            return lambda names: not node(names)
        return self._comparison()

    def _comparison(self) -> _Node:
        node = self._sum()
        if sign := self._take(*_COMPARE):
            return _both(node, self._sum(), _COMPARE[sign])
        return node

    def _sum(self) -> _Node:
        node = self._product()
        while sign := self._take("+", "-", "~"):
            node = _both(node, self._product(), {"+": _plus, "-": operator.sub, "~": _joined}[sign])
        return node

    def _product(self) -> _Node:
        node = self._negative()
        while sign := self._take("*", "/"):
            node = _both(node, self._negative(), _times if sign == "*" else operator.truediv)
        return node

    def _negative(self) -> _Node:
        if self._take("-"):
            node = self._filtered()
            return lambda names: -node(names)
        return self._filtered()

    def _filtered(self) -> _Node:
        node = self._path()
        while self._take("|"):
            kind, name = self._tokens[self._at] if self._at < len(self._tokens) else ("", "its end")
            if kind != "name" or name not in _FILTERS:
                raise self._wrong(name)
            self._at += 1
            arguments: list[_Node] = []
            if self._take("("):
                while not self._take(")"):
                    arguments.append(self._choice())
                    self._take(",")
            node = _filter(name, node, arguments)
        return node

    def _path(self) -> _Node:
        node = self._atom()
        while True:
            if self._take("."):
                kind, name = self._tokens[self._at] if self._at < len(self._tokens) else ("", "its end")
                if kind not in ("name", "number"):
                    raise self._wrong(name)
                self._at += 1
                node = _item(node, _constant(name))
            elif self._take("["):
                index = self._choice()
                self._expect("]")
                node = _item(node, index)
            else:
                return node

    def _atom(self) -> _Node:
        if self._at >= len(self._tokens):
            raise self._wrong("its end")
        if self._take("("):
            node = self._choice()
            self._expect(")")
            return node
        kind, word = self._tokens[self._at]
        self._at += 1
        constant: object
        if kind == "number":
            constant = float(word) if "." in word else int(word)
        elif kind == "text":
            constant = word[1:-1]
        elif word in _CONSTANTS:
            constant = _CONSTANTS[word]
        elif kind == "name":
            return lambda names: _named(names, word)
        else:
            raise self._wrong(word)
        return _constant(constant)


def _constant(value: object) -> _Node:
    return lambda _: value


def _named(names: Names, name: str) -> Any:  # noqa: ANN401 - what a payload has
    if name == "value_json" and name not in names:
        return read_json(names["value"])
    if name not in names:
        raise _Missing(name)
    return names[name]


def _item(node: _Node, index: _Node) -> _Node:
    def take(names: Names) -> Any:  # noqa: ANN401
        whole, key = node(names), index(names)
        if isinstance(whole, dict) and key in whole:
            return whole[key]
        if isinstance(whole, list | str) and str(key).isdecimal() and int(key) < len(whole):
            return whole[int(key)]
        raise _Missing(str(key))

    return take


def _both(one: _Node, other: _Node, function: Callable[[Any, Any], Any]) -> _Node:
    return lambda names: function(one(names), other(names))


def _plus(one: Any, other: Any) -> Any:  # noqa: ANN401
    return _joined(one, other) if isinstance(one, str) and isinstance(other, str) else operator.add(one, other)


def _joined(one: object, other: object) -> str:
    return _text(_text(one) + _text(other))


def _times(one: Any, other: Any) -> Any:  # noqa: ANN401
    if isinstance(one, str | list) or isinstance(other, str | list):
        raise TypeError("only numbers are multiplied")
    return one * other


def _number(value: Any, *otherwise: Any) -> float:  # noqa: ANN401
    try:
        return float(value)
    except (TypeError, ValueError):
        return float(otherwise[0]) if otherwise else 0.0


_FILTERS: Mapping[str, Callable[..., Any]] = {
    "float": _number,
    "int": lambda value, *otherwise: int(_number(value, *otherwise)),
    "round": lambda value, digits=0, *_: round(float(value), min(int(digits), 12)) if digits else float(round(value)),
    "abs": lambda value: abs(float(value)),
    "upper": lambda value: _text(value).upper(),
    "lower": lambda value: _text(value).lower(),
    "trim": lambda value: _text(value).strip(),
    "string": _text,
    "bool": lambda value: value in (True, 1, "1", "true", "True", "on", "ON", "yes"),
    "default": lambda value, *_: value,
    "is_defined": lambda value: value,
    "tojson": json.dumps,
    "to_json": json.dumps,
}


def _filter(name: str, node: _Node, arguments: list[_Node]) -> _Node:
    function = _FILTERS[name]

    def work(names: Names) -> Any:  # noqa: ANN401
        try:
            value = node(names)
        except (_Missing, ValueError):
            if name == "default" and arguments:
                return arguments[0](names)
            raise
        return function(value, *(argument(names) for argument in arguments))

    return work
