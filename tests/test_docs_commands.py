"""Every `msbot` command that a page shows is one that there is, and the page of commands has all of them."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from msbot_agent.cli import msbot
from tools.commands_page import PAGE, with_tables

ROOT = Path(__file__).parent.parent
PAGES = [*sorted((ROOT / "docs" / "howto").glob("*.md")), *sorted((ROOT / "docs" / "tutorial").glob("*.md"))]
REFERENCE = re.compile(r"\bdocs/\w+/\w+\.md\b|msbot help (?P<page>[a-z_/]+)")
"""How a text refers to a page of the documentation: to its file, or to the command that shows it."""
SHELL = {"|", ">", ">>", "<", "&", "&&", "2>"}
"""Where the shell takes over."""


def shown(page: Path) -> Iterator[list[str]]:
    """The words of every line of a code block that begins with `msbot`; a comment behind it is left out."""
    for block in re.findall(r"^ *```\w*\n(.*?)^ *```", page.read_text(), re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            command = line.strip().removeprefix("$ ").removeprefix("sudo ")
            if re.match(r"msbot (?!\d)", command):  # `msbot 0.1.0` is an answer
                words = shlex.split(command, comments=True)[1:]
                end = next((at for at, word in enumerate(words) if word in SHELL), len(words))
                yield words[:end]


def parse(words: list[str]) -> None:
    """Take the words as `msbot` does, up to the last subcommand, without doing it.

    Raises:
        click.UsageError: there is no such command or option, or too many words.
    """
    group: click.Command = msbot
    context = click.Context(msbot, info_name="msbot")
    while isinstance(group, click.Group) and words:
        command = group.get_command(context, words[0])
        if command is None:
            raise click.UsageError(f"there is no command {words[0]}")
        context, group, words = click.Context(command, parent=context, info_name=words[0]), command, words[1:]
    if "..." not in words:
        left = group.make_parser(context).parse_args(list(words))[1]
        if left:
            raise click.UsageError(f"too many words: {left}")


def test_the_page_of_commands_is_up_to_date() -> None:
    page = PAGE.read_text()
    assert page == with_tables(page), "python tools/commands_page.py --write"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_on_a_page_is_one(page: Path) -> None:
    wrong = []
    for words in shown(page):
        try:
            parse(words)
        except click.UsageError as error:
            wrong.append(f"msbot {shlex.join(words)}: {error.format_message()}")
    assert wrong == []


def test_commands_are_found_at_all() -> None:
    assert sum(len(list(shown(page))) for page in PAGES) > 150
    for words in (["nonsense"], ["part", "LED", "--pinz", "s=2"], ["key", "list", "more"]):
        with pytest.raises(click.UsageError):
            parse(words)


def texts_of(module: Path) -> Iterator[str]:
    """The texts of a module that refer to a page: its strings, without those that explain the code."""
    source = module.read_text("utf-8")
    if not REFERENCE.search(source):
        return
    tree = ast.parse(source)
    explaining = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in explaining:
            yield node.value


def test_the_program_refers_to_pages_that_every_installation_has() -> None:
    """Who has installed the packages has no folder `docs`, but `msbot help`."""
    found = [
        (match, f"{module.relative_to(ROOT)}: {text}")
        for module in sorted(ROOT.glob("packages/*/src/**/*.py"))
        for text in texts_of(module)
        for match in REFERENCE.finditer(text)
    ]
    assert [words for match, words in found if not match["page"]] == []
    pages = {match["page"] for match, _ in found}
    assert pages >= {"zenoh", "write_an_extension", "reference/library"}
    assert [page for page in sorted(pages) if not list((ROOT / "docs").glob(f"**/{page}.md"))] == []
