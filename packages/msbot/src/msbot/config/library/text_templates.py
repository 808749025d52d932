"""Texts with sources in braces: `turn-on {output:d}`; the form after a colon is that of Python's `format`."""

from __future__ import annotations

import re
from collections.abc import Mapping

from msbot_agent.toml.table import Scalar

PLACEHOLDER = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")
"""A source in a text: its name, and a form if there is one."""

_WHOLE = "bcdoxX"
"""Forms that need a whole number."""


def format_text(text: str, values: Mapping[str, Scalar]) -> str:
    """The text with its sources filled in; a value that does not suit its form is written as it is."""

    def fill(found: re.Match[str]) -> str:
        value, form = values[found[1]], found[2]
        if form and can_format(value, form):
            return format(_plain(value, form), form)
        if isinstance(value, float):
            return f"{value:g}"
        return str(value).lower() if isinstance(value, bool) else str(value)

    return PLACEHOLDER.sub(fill, text)


def can_format(value: Scalar, form: str) -> bool:
    """Whether a value of this kind can be written in that form."""
    try:
        format(_plain(value, form), form)
    except ValueError:
        return False
    return True


def _plain(value: Scalar, form: str) -> Scalar:
    """The value in the type that the form needs."""
    return round(value) if form[-1] in _WHOLE and not isinstance(value, str) else value
