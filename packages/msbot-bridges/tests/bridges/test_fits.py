"""Whose part fits: what the worlds say of themselves is what their devices have, and the page shows it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from msbot_bridges.bridge import worlds
from msbot_bridges.bridge.quantity import QUANTITIES, quantity
from msbot_bridges.mqtt.device_model import PortNames
from msbot_bridges.mqtt.ha_discovery import HaDiscovery
from msbot_bridges.mqtt.ha_entity import COMPONENTS
from msbot_bridges.mqtt.homie_property import DATATYPES, HomieProperty, homie_ports
from tools import fits_table

CONFIGS: dict[str, list[dict[str, Any]]] = {
    "light": [
        {"command_topic": "c", "state_topic": "s"},
        {"command_topic": "c", "state_topic": "s", "brightness_command_topic": "b", "rgb_command_topic": "r"},
    ],
    "switch": [{"command_topic": "c", "state_topic": "s"}],
    "fan": [
        {"command_topic": "c", "state_topic": "s"},
        {"command_topic": "c", "percentage_command_topic": "p", "state_topic": "s"},
    ],
    "cover": [{"command_topic": "c", "state_topic": "s"}, {"set_position_topic": "p", "position_topic": "q"}],
    "number": [{"command_topic": "c", "state_topic": "s"}],
    "button": [{"command_topic": "c"}],
    "sensor": [{"state_topic": "s", "state_class": "measurement"}, {"state_topic": "s"}],
    "binary_sensor": [{"state_topic": "s"}],
}


def test_the_page_is_what_the_worlds_say() -> None:
    assert fits_table.page() == fits_table.PAGE.read_text(encoding="utf-8"), "python tools/fits_table.py"


def test_every_world_of_ours_says_what_it_fills() -> None:
    for name in ("canopen", "cyphal", "dronecan", "jacdac", "modbus", "mqtt"):
        fits = worlds()[name].fits()
        assert fits, name
        assert all(fit.reports or fit.driven for fit in fits)


@pytest.mark.parametrize("component", list(COMPONENTS))
def test_a_component_has_the_messages_that_the_table_names(component: str) -> None:
    found: tuple[set[type], set[type]] = (set(), set())
    for number, config in enumerate(CONFIGS[component]):
        discovery = HaDiscovery()
        discovery.hear(f"homeassistant/{component}/x{number}/config", json.dumps(config).encode(), 0.0)
        ((_, model),) = discovery.due(9.0)
        assert model is not None
        found[0].update(one.message for one in model.readings)
        found[1].update(one.message for one in model.commands)
    reports, driven = COMPONENTS[component]
    assert found == (set(reports), set(driven))


@pytest.mark.parametrize("datatype", list(DATATYPES))
def test_a_property_has_the_message_that_the_table_names(datatype: str) -> None:
    (reading,), _ = homie_ports(HomieProperty("t", "n", datatype, "rgb" if datatype == "color" else ""), PortNames())
    assert reading.message is DATATYPES[datatype]


@pytest.mark.parametrize("unit", list(QUANTITIES))
def test_a_number_with_a_unit_comes_back_as_it_went(unit: str) -> None:
    what = quantity(unit)
    assert what.number(what.make(12.5)) == pytest.approx(12.5, rel=1e-5)
