"""A stranger's text as the cell of a table that somebody opens in a spreadsheet."""

from __future__ import annotations


def as_cell(text: str) -> str:
    """The text; with `'` before it where a spreadsheet would take it for a formula and do what it says."""
    if text[:1] not in tuple("=+-@\t\r\n"):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
