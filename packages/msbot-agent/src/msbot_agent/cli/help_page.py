"""What `msbot --help` prints, octet for octet as click would: to import click takes longer than all the rest.

A test compares the two.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping

SUMMARY = "Plug-and-play robots for the classroom."

_OPTIONS = {"--version": "Show the version and exit.", "-h, --help": "Show this message and exit."}
_WIDEST, _NARROWEST = 78, 50
_INDENT = 2


def show(commands: Mapping[str, str]) -> None:
    """Print it for the terminal's width."""
    try:
        print(page(commands, _columns()), flush=True)
    except BrokenPipeError:
        leave_output()  # whoever read it (`| head`) has enough
    except OSError as error:
        leave_output()
        print(f"msbot: standard output takes nothing: {error.strerror}", file=sys.stderr)
        sys.exit(2)


def leave_output() -> None:
    """Let standard output go nowhere: what waits in its buffer would make Python complain at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def page(commands: Mapping[str, str], columns: int) -> str:
    """The page for a terminal of that width; `commands`: name -> what it does."""
    width = max(min(columns - 2, _WIDEST), _NARROWEST)
    lines = ["Usage: msbot [OPTIONS] COMMAND [ARGS]...", ""]
    lines += textwrap.wrap(SUMMARY, width, initial_indent=" " * _INDENT, subsequent_indent=" " * _INDENT)
    lines += ["", "Options:", *_list(_OPTIONS.items(), width)]
    lines += ["", "Commands:", *_list(commands.items(), width)]
    return "\n".join(lines)


def _list(rows: Iterable[tuple[str, str]], width: int) -> Iterator[str]:
    pairs = list(rows)
    first = max(len(name) for name, _ in pairs) + 2
    room = max(width - first - 2, 10)
    for name, words in pairs:
        head, *rest = textwrap.wrap(words, room)
        yield f"{' ' * _INDENT}{name:<{first}}{head}"
        yield from (" " * (first + _INDENT) + line for line in rest)


def _columns() -> int:
    try:
        return int(os.environ.get("COLUMNS", "")) or _of_terminal()
    except ValueError:
        return _of_terminal()


def _of_terminal() -> int:
    try:
        return os.get_terminal_size(sys.__stdout__.fileno() if sys.__stdout__ else 1).columns or 80
    except OSError:
        return 80
