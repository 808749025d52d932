"""What `msbot --help` prints, octet for octet as click would: to import click takes longer than all the rest.

A test compares the two.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping

from msbot_agent.cli.exit_status import ExitStatus

SUMMARY = "Plug-and-play robots for the classroom."

_OPTIONS = {"--version": "Show the version and exit.", "-h, --help": "Show this message and exit."}
_WIDEST, _NARROWEST = 78, 50
_INDENT = 2


def show(tasks: Mapping[str, Mapping[str, str]]) -> None:
    """Print it for the terminal's width."""
    try:
        print(page(tasks, columns_here()), flush=True)
    except BrokenPipeError:
        leave_output()  # whoever read it (`| head`) has enough
    except OSError as error:
        leave_output()
        print(f"msbot: standard output takes nothing: {error.strerror}", file=sys.stderr)
        sys.exit(ExitStatus.MISTAKE)


def leave_output() -> None:
    """Let standard output go nowhere: what waits in its buffer would make Python complain at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def page(tasks: Mapping[str, Mapping[str, str]], columns: int) -> str:
    """The page for a terminal of that width; `tasks`: title -> command -> what it does."""
    width = max(min(columns - 2, _WIDEST), _NARROWEST)
    lines = ["Usage: msbot [OPTIONS] COMMAND [ARGS]...", ""]
    lines += textwrap.wrap(SUMMARY, width, initial_indent=" " * _INDENT, subsequent_indent=" " * _INDENT)
    lines += ["", "Options:", *_list(_OPTIONS.items(), width, max(map(len, _OPTIONS)) + 2), *command_list(tasks, width)]
    return "\n".join(lines)


def command_list(tasks: Mapping[str, Mapping[str, str]], width: int) -> Iterator[str]:
    """The commands, one paragraph for each task, in lines of at most that width."""
    first = max((len(name) for commands in tasks.values() for name in commands), default=0) + 2
    for title, commands in tasks.items():
        yield from ("", f"{title}:", *_list(commands.items(), width, first))


def _list(rows: Iterable[tuple[str, str]], width: int, first: int) -> Iterator[str]:
    room = max(width - first - _INDENT, 10)
    for name, words in rows:
        head, *rest = textwrap.wrap(words, room) or [""]
        yield f"{' ' * _INDENT}{name:<{first}}{head}".rstrip()
        yield from (" " * (first + _INDENT) + line for line in rest)


def columns_here() -> int:
    try:
        return int(os.environ.get("COLUMNS", "")) or _of_terminal()
    except ValueError:
        return _of_terminal()


def _of_terminal() -> int:
    try:
        return os.get_terminal_size(sys.__stdout__.fileno() if sys.__stdout__ else 1).columns or 80
    except OSError:
        return 80
