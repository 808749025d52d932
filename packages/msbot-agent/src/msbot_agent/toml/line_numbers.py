"""On which line of a TOML text each key is.

The standard library's parser keeps no positions, so the text is walked once more. It has already been parsed and is
known to be valid; the walk only needs to distinguish keys, tables, lists and strings.
"""

from __future__ import annotations

import tomllib
from bisect import bisect_right

from msbot_agent.toml.problems import KeyPath

_BLANK = " \t"
_BARE_KEY = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_")
_BARE_VALUE_END = frozenset(",]}#\n")


def key_lines(text: str) -> dict[KeyPath, int]:
    """The line, counted from 1, of every table, key and list item of a valid TOML text."""
    scanner = _Scanner(text.replace("\r\n", "\n"))
    scanner.document()
    return scanner.lines


class _Scanner:
    """A cursor over the text; each method starts at its construct and ends after it."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self._text = text
        self._at = 0
        self._newlines = [at for at, character in enumerate(text) if character == "\n"]
        self._tables_seen: dict[KeyPath, int] = {}
        """How many tables each `[[list of tables]]` has so far."""

    def document(self) -> None:
        """Walk the whole text."""
        prefix: KeyPath = ()
        self._skip(across_lines=True)
        while self._at < len(self._text):
            if self._peek() == "[":
                prefix = self._header()
            else:
                self._pair(prefix)
            self._skip(across_lines=True)

    def _header(self) -> KeyPath:
        is_list = self._text.startswith("[[", self._at)
        self._at += 2 if is_list else 1
        keys = self._keys()
        line = self._line()
        self._at += 2 if is_list else 1
        path: KeyPath = ()
        for key in keys[:-1]:
            path = self._newest((*path, key))
            self.lines.setdefault(path, line)
        path = (*path, keys[-1])
        if is_list:
            self.lines.setdefault(path, line)
            position = self._tables_seen.get(path, 0)
            self._tables_seen[path] = position + 1
            path = (*path, position)
        self.lines[path] = line
        return path

    def _newest(self, path: KeyPath) -> KeyPath:
        """The path itself, or that of the newest table of a list of tables."""
        seen = self._tables_seen.get(path)
        return path if seen is None else (*path, seen - 1)

    def _pair(self, prefix: KeyPath) -> None:
        line = self._line()
        path = prefix
        for key in self._keys():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self._at += 1  # the equals sign
        self._value(path)

    def _keys(self) -> list[str]:
        """A dotted key, up to the first character after it and its blanks."""
        keys = []
        while True:
            self._skip(across_lines=False)
            start = self._at
            if self._peek() in "\"'":
                self._string()
                keys.append(str(tomllib.loads(f"key = {self._text[start : self._at]}")["key"]))
            else:
                while self._peek() in _BARE_KEY:
                    self._at += 1
                keys.append(self._text[start : self._at])
            self._skip(across_lines=False)
            if self._peek() != ".":
                return keys
            self._at += 1

    def _value(self, path: KeyPath) -> None:
        self._skip(across_lines=False)
        match self._peek():
            case '"' | "'":
                self._string()
            case "[":
                self._list(path)
            case "{":
                self._inline_table(path)
            case _:
                while self._at < len(self._text) and self._peek() not in _BARE_VALUE_END:
                    self._at += 1

    def _list(self, path: KeyPath) -> None:
        self._at += 1
        position = 0
        self._skip(across_lines=True)
        while self._peek() != "]":
            self.lines[(*path, position)] = self._line()
            self._value((*path, position))
            position += 1
            self._skip_comma()
        self._at += 1

    def _inline_table(self, path: KeyPath) -> None:
        self._at += 1
        self._skip(across_lines=True)
        while self._peek() != "}":
            self._pair(path)
            self._skip_comma()
        self._at += 1

    def _skip_comma(self) -> None:
        self._skip(across_lines=True)
        if self._peek() == ",":
            self._at += 1
            self._skip(across_lines=True)

    def _string(self) -> None:
        quote = self._peek()
        fence = quote * 3 if self._text.startswith(quote * 3, self._at) else quote
        self._at += len(fence)
        while not self._text.startswith(fence, self._at):
            self._at += 2 if quote == '"' and self._peek() == "\\" else 1
        self._at += len(fence)
        # Up to two quotes may stand before a closing fence of three.
        while len(fence) == 3 and self._peek() == quote:
            self._at += 1

    def _skip(self, *, across_lines: bool) -> None:
        """Skip blanks, and line ends and comments where they mean nothing."""
        while self._at < len(self._text):
            character = self._text[self._at]
            if across_lines and character == "#":
                end = self._text.find("\n", self._at)
                self._at = len(self._text) if end < 0 else end
            elif character in _BLANK or (across_lines and character == "\n"):
                self._at += 1
            else:
                return

    def _peek(self) -> str:
        """The character under the cursor; after the end a NUL, which TOML forbids."""
        return self._text[self._at] if self._at < len(self._text) else "\0"

    def _line(self) -> int:
        return bisect_right(self._newlines, self._at - 1) + 1
