"""Splits OMG IDL into words: names, numbers, texts, signs, each with its place and the comment before it."""

from __future__ import annotations

import re
from enum import Enum

from msbot_agent.idl.model import SourcePlace
from msbot_xrce.common.lazy_dataclass import dataclass


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
    place: SourcePlace
    comment: str = ""
    """The comment in front of it."""


_WORDS = re.compile(
    r"(?P<space>[ \t\r\f\v]+)"
    r"|(?P<line>\n)"
    r"|//(?P<comment>[^\n]*)"
    r"|/\*(?P<block>.*?)\*/"
    r"|(?P<directive>\#[^\n]*)"
    r"|(?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?[fFdD]?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r'|(?P<text>"(?:[^"\\\n]|\\.)*")'
    r"|(?P<sign>::|<<|>>|[{}()\[\]<>;:,=@+\-*/%|&^~])",
    re.DOTALL,
)


def scan(text: str, file: str) -> list[Word]:
    """The words of a file; the last one marks its end.

    Raises:
        ConfigError: a character that IDL does not allow.
    """
    words: list[Word] = []
    offset, line, start = 0, 1, 0
    remark: list[str] = []
    while offset < len(text):
        place = SourcePlace(file, line, offset - start + 1)
        found = _WORDS.match(text, offset)
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
        elif kind not in ("space", "line"):
            shown = " ".join(part for part in remark if part)
            words.append(Word(TokenKind[str(kind).upper()], inside, place, shown))
            remark = []
        breaks = found[0].count("\n")
        if breaks:
            line += breaks
            start = offset + found[0].rindex("\n") + 1
        offset = found.end()
    words.append(Word(TokenKind.END, "", SourcePlace(file, line, offset - start + 1)))
    return words
