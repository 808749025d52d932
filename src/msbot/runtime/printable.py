"""Words of others, fit for a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with `?` for each character that would control a terminal, line breaks included."""
    return text if text.isprintable() else "".join(one if one.isprintable() else "?" for one in text)
