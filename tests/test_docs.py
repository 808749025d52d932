"""The docs say what there is: commands and options, links that lead somewhere, no page left out."""

import re
from pathlib import Path

import click
import pytest

from msbot.cli import COMMANDS, msbot

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def options_of(command: click.Command) -> list[str]:
    own = [max(param.opts, key=len) for param in command.params if isinstance(param, click.Option)]
    if isinstance(command, click.Group):
        own += [option for sub in command.commands.values() for option in options_of(sub)]
    return own


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_is_documented(name: str) -> None:
    page = (DOCS / "reference/commands.md").read_text()
    section = page.partition(f"## `msbot {name}`")[2].partition("\n## ")[0]
    assert section, f"docs/reference/commands.md has no section for `msbot {name}`"
    command = msbot.get_command(click.Context(msbot), name)
    assert command is not None
    of_many = page.partition("## Options of many commands")[2].partition("\n## ")[0]
    known = [*re.findall(r"^\| `(--\w+)", of_many, re.MULTILINE)]
    missing = [option for option in options_of(command) if option not in section and option not in known]
    assert not missing


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)(?:#[^)]*)?\)", page.read_text())
    missing = [target for target in targets if not (page.parent / target).exists()]
    assert not missing


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text()
    assert [str(page.relative_to(DOCS)) for page in PAGES if str(page.relative_to(DOCS)) not in navigation] == []
    listed = re.findall(r": (\S+\.md)$", navigation, re.MULTILINE)
    assert [name for name in listed if not (DOCS / name).exists()] == []


def test_the_readme_shows_the_examples_as_they_are() -> None:
    readme = (ROOT / "README.md").read_text()
    shown = re.findall(r"`(examples/\w+\.py)`:\n\n```python\n(.*?)```", readme, re.DOTALL)
    assert len(shown) == 3
    for name, code in shown:
        assert code.strip() == (ROOT / name).read_text().strip()


NO_FACTS = {
    "demo", "init", "master", "part", "host", "export", "completion",  # they run, or write a file
    "library add", "db migrate", "db backup", "db restore", "service install", "service remove",  # they do one thing
    "user add", "user passwd", "user role", "user remove", "key new", "key remove",
    "idl to-python", "idl to-idl", "idl to-c",  # they write source texts
    "bus decode", "bus dump", "bus send", "bus serve", "bus selftest",  # they show a bus as it goes by
    *(f"agent {sub}" for sub in ("udp4", "udp6", "tcp4", "tcp6", "serial", "multiserial", "pseudoterminal", "can",
                                 "canfd", "can-legacy")),
}  # fmt: skip


def leaves(command: click.Command, name: str) -> dict[str, click.Command]:
    if isinstance(command, click.Group):
        subs = command.commands.items()
        return {leaf: one for sub, below in subs for leaf, one in leaves(below, f"{name} {sub}").items()}
    return {name: command}


def test_every_command_that_tells_facts_tells_them_as_json() -> None:
    context = click.Context(msbot)
    found: dict[str, click.Command] = {}
    for name in COMMANDS:
        command = msbot.get_command(context, name)
        assert command is not None
        found |= leaves(command, name)
    assert set(found) >= NO_FACTS
    assert [name for name, one in found.items() if name not in NO_FACTS and "--json" not in options_of(one)] == []
