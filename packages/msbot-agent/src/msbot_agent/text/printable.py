"""Words of others, fit for a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with `?` for each character that would control a terminal, line breaks included."""
    return text if text.isprintable() else "".join(one if one.isprintable() else "?" for one in text)


def whole(text: str) -> str:
    """The text with `?` for each half of a character, which UTF-8 cannot write, and so no file and no database.

    They come from command lines that are no UTF-8, and from JSON such as `"\\ud800"`.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        return text.encode("utf-8", "replace").decode()
    return text
