"""Homie 4: a device describes itself in many retained topics, `DOMAIN/DEVICE/$name`, `.../NODE/PROPERTY/$datatype`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import islice

from msbot_bridges.bridge import DeviceIdentity
from msbot_bridges.mqtt.device_model import DeviceModel, LifeTopic, chosen, chosen_settings
from msbot_bridges.mqtt.homie_property import MOST_PROPERTIES, SETTING_NODES, HomiePorts, HomieProperty

QUIET_S = 1.0
MOST_DEVICES = 200
MOST_ATTRIBUTES = 400
"""Attributes of a device; further ones are dropped."""
LONGEST_ATTRIBUTE = 4000
MOST_CHARACTERS = 4_000_000
"""Characters of all attributes."""


class Homie4:
    """The devices of one domain.

    Args:
        domain: the first level of their topics.
        setting_nodes: nodes whose properties are settings.
    """

    def __init__(self, domain: str = "homie", setting_nodes: Collection[str] = SETTING_NODES) -> None:
        self.dropped = 0
        self._domain = domain
        self._setting_nodes = setting_nodes
        self._attributes: dict[str, dict[str, str]] = {}
        """By device: what it says about itself, by the rest of the topic."""
        self._characters = 0
        self._changed: dict[str, float] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """What is to be heard; `#` would also bring what other devices are told."""
        return tuple(f"{self._domain}/+/{levels}" for levels in ("+", "+/+", "+/+/+"))

    def hear(self, topic: str, payload: bytes, now: float) -> bool:
        """Take a message; whether it was an attribute."""
        start = f"{self._domain}/"
        if not topic.startswith(start):
            return False
        device, _, rest = topic.removeprefix(start).partition("/")
        is_attribute = any(word.startswith("$") for word in rest.split("/"))
        if device == "5" or device.startswith("$") or not is_attribute:
            return False
        if rest == "$state" and payload:
            return False  # its life, which makes it no other device
        known = self._attributes.get(device)
        if known is None:
            if not payload:
                return True
            if len(self._attributes) >= MOST_DEVICES:
                self.dropped += 1
                return True
            known = self._attributes[device] = {}
        text = payload[: LONGEST_ATTRIBUTE + 1].decode(errors="replace")
        before = len(known.get(rest, ""))
        has_room = rest in known or len(known) < MOST_ATTRIBUTES
        if not payload:
            known.pop(rest, None)
            self._characters -= before
        elif len(text) <= LONGEST_ATTRIBUTE and has_room and self._characters - before + len(text) <= MOST_CHARACTERS:
            known[rest] = text
            self._characters += len(text) - before
        else:
            self.dropped += 1
        self._changed[device] = now
        return True

    def due(self, now: float) -> Iterator[tuple[str, DeviceModel | None]]:
        """See `Convention`."""
        for device in [one for one, when in self._changed.items() if now - when >= QUIET_S]:
            del self._changed[device]
            told = self._attributes.get(device, {})
            if told.get("$homie", "").startswith("4."):
                yield device, self._model(device, told)
            else:
                if not told:
                    self._attributes.pop(device, None)
                yield device, None

    def next_due(self) -> float | None:
        """See `Convention`."""
        return min(self._changed.values()) + QUIET_S if self._changed else None

    def _model(self, device: str, told: Mapping[str, str]) -> DeviceModel:
        base = f"{self._domain}/{device}"
        found = HomiePorts(self._setting_nodes)
        for one in islice(_properties(base, told), MOST_PROPERTIES):
            found.add(one)
        kept, driven, over = chosen(found.readings, found.commands)
        set_here, too_many = chosen_settings(found.settings)
        name = told.get("$name", device)
        identity = DeviceIdentity(
            "homie",
            told.get("$fw/name", name),
            base.encode(),
            f"{name}, a device of Homie 4",
            device,
            software=told.get("$fw/version", ""),
        )
        life = [LifeTopic(f"{base}/$state", lambda payload: payload in ("ready", "alert"))]
        declared = {key: value for key, value in told.items() if not key.startswith("$stats")}
        return DeviceModel(
            device, identity, kept, driven, set_here, life, "all", (*found.left_out, *over, *too_many), declared
        )


def _properties(base: str, told: Mapping[str, str]) -> Iterator[HomieProperty]:
    for node in _ids(told.get("$nodes", "")):
        for name in _ids(told.get(f"{node}/$properties", "")):
            start = f"{node}/{name}"
            yield HomieProperty(
                f"{base}/{start}",
                name,
                told.get(f"{start}/$datatype", ""),
                told.get(f"{start}/$format", ""),
                told.get(f"{start}/$unit", ""),
                told.get(f"{start}/$settable") == "true",
                told.get(f"{start}/$retained") != "false",
            )


def _ids(text: str) -> Iterable[str]:
    """`lamp,switch`: each id once."""
    return dict.fromkeys(filter(None, text.split(",")))
