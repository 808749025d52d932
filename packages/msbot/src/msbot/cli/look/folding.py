"""Long sentences in a terminal: they go on in the next line between two words, and never within one."""

from __future__ import annotations

import re
import sys
from shutil import get_terminal_size
from textwrap import wrap

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
        wrap(rest, columns, initial_indent=before[0], subsequent_indent=further, break_long_words=False,
             break_on_hyphens=False)
    )  # fmt: skip
