"""Message classes for the types that a library declares: the standard ones, or generated."""

from __future__ import annotations

import types

from msbot.config import FieldKind, MessageType
from msbot.part import Message
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.wire_types import float32, float64, int8, int16, int32, int64, uint8, uint16, uint32, uint64

ANNOTATIONS: dict[FieldKind, object] = {
    FieldKind.BOOL: bool,
    FieldKind.UINT8: uint8,
    FieldKind.UINT16: uint16,
    FieldKind.UINT32: uint32,
    FieldKind.UINT64: uint64,
    FieldKind.INT8: int8,
    FieldKind.INT16: int16,
    FieldKind.INT32: int32,
    FieldKind.INT64: int64,
    FieldKind.FLOAT32: float32,
    FieldKind.FLOAT64: float64,
    FieldKind.TEXT: str,
}
"""The Python type of each kind of field."""

_made: dict[tuple[str, tuple[tuple[str, FieldKind], ...]], type[Message]] = {}


def message_class(message: MessageType) -> type[Message]:
    """The class of a message type; the same class for the same name and fields."""
    standard = STANDARD_MESSAGES.get(message.name)
    if standard is not None:
        return standard
    key = (message.name, tuple(message.fields.items()))
    if key not in _made:
        _made[key] = _make(message)
    return _made[key]


def _make(message: MessageType) -> type[Message]:
    body = {
        "__annotations__": {name: ANNOTATIONS[kind] for name, kind in message.fields.items()},
        "__doc__": message.description or f"Messages of type {message.name}.",
        "type_name": message.name,
    }
    made = types.new_class(message.name, (Message,), exec_body=lambda namespace: namespace.update(body))
    assert issubclass(made, Message)
    return made
