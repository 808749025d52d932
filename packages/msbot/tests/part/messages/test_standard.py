"""The standard messages: the classes a program uses are the types the library knows."""

import pytest

import msbot
from msbot.config import standard_message_types
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.type_hash import described_types


def test_the_library_knows_each_class_and_there_is_a_class_for_each_type() -> None:
    assert sorted(STANDARD_MESSAGES) == sorted(standard_message_types())


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_a_program_can_import_it_from_msbot(name: str) -> None:
    assert getattr(msbot, name) is STANDARD_MESSAGES[name]
    assert name in msbot.__all__


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_class_and_type_have_the_same_fields_in_the_same_order(name: str) -> None:
    message_class = STANDARD_MESSAGES[name]
    assert {one: list(fields) for one, fields in standard_message_types()[name].described().items()} == described_types(
        message_class
    )
    assert message_class.decode(message_class().encode()) == message_class()


@pytest.mark.parametrize("name", STANDARD_MESSAGES)
def test_the_size_the_library_tells_is_that_on_the_wire(name: str) -> None:
    size = standard_message_types()[name].size_bytes
    assert size in (None, len(STANDARD_MESSAGES[name]().encode()))
