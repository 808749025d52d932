"""One part, several masters of which one serves: `udp:192.168.1.20:8888,udp:192.168.1.21:8888`.

The part speaks to one of them at a time and hears no other: a master that was frozen and thaws speaks to the wind. When
what it sends has no answer for `PATIENCE_S`, it tries the others in turn, for `TRY_S` each, until one answers; one
where nobody listens is left at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Final

from msbot_agent.link.base import BaseLink
from msbot_agent.link.contract import Link, LinkInfo, Peer, Signal
from msbot_agent.link.net.udp import NOBODY_LISTENS
from msbot_xrce.errors import ConfigError, LinkDown

PATIENCE_S: Final = 2.2
"""Time without an answer from a master that has answered before; a part beats once a second and is answered."""
TRY_S: Final = 0.4
"""The same for one that has not answered yet."""
LOOK_S: Final = 0.1
REOPEN_S: Final = 1.0
ANOTHER: Final = "packet from another master than the one in use"

MASTER: Final = 0
"""The only peer."""


class FailoverLink(BaseLink):
    """The part's side of several links, of which one is in use; satisfies `Link`.

    Args:
        links: links with one peer each, two at least.

    Raises:
        ConfigError: one of them is a bus, whose master is found by itself.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        name = ",".join(link.info.name for link in links)
        if any(link.info.shared_bus for link in links):
            raise ConfigError(f"link {name!r}: a bus has one master at a time, and parts find it by themselves")
        mtu, is_sparse = min(link.info.mtu for link in links), all(link.info.sparse_acknacks for link in links)
        super().__init__(LinkInfo(name, mtu, sparse_acknacks=is_sparse), remote=MASTER)
        self._links = tuple(links)
        self._current = 0
        self._is_up = [False] * len(links)
        self._waits_since: float | None = None
        self._has_answered = False
        self._refused_before = 0
        for number, link in enumerate(self._links):
            link.attach(
                packet=partial(self._packet_received, number),
                signal=partial(self._signal_received, number),
                room=partial(self._room_gained, number),
            )

    @property
    def in_use(self) -> Link:
        """The link that leads to the master that it speaks to."""
        return self._links[self._current]

    def has_room(self, peer: Peer) -> bool:
        """See `Link`."""
        link = self.in_use
        return peer == MASTER and link.remote is not None and link.has_room(link.remote)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the queue of the link in use is full.
            LinkDown: it is not open, or that is not its peer.
        """
        link = self.in_use
        if peer != MASTER or link.remote is None:
            raise LinkDown(f"a part talks to the master ({MASTER}) only, not to {peer}")
        now = asyncio.get_running_loop().time()
        if self._waits_since is None:
            self._waits_since = now
        link.send(packet, link.remote)
        self._sent(packet, peer, now)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return f"the master at {self.in_use.info.name}" if peer == MASTER else f"nobody ({peer})"

    async def run(self) -> None:
        """See `Link`; a link that cannot be opened is tried again, as long as another one is open.

        Raises:
            LinkDown: none of them can be opened.
        """
        failures: dict[int, LinkDown] = {}
        tasks = [asyncio.ensure_future(self._keep(number, failures)) for number in range(len(self._links))]
        try:
            while True:
                await asyncio.sleep(LOOK_S)
                if len(failures) == len(self._links) and not any(self._is_up):
                    raise next(iter(failures.values()))
                self._look(asyncio.get_running_loop().time())
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _keep(self, number: int, failures: dict[int, LinkDown]) -> None:
        while True:
            try:
                await self._links[number].run()
            except LinkDown as error:
                failures[number] = error
            await asyncio.sleep(REOPEN_S)
            failures.pop(number, None)

    def _look(self, now: float) -> None:
        patience_s = PATIENCE_S if self._has_answered else TRY_S
        refused = self.in_use.counters.dropped.get(NOBODY_LISTENS, 0)
        if refused != self._refused_before:
            self._move_on(f"nobody listens at {self.in_use.info.name}", now)
        elif self._waits_since is not None and now - self._waits_since > patience_s:
            self._move_on(f"no answer from {self.in_use.info.name} for {patience_s:g} s", now)

    def _move_on(self, reason: str, now: float) -> None:
        """Use the next link that is open."""
        count = len(self._links)
        others = [(self._current + step) % count for step in range(1, count)]
        number = next((other for other in others if self._is_up[other]), None)
        self._waits_since = None
        if number is not None:
            self._current = number
        self._refused_before = self.in_use.counters.dropped.get(NOBODY_LISTENS, 0)
        if number is None:
            return
        if self._has_answered:
            self._has_answered = False
            self._signal_handler(Signal.LINK_DOWN, MASTER, reason, now)
        self._signal_handler(Signal.LINK_UP, MASTER, self.in_use.info.name, now)

    def _packet_received(self, number: int, packet: bytes, peer: Peer, now: float) -> None:  # noqa: ARG002
        if number != self._current:
            self.counters.dropped.count(ANOTHER)
            return
        self._waits_since = None
        self._has_answered = True
        self._received(packet, MASTER, now)

    def _signal_received(self, number: int, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        is_first = not any(self._is_up)
        if signal is Signal.LINK_UP:
            self._is_up[number] = True
            if is_first:
                self._current = number
            if number == self._current:
                self._signal_handler(signal, MASTER, self.in_use.info.name, now)
        elif signal is Signal.LINK_DOWN:
            self._is_up[number] = False
            if number == self._current:
                self._move_on(reason, now)
                if not any(self._is_up):
                    self._signal_handler(signal, MASTER, reason, now)
        elif number == self._current and signal is Signal.STOP:
            self._signal_handler(signal, peer, reason, now)

    def _room_gained(self, number: int, _: Peer | None) -> None:
        if number == self._current:
            self._room_handler(None)
