"""Home Assistant's MQTT discovery, read as Home Assistant reads it: messages of entities, or of whole devices.

`PREFIX/COMPONENT/[NODE/]OBJECT/config` declares an entity, `PREFIX/device/[NODE/]OBJECT/config` a device with all its
components. An empty message takes back what was declared. Entities with the same device are one part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from msbot_bridges.bridge import DeviceIdentity
from msbot_bridges.mqtt.device_model import DeviceModel, LifeTopic, PortNames, chosen, chosen_settings
from msbot_bridges.mqtt.ha_entity import ports_of
from msbot_bridges.mqtt.ha_settings import is_setting, setting_of
from msbot_bridges.mqtt.ha_words import spelt_out
from msbot_bridges.mqtt.json_payload import json_object
from msbot_bridges.mqtt.template import Template
from msbot_bridges.mqtt.topics import checked_topic
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

QUIET_S = 1.0
"""A device is complete when nothing about it has come for so long: each entity has a message of its own."""
MOST_ENTITIES = 2000
MOST_COMPONENTS = 200
"""Of a device that declares itself in one message."""
MOST_KEYS = 200
"""Of a message, or of one of its components."""
MOST_OCTETS = 4_000_000
"""Of all messages that are kept; an entity's has some 500."""


@dataclass(frozen=True, slots=True)
class _Entity:
    component: str
    name: str
    config: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class _Kept:
    key: str
    """Of its device."""
    entities: list[_Entity]
    octets: int


class HaDiscovery:
    """What has been declared on one broker.

    Args:
        prefix: Home Assistant's discovery prefix.
    """

    def __init__(self, prefix: str = "homeassistant") -> None:
        self.dropped = 0
        """Messages that are no discovery, or for which there is no room."""
        self._prefix = prefix
        self._entities: dict[str, _Kept] = {}
        """By topic."""
        self._octets = 0
        self._changed: dict[str, float] = {}
        """Devices about which something has come, and when."""

    @property
    def topics(self) -> tuple[str, ...]:
        """What is to be heard."""
        return (f"{self._prefix}/+/+/config", f"{self._prefix}/+/+/+/config")

    def hear(self, topic: str, payload: bytes, now: float) -> bool:
        """Take a message; whether it was for here."""
        words = topic.removeprefix(f"{self._prefix}/").split("/")
        if not topic.startswith(f"{self._prefix}/") or words[-1] != "config" or len(words) not in (3, 4):
            return False
        before = self._entities.pop(topic, None)
        if before is not None:
            self._octets -= before.octets
            self._changed[before.key] = now
        if not payload:
            return True
        told = json_object(payload.decode(errors="replace"))
        has_room = len(self._entities) < MOST_ENTITIES and self._octets + len(payload) <= MOST_OCTETS
        if not told or not has_room or len(told) > MOST_KEYS:
            self.dropped += 1
            return True
        config = spelt_out(told)
        entities = list(_parts_of_device(config)) if words[0] == "device" else [_entity(words[0], words[-2], config)]
        key = _key(config.get("device"), topic)
        self._entities[topic] = _Kept(key, entities, len(payload))
        self._octets += len(payload)
        self._changed[key] = now
        return True

    def due(self, now: float) -> Iterator[tuple[str, DeviceModel | None]]:
        """Devices that are complete, or changed, since this was asked last; None: it is declared no longer."""
        ready: dict[str, list[_Entity]] = {key: [] for key, when in self._changed.items() if now - when >= QUIET_S}
        for kept in self._entities.values():
            if kept.key in ready:
                ready[kept.key] += kept.entities
        for key, entities in ready.items():
            del self._changed[key]
            yield key, _model(key, entities) if entities else None

    def next_due(self) -> float | None:
        """When `due` will have something."""
        return min(self._changed.values()) + QUIET_S if self._changed else None


def _entity(component: str, object_id: str, config: Mapping[str, Any]) -> _Entity:
    name = config.get("name") or (component if "name" in config else object_id)
    return _Entity(component, str(name), config)


