"""Walks through the words of an IDL file: the next word, a required word, and whole-number expressions."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator
from enum import Enum

from msbot_agent.idl.directives import Conditions
from msbot_agent.idl.model import Name, SourceLocation
from msbot_xrce.lazy import dataclass

# Splits OMG IDL into words: names, numbers, texts, signs, each with its place and the comment before it.


class TokenKind(Enum):
    """The kinds of words."""

    NAME = "a name"
    NUMBER = "a number"
    TEXT = "a text"
    SIGN = "a sign"
    DIRECTIVE = "a directive"
    END = "the end of the file"


@dataclass(frozen=True, slots=True)
class Word:
    """One word of a file."""

    kind: TokenKind
    text: str
    place: SourceLocation
    comment: str = ""
    """The comment in front of it."""


_WORDS = re.compile(
    r"(?P<space>[ \t\r\f\v]+)"
    r"|(?P<line>\n)"
    r"|//(?P<comment>[^\n]*)"
    r"|/\*(?P<block>.*?)\*/"
    r"|(?P<directive>\#(?:[^\n\\]|\\.)*)"
    r"|(?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?[fFdD]?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r'|(?P<text>"(?:[^"\\\n]|\\.)*")'
    r"|(?P<sign>::|<<|>>|[{}()\[\]<>;:,=@+\-*/%|&^~])",
    re.DOTALL,
)


_SKIPPED = re.compile(r"[^\n]*")


def scan(text: str, file: str, conditions: Conditions) -> Iterator[Word]:
    """The words of a file that count, each read when it is asked for; the last one marks the end.

    Of the directives only `#include` is a word: it is read before what follows it, and may define what that asks for.

    Raises:
        ConfigError: a character that IDL does not allow.
    """
    offset, line, start = 0, 1, 0
    remark: list[str] = []
    while offset < len(text):
        place = SourceLocation(file, line, offset - start + 1)
        found = _WORDS.match(text, offset)
        if not conditions.is_active and text[offset] not in "# \t\r\f\v\n":
            found = _SKIPPED.match(text, offset)
            assert found is not None
            offset = found.end()
            continue
        if text.startswith("/*", offset) and (found is None or found.lastgroup != "block"):
            raise place.error("this comment is never closed: */ is missing")
        if found is None:
            if text[offset] == '"':
                raise place.error('this text is never closed: " is missing')
            raise place.error(f"{text[offset]!r} has no place in IDL")
        kind = found.lastgroup
        inside = found[kind] if kind else ""
        if kind in ("comment", "block"):
            remark += [part.strip(" \t*/!<") for part in inside.splitlines()]
        elif kind == "line" and text[offset - 1 : offset] == "\n":
            remark = []  # an empty line: the comment before it belongs to no word
        elif kind == "directive" and not conditions.obey(inside, place):
            pass
        elif kind not in ("space", "line"):
            if kind == "name":
                conditions.check_name(inside, place)
            shown = " ".join(part for part in remark if part)
            yield Word(TokenKind[str(kind).upper()], inside, place, shown)
            remark = []
        breaks = found[0].count("\n")
        if breaks:
            line += breaks
            start = offset + found[0].rindex("\n") + 1
        offset = found.end()
    conditions.check_end()
    yield Word(TokenKind.END, "", SourceLocation(file, line, offset - start + 1))


DEEPEST = 32
"""Deepest nesting of brackets and signs in an expression."""

_BINARY: list[dict[str, Callable[[int, int], int]]] = [
    {"|": operator.or_},
    {"^": operator.xor},
    {"&": operator.and_},
    {"<<": operator.lshift, ">>": operator.rshift},
    {"+": operator.add, "-": operator.sub},
    {"*": operator.mul, "/": operator.floordiv, "%": operator.mod},
]
"""Operators from the weakest to the strongest."""


class Cursor:
    """The words of one file, one after the other; every method raises ConfigError when it finds something else."""

    def __init__(self, words: Iterator[Word]) -> None:
        self._words = words
        self._next: Word | None = None

    @property
    def peek(self) -> Word:
        """The word that comes next."""
        if self._next is None:
            self._next = next(self._words)
        return self._next

    def take(self) -> Word:
        """Take the next word; at the end of the file this returns the end again."""
        word = self.peek
        if word.kind is not TokenKind.END:
            self._next = None
        return word

    def has(self, text: str) -> bool:
        """Whether that sign or name comes next."""
        return self.peek.text == text and self.peek.kind in (TokenKind.SIGN, TokenKind.NAME)

    def take_if(self, text: str) -> bool:
        """Take that sign or name if it comes next; returns whether it did."""
        if self.has(text):
            self.take()
            return True
        return False

    def expect(self, text: str) -> Word:
        """Take that sign or name, which must come next."""
        if not self.has(text):
            raise self.peek.place.error(f"{text} is missing before {self.shown()}")
        return self.take()

    def need_name(self, what: str) -> Word:
        """Take a name, which must come next."""
        if self.peek.kind is not TokenKind.NAME:
            raise self.peek.place.error(f"the name of {what} is missing before {self.shown()}")
        return self.take()

    def scoped_name(self) -> tuple[Name, SourceLocation]:
        """Take a name with its modules: `geometry_msgs::msg::Twist`."""
        place = self.peek.place
        self.take_if("::")
        parts = [self.need_name("a type").text]
        while self.take_if("::"):
            parts.append(self.need_name("a type").text)
        return tuple(parts), place

    def close_bracket(self) -> None:
        """Take a `>`, also the first half of a `>>` that closes two brackets: `sequence<string<8>>`."""
        if self.has(">>"):
            self._next = Word(TokenKind.SIGN, ">", self.peek.place)
        else:
            self.expect(">")

    def shown(self) -> str:
        """The next word for a person."""
        return self.peek.text or TokenKind.END.value


class Expressions:
    """Whole numbers, written as expressions.

    Args:
        words: where they are.
        constant: gives the value of a constant by its name, or None when there is none.
    """

    def __init__(self, words: Cursor, constant: Callable[[Name], int | None]) -> None:
        self._words = words
        self._constant = constant
        self._depth = 0

    def number(self, level: int = 0, *, shifts: bool = True) -> int:
        """Take the next expression; without shifts where a `>>` would close two brackets."""
        if level == len(_BINARY):
            return self._unary(shifts=shifts)
        value = self.number(level + 1, shifts=shifts)
        while self._words.peek.kind is TokenKind.SIGN and self._words.peek.text in _BINARY[level]:
            if self._words.peek.text in ("<<", ">>") and not shifts:
                break
            word = self._words.take()
            other = self.number(level + 1, shifts=shifts)
            if (word.text in "/%" and other == 0) or (word.text in ("<<", ">>") and not 0 <= other < 64):
                raise word.place.error(f"{word.text} {other} cannot be worked out")
            value = _BINARY[level][word.text](value, other)
            if value.bit_length() > 64:
                raise word.place.error("this number needs more than 64 bits")
        return value

    def _unary(self, *, shifts: bool) -> int:
        self._depth += 1
        if self._depth > DEEPEST:
            raise self._words.peek.place.error(f"an expression is nested more than {DEEPEST} deep")
        try:
            return self._operand(shifts=shifts)
        finally:
            self._depth -= 1

    def _operand(self, *, shifts: bool) -> int:
        words = self._words
        if words.take_if("-"):
            return -self._unary(shifts=shifts)
        if words.take_if("~"):
            return ~self._unary(shifts=shifts)
        if words.take_if("+"):
            return self._unary(shifts=shifts)
        if words.take_if("("):
            value = self.number()
            words.expect(")")
            return value
        word = words.peek
        if word.kind is TokenKind.NUMBER:
            words.take()
            try:
                return int(word.text, 16 if word.text[:2].lower() == "0x" else 10)
            except ValueError:
                raise word.place.error(f"a whole number is needed, not {word.text}") from None
        if word.kind is TokenKind.NAME:
            name, place = words.scoped_name()
            found = self._constant(name)
            if found is None:
                raise place.error(f"there is no whole-number constant {'::'.join(name)}")
            return found
        raise word.place.error(f"a number is missing before {words.shown()}")
