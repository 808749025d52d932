"""A message as values that stand in a setting or a description, as on a PC: a list is a JSON text."""

import json

from .errors import ConfigError
from .message import Kind, Message, fields_of


def leaves_of(message, way=""):
    """`(way, kind, value)` of each leaf, in the order of the wire."""
    found = []
    for name, kind in fields_of(type(message)):
        value = getattr(message, name)
        if isinstance(value, Message):
            found += leaves_of(value, way + name + ".")
        elif isinstance(value, (list, bytes)):
            found.append((way + name, kind, json.dumps(_plain(kind, value))))
        else:
            found.append((way + name, kind, _plain(kind, value)))
    return found


def set_leaf(message, way, text):
    """Set the leaf at the end of a way from its text."""
    place = message
    *outer, last = way.split(".")
    for name in outer:
        place = getattr(place, name, None)
    kinds = dict(fields_of(type(place))) if isinstance(place, Message) else {}
    if last not in kinds:
        raise ConfigError("{} has no field {!r}".format(type(message).__name__, way))
    setattr(place, last, _from_text(kinds[last], text))


def _from_text(kind, text):
    if kind is bool:
        return {"true": True, "false": False}[text]
    if (
        kind is str
        or hasattr(kind, "names")
        or not (isinstance(kind, str) or kind is bytes or hasattr(kind, "element"))
    ):
        return _made(kind, text)
    if isinstance(kind, str):
        return float(text) if kind in "fd" else int(text)
    return _made(kind, json.loads(text))


def _made(kind, value):
    """What a field holds for a value from JSON."""
    if hasattr(kind, "names"):
        return kind.numbers[kind.names.index(value)] if value in kind.names else value
    if kind is bytes or getattr(kind, "octets", False):
        return bytes(value)
    if hasattr(kind, "element"):
        return [_made(kind.element, one) for one in value]
    if isinstance(kind, type) and issubclass(kind, Message):
        if isinstance(value, list):
            value = {name: one for (name, _), one in zip(fields_of(kind), value)}
        return kind(**{name: _made(inner, value[name]) for name, inner in fields_of(kind)})
    return float(value) if kind in ("f", "d") else value


def _plain(kind, value):
    if isinstance(value, Message):
        return [_plain(inner, getattr(value, name)) for name, inner in fields_of(type(value))]
    if isinstance(value, (list, bytes)):
        return [_plain(getattr(kind, "element", "B"), one) for one in value]
    if isinstance(kind, Kind) and hasattr(kind, "names"):
        return kind.names[kind.numbers.index(value)]
    return float(value) if kind in ("f", "d") else value
