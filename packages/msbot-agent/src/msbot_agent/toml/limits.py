"""How large and how deep a TOML text may be, checked before it is parsed, in time that grows only with its length.

A parser builds what a text asks for: forty kilobytes of dots are a table forty thousand levels deep. So the text is
scanned first, ignoring strings and comments, and refused when it asks for more than any file written by a person.
"""

from __future__ import annotations

import re

from msbot_agent.text.sentence import said

MOST_BYTES = 256_000
"""Largest text that is read; a blueprint has a few thousand bytes, one of a thousand slots about a hundred thousand."""
MOST_LINES = 20_000
MOST_ENTRIES = 20_000
"""Most keys and list items of one text."""
DEEPEST = 8
"""Most levels of lists and tables, and steps of a dotted key."""

_MARKS = re.compile("[\"'#\\n.,=\\[\\]{}]")


def too_much(text: str) -> tuple[int | None, str] | None:
    """Why a text must not be parsed, with the line that shows it; None when it may be parsed.

    A text that is not TOML may pass: the parser then says so.
    """
    if len(text) > MOST_BYTES or len(text.encode("utf-8", "replace")) > MOST_BYTES:
        return None, said(
            "is larger than {most_bytes:,} bytes; no file of this kind is: name another", most_bytes=MOST_BYTES
        )
    if text.count("\n") >= MOST_LINES:
        return None, said(
            "has more than {most_lines:,} lines; no file of this kind has: divide it", most_lines=MOST_LINES
        )
    return _Walk(text).fault()


class _Walk:
    """One pass through a text, from mark to mark."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._line = 1
        self._entries = 0
        self._depth = 0
        self._dots = 0

    def fault(self) -> tuple[int, str] | None:
        while (found := _MARKS.search(self._text, self._at)) is not None:
            mark = found[0]
            self._at = found.end()
            match mark:
                case '"' | "'":
                    if not self._skip_string(found.start(), mark):
                        return None  # it is not closed: the parser will say so
                case "#":
                    end = self._text.find("\n", self._at)
                    self._at = len(self._text) if end < 0 else end
                case "\n":
                    self._line += 1
                    self._dots = 0
                case ".":
                    self._dots += 1
                case _:
                    self._structure(mark)
            if self._dots >= DEEPEST or self._depth > DEEPEST:
                return self._line, said(
                    "lists, tables or keys are nested deeper than {deepest} levels; a few are enough", deepest=DEEPEST
                )
            if self._entries > MOST_ENTRIES:
                return (
                    self._line,
                    said(
                        "there are more than {most_entries:,} keys and list items up to here; divide the file",
                        most_entries=MOST_ENTRIES,
                    ),
                )
        return None

    def _structure(self, mark: str) -> None:
        self._dots = 0
        if mark in "[{":
            self._depth += 1
        elif mark in "]}":
            self._depth = max(self._depth - 1, 0)
        self._entries += mark in "=,["

    def _skip_string(self, start: int, quote: str) -> bool:
        """Skip a string; False when it has no end."""
        if self._text.startswith(quote * 3, start):
            fence, begin = quote * 3, start + 3
        else:
            fence, begin = quote, start + 1
        at = begin
        while True:
            at = self._text.find(fence, at)
            if at < 0:
                return False
            if quote == "'" or not self._is_escaped(begin, at):
                break
            at += 1
        self._line += self._text.count("\n", start, at)
        self._at = at + len(fence)
        return True

    def _is_escaped(self, begin: int, at: int) -> bool:
        back = at
        while back > begin and self._text[back - 1] == "\\":
            back -= 1
        return (at - back) % 2 == 1
