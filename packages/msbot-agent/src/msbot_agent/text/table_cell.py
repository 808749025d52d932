"""A stranger's text as the cell of a table that somebody opens in a spreadsheet."""

from __future__ import annotations

import re

_OWN_NAME = re.compile(r"@[A-Za-z][\w.]*")
"""A figure of the robot, as `@late`: without parentheses no spreadsheet calls anything."""


def as_cell(text: str) -> str:
    """The text; with `'` before it where a spreadsheet would take it for a formula and do what it says."""
    if text[:1] not in tuple("=+-@\t\r\n") or _OWN_NAME.fullmatch(text):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
