"""How a program that has blocks is shown: as these, or as text. It is kept with the blocks. Pure."""

from __future__ import annotations

import json
from typing import Literal, TypeAlias

from msbot_agent.text.json_reading import read_json

View: TypeAlias = Literal["blocks", "python"]
BLOCKS: View = "blocks"
PYTHON: View = "python"


def view_of(doc: str) -> View:
    """How a program was shown when it was kept."""
    return BLOCKS if _read(doc).get("view") == BLOCKS else PYTHON


def with_view(doc: str, view: View) -> str:
    """The same blocks, of a program that is shown so; what is no blocks stays as it is."""
    found = _read(doc)
    return json.dumps(found | {"view": view}, ensure_ascii=False, separators=(",", ":")) if found else doc


def _read(doc: str) -> dict[str, object]:
    try:
        found = read_json(doc) if doc else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
