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

from msbot_agent.cli import TASKS, msbot
from msbot_agent.cli.exit_status import MEANINGS, NO_MEANS, ExitStatus

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "commands.md"
STATUSES = "<!-- statuses: made by tools/commands_page.py -->\n"
END_OF_STATUSES = "<!-- end of the statuses -->\n"
BEGIN = "<!-- made by tools/commands_page.py -->\n"
END = "<!-- end of what is made -->\n"
SHARED = "## Options of many commands\n"


def tables(shared: set[str]) -> str:
    """A list for each task, in Markdown; options in `shared` are left out."""
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
    page = _between(page, STATUSES, statuses(), END_OF_STATUSES)
    return _between(page, BEGIN, tables(shared_options(page)), END)


def _between(page: str, begins: str, made: str, ends: str) -> str:
    head, begin, rest = page.partition(begins)
    _old, end, tail = rest.partition(ends)
    if not begin or not end:
        raise ValueError(f"{PAGE} has no place for what is made: {begins.strip()} ... {ends.strip()}")
    return head + begins + made + ends + tail


def statuses() -> str:
    """A list of the exit statuses, in Markdown; of NO with what it means for each command."""
    of_same = dict[str, list[str]]()
    for command, words in NO_MEANS.items():
        of_same.setdefault(words, []).append(f"`{command}`")
    no = "".join(f"\n  * {', '.join(commands)}: {words}" for words, commands in of_same.items())
    lines = [f"* {one.value}: {words}.{no if one is ExitStatus.NO else ''}\n" for one, words in MEANINGS.items()]
    return "".join(lines)


def main() -> None:
    page = PAGE.read_text("utf-8")
    made = with_tables(page)
    if "--write" in sys.argv[1:]:
        PAGE.write_text(made, "utf-8")
    elif made != page:
        sys.exit("docs/reference/commands.md is out of date: python tools/commands_page.py --write")


if __name__ == "__main__":
    main()
