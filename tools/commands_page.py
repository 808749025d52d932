"""Writes the lists of commands in docs/reference/commands.md from the commands themselves.

    python tools/commands_page.py            says whether the page is up to date (status 1 if not); a test does the same
    python tools/commands_page.py --write    writes them

A row is a command with its arguments, then the first clause of its `--help`.
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


def tables() -> str:
    """A list for each task, in Markdown."""
    lines = []
    for title, names in TASKS.items():
        lines += [f"## {title}", ""]
        for name in names:
            lines += _rows(name)
        lines.append("")
    return "\n".join(lines)


def _rows(name: str) -> Iterator[str]:
    """The row of a command; of a group, one for each of its commands."""
    command = msbot.get_command(click.Context(msbot, info_name="msbot"), name)
    assert command is not None, name
    if not isinstance(command, click.Group):
        yield _row(name, command)
        return
    if command.invoke_without_command:
        yield _row(name, command)
    for sub, one in command.commands.items():
        if one.hidden:  # what people type out of habit: a sentence says what is right
            continue
        yield _row(f"{name} {sub}", one)


def _row(words: str, command: click.Command) -> str:
    context = click.Context(command, info_name=words)
    arguments = [part.make_metavar(context) for part in command.params if isinstance(part, click.Argument)]
    return f"* `{' '.join([words, *arguments])}`: {_first_clause(command)}"


def _first_clause(command: click.Command) -> str:
    paragraph = re.sub(r"\s+", " ", (command.help or "").strip().partition("\n\n")[0])
    return re.split(r"(?<=\.) (?=[A-Z`])|; ", paragraph, maxsplit=1)[0].removesuffix(".")


def with_tables(page: str) -> str:
    """The page, with tables as the commands are now."""
    page = _between(page, STATUSES, statuses(), END_OF_STATUSES)
    return _between(page, BEGIN, tables(), END)


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
