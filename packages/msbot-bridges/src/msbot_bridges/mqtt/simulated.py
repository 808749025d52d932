"""A lamp for those who have none: it declares itself as devices of Home Assistant do, and obeys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from msbot_bridges.bridge import BridgeLink
from msbot_bridges.mqtt.broker import Broker, LastWill, read_address
from msbot_bridges.mqtt.ha_entity import json_object

MOST_SERIAL = 32


class SimulatedLamp:
    """A lamp with brightness.

    Args:
        link: the broker.
        options: `serial` tells several of them apart.
    """

    def __init__(self, link: BridgeLink, options: Mapping[str, Any]) -> None:
        serial = "".join(one for one in str(options.get("serial", "1")) if one.isalnum())[:MOST_SERIAL] or "1"
        self._serial, self._base = serial, f"msbot-lamp/{serial}"
        self._state: dict[str, object] = {"state": "OFF", "brightness": 255}
        self._broker = Broker(
            read_address(link.address, link.options),
            on_message=self._told,
            on_connected=self._declare,
            on_leaving=lambda: self._broker.publish(f"{self._base}/available", "offline", is_kept=True),
            will=LastWill(f"{self._base}/available", "offline"),
        )

    async def run(self) -> None:
        """Run until cancelled."""
        self._broker.subscribe([f"{self._base}/set"])
        await self._broker.run()

    def _declare(self) -> None:
        declared = {
            "name": "lamp",
            "unique_id": f"msbot-lamp-{self._serial}",
            "schema": "json",
            "brightness": True,
            "command_topic": f"{self._base}/set",
            "state_topic": f"{self._base}/state",
            "availability_topic": f"{self._base}/available",
            "device": {
                "identifiers": [f"msbot-lamp-{self._serial}"],
                "manufacturer": "simulated",
                "model": "lamp",
                "name": f"Simulated lamp {self._serial}",
            },
        }
        topic = f"homeassistant/light/msbot-lamp-{self._serial}/config"
        self._broker.publish(topic, json.dumps(declared), is_kept=True)
        self._broker.publish(f"{self._base}/available", "online", is_kept=True)
        self._report()

    def _told(self, topic: str, payload: bytes, is_old: bool) -> None:  # noqa: ARG002
        told = json_object(payload.decode(errors="replace"))
        if told.get("state") in ("ON", "OFF"):
            self._state["state"] = told["state"]
        brightness = told.get("brightness")
        if isinstance(brightness, int) and 0 <= brightness <= 255:
            self._state["brightness"] = brightness
        self._report()

    def _report(self) -> None:
        self._broker.publish(f"{self._base}/state", json.dumps(self._state), is_kept=True)
