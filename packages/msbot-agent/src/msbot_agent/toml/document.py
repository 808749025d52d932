"""A TOML file being read: its text, its values, the line of every key, or a clear message why it cannot be read."""

from __future__ import annotations

import re
import tomllib
from functools import cached_property
from importlib.resources.abc import Traversable
from pathlib import Path

from msbot_agent.startup.bytecode_cache import packaged_toml
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import open_input_file
from msbot_agent.toml.line_numbers import key_lines
from msbot_agent.toml.problems import FileLocation, KeyPath, Problems
from msbot_xrce.lazy import dataclass

# How large and how deep a TOML text may be, checked before it is parsed, in time that grows only with its length.
#
# A parser builds what a text asks for: forty kilobytes of dots are a table forty thousand levels deep. So the text is
# scanned first, ignoring strings and comments, and refused when it asks for more than any file written by a person.


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


@dataclass(frozen=True)
class Document:
    """A parsed TOML file."""

    file: str
    """The path as the user wrote it."""
    values: dict[str, object]
    text: str
    """What it was parsed from."""
    begins: int | None = None
    """Line on which it begins, where it is a block of a larger file."""

    @cached_property
    def lines(self) -> dict[KeyPath, int]:
        """The line of every key; looked for only when something is wrong, as it takes as long as parsing."""
        return key_lines(self.text)

    def location(self, path: KeyPath) -> FileLocation:
        """Where `path` is; for a key that is missing, where its table begins."""
        known = path
        while known and known not in self.lines:
            known = known[:-1]
        return FileLocation(self.file, self.lines.get(known, self.begins), path)


def read_document(path: Path, problems: Problems, *, if_missing: str = "name another file") -> Document | None:
    """Read and parse one TOML file; None after a problem: missing, unreadable, not UTF-8, not TOML."""
    octets = _read(path, problems, if_missing)
    text = None if octets is None else _decode(octets, str(path), problems)
    return None if text is None else parse_document(text, str(path), problems)


def parse_document(text: str, file: str, problems: Problems) -> Document | None:
    """Parse a TOML text; `file` is its name in messages. None after a problem.

    A text larger or deeper than anything written by a person is not parsed at all, see `limits`.
    """
    if refused := too_much(text):
        problems.add(FileLocation(file, refused[0]), refused[1])
        return None
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place, sentence, excerpt = _syntax_problem(text, file, str(error))
        problems.add(place, sentence, excerpt)
    except ValueError as error:
        problems.add(
            FileLocation(file), said("a number in it cannot be read ({error}); write it shorter", error=str(error))
        )
    else:
        return Document(file, values, text)
    return None


def packaged_document(entry: Traversable, file: str) -> Document:
    """A TOML file that MsBOT brings, which needs no protection from its author; `file` is its name in messages."""
    return Document(file, dict(packaged_toml(entry)), entry.read_text("utf-8"))


def _read(path: Path, problems: Problems, if_missing: str) -> bytes | None:
    try:
        with open_input_file(path) as stream:
            octets = stream.read(MOST_BYTES + 1) or b""
    except (OSError, ValueError) as error:
        problems.add(FileLocation(str(path)), _unreadable(path, error, if_missing))
        return None
    if len(octets) > MOST_BYTES:
        problems.add(
            FileLocation(str(path)),
            said("is larger than {most_bytes:,} bytes; no file of this kind is: name another", most_bytes=MOST_BYTES),
        )
        return None
    return octets


def _unreadable(path: Path, error: OSError | ValueError, if_missing: str) -> str:
    match error:
        case FileNotFoundError():
            return said("there is no such file; {if_missing}", if_missing=if_missing)
        case IsADirectoryError():
            return said("is a directory; name a file in it, for example {value}", value=path / "robot.toml")
        case PermissionError():
            return said("no permission to read it; try `chmod u+r {path}`", path=path)
        case OSError():
            return said("cannot be read ({strerror}); name another file", strerror=error.strerror)
        case _:
            return said("cannot be read ({error}); name another file", error=str(error))


def _decode(octets: bytes, file: str, problems: Problems) -> str | None:
    try:
        return octets.decode("utf-8-sig")  # some editors put a byte order mark in front
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        sentence = said(
            "byte 0x{octets:02X} is not UTF-8; save the file as UTF-8 in your editor", octets=octets[error.start]
        )
        problems.add(FileLocation(file, line), sentence)
        return None


_SYNTAX_WORDS = (
    ("Expected '=' after a key", said('a key needs an equals sign and a value after it, as in name = "AA"')),
    ("Invalid value", said('this is not a value; text needs quotes, as in name = "AA"')),
    ("Expected newline or end of document", said("something is left behind the value; one key = value on each line")),
    ("Cannot overwrite a value", said("this key is there twice in one table; keep one of them")),
    ("Duplicate inline table key", said("this key is there twice in one table; keep one of them")),
    ("twice", said("this table is there twice; for several of a kind write [[slot]] with two brackets")),
    ("Cannot mutate immutable namespace", said("this table was completed before; put all of it in one place")),
    ("Cannot redefine namespace", said("this table was completed before; put all of it in one place")),
    ("Expected ']", said("a bracket ] is missing behind the table's name")),
    ("Unclosed array", said("a list is not closed; put a comma between its items and ] at its end")),
    ("Unclosed inline table", said("a table in braces is not closed; put a comma between its keys and } at its end")),
    ("Unterminated string", said("a text is not closed; put a quote at its end")),
    (
        "Unescaped '\\' in a string",
        said("a backslash in a text must be doubled, or use 'single quotes' around the text"),
    ),
    ('Expected \'"""\'', said("a text over several lines is not closed; put three quotes at its end")),
    ("Expected \"'", said("a text is not closed; put a quote at its end")),
    ("character '\\n'", said("a text is not closed on its line; put a quote at its end")),
    ("Found invalid character", said("this character is not allowed here; remove it")),
    (
        "Invalid initial character for a key",
        said("a key is missing or has no plain letters; put it in quotes if it is meant"),
    ),
    ("Invalid statement", said("this line is neither key = value nor [table]; put # before a comment")),
    (
        "Invalid date or datetime",
        said('this is not a date; put quotes around it if it is text, as in released = "8-4-2021"'),
    ),
)
"""Phrases in the parser's messages, and what to tell a person instead."""

_POSITION = re.compile(r"\(at (?:line (\d+), column (\d+)|end of document)\)\s*$")


def _syntax_problem(text: str, file: str, message: str) -> tuple[FileLocation, str, str]:
    """The place, a sentence, and the line itself."""
    position = _POSITION.search(message)
    words = next((ours for theirs, ours in _SYNTAX_WORDS if theirs in message), None)
    if words is None:
        words = said("this is not TOML ({right}); see https://toml.io", right=_POSITION.sub("", message).strip())
    lines = text.split("\n")
    if position is None or position[1] is None:
        return FileLocation(file, len(lines)), said("at the end of the file: {words}", words=words), ""
    line = int(position[1])
    excerpt = lines[line - 1].strip()
    shown = f"{line} | {excerpt[:100]}" if excerpt else ""
    return FileLocation(file, line), said("column {column}: {words}", column=position[2], words=words), shown
