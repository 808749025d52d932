"""`docs/reference/registry.md` names every table and column, and nothing else."""

import re

from msbot.registry.database.database_writer import CAPACITY
from msbot.registry.database.tables import metadata
from msbot.registry.running.robot_store import JOURNAL_ROWS, STRANGERS
from tests import ROOT

PAGE = (ROOT / "docs/reference/registry.md").read_text()

NUMBERS = ("id", "robot_id")
"""Columns that the page explains once for all tables, but for the changes of all robots."""


def _tables() -> dict[str, set[str]]:
    """The columns that each table of the page lists."""
    parts = re.split(r"(?m)^### `(\w+)`$", PAGE)
    heads = (re.findall(r"(?m)^\* (.*?)(?:: .*)?$", text) for text in parts[2::2])
    listed = (re.findall(r"`(\w+)`", " ".join(head)) for head in heads)
    return {name: set(columns) for name, columns in zip(parts[1::2], listed, strict=True)}


def test_the_page_shows_the_tables_as_they_are() -> None:
    expected = {
        table.name: {
            column.name
            for column in table.columns
            if column.name not in NUMBERS or (table.name, column.name) == ("edits", "robot_id")
        }
        for table in metadata.sorted_tables
    }
    assert _tables() == expected


def test_the_numbers_on_the_page_are_right() -> None:
    assert f"newest {JOURNAL_ROWS:,} lines" in PAGE
    assert f"newest {STRANGERS} are kept" in PAGE
    assert f"up to {CAPACITY:,} changes" in PAGE


def test_column_names_say_their_unit() -> None:
    times = [column for table in metadata.sorted_tables for column in table.columns if column.name.endswith("_at")]
    assert times == []
