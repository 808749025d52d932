"""A message as values that stand in a setting, a table or a command: one number, truth value or text for each leaf.

A leaf is a field, or a field inside a nested message with the way to it: `pose.x`. A value of an enum is its name in
small letters. A list is one leaf, too: a JSON text, `[1, 2.5]`; messages in it are JSON objects, or lists of their
fields in order, `[[255, 0, 0], [0, 0, 255]]`. Each has all its fields.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import Any

from msbot.part.messages.message import Message, fields_of
from msbot.part.messages.wire_types import FieldCodec
from msbot_xrce.errors import LocalProtocolError

Leaf = bool | int | float | str


def leaves_of(message: Message) -> dict[str, Leaf]:
    """The leaves of a message by the way to each, in the order of the wire."""
    return dict(_leaves("", message))


def _leaves(way: str, message: Message) -> Iterator[tuple[str, Leaf]]:
    for field in fields_of(type(message)):
        value = getattr(message, field.name)
        if isinstance(value, Message):
            yield from _leaves(f"{way}{field.name}.", value)
        elif isinstance(value, list | bytes):
            yield f"{way}{field.name}", json.dumps(plain(value))
        elif isinstance(value, IntEnum):
            yield f"{way}{field.name}", value.name.lower()
        elif isinstance(value, bool | int | float | str):
            yield f"{way}{field.name}", value


def plain(value: object) -> object:
    """A value of a field as JSON has it; messages in it as lists of their fields."""
    if isinstance(value, Message):
        return [plain(getattr(value, field.name)) for field in fields_of(type(value))]
    if isinstance(value, list | bytes):
        return [plain(one) for one in value]
    return value.name.lower() if isinstance(value, IntEnum) else value


def set_leaf(message: Message, way: str, value: object) -> None:
    """Set the leaf at the end of a way.

    Raises:
        LocalProtocolError: there is no such leaf, or it cannot have this value.
    """
    codec = leaf_codecs(type(message)).get(way)
    if codec is None:
        known = ", ".join(leaf_codecs(type(message)))
        raise LocalProtocolError(f"{type(message).__name__} has no field {way!r}; it has {known}")
    if isinstance(value, str) and codec.element is not None:
        value = _from_json(type(message).__name__, way, value)
    *outer, last = way.split(".")
    place = message
    for name in outer:
        place = getattr(place, name)
    setattr(place, last, from_plain(codec, value))


def leaf_codecs(message_class: type[Message]) -> dict[str, FieldCodec]:
    """What each leaf holds, by the way to it."""
    found: dict[str, FieldCodec] = {}
    for field in fields_of(message_class):
        inside = field.codec.inside
        if inside is not None and issubclass(inside, Message) and field.codec.element is None:
            found |= {f"{field.name}.{way}": codec for way, codec in leaf_codecs(inside).items()}
        else:
            found[field.name] = field.codec
    return found


def with_leaves(message_class: type[Message], values: Mapping[str, object]) -> Message:
    """A message with these leaves; the others have their defaults.

    Raises:
        LocalProtocolError: see `set_leaf`.
    """
    message = message_class()
    for way, value in values.items():
        set_leaf(message, way, value)
    return message


def from_plain(codec: FieldCodec, value: object) -> object:
    """What a field holds for a value from JSON; whatever does not fit stays as it is, and the field refuses it."""
    if codec.element is not None:
        if not isinstance(value, list):
            return value
        if isinstance(codec.zero(), bytes):
            return _octets(codec.element, value)
        return [from_plain(codec.element, one) for one in value]
    inside = codec.inside
    if inside is None or not isinstance(value, list | dict | str | int):
        return value
    if issubclass(inside, IntEnum):
        return _member(inside, value)
    return _message(inside, value) if issubclass(inside, Message) else value


def _octets(element: FieldCodec, value: list[Any]) -> object:
    return bytes(value) if all(element.fits(one) for one in value) else value


def _member(inside: type[IntEnum], value: object) -> object:
    for member in inside:
        if value == member.name.lower() or (value == int(member) and not isinstance(value, bool)):
            return member
    return value


def _message(inside: type[Message], value: object) -> object:
    fields = fields_of(inside)
    if isinstance(value, list) and len(value) == len(fields):
        value = dict(zip((field.name for field in fields), value, strict=True))
    if not isinstance(value, dict):
        return value
    shown = ", ".join(field.name for field in fields)
    names = [field.name for field in fields]
    if missing := [name for name in names if name not in value]:
        raise LocalProtocolError(f"{value} has no {', '.join(missing)}; a {inside.type_name} has {shown}")
    if unknown := [str(name) for name in value if name not in names]:
        raise LocalProtocolError(f"{value} has an unknown field {unknown[0]}; a {inside.type_name} has {shown}")
    return inside(**{field.name: from_plain(field.codec, value[field.name]) for field in fields})


def _from_json(where: str, way: str, text: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise LocalProtocolError(f"{where}.{way} cannot be {text[:60]!r}: write a list such as [1, 2, 3]") from None
