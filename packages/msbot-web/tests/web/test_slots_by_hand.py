"""Names that the wires page proposes for new slots and topics."""

from __future__ import annotations

import pytest
from nicegui import Client
from nicegui.events import GenericEventArguments
from nicegui.page import page as nicegui_page

from msbot.config import load_library
from msbot_web.pages.slot_dialogs import TypeChoice, free_name, slot_name


@pytest.mark.parametrize(
    ("type_name", "name"),
    [
        ("Servo, 180 degrees", "servo"),
        ("Motion sensor (PIR)", "motion_sensor"),
        ("Push button", "push_button"),
        ("Größe", "größe"),
        ("(?)", "slot"),
        ("", "slot"),
    ],
)
def test_a_slot_is_called_after_its_part_type(type_name: str, name: str) -> None:
    assert slot_name(type_name) == name


def test_every_part_type_of_the_library_makes_a_name_that_can_stand_before_a_dot() -> None:
    for part_type in load_library():
        assert slot_name(part_type.name).replace("_", "").isalnum()


@pytest.mark.parametrize(
    ("taken", "name"), [(set(), "fan"), ({"fan"}, "fan_2"), ({"fan", "fan_2", "fan_4"}, "fan_3"), ({"fan_2"}, "fan")]
)
def test_a_name_that_is_taken_gets_a_number(taken: set[str], name: str) -> None:
    assert free_name("fan", taken) == name


async def test_a_click_is_for_the_type_that_was_seen_also_when_the_search_has_shortened_the_list() -> None:
    with Client(nicegui_page("/")) as client:
        choice = TypeChoice({"BUTTON": "Push button", "FAN": "Fan", "SERVO": "Servo"})

        def click(number: str) -> object:
            told = GenericEventArguments(sender=choice, client=client, args=number)
            choice.set_value(choice._event_args_to_value(told))
            return choice.value

        assert [one["value"] for one in choice.props["options"]] == ["BUTTON", "FAN", "SERVO"]
        choice.set_options({"FAN": "Fan", "SERVO": "Servo"})
        assert click("FAN") == "FAN"
        assert choice.props["model-value"] == "FAN"
        assert click("BUTTON") == "FAN", "it is no longer there"
        choice.set_options({"SERVO": "Servo"})
        assert choice.value is None
        assert click("SERVO") == "SERVO"
