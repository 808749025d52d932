"""Homie 5: a device describes itself in one document, `DOMAIN/5/DEVICE/$description`, and its state is `$state`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from msbot_bridges.bridge import DeviceIdentity
from msbot_bridges.mqtt.device_model import DeviceModel, LifeTopic, chosen, chosen_settings
from msbot_bridges.mqtt.ha_entity import json_object
from msbot_bridges.mqtt.homie_property import SETTING_NODES, HomiePorts, HomieProperty

QUIET_S = 0.5
MOST_DEVICES = 500


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
        if payload and (not str(told.get("homie", "")).startswith("5.") or len(self._described) >= MOST_DEVICES):
            self.dropped += 1
            return True
        if told:
            self._described[device] = told
        elif self._described.pop(device, None) is None:
            return True
        self._changed[device] = now
        return True

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
        for one in _properties(base, told):
            found.add(one)
        kept, driven, over = chosen(found.readings, found.commands)
        set_here, too_many = chosen_settings(found.settings)
        product = str(told.get("type") or told.get("name") or device)
        life = [LifeTopic(f"{base}/$state", lambda payload: payload == "ready")]
        root = told.get("root")
        if isinstance(root, str) and root:
            # Only the root has a last will: when it is lost, so are all below it.
            life.append(LifeTopic(f"{self._domain}/5/{root}/$state", lambda payload: payload != "lost"))
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
