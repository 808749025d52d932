"""The page of `msbot --help`, made without click."""

import click
import pytest

from msbot_agent.cli import help_page, task_lines
from msbot_agent.cli.group import msbot


@pytest.mark.parametrize("columns", [20, 52, 60, 80, 200])
def test_it_is_what_click_would_print(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # Click keeps the option as it was asked for first in this process, by another test with other names, say.
    monkeypatch.setattr(msbot, "_help_option", None, raising=False)
    context = click.Context(msbot, info_name="msbot", terminal_width=None, max_content_width=None)
    context.terminal_width = max(min(columns, 80) - 2, 50)
    context.help_option_names = ["-h", "--help"]
    assert help_page.page(task_lines(), columns) == msbot.get_help(context)
