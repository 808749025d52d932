"""Keys and values as TOML writes them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from msbot_agent.toml.table import Scalar

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_key(name: str) -> str:
    """A key, in quotes if it needs them."""
    return name if _BARE.fullmatch(name) else toml_value(name)


def toml_value(value: Scalar) -> str:
    """A number, truth value or text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # TOML understands what JSON escapes, but also needs DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    return repr(value)


def toml_table(values: Mapping[str, Scalar]) -> str:
    """A table on one line."""
    return f"{{ {', '.join(f'{toml_key(key)} = {toml_value(value)}' for key, value in values.items())} }}"
