"""Ports that people drive by hand: while somebody holds one, its wire is cut and it listens to the master. Pure.

A held port is bound to a topic of its own, which only the master publishes. The part gets this like any other change of
its configuration; when nobody holds the port any more it is bound to its wire again.
"""

from __future__ import annotations

from dataclasses import replace

from msbot.pnp.model import Configuration, SlotBinding
from msbot_xrce.common.lazy_dataclass import dataclass

TOPIC_PREFIX = "msbot_hand_"
"""Prefix of the topics of held ports; a blueprint cannot use such a name."""
GENERATION_BIT = 16
"""The bits of a configuration's version from this one up count how often ports of the slot were taken or released."""


@dataclass(frozen=True, slots=True)
class HeldPort:
    """A port that somebody drives by hand."""

    slot: str
    port: str
    type_name: str

    @property
    def topic(self) -> str:
        """The topic that the port reads while it is held."""
        return f"{TOPIC_PREFIX}{self.slot}_{self.port}"


class HandControl:
    """Which ports are held, and the configurations of their slots while they are."""

    def __init__(self) -> None:
        self._held: dict[str, dict[str, HeldPort]] = {}
        self._generation: dict[str, int] = {}

    def take(self, slot: str, port: str, type_name: str) -> HeldPort:
        """Hold a port; its slot's configuration has changed unless it was held before."""
        held = HeldPort(slot, port, type_name)
        before = self._held.setdefault(slot, {}).get(port)
        if before != held:
            self._held[slot][port] = held
            self._turn(slot)
        return held

    def let_go(self, slot: str, port: str) -> None:
        """Let go of a port; its slot's configuration has changed if it was held."""
        if self._held.get(slot, {}).pop(port, None) is not None:
            self._turn(slot)

    def over(self, configuration: Configuration) -> Configuration:
        """A slot's configuration with its held ports bound to their own topics."""
        generation = self._generation.get(configuration.slot, 0)
        if generation == 0:
            return configuration
        held = self._held.get(configuration.slot, {})
        bindings = [binding for binding in configuration.bindings if binding.publishes or binding.port not in held]
        bindings += [
            SlotBinding(port=one.port, topic=one.topic, type_name=one.type_name, publishes=False)
            for one in held.values()
        ]
        low = (1 << GENERATION_BIT) - 1
        version = (generation << GENERATION_BIT | configuration.version & low) & 0xFFFFFFFF
        return replace(configuration, version=version, bindings=tuple(bindings))

    def _turn(self, slot: str) -> None:
        # Never back to 0: a version that was used before must not be reused while the part remembers it.
        self._generation[slot] = self._generation.get(slot, 0) % 0xFFFF + 1
