"""Writes the lists of commands in docs/reference/commands.md from the commands themselves.

    python tools/commands_page.py            says whether the page is up to date (status 1 if not); a test does the same
    python tools/commands_page.py --write    writes them

A row is a command with its arguments, then the first sentence of its `--help` and the names of its own options: those
of the page's list of shared options are left out, and those that all commands of a group have stand once.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click

from msbot_agent.cli import COMMANDS, msbot

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "commands.md"
BEGIN = "<!-- made by tools/commands_page.py -->\n"
END = "<!-- end of what is made -->\n"
SHARED = "## Options of many commands\n"

TASKS = {
    "Try it": ("demo", "arena", "lesson", "quiz"),
    "Run a robot": ("init", "master", "service", "doctor", "extensions", "completion"),
    "Run parts": ("part", "host", "bridge", "board", "hardware", "library", "key"),
    "See what a robot does": ("parts", "why", "topic", "clients", "robots"),
    "Change a running robot": (
        *("adopt", "swap", "release", "block", "unblock", "simulate", "identify"),
        *("set", "publish", "call", "bind", "unbind", "undo", "stop", "go"),
    ),
    "Blueprint and database": ("check", "diff", "apply", "slot", "export", "db"),
    "A class": ("class", "user", "pupils", "fault", "mission"),
    "Recordings and curves": ("rec", "log", "play", "plot"),
    "The CAN bus and messages": ("bus", "explain", "idl"),
    "Agents and several computers": ("agent", "relay", "gateway", "router"),
}
"""Every command in the group of tasks that somebody looks for it under."""


def tables(shared: set[str]) -> str:
    """A list for each group of tasks, in Markdown; options in `shared` are left out."""
    grouped = [name for names in TASKS.values() for name in names]
    if sorted(grouped) != sorted(COMMANDS):
        raise ValueError(f"TASKS and COMMANDS differ: {sorted(set(grouped) ^ set(COMMANDS))}")
    lines = []
    for title, names in TASKS.items():
        lines += [f"## {title}", ""]
        for name in names:
            lines += _rows(name, shared)
        lines.append("")
    return "\n".join(lines)


def _rows(name: str, shared: set[str]) -> Iterator[str]:
    """The row of a command; of a group, one for each of its commands, and one for the options that all of them have."""
    context = click.Context(msbot, info_name="msbot")
    command = msbot.get_command(context, name)
    assert command is not None, name
    if not isinstance(command, click.Group):
        yield _row(name, command, shared)
        return
    subs = command.commands
    of_all = set.intersection(*(set(_options(one)) for one in subs.values())) - shared if len(subs) > 2 else set()
    if of_all:
        options = [option for option in _options(next(iter(subs.values()))) if option in of_all]
        yield f"* `{name} ...`: {_first_sentence(command)}{_listed(options)}"
    for sub, one in subs.items():
        yield _row(f"{name} {sub}", one, shared | of_all)


def _row(words: str, command: click.Command, left_out: set[str]) -> str:
    context = click.Context(command, info_name=words)
    arguments = [part.make_metavar(context) for part in command.params if isinstance(part, click.Argument)]
    call = " ".join([words, *arguments])
    options = [option for option in _options(command) if option not in left_out]
    return f"* `{call}`: {_first_sentence(command)}{_listed(options)}"


def _options(command: click.Command) -> dict[str, None]:
    """The long names of its options, in the order of `--help`."""
    return {max(part.opts, key=len): None for part in command.params if isinstance(part, click.Option)}


def _listed(options: list[str]) -> str:
    return f". {', '.join(f'`{option}`' for option in options)}" if options else ""


def _first_sentence(command: click.Command) -> str:
    paragraph = re.sub(r"\s+", " ", (command.help or "").strip().partition("\n\n")[0])
    return re.split(r"(?<=\.) (?=[A-Z`])", paragraph, maxsplit=1)[0].removesuffix(".")


def shared_options(page: str) -> set[str]:
    """The long options in the page's list of shared options."""
    section = page.partition(SHARED)[2].partition("\n## ")[0]
    firsts = re.findall(r"^\* (.*?): ", section, re.MULTILINE)
    return {option for cell in firsts for option in re.findall(r"--[\w-]+", cell)}


def with_tables(page: str) -> str:
    """The page, with tables as the commands are now."""
    head, begin, rest = page.partition(BEGIN)
    _old, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{PAGE} has no place for the tables: {BEGIN.strip()} ... {END.strip()}")
    return head + BEGIN + tables(shared_options(page)) + END + tail


def main() -> None:
    page = PAGE.read_text("utf-8")
    made = with_tables(page)
    if "--write" in sys.argv[1:]:
        PAGE.write_text(made, "utf-8")
    elif made != page:
        sys.exit("docs/reference/commands.md is out of date: python tools/commands_page.py --write")


if __name__ == "__main__":
    main()
