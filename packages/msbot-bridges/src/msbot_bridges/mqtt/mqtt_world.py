"""The devices of one broker: found by what they have published about themselves, there as long as they say so."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import field
from typing import Protocol

from msbot_bridges.bridge import World, WorldHost
from msbot_bridges.mqtt.broker import Broker, BrokerAddress
from msbot_bridges.mqtt.device_model import DeviceModel, LifeTopic, Order
from msbot_bridges.mqtt.mqtt_device import MqttDevice
from msbot_xrce.lazy import dataclass

SETTINGS_S = 2.0
"""Longest wait for what a device has as settings; brokers mostly keep it, and tell it at once."""


MOST_WORDS = 30
"""Ports of one device of which it is said why they were left out."""
LONGEST_WORDS = 300


class Convention(Protocol):
    """A way in which devices say what they are; without I/O."""

    dropped: int
    """Declarations that were too many, too long, or could not be read."""

    @property
    def topics(self) -> tuple[str, ...]:
        """What is to be heard."""

    def hear(self, topic: str, payload: bytes, now: float) -> bool:
        """Take a message; whether it was for here, and for nobody else."""

    def due(self, now: float) -> Iterator[tuple[str, DeviceModel | None]]:
        """Devices that are complete, or changed, since this was asked last; None: it is declared no longer."""

    def next_due(self) -> float | None:
        """When `due` will have something."""


@dataclass(slots=True)
class _Known:
    model: DeviceModel
    device: MqttDevice
    life: dict[str, bool] = field(default_factory=dict)
    """What each topic of life has said."""
    latest: bool | None = None
    is_found: bool = False
    """The bridge has been told of it."""
    waits: asyncio.TimerHandle | None = None
    """For the values of its settings."""

    @property
    def is_alive(self) -> bool:
        topics = self.model.life
        if not topics:
            return True
        if self.model.life_mode == "all":
            return all(self.life.get(one.topic) for one in topics)
        if self.model.life_mode == "any":
            return any(self.life.get(one.topic) for one in topics)
        return bool(self.latest)


class MqttWorld(World):
    """All devices of one broker that follow one of the conventions.

    Args:
        address: where it is.
        conventions: how its devices say what they are.
    """

    def __init__(self, address: BrokerAddress, conventions: tuple[Convention, ...]) -> None:
        self._address = address
        self._conventions = conventions
        self._known: dict[str, _Known] = {}
        self._by_topic: dict[str, set[str]] = {}
        """Which devices hear a topic."""
        self._filters = tuple(topic for one in conventions for topic in one.topics)
        self._changed = asyncio.Event()
        self._say_at = 1
        """Of so many messages that were left out it is said next."""

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host, self._loop = host, asyncio.get_running_loop()
        self._broker = Broker(
            self._address, on_message=self._heard, on_lost=self._broker_lost, on_dropped=self._say_dropped
        )
        self._broker.subscribe(self._filters)
        connecting = asyncio.create_task(self._broker.run())
        watching = asyncio.create_task(self._watch())
        try:
            await asyncio.wait([connecting, watching], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for known in self._known.values():
                self._wait_no_longer(known)
            await self._broker.flush()
            connecting.cancel()
            watching.cancel()
            await asyncio.wait([connecting, watching])
        for task in (connecting, watching):
            if not task.cancelled() and (error := task.exception()) is not None:
                raise error

    async def _watch(self) -> None:
        """Make devices of what is complete."""
        while True:
            self._changed.clear()
            times = [when for one in self._conventions if (when := one.next_due()) is not None]
            try:
                async with asyncio.timeout_at(min(times) if times else None):
                    await self._changed.wait()
            except TimeoutError:
                pass
            now = self._loop.time()
            for convention in self._conventions:
                for key, model in list(convention.due(now)):
                    self._declared(f"{type(convention).__name__} {key}", model)

    def _declared(self, key: str, model: DeviceModel | None) -> None:
        known = self._known.get(key)
        if known is not None and model is not None and known.model.declared == model.declared:
            return
        if known is not None:
            why = "has taken back what it had declared" if model is None else "declares something else"
            self._forget(key, f"{known.model.identity.where} {why}")
        if model is None:
            return
        where = model.identity.where
        for words in model.left_out[:MOST_WORDS]:
            self._host.say(f"{where}: left out: {words[:LONGEST_WORDS]}")
        if (more := len(model.left_out) - MOST_WORDS) > 0:
            self._host.say(f"{where}: left out: {more} more")
        if not model.readings and not model.commands:
            self._host.say(f"{where}: no part, because it has no port")
            return
        if not model.life:
            self._host.say(f"{where} has no availability topic: nobody sees when it is lost")
        device = MqttDevice(model, send=self._send, news=self._host.news, now=self._loop.time)
        self._known[key] = _Known(model, device)
        topics = _topics(model)
        for topic in topics:
            self._by_topic.setdefault(topic, set()).add(key)
        # Also what a filter covers: the broker then tells again what it has kept, which came too early.
        self._broker.subscribe(topics)
        self._judge(key)

    def _forget(self, key: str, why: str) -> None:
        known = self._known.pop(key)
        self._wait_no_longer(known)
        for topic in _topics(known.model):
            hearers = self._by_topic[topic]
            hearers.discard(key)
            if not hearers:
                del self._by_topic[topic]
                if topic not in self._filters:
                    self._broker.unsubscribe([topic])
        if known.is_found:
            self._host.lost(known.device, why)

    def _broker_lost(self, why: str) -> None:
        for known in self._known.values():
            known.life.clear()
            known.latest = None
            self._wait_no_longer(known)
            self._lose(known, why)

    def _lose(self, known: _Known, why: str) -> None:
        if known.is_found:
            known.is_found = False
            known.device.was_lost()
            self._host.lost(known.device, why)

    def _heard(self, topic: str, payload: bytes, is_old: bool) -> None:
        now = self._loop.time()
        for convention in self._conventions:
            if convention.hear(topic, payload, now):
                self._changed.set()
                break
        text = payload.decode(errors="replace")
        for key in list(self._by_topic.get(topic, ())):
            known = self._known[key]
            for one in known.model.life:
                if one.topic == topic and (is_there := one.read(text)) is not None:
                    known.life[topic] = known.latest = is_there
            known.device.heard(topic, text, is_old=is_old)
            self._judge(key)
        self._say_dropped()

    def _say_dropped(self) -> None:
        """Say that messages are left out: the first time, and whenever they are ten times as many."""
        count = self._broker.dropped + sum(one.dropped for one in self._conventions)
        if count >= self._say_at:
            self._say_at = 10 ** len(str(count))
            what = "message" if count == 1 else "messages"
            self._host.say(f"left out so far: {count} {what} of the broker, too long, too many, or not readable")

    def _judge(self, key: str) -> None:
        """A device that says that it is there is found; one that says that it is not is lost."""
        known = self._known[key]
        if not known.is_alive:
            self._wait_no_longer(known)
            self._lose(known, f"{known.model.identity.where} is no longer available, as its topic says")
        elif not known.is_found and self._broker.is_connected:
            if not known.device.unknown_settings:
                self._find(known)
            elif known.waits is None:
                known.waits = self._loop.call_later(SETTINGS_S, self._find, known)

    def _find(self, known: _Known) -> None:
        self._wait_no_longer(known)
        for name in known.device.unknown_settings:
            self._host.say(f"{known.model.identity.where}: left out: {name}: it has not reported its value")
        known.device.describe_settings()
        known.is_found = True
        self._host.found(known.device)

    @staticmethod
    def _wait_no_longer(known: _Known) -> None:
        if known.waits is not None:
            known.waits.cancel()
            known.waits = None

    def _send(self, order: Order, is_urgent: bool) -> None:
        if is_urgent:
            self._broker.publish_urgently(order.topic, order.payload)
        else:
            self._broker.publish(order.topic, order.payload)


def _topics(model: DeviceModel) -> list[str]:
    states = [one.topic for one in model.readings]
    states += [one.state_topic for one in model.commands if one.state_topic]
    states += [one.topic for one in model.settings]
    life: list[LifeTopic] = list(model.life)
    return list(dict.fromkeys([*states, *(one.topic for one in life)]))
