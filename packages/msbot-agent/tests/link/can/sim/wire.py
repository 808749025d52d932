"""A transport without a socket, so that both ends of a simulated bus' protocol can be tried in virtual time."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any

from msbot_agent.link.can.sim.model.sim_bus_messages import Message, Splitter


@dataclass
class Options:
    """A socket that only takes options."""

    set: list[tuple[int, int, int]] = field(default_factory=list)

    def setsockopt(self, level: int, option: int, value: int) -> None:
        self.set.append((level, option, value))


class Wire(asyncio.Transport):
    """Keeps what is written."""

    def __init__(self) -> None:
        super().__init__()
        self.options = Options()
        self.ended = ""
        self.reads = True
        self.most: int | None = None
        self._splitter = Splitter()
        self._said: list[Message] = []

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return self.options if name == "socket" else default

    def write(self, data: Any) -> None:
        assert not self.ended, "nothing is said behind the end"
        self._said += self._splitter.receive(bytes(data))

    def said(self) -> list[Message]:
        """What has been written since the last look."""
        said, self._said = self._said, []
        return said

    def close(self) -> None:
        self.ended = self.ended or "closed"

    def abort(self) -> None:
        self.ended = "aborted"

    def is_closing(self) -> bool:
        return bool(self.ended)

    def pause_reading(self) -> None:
        self.reads = False

    def resume_reading(self) -> None:
        assert not self.ended
        self.reads = True

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        assert low is None
        self.most = high
