"""Reads JSON that somebody else has written."""

from __future__ import annotations

import json
from typing import Any


def read_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever is in it
    """What a JSON text says.

    Raises:
        ValueError: it is none, or deeper than the parser can follow, for which `json.loads` raises RecursionError.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
