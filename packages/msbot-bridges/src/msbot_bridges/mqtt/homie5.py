"""Homie 5: a device describes itself in one document, `DOMAIN/5/DEVICE/$description`, and its state is `$state`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import islice
from typing import Any

from msbot_bridges.bridge import DeviceIdentity
from msbot_bridges.mqtt.device_model import DeviceModel, LifeTopic, chosen, chosen_settings
from msbot_bridges.mqtt.homie_property import MOST_PROPERTIES, SETTING_NODES, HomiePorts, HomieProperty
from msbot_bridges.mqtt.json_payload import json_object
from msbot_bridges.mqtt.topics import checked_topic
from msbot_xrce.errors import ConfigError

QUIET_S = 0.5
MOST_DEVICES = 500
MOST_OCTETS = 4_000_000
"""Of all descriptions."""


class Homie5:
    """The devices of one domain.

    Args:
        domain: the first level of their topics.
        setting_nodes: nodes whose properties are settings.
    """

    def __init__(self, domain: str = "homie", setting_nodes: Collection[str] = SETTING_NODES) -> None:
        self.dropped = 0
        self._domain = domain
        self._setting_nodes = setting_nodes
        self._described: dict[str, Mapping[str, Any]] = {}
        self._octets: dict[str, int] = {}
        """Of each description."""
        self._changed: dict[str, float] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """What is to be heard."""
        return (f"{self._domain}/5/+/$description", f"{self._domain}/5/+/$state")

    def hear(self, topic: str, payload: bytes, now: float) -> bool:
        """Take a message; whether it was a description."""
        words = topic.split("/")
        if words[:-2] != [*self._domain.split("/"), "5"] or words[-1] not in ("$description", "$state"):
            return False
        device = words[-2]
        if words[-1] == "$state":
            if payload:
                return False
            payload = b""  # an empty state removes the device
        told = json_object(payload.decode(errors="replace"))
        if payload and not (str(told.get("homie", "")).startswith("5.") and self._has_room(device, len(payload))):
            self.dropped += 1
            return True
        if told:
            self._described[device] = told
            self._octets[device] = len(payload)
        elif self._described.pop(device, None) is None:
            return True
        else:
            del self._octets[device]
        self._changed[device] = now
        return True

    def _has_room(self, device: str, octets: int) -> bool:
        others = sum(self._octets.values()) - self._octets.get(device, 0)
        return others + octets <= MOST_OCTETS and (device in self._described or len(self._described) < MOST_DEVICES)

    def due(self, now: float) -> Iterator[tuple[str, DeviceModel | None]]:
        """See `Convention`."""
        for device in [one for one, when in self._changed.items() if now - when >= QUIET_S]:
            del self._changed[device]
            told = self._described.get(device)
            yield device, None if told is None else self._model(device, told)

    def next_due(self) -> float | None:
        """See `Convention`."""
        return min(self._changed.values()) + QUIET_S if self._changed else None

    def _model(self, device: str, told: Mapping[str, Any]) -> DeviceModel:
        base = f"{self._domain}/5/{device}"
        found = HomiePorts(self._setting_nodes)
        for one in islice(_properties(base, told), MOST_PROPERTIES):
            found.add(one)
        kept, driven, over = chosen(found.readings, found.commands)
        set_here, too_many = chosen_settings(found.settings)
        product = str(told.get("type") or told.get("name") or device)
        life = [LifeTopic(f"{base}/$state", lambda payload: payload == "ready")]
        if root := told.get("root"):
            # Only the root has a last will: when it is lost, so are all below it.
            try:
                topic = checked_topic(f"{self._domain}/5/{root}/$state", "its root")
                life.append(LifeTopic(topic, lambda payload: payload != "lost"))
            except ConfigError as error:
                found.left_out.append(f"{root}: {error}")
        return DeviceModel(
            device,
            DeviceIdentity(
                "homie", product, base.encode(), f"{told.get('name') or device}, a device of Homie 5", device
            ),
            kept,
            driven,
            set_here,
            life,
            "all",
            (*found.left_out, *over, *too_many),
            told,
        )


def _properties(base: str, told: Mapping[str, Any]) -> Iterator[HomieProperty]:
    nodes = told.get("nodes")
    for node_id, node in sorted(nodes.items()) if isinstance(nodes, Mapping) else ():
        properties = node.get("properties") if isinstance(node, Mapping) else None
        for property_id, one in sorted(properties.items()) if isinstance(properties, Mapping) else ():
            if isinstance(one, Mapping) and "/" not in f"{node_id}{property_id}":
                yield HomieProperty(
                    f"{base}/{node_id}/{property_id}",
                    str(property_id),
                    str(one.get("datatype", "")),
                    str(one.get("format", "")),
                    str(one.get("unit", "")),
                    one.get("settable") is True,
                    one.get("retained") is not False,
                )
