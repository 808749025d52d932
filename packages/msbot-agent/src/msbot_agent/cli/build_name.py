"""`msbot --version`: the version, and which build of it runs."""

from __future__ import annotations

import re
from pathlib import Path

import click

_COMMIT = re.compile(r"[0-9a-f]{40}")
_SHOWN = 12
"""Digits of a commit: enough for a repository of any size."""


def commit_of_build(text: str | None = None) -> str | None:
    """The commit that this MsBOT was built from; None: it runs from a working tree, where files may be changed.

    Args:
        text: what the file says, in place of the one that was installed; git writes the commit when it exports a tree
            (`export-subst`).
    """
    told = (Path(__file__).parents[1] / "build.txt").read_text("utf-8") if text is None else text
    found = _COMMIT.fullmatch(told.strip())
    return found[0][:_SHOWN] if found else None


def version_words() -> str:
    """What `msbot --version` prints."""
    from importlib.metadata import version  # slow to load, and seldom needed

    commit = commit_of_build()
    return f"msbot {version('msbot-agent')} ({f'build {commit}' if commit else 'from a working tree'})"


def print_version(ctx: click.Context, _option: click.Parameter, is_asked: bool) -> None:
    """The option's callback: print and end."""
    if is_asked and not ctx.resilient_parsing:
        click.echo(version_words())
        ctx.exit()
