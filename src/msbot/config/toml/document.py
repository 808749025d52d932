"""A TOML file being read: its text, its values, the line of every key, or a clear message why it cannot be read."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from msbot.config.toml.limits import MOST_BYTES, too_much
from msbot.config.toml.line_numbers import key_lines
from msbot.config.toml.problems import KeyPath, Problems, TextPlace


@dataclass(frozen=True, slots=True)
class Document:
    """A parsed TOML file."""

    file: str
    """The path as the user wrote it."""
    values: dict[str, object]
    lines: dict[KeyPath, int]

    def place(self, path: KeyPath) -> TextPlace:
        """Where `path` is; for a key that is missing, where its table begins."""
        known = path
        while known and known not in self.lines:
            known = known[:-1]
        return TextPlace(self.file, self.lines.get(known), path)


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
        problems.add(TextPlace(file, refused[0]), refused[1])
        return None
    try:
        values = tomllib.loads(text)
        lines = key_lines(text)
    except tomllib.TOMLDecodeError as error:
        place, sentence, excerpt = _syntax_problem(text, file, str(error))
        problems.add(place, sentence, excerpt)
    except ValueError as error:
        problems.add(TextPlace(file), f"a number in it cannot be read ({error}); write it shorter")
    else:
        return Document(file, values, lines)
    return None


def _read(path: Path, problems: Problems, if_missing: str) -> bytes | None:
    try:
        with path.open("rb") as stream:
            octets = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        problems.add(TextPlace(str(path)), _unreadable(path, error, if_missing))
        return None
    if len(octets) > MOST_BYTES:
        problems.add(
            TextPlace(str(path)), f"is larger than {MOST_BYTES:,} bytes; no file of this kind is: name another"
        )
        return None
    return octets


def _unreadable(path: Path, error: OSError | ValueError, if_missing: str) -> str:
    match error:
        case FileNotFoundError():
            return f"there is no such file; {if_missing}"
        case IsADirectoryError():
            return f"is a directory; name a file in it, for example {path / 'robot.toml'}"
        case PermissionError():
            return f"no permission to read it; try `chmod u+r {path}`"
        case OSError():
            return f"cannot be read ({error.strerror}); name another file"
        case _:
            return f"cannot be read ({error}); name another file"


def _decode(octets: bytes, file: str, problems: Problems) -> str | None:
    try:
        return octets.decode("utf-8-sig")  # some editors put a byte order mark in front
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        sentence = f"byte 0x{octets[error.start]:02X} is not UTF-8; save the file as UTF-8 in your editor"
        problems.add(TextPlace(file, line), sentence)
        return None


_SYNTAX_WORDS = (
    ("Expected '=' after a key", 'a key needs an equals sign and a value after it, as in name = "AA"'),
    ("Invalid value", 'this is not a value; text needs quotes, as in name = "AA"'),
    ("Expected newline or end of document", "something is left behind the value; one key = value on each line"),
    ("Cannot overwrite a value", "this key is there twice in one table; keep one of them"),
    ("Duplicate inline table key", "this key is there twice in one table; keep one of them"),
    ("twice", "this table is there twice; for several of a kind write [[slot]] with two brackets"),
    ("Cannot mutate immutable namespace", "this table was completed before; put all of it in one place"),
    ("Cannot redefine namespace", "this table was completed before; put all of it in one place"),
    ("Expected ']", "a bracket ] is missing behind the table's name"),
    ("Unclosed array", "a list is not closed; put a comma between its items and ] at its end"),
    ("Unclosed inline table", "a table in braces is not closed; put a comma between its keys and } at its end"),
    ("Unterminated string", "a text is not closed; put a quote at its end"),
    ("Unescaped '\\' in a string", "a backslash in a text must be doubled, or use 'single quotes' around the text"),
    ('Expected \'"""\'', "a text over several lines is not closed; put three quotes at its end"),
    ("Expected \"'", "a text is not closed; put a quote at its end"),
    ("character '\\n'", "a text is not closed on its line; put a quote at its end"),
    ("Found invalid character", "this character is not allowed here; remove it"),
    (
        "Invalid initial character for a key",
        "a key is missing or has no plain letters; put it in quotes if it is meant",
    ),
    ("Invalid statement", "this line is neither key = value nor [table]; put # before a comment"),
    ("Invalid date or datetime", 'this is not a date; put quotes around it if it is text, as in released = "8-4-2021"'),
)
"""Phrases in the parser's messages, and what to tell a person instead."""

_POSITION = re.compile(r"\(at (?:line (\d+), column (\d+)|end of document)\)\s*$")


def _syntax_problem(text: str, file: str, message: str) -> tuple[TextPlace, str, str]:
    """The place, a sentence, and the line itself."""
    position = _POSITION.search(message)
    words = next((ours for theirs, ours in _SYNTAX_WORDS if theirs in message), None)
    if words is None:
        words = f"this is not TOML ({_POSITION.sub('', message).strip()}); see https://toml.io"
    lines = text.split("\n")
    if position is None or position[1] is None:
        return TextPlace(file, len(lines)), f"at the end of the file: {words}", ""
    line = int(position[1])
    excerpt = lines[line - 1].strip()
    shown = f"{line} | {excerpt[:100]}" if excerpt else ""
    return TextPlace(file, line), f"column {position[2]}: {words}", shown
