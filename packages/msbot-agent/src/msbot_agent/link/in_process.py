"""A link inside one process: the master's own parts reach the agent through it.

Packets are handed over in the next turn of the event loop, in order, through bounded queues. Any number of client
ends attach to one server end. It works in virtual time.
"""

from __future__ import annotations

import asyncio

from msbot_agent.link.base import BaseLink
from msbot_agent.link.contract import LinkInfo, Peer, Signal
from msbot_xrce.errors import LinkDown, LinkFull

INPROC_MTU = 65535
QUEUE_PACKETS = 256
"""Packets that may wait from one end to another; beyond, `send` raises LinkFull."""

SERVER = 0
"""The server as its clients see it; the server sees them as 1, 2, 3, ..."""


class InprocHub:
    """One server end and the client ends that were made for it.

    Args:
        name: what it is called, where links are shown.
    """

    def __init__(self, name: str = "inproc") -> None:
        self.info = LinkInfo(name, INPROC_MTU, sparse_acknacks=True)
        """What both ends say of it."""
        self._open: dict[Peer, InprocEnd] = {}
        self._clients = 0
        self.server = InprocEnd(self, SERVER)
        """The end that all clients speak to."""

    def connect(self) -> InprocEnd:
        """A new client end; its `remote` is the server."""
        self._clients += 1
        return InprocEnd(self, self._clients)

    def opened(self, end: InprocEnd) -> None:
        """Note that an end has started to run: its partners get PEER_JOINED."""
        self._open[end.number] = end
        self._tell_partners(end, Signal.PEER_JOINED, "opened")

    def closed(self, end: InprocEnd) -> None:
        """Note that an end has stopped running: its partners get PEER_GONE, unless it was pulled."""
        if end.number in self._open:
            self._tell_partners(end, Signal.PEER_GONE, "closed")
            del self._open[end.number]

    def pulled(self, end: InprocEnd) -> None:
        """Note that an end is off the wire: its partners hear nothing, as after a pulled cable."""
        self._open.pop(end.number, None)

    def partner(self, end: InprocEnd, peer: Peer) -> InprocEnd | None:
        """The running end that `end` knows as `peer`; clients only see the server."""
        are_joined = SERVER in (end.number, peer) and end.number != peer and end.number in self._open
        return self._open.get(peer) if are_joined else None

    def _tell_partners(self, end: InprocEnd, signal: Signal, words: str) -> None:
        for number in list(self._open):
            if partner := self.partner(end, number):
                partner.notice(signal, end.number, words)


class InprocEnd(BaseLink):
    """One end of an in-process link; satisfies `Link`. Made by `InprocHub`.

    Signals are LINK_UP and LINK_DOWN of this end, PEER_JOINED and PEER_GONE of its partners.
    """

    def __init__(self, hub: InprocHub, number: int) -> None:
        super().__init__(hub.info, remote=None if number == SERVER else SERVER)
        self.number = number
        """What its partners call this end."""
        self._hub = hub
        self._loop: asyncio.AbstractEventLoop | None = None
        self._queues: dict[Peer, list[bytes]] = {}

    def has_room(self, peer: Peer) -> bool:
        """Whether `send` to that peer would succeed now."""
        return self._loop is not None and len(self._queues.get(peer, ())) < QUEUE_PACKETS

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet for the next turn of the loop; a packet to an absent peer is dropped and counted.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: this end is not running.
        """
        if self._loop is None:
            raise LinkDown("the in-process link is not open: start its run() first")
        if self._hub.partner(self, peer) is None:
            self.counters.dropped.count("nobody at the other end")
            return
        queue = self._queues.get(peer)
        if queue is None:
            self._queues[peer] = [packet]
            self._loop.call_soon(self._deliver, peer)
        elif len(queue) >= QUEUE_PACKETS:
            raise LinkFull(f"{QUEUE_PACKETS} packets wait for {self.describe(peer)}")
        else:
            queue.append(packet)
        self._sent(packet, peer, self._loop.time())

    def describe(self, peer: Peer) -> str:
        """`in-process server` or `in-process client 3`."""
        return "in-process server" if peer == SERVER else f"in-process client {peer}"

    def pull(self) -> None:
        """Take this end off the wire before its `run` is cancelled: no more packets, and no PEER_GONE."""
        self._hub.pulled(self)

    async def run(self) -> None:
        """Serve until cancelled; it may run again afterwards."""
        self._loop = asyncio.get_running_loop()
        self.notice(Signal.LINK_UP, None, "opened")
        self._hub.opened(self)
        try:
            await self._loop.create_future()
        finally:
            self._hub.closed(self)
            self.notice(Signal.LINK_DOWN, None, "closed")
            self._queues.clear()
            self._loop = None

    def notice(self, signal: Signal, peer: Peer | None, words: str) -> None:
        """Pass a signal on to the owner of this end."""
        if self._loop is not None:
            self._signal_handler(signal, peer, words, self._loop.time())

    def receive(self, packet: bytes, peer: Peer) -> None:
        """Take one packet from a partner."""
        if self._loop is not None:
            self._received(packet, peer, self._loop.time())

    def _deliver(self, peer: Peer) -> None:
        # All taken out at once: packets that the handlers send in the meantime belong to the next turn.
        queue = self._queues.pop(peer, None)
        partner = self._hub.partner(self, peer)
        if queue is None:
            return
        for packet in queue:
            if partner is None:
                self.counters.dropped.count("nobody at the other end")
            else:
                partner.receive(packet, self.number)
        if len(queue) >= QUEUE_PACKETS:
            self._room_handler(peer)


def inproc_pair() -> tuple[InprocEnd, InprocEnd]:
    """A server end and one client end, joined; both still have to `run`."""
    hub = InprocHub()
    return hub.server, hub.connect()
