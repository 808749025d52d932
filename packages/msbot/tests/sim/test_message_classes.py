"""Message classes made of the types of a library."""

import pytest

from msbot.config import FieldKind, MessageType, standard_message_types
from msbot.part import Message
from msbot.part.messages.standard import Light
from msbot.sim import message_class

EVERY_KIND = MessageType("EveryKind", {f"f_{kind.value}": kind for kind in FieldKind}, description="All there is.")


def test_a_standard_type_has_its_well_known_class() -> None:
    assert message_class(standard_message_types()["Light"]) is Light


def test_a_type_of_ones_own_becomes_a_class_once() -> None:
    made = message_class(EVERY_KIND)
    assert issubclass(made, Message)
    assert (made.type_name, made.__name__, made.__doc__) == ("EveryKind", "EveryKind", "All there is.")
    assert message_class(EVERY_KIND) is made
    assert message_class(MessageType("EveryKind", {"x": FieldKind.BOOL})) is not made


@pytest.mark.parametrize("kind", FieldKind)
def test_each_kind_of_field_travels(kind: FieldKind) -> None:
    made = message_class(MessageType(f"Only_{kind.value}", {"x": kind}))
    value = {FieldKind.BOOL: True, FieldKind.TEXT: "word"}.get(kind, kind.limits[1] if kind.is_whole else 0.5)
    message = made(x=value)
    assert made.decode(message.encode()) == message
