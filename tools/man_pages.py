"""Writes a man page for `msbot` and for each of its commands, from the commands themselves.

    python tools/man_pages.py            into build/man of each distribution, from where its wheel takes them
    python tools/man_pages.py FOLDER     all into one folder

A page has what `--help` says: `msbot topic --help` and those of all commands below are `msbot-topic(1)`.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).parents[1]))

from msbot_agent.cli import COMMANDS, TASKS, msbot, package_of
from msbot_agent.cli.exit_status import MEANINGS
from msbot_agent.cli.help_page import SUMMARY
from msbot_agent.startup.extensions import own_version
from tools.sources import ROOT

PACKAGES = ROOT / "packages"
_FIRST_OF_LINE = re.compile(r"^[.']", re.MULTILINE)


def main(*arguments: str) -> None:
    """Write them all."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folder", nargs="?", type=Path, help="where to, all of them")
    wanted = options.parse_args(arguments).folder
    for name, page in pages():
        package = "msbot-agent" if name == "msbot" else package_of(name.removeprefix("msbot-"))
        folder = wanted or PACKAGES / package / "build" / "man"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.1").write_text(page, "utf-8")


def pages() -> Iterator[tuple[str, str]]:
    """Name and text of each page."""
    yield "msbot", "\n".join(_whole()) + "\n"
    for name in COMMANDS:
        context = click.Context(msbot, info_name="msbot", **msbot.context_settings)
        command = msbot.get_command(context, name)
        assert command is not None, name
        yield f"msbot-{name}", "\n".join(_page(name, command, context)) + "\n"


def _whole() -> Iterator[str]:
    yield from _head("msbot", SUMMARY)
    yield from (".SH SYNOPSIS", r"\fBmsbot\fR \fICOMMAND\fR [\fIOPTIONS\fR] [\fIARGUMENTS\fR]", ".SH DESCRIPTION")
    yield "Each command has a page of its own, msbot\\-COMMAND(1). `msbot help` lists the handbook."
    for task, commands in TASKS.items():
        yield f".SH {_text(task).upper()}"
        for name, words in commands.items():
            yield from (".TP", rf"\fB{_text(name)}\fR", _text(words))
    yield from _ending()


def _page(name: str, command: click.Command, context: click.Context) -> Iterator[str]:
    yield from _head(f"msbot-{name}", COMMANDS[name])
    here = click.Context(command, info_name=name, parent=context)
    yield ".SH SYNOPSIS"
    every = list(_all(command, here))
    for one, at in every:
        yield from (".PP", _call(one, at))
    if len(every) == 1:
        yield ".SH DESCRIPTION"
        yield from _described(command, here)
    else:
        yield ".SH COMMANDS"
        for one, at in every:
            yield f'.SS "{_quoted(at.command_path)}"'
            yield from _described(one, at)
    yield from _ending()


def _all(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    if not isinstance(command, click.Group) or command.invoke_without_command:
        yield command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from _all(below, click.Context(below, info_name=name, parent=context))


def _call(command: click.Command, context: click.Context) -> str:
    words = " ".join(command.collect_usage_pieces(context))
    return rf"\fB{_text(context.command_path)}\fR {_text(words)}"


def _described(command: click.Command, context: click.Context) -> Iterator[str]:
    for paragraph in (command.help or "").split("\n\n"):
        kept = "\b" in paragraph  # lines that click keeps as they are
        text = paragraph.replace("\b", "").strip("\n")
        if not text.strip():
            continue
        yield ".PP"
        yield from (".nf", _text(text), ".fi") if kept else (_text(" ".join(text.split())),)
    for one in command.get_params(context):
        shown = one.get_help_record(context)
        if shown is not None and shown[1]:
            yield from (".TP", rf"\fB{_text(shown[0])}\fR", _text(" ".join(shown[1].split())))


def _head(name: str, words: str) -> Iterator[str]:
    yield f'.TH "{_quoted(name.upper())}" 1 "" "MsBOT {_quoted(own_version().partition(" ")[0])}" "MsBOT"'
    yield from (".SH NAME", rf"{_text(name)} \- {_text(words)}")


def _ending() -> Iterator[str]:
    yield ".SH EXIT STATUS"
    for status, words in MEANINGS.items():
        yield from (".TP", rf"\fB{int(status)}\fR", _text(words.replace("`", "")))
    yield from (".SH SEE ALSO", "msbot(1), `msbot help`")


def _text(words: str) -> str:
    """As roff takes it: no line is a request, no backslash an escape."""
    text = words.replace("\\", r"\e").replace("-", r"\-")
    return _FIRST_OF_LINE.sub(lambda found: rf"\&{found[0]}", text)


def _quoted(words: str) -> str:
    return _text(words).replace('"', r"\(dq")


if __name__ == "__main__":
    main(*sys.argv[1:])