def _parts_of_device(config: Mapping[str, Any]) -> Iterator[_Entity]:
    """The components of a device; what the device says of all of them counts for each."""
    components = config.get("components")
    if not isinstance(components, Mapping):
        return
    shared = {key: value for key, value in config.items() if key not in ("components", "origin", "name")}
    for name, told in islice(components.items(), MOST_COMPONENTS):
        if not isinstance(told, Mapping) or len(told) > MOST_KEYS:
            continue
        base = {"~": config["~"]} if "~" in config else {}
        own = spelt_out({**base, **told})
        if len(own) > 1 and isinstance(own.get("platform"), str):  # with nothing but its platform it is taken back
            yield _entity(own["platform"], str(name), {**shared, **own})


def _key(device: object, topic: str) -> str:
    """What is the same in all entities of a device: one of its identifiers or connections."""
    if isinstance(device, Mapping):
        identifiers = device.get("identifiers")
        if isinstance(identifiers, str):
            return identifiers
        if isinstance(identifiers, list) and identifiers:
            return min(map(str, identifiers))
        connections = device.get("connections")
        if isinstance(connections, list) and connections:
            return min(":".join(map(str, one)) if isinstance(one, list) else str(one) for one in connections)
    return topic


def _model(key: str, entities: list[_Entity]) -> DeviceModel:
    entities = sorted(entities, key=lambda one: (one.config.get("entity_category") is not None, one.name))
    device: Mapping[str, Any] = next(
        (one.config["device"] for one in entities if isinstance(one.config.get("device"), Mapping)), {}
    )
    readings, commands, settings, left_out, names = [], [], [], [], PortNames()
    life: dict[str, LifeTopic] = {}
    mode = "latest"
    for one in entities:
        try:
            topics = list(_life(one.config))
            if is_setting(one.config):
                settings.append(setting_of(one.component, one.config, one.name, names))
            else:
                ports = ports_of(one.component, one.config, one.name, names)
                readings += ports.readings
                commands += ports.commands
        except ConfigError as error:
            left_out.append(f"{one.name}: {error}")
            continue
        life.update((topic.topic, topic) for topic in topics)
        mode = str(one.config.get("availability_mode", mode))
    kept, driven, over = chosen(readings, commands)
    set_here, too_many = chosen_settings(settings)
    return DeviceModel(
        key,
        _identity(key, device, entities[0]),
        kept,
        driven,
        set_here,
        tuple(life.values()),
        mode,
        (*left_out, *over, *too_many),
        {f"{one.component} {one.name}": dict(one.config) for one in entities},
    )


def _identity(key: str, device: Mapping[str, Any], first: _Entity) -> DeviceIdentity:
    maker = str(device.get("manufacturer") or "mqtt")
    product = str(device.get("model") or device.get("model_id") or device.get("name") or first.component)
    name = str(device.get("name") or first.name)
    return DeviceIdentity(
        maker,
        product,
        key.encode(),
        f"{product} of {maker}" if device.get("manufacturer") else f"{name}, a device of MQTT",
        name,
        str(device.get("hw_version") or ""),
        str(device.get("sw_version") or ""),
    )


def _life(config: Mapping[str, Any]) -> Iterator[LifeTopic]:
    """The topics of availability of an entity: one, or a list of them."""
    listed = config.get("availability")
    if isinstance(listed, list):
        entries = [(one, "value_template", one.get("topic")) for one in listed]
    else:
        entries = [(config, "availability_template", config.get("availability_topic"))]
    for entry, template_key, topic in entries:
        if not topic:
            continue
        checked = checked_topic(topic, "a topic of its availability")
        template = Template(str(entry.get(template_key) or ""))
        yes, no = str(entry.get("payload_available", "online")), str(entry.get("payload_not_available", "offline"))

        def read(payload: str, template: Template = template, yes: str = yes, no: str = no) -> bool | None:
            text = template.render(payload)
            return True if text == yes else False if text == no else None

        yield LifeTopic(checked, read)
