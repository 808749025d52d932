"""A lamp for those who have none: it declares itself as devices of Home Assistant do, and obeys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from msbot_bridges.bridge import BridgeLink
from msbot_bridges.mqtt.broker import Broker, LastWill, read_address
from msbot_bridges.mqtt.json_payload import json_object

MOST_SERIAL = 32


class SimulatedLamp:
    """A lamp with brightness, and with a setting: how bright it may be.

    Args:
        link: the broker.
        options: `serial` tells several of them apart.
    """

    def __init__(self, link: BridgeLink, options: Mapping[str, Any]) -> None:
        serial = "".join(one for one in str(options.get("serial", "1")) if one.isalnum())[:MOST_SERIAL] or "1"
        self._serial, self._base = serial, f"msbot-lamp/{serial}"
        self.limit = 100
        """Its greatest brightness, in percent."""
        self._is_on, self._brightness = False, 255
        self._broker = Broker(
            read_address(link.address, link.options),
            on_message=self._told,
            on_connected=self._declare,
            on_leaving=lambda: self._broker.publish(f"{self._base}/available", "offline", is_kept=True),
            will=LastWill(f"{self._base}/available", "offline"),
        )

    async def run(self) -> None:
        """Run until cancelled."""
        self._broker.subscribe([f"{self._base}/set", f"{self._base}/limit/set"])
        await self._broker.run()

    def _declare(self) -> None:
        lamp = {"schema": "json", "brightness": True}
        self._declare_entity("light", "lamp", {**lamp, "state_topic": f"{self._base}/state"}, f"{self._base}/set")
        limit = {"entity_category": "config", "min": 10, "max": 100, "unit_of_measurement": "%"}
        topic = f"{self._base}/limit"
        self._declare_entity("number", "limit", {**limit, "state_topic": topic}, f"{topic}/set")
        self._broker.publish(f"{self._base}/available", "online", is_kept=True)
        self._report()

    def _declare_entity(self, component: str, name: str, config: Mapping[str, object], command_topic: str) -> None:
        declared = {
            "name": name,
            "unique_id": f"msbot-lamp-{self._serial}-{name}",
            "command_topic": command_topic,
            "availability_topic": f"{self._base}/available",
            "device": {
                "identifiers": [f"msbot-lamp-{self._serial}"],
                "manufacturer": "simulated",
                "model": "lamp",
                "sw_version": "1.0",
                "name": f"Simulated lamp {self._serial}",
            },
            **config,
        }
        topic = f"homeassistant/{component}/msbot-lamp-{self._serial}/{name}/config"
        self._broker.publish(topic, json.dumps(declared), is_kept=True)

    def _told(self, topic: str, payload: bytes, is_old: bool) -> None:  # noqa: ARG002
        text = payload.decode(errors="replace")
        if topic.endswith("/limit/set"):
            if text.isdecimal() and 10 <= int(text) <= 100:
                self.limit = int(text)
            self._report()
            return
        told = json_object(text)
        if told.get("state") in ("ON", "OFF"):
            self._is_on = told["state"] == "ON"
        brightness = told.get("brightness")
        if isinstance(brightness, int) and 0 <= brightness <= 255:
            self._brightness = brightness
        self._report()

    @property
    def brightness(self) -> int:
        """0 to 255, as it shines when it is on."""
        return min(self._brightness, round(255 * self.limit / 100))

    def _report(self) -> None:
        state = {"state": "ON" if self._is_on else "OFF", "brightness": self.brightness}
        self._broker.publish(f"{self._base}/state", json.dumps(state), is_kept=True)
        self._broker.publish(f"{self._base}/limit", str(self.limit), is_kept=True)
