"""The tables that commands print: columns two blanks apart under their titles, without lines around them.

In a pipe or a file a row is one line, however long, so that `grep` and `awk` find it whole. In a terminal no line is
longer than the terminal is wide: the last column, where the sentences are, goes on below between two words, and what
has no room in the others is cut off with an ellipsis.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from shutil import get_terminal_size
from textwrap import wrap
from unicodedata import combining, east_asian_width

import click

from msbot_agent.text.sentence import printable

GAP = "  "
LEAST_WIDTH = 8
"""No column is made narrower than that."""
LEAST_WRAPPED = 20
"""A last column that is narrower is cut, as the others: a word in each line is no sentence."""
_NUMBER = re.compile(r"-|[+-]?[0-9.,]+%?")
"""Columns of these stand at the right."""


def print_table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table for whoever reads it.

    Args:
        titles: of the columns.
        rows: their cells; control characters in them are shown, not sent to the terminal.
    """
    for line in table_lines(titles, rows, columns_here()):
        click.echo(line)


def columns_here() -> int | None:
    """How wide the terminal is; None: standard output is none."""
    return get_terminal_size().columns if sys.stdout.isatty() else None


def table_lines(titles: Sequence[str], rows: Iterable[Sequence[str]], columns: int | None) -> Iterator[str]:
    """The lines of a table, the titles first.

    Args:
        titles: of the columns.
        rows: their cells.
        columns: the longest line; None: each row is one line.
    """
    cells = [[printable(cell) for cell in row] for row in (titles, *rows)]
    widths = [max(map(_width, column)) for column in zip(*cells, strict=True)]
    if columns is not None:
        widths = _fitted(widths, columns - len(GAP) * (len(widths) - 1))
    is_number = [_is_numbers(column[1:]) for column in zip(*cells, strict=True)]
    *firsts, last = widths
    ellipsis = "\u2026" if (sys.stdout.encoding or "").lower().startswith("utf") else "..."
    for row in cells:
        begin = GAP.join(
            _padded(_cut(cell, width, ellipsis), width, right=right)
            for cell, width, right in zip(row, firsts, is_number, strict=False)
        )
        begin += GAP if firsts else ""
        ends = [row[-1]]
        if _width(row[-1]) > last >= LEAST_WRAPPED:
            ends = wrap(row[-1], last) or [""]
        elif is_number[-1]:
            ends = [_padded(row[-1], last, right=True)]
        for number, end in enumerate(ends):
            yield f"{begin if number == 0 else ' ' * _width(begin)}{_cut(end, last, ellipsis)}".rstrip()


def _is_numbers(cells: Sequence[str]) -> bool:
    return all(map(_NUMBER.fullmatch, cells)) and any(map(str.isalnum, "".join(cells)))


def _fitted(widths: Sequence[int], room: int) -> list[int]:
    """Widths that fit: the last column gives way first as far as it can be read, then always the widest."""
    fitted = [*widths]
    missing = sum(fitted) - room
    if missing > 0:
        fitted[-1] -= min(missing, max(fitted[-1] - 2 * LEAST_WRAPPED, 0))
    while sum(fitted) > room and max(fitted) > LEAST_WIDTH:
        fitted[max(range(len(fitted)), key=fitted.__getitem__)] -= 1
    while sum(fitted) > room and max(fitted) > 1:  # a terminal of a few columns
        fitted[max(range(len(fitted)), key=fitted.__getitem__)] -= 1
    return fitted


def _cut(text: str, width: int, ellipsis: str) -> str:
    if _width(text) <= width:
        return text
    while text and _width(text) > width - len(ellipsis):
        text = text[:-1]
    return (text.rstrip() + ellipsis)[:width]


def _padded(text: str, width: int, *, right: bool) -> str:
    blanks = " " * (width - _width(text))
    return blanks + text if right else text + blanks


def _width(text: str) -> int:
    """How many columns of a terminal it takes: letters of East Asia take two, accents of their own none."""
    if text.isascii():
        return len(text)
    return sum(0 if combining(one) else 2 if east_asian_width(one) in "WF" else 1 for one in text)


# Long sentences in a terminal: they go on in the next line between two words, and never within one.


INDENT = 4
"""Spaces before what goes on, besides those of the sentence itself."""
LEAST_COLUMNS = 40
"""In a narrower terminal the terminal itself breaks the lines."""


def for_terminal(line: str) -> str:
    """The line as it is printed: folded in a terminal; in a pipe or a file a sentence stays one line."""
    return folded(line, get_terminal_size().columns) if sys.stdout.isatty() else line


def folded(line: str, columns: int) -> str:
    """A line as lines of at most that many columns; a word that is longer than that (a path) stays whole."""
    if len(line) <= columns or columns < LEAST_COLUMNS:
        return line
    before = re.match(r"( *)(?:- )?", line)  # the mark of a list never stands alone
    assert before is not None
    rest, further = line[before.end() :], " " * (before.end(1) + INDENT)
    return "\n".join(
        wrap(
            rest,
            columns,
            initial_indent=before[0],
            subsequent_indent=further,
            break_long_words=False,
            break_on_hyphens=False,
        )
    )
