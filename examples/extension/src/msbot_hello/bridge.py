"""A world of its own, with one lamp: what a bridge needs, without a network.

msbot bridge hello --link here
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from msbot import Level, Message
from msbot_bridges.bridge import (
    BridgeLink,
    DeviceIdentity,
    DeviceOutput,
    DeviceSetting,
    ForeignDevice,
    Input,
    Report,
    World,
    WorldHost,
    WorldKind,
)


class Lamp(ForeignDevice):
    """A lamp that says how bright it is; a genuine one would answer later, from its network."""

    outputs = (DeviceOutput("brightness", Level),)
    inputs = (Input("power", Level, safe=Level(percent=0)),)
    settings: Sequence[DeviceSetting] = (DeviceSetting("most", float, 100.0, least=0.0, most=100.0, unit="%"),)

    def __init__(self, serial: bytes, news: Callable[[ForeignDevice], None]) -> None:
        self.identity = DeviceIdentity("hello", "lamp", serial, "Lamp of the example", where="here")
        self.percent = self.safe = 0.0
        self.most = 100.0
        self.answers = True
        self.is_stopped = False
        self._news = news
        self._report: Report | None = None
        self._stopping = False

    def begin(self, report: Report) -> None:
        self._report = report
        self._tell()

    def end(self) -> None:
        self._report = None

    def act(self, port: str, message: Message) -> None:
        assert isinstance(message, Level)
        self.percent = min(message.percent, self.most)
        self._tell()

    def set(self, name: str, value: object) -> None:
        assert isinstance(value, float)
        self.most = value

    def safe_is(self, port: str, message: Message) -> None:
        assert isinstance(message, Level)
        self.safe = message.percent  # what the slot says for STOP, or the library

    def stop(self) -> None:
        self.percent, self._stopping = self.safe, True
        if self.answers and not self.is_stopped:
            self.is_stopped = True
            self._news(self)

    def go(self) -> None:
        self._stopping = self.is_stopped = False
        self.safe = 0.0

    @property
    def not_stopped(self) -> str:
        return "" if self.is_stopped else "the lamp has not said that it is off"

    def answer(self) -> None:
        """It reports what it could not report before."""
        self.answers, self.is_stopped = True, self._stopping
        self._news(self)

    def _tell(self) -> None:
        if self._report is not None:
            self._report("brightness", Level(percent=self.percent))


class HelloWorldOfLamps(World):
    """One lamp, which is there from the beginning."""

    async def run(self, host: WorldHost) -> None:
        lamp = Lamp(b"1", host.news)
        host.found(lamp)
        host.say("one lamp is there")
        await asyncio.Event().wait()


def open_world(link: BridgeLink) -> World:
    return HelloWorldOfLamps()


WORLD = WorldKind("one lamp of the example", "here", open_world)
