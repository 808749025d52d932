"""`msbot help`: the handbook in the terminal, and the help of commands."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator

import click

from msbot_agent.cli.table import for_terminal, print_table
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_web.handbook import chapters, folder
from msbot_xrce.errors import ConfigError

MOST_FOUND = 12
"""Pages that are named for a word that no page is called."""

_PICTURE = re.compile(r"!\[[^\]]*\]\([^)]*\)")
_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\]+)+)\]\([^)\s]*\)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


@click.command("help")
@click.argument("topic", nargs=-1, metavar="[TOPIC]...")
def command(topic: tuple[str, ...]) -> None:
    """Show a page of the handbook, or what `--help` says of a command; without TOPIC, list the pages."""
    if not topic:
        print_table(("page", "what it is about"), sorted(_titles().items()))
        return
    if shown := _command_help(topic):
        click.echo(shown)
        pages = _mentioning(f"msbot {' '.join(topic)}")
        if pages:
            click.echo(for_terminal(f"\nIn the handbook: {', '.join(f'`msbot help {page}`' for page in pages)}"))
        return
    wanted = "_".join(topic).removesuffix(".md").replace("-", "_").casefold()
    page = {word.replace("-", "_"): name for word, name in _files().items()}.get(wanted)
    if page is None:
        _show_near(" ".join(topic), wanted)
        return
    text = "\n".join(_lines((folder() / f"{page}.md").read_text("utf-8")))
    if sys.stdout.isatty():
        click.echo_via_pager(text + "\n")
    else:
        click.echo(text)


def _files() -> dict[str, str]:
    """The last word of a page's name -> its whole name, `howto/swap_a_part`; where two have it, the first in order."""
    found: dict[str, str] = {}
    for chapter in chapters():
        for name, _ in chapter.pages:
            found.setdefault(name.rpartition("/")[2].casefold(), name)
            found.setdefault(name.casefold(), name)
    return found


def _titles() -> dict[str, str]:
    whole = dict(page for chapter in chapters() for page in chapter.pages)
    return {word: whole[name] for word, name in _files().items() if "/" not in word}


def _mentioning(words: str) -> list[str]:
    """The pages that have these words, those with most of them first."""
    names = {name: word for word, name in _files().items() if "/" not in word}
    counts = {
        word: len(re.findall(rf"{re.escape(words)}\b", (folder() / f"{name}.md").read_text("utf-8"), re.IGNORECASE))
        for name, word in names.items()
    }
    found = [word for word, count in counts.items() if count]
    return sorted(found, key=lambda word: -counts[word])[:MOST_FOUND]


def _show_near(words: str, wanted: str) -> None:
    """Name the pages that may be meant.

    Raises:
        ConfigError: none is.
    """
    titles = _titles()
    if near := nearest(wanted, titles):
        raise ConfigError(f"the handbook has no page {words!r}; {did_you_mean(near)}")
    found = _mentioning(words)
    if not found:
        raise ConfigError(f"the handbook does not speak of {words!r}; `msbot help` lists its pages")
    click.echo(f"These pages speak of {words}:")
    print_table(("page", "what it is about"), [(word, titles[word]) for word in found])


def _command_help(words: tuple[str, ...]) -> str:
    """What `--help` of a command says; empty: there is no such command."""
    from msbot_agent.cli import msbot

    context = click.Context(msbot, info_name="msbot", **msbot.context_settings)
    found: click.Command = msbot
    for word in words:
        below = found.get_command(context, word) if isinstance(found, click.Group) else None
        if below is None:
            return ""
        found, context = below, click.Context(below, info_name=word, parent=context)
    return found.get_help(context)


def _lines(text: str) -> Iterator[str]:
    """A page as people read it in a terminal: links as their words, no pictures; code as it is."""
    is_code = False
    for line in _COMMENT.sub("", text).splitlines():
        if line.startswith("```"):
            is_code = not is_code
        elif is_code:
            yield f"    {line}".rstrip()
        else:
            plain = _LINK.sub(r"\1", _PICTURE.sub("", line)).replace("**", "")
            yield for_terminal(plain)
