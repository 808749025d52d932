"""What others have published as JSON, read so that all of it can be shown, counted with and published again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

_MOST_DIGITS = 300
"""Of a whole number that a float has room for; a longer one is read as infinite."""


def json_object(payload: str) -> Mapping[str, Any]:
    """A payload that is an object of JSON; otherwise an empty one, also where texts in it are none in UTF-8."""
    try:
        told = read_json(payload)
    except (ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def read_json(payload: str) -> Any:  # noqa: ANN401 - whatever it is
    """A payload as JSON.

    Raises:
        ValueError: it is none, or texts in it have halves of characters.
        RecursionError: it is too deep.
    """
    told = json.loads(payload, parse_int=_whole)
    if "\\ud" in payload or "\\uD" in payload:
        json.dumps(told, ensure_ascii=False).encode()
    return told


def _whole(digits: str) -> int | float:
    return int(digits) if len(digits) <= _MOST_DIGITS else float(digits)
