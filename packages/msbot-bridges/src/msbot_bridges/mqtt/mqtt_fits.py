"""Which standard messages devices on MQTT send, and are driven by, from the tables of the conventions."""

from __future__ import annotations

from msbot.part import Message
from msbot.part.messages.standard import Battery
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import Fit, fits_of
from msbot_bridges.bridge.quantity import messages_by_unit
from msbot_bridges.mqtt.ha_entity import COMPONENTS
from msbot_bridges.mqtt.homie_property import DATATYPES

Kinds = list[tuple[type[Message], str]]


def mqtt_fits() -> tuple[Fit, ...]:
    """Components of Home Assistant, properties of Homie, and numbers of both by their unit."""
    reports: Kinds = [(message, kind) for kind, (out, _) in COMPONENTS.items() for message in out]
    driven: Kinds = [(message, kind) for kind, (_, into) in COMPONENTS.items() for message in into]
    homie: Kinds = [(message, f"Homie {datatype}") for datatype, message in DATATYPES.items()]
    reports += [(Battery, said("sensor of a battery"))]
    reports += [(message, said("sensor in {units}", units=units)) for message, units in messages_by_unit()]
    driven += [(message, said("number in {units}", units=units)) for message, units in messages_by_unit()]
    return fits_of([*reports, *homie], [*driven, *homie])
