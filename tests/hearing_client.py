"""A client whose callbacks a test may choose while it runs; a program gives them when it makes its `Client`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from msbot.part import Client, ConnectionState
from msbot_agent.link import Link, SignalHandler


def _ignore(*_: object) -> None:
    """The test does not listen."""


class HearingClient(Client):
    """Calls whatever its `on_...` is at that moment."""

    def __init__(self, link: Link, **options: Any) -> None:
        self.on_state: Callable[[ConnectionState, str], None] = _ignore
        self.on_signal: SignalHandler = _ignore
        self.on_topic: Callable[[int, int, bytes], None] = _ignore
        self.on_request: Callable[[int, int, bytes, bytes], None] = _ignore
        self.on_reply: Callable[[int, int, bytes], None] = _ignore
        self.on_status: Callable[[int, int, int], None] = _ignore
        self.on_room: Callable[[], None] = _ignore
        callbacks: dict[str, Any] = {name: partial(self._tell, name) for name in vars(self)}
        super().__init__(link, **callbacks, **options)

    def _tell(self, callback: str, *told: object) -> None:
        getattr(self, callback)(*told)
