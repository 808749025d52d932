"""What two programs say to each other about a world: one JSON object on a line, checked before it is believed.

To the world: `{"arena": 1, "password": "...", "robot": "second"}` first (no name: a robot that is free), then
`{"seat": "eyes", "can": ["distance"]}`, `{"unseat": "eyes"}` and, up to 50 times a second,
`{"do": {"wheels": {"motor.left": 50}}}`.
From the world: `{"robot": "second", "world": "Warehouse", "named": ["bumper"]}` or `{"error": "..."}` first, then
`{"see": {"eyes": {"distance": 0.4}}}`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

from msbot.config import DRIVES, SENSES
from msbot_agent.text.untrusted_input import read_remote_json

VERSION = 1
LONGEST_LINE = 32 * 1024
MOST_SLOTS = 64
LONGEST_NAME = 254

Values = dict[str, dict[str, float | bool]]
"""Slot -> quantity -> value."""


def to_line(message: Mapping[str, object]) -> bytes:
    """A message as it travels."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def from_line(line: bytes) -> dict[str, object] | None:
    """The message of a line; None: it is not one."""
    try:
        found = read_remote_json(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def is_name(value: object) -> bool:
    """Whether a value can be the name of a slot or a robot."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME and value.isprintable()


def known_quantities(value: object) -> tuple[str, ...]:
    """Those words of a list that mean something."""
    if not isinstance(value, list):
        return ()
    return tuple(dict.fromkeys(word for word in value if isinstance(word, str) and (word in SENSES or word in DRIVES)))


def values_of(value: object) -> Values:
    """What parts do or see, as far as it makes sense."""
    if not isinstance(value, dict) or len(value) > MOST_SLOTS:
        return {}
    return {
        slot: {
            name: number
            for name, number in said.items()
            if (name in SENSES or name in DRIVES)
            and isinstance(number, bool | int | float)
            and abs(number) <= 1e9  # neither NaN nor infinite, nor a whole number that is too large for a float
        }
        for slot, said in value.items()
        if is_name(slot) and isinstance(said, dict)
    }
