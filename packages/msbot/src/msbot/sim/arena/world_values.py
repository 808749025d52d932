"""Values that only world files have: colours, angles, points; a mistake becomes a problem."""

from __future__ import annotations

from msbot.sim.arena.world import COLOURS, Colour, Point
from msbot_agent.toml.problems import kind_words, suggestion
from msbot_agent.toml.table import Table


def colour(table: Table, key: str, default: Colour) -> Colour:
    """A colour by name, or red, green and blue."""
    value = table.item(key)
    if value is None:
        return default
    if isinstance(value, list):
        red, green, blue = numbers(table, value, 3, "[255, 128, 0]", key)
        if not all(0 <= part <= 255 for part in (red, green, blue)):
            table.problem("red, green and blue are 0 to 255", key)
        return round(red), round(green), round(blue)
    if isinstance(value, str) and value in COLOURS:
        return COLOURS[value]
    right = suggestion(str(value), list(COLOURS), none_known="")
    table.problem(f"must be a colour, by name or as [red, green, blue]; it is {kind_words(value)}; {right}", key)
    return default


def degrees(table: Table, key: str, default: float) -> float:
    """An angle."""
    return table.number(key, default=default, least=-360.0, most=360.0, unit="degrees")


def pair(table: Table, value: object, example: str, *steps: str | int) -> Point:
    """Two numbers."""
    x, y = numbers(table, value, 2, example, *steps)
    return x, y


def numbers(table: Table, value: object, count: int, example: str, *steps: str | int) -> list[float]:
    """A list of so many numbers."""
    if isinstance(value, list) and len(value) == count and all(_is_number(item) for item in value):
        return [float(item) for item in value]
    what = f"a list of {len(value)}" if isinstance(value, list) else kind_words(value)
    table.problem(f"must be {count} numbers, for example {example}; it is {what}", *steps)
    return [0.0] * count


def _is_number(item: object) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool) and abs(item) <= 1e6
