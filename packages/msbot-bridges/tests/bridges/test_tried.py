"""The table of what was tried: each cell names the file of a test that there is."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PAGE = HERE.parents[3] / "docs" / "howto" / "bridges.md"
WHOLE = "test_a_device_is_adopted_recorded_stopped_and_its_loss_explained"
SWAP = "test_a_servo_of_another_world_takes_the_slot_of_a_drive_that_is_pulled"
DRIVE = "test_a_drive_is_found_turns_stops_and_is_missed"
MODULE = "test_a_servo_is_found_driven_stopped_and_missed"
LAMP, PUMP = "test_a_device_of_home_assistant_is_a_part", "test_a_pump_by_tcp"
SPARE = "test_a_pump_on_mqtt_takes_the_slot_of_one_with_modbus"
SPARE_BACK = "test_a_dimmer_with_modbus_takes_the_slot_of_a_lamp_on_mqtt"
EITHER = "test_a_lamp_of_jacdac_and_a_dimmer_with_modbus_stand_by_for_each_other"
LIKE_PUMP = "test_a_like_pump_with_modbus_gets_the_slot_with_its_settings"
LIKE_MODULE = "test_a_like_module_of_jacdac_gets_the_slot_with_its_settings"
SET = "test_settings_reach_the_device_survive_a_swap_and_are_undone"
LIKE = "test_a_like_device_gets_the_slot_with_its_settings"
RANGE = "test_a_range_finder_gets_subjects_and_is_heard_and_missed"
CYPHAL_SPARE = "test_a_cyphal_servo_takes_the_slot_of_a_dronecan_servo"
CYPHAL_SERVO = "test_a_servo_is_engaged_told_and_stopped"
NODE = "test_a_genuine_node_is_found_with_the_ports_of_what_it_sends_and_is_missed"
SAFE_ON_CAN = "test_a_slot_says_what_stop_and_leaving_leave_a_device_with"
SAFE_CYPHAL = "test_the_safe_value_of_the_library_is_sent_and_waited_for"
SAFE_MQTT = "test_mqtt_is_ordered_it_with_and_without_a_wire_and_reports_it"
SAFE_MODBUS = "test_modbus_writes_it_and_waits_until_it_is_read_back"
SAFE_MODULE = "test_a_servo_holds_the_safe_value_of_its_slot_with_power"

TRIED = {
    "found, described": (NODE, RANGE, DRIVE, LAMP, PUMP, MODULE),
    "settings": ("test_a_genuine_servo_is_found_told_stopped_and_missed", SET, DRIVE, SET, PUMP, MODULE),
    "STOP confirmed": (
        "test_a_motor_controller_turns_and_confirms_stop_by_its_speed",
        CYPHAL_SERVO,
        DRIVE,
        LAMP,
        PUMP,
        MODULE,
    ),
    "`[slot.safe]`": (SAFE_ON_CAN, SAFE_CYPHAL, SAFE_ON_CAN, SAFE_MQTT, SAFE_MODBUS, SAFE_MODULE),
    "adopted, recorded, lost, explained": (WHOLE,) * 6,
    "a device of the same type gets slot and settings; undone": (LIKE, SET, LIKE, SET, LIKE_PUMP, LIKE_MODULE),
    "a spare of another world": (SWAP, CYPHAL_SPARE, SWAP, SPARE, SPARE_BACK, EITHER),
}
"""The test of each cell, in the order of the page's columns; None: a gap."""


def table() -> dict[str, list[str]]:
    """The rows of the page, by their heads."""
    lines = PAGE.read_text().partition("## What was tried\n")[2].partition("\n## ")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return {head: cells for head, *cells in rows if set(head) != {"-"}}


def names_in(cell: str) -> set[str]:
    tree = ast.parse((HERE / f"test_{cell}.py").read_text())
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}


def test_the_page_has_every_world_and_row() -> None:
    rows = table()
    points = tomllib.loads((HERE.parents[1] / "pyproject.toml").read_text())["project"]["entry-points"]
    assert sorted(name.lower() for name in rows.pop("")) == sorted(points["msbot.bridges"])
    assert list(rows) == list(TRIED)


@pytest.mark.parametrize("row", TRIED)
def test_each_cell_names_the_file_of_its_test(row: str) -> None:
    for cell, test in zip(table()[row], TRIED[row], strict=True):
        if test is None:
            assert cell == "-"
        else:
            assert test in names_in(cell), f"{row}: {test} is not in test_{cell}.py"
