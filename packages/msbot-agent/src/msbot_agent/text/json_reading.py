"""Reads JSON that somebody else has written."""

from __future__ import annotations

import json
from typing import Any

from msbot_agent.text.printable import whole

MOST_DIGITS = 9
"""Of a count that somebody tells: nothing here is counted further."""


def read_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """What a JSON text says.

    Raises:
        ValueError: it is none, or deeper than the parser can follow, for which `json.loads` raises RecursionError.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_told(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """The same, of another program: what it says is shown and passed on, so texts can all be written (`whole`).

    Raises:
        ValueError: as above.
    """
    try:
        return _whole(read_json(text))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def told_count(value: object) -> int:
    """How many of something another program says that there are, as a number or in digits; 0: it makes no sense."""
    digits = str(value) if isinstance(value, str) or (isinstance(value, int) and 0 <= value < 10**MOST_DIGITS) else ""
    return int(digits) if digits.isdecimal() and len(digits) <= MOST_DIGITS else 0


def _whole(value: Any) -> Any:  # noqa: ANN401 - as above
    if isinstance(value, str):
        return whole(value)
    if isinstance(value, list):
        return [_whole(one) for one in value]
    if isinstance(value, dict):
        return {whole(name): _whole(one) for name, one in value.items()}
    return value
