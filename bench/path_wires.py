"""What `bench/path.py` sends packets through: a link in memory, or a UDP link with sockets of clients on this computer.

Both are worked by hand, a burst at a time, so that only the agent's own time is counted.
"""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import Sequence

from msbot_agent.link import BaseLink, LinkInfo, Peer
from msbot_agent.link.net import UdpServerLink

LARGEST = 2048


class Wire(BaseLink):
    """A link in memory; satisfies `Link`."""

    def __init__(self) -> None:
        super().__init__(LinkInfo("memory:", 512, in_bursts=True))
        self._out: list[tuple[bytes, Peer]] = []
        self._handed_in: Sequence[tuple[bytes, Peer]] = ()

    async def opened(self) -> None:
        """Wait until the agent serves it."""
        await asyncio.sleep(0)

    def hand_in(self, packets: list[bytes], sender: int) -> None:
        """Packets of a client that wait for the agent."""
        self.hand_in_all([(packet, sender) for packet in packets])

    def hand_in_all(self, packets: Sequence[tuple[bytes, int]]) -> None:
        """Packets of several clients that wait for the agent, with their senders."""
        self._handed_in = packets

    def work(self, now: float) -> None:
        """What the agent does with all that waits."""
        receive = self._packet_handler
        for packet, sender in self._handed_in:
            receive(packet, sender, now)
        self._burst_end_handler()
        self._handed_in = ()

    def has_room(self, peer: Peer) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always."""
        return True

    def send(self, packet: bytes, peer: Peer) -> None:
        """Keep it."""
        self._out.append((packet, peer))

    def take(self) -> list[tuple[bytes, Peer]]:
        """What was sent since the last call."""
        sent, self._out = self._out, []
        return sent

    def describe(self, peer: Peer) -> str:
        """Its number."""
        return str(peer)

    async def run(self) -> None:
        """For ever."""
        await asyncio.get_running_loop().create_future()


class SocketWire(UdpServerLink):
    """The agent's UDP link, and a socket for each client; what is sent on this computer is there at once."""

    def __init__(self) -> None:
        super().__init__("127.0.0.1", 0, linger_s=0.0)  # nothing comes while the agent works: it would wait in vain
        self._clients: dict[int, socket.socket] = {}
        self._poll = select.epoll()
        self._is_open = asyncio.Event()

    async def opened(self) -> None:
        """Wait until the agent serves it."""
        await self._is_open.wait()
        assert self._socket is not None
        self._poll.register(self._socket, select.EPOLLIN)

    async def _open(self, loop: asyncio.AbstractEventLoop) -> socket.socket:
        opened = await super()._open(loop)
        self._is_open.set()
        return opened

    def hand_in(self, packets: list[bytes], sender: int) -> None:
        """Packets of a client that wait for the agent."""
        self.hand_in_all([(packet, sender) for packet in packets])

    def hand_in_all(self, packets: Sequence[tuple[bytes, int]]) -> None:
        """Packets of several clients that wait for the agent, with their senders."""
        for packet, sender in packets:
            if sender not in self._clients:
                client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                client.connect(("127.0.0.1", self.port))
                client.setblocking(False)
                self._clients[sender] = client
            self._clients[sender].send(packet)

    def work(self, now: float) -> None:  # noqa: ARG002 - it asks the loop's clock, as in a robot
        """What the agent does with all that waits."""
        assert self._socket is not None
        assert self._loop is not None
        if self._poll.poll(0):
            self._drain(self._socket, self._loop)

    def take(self) -> list[tuple[bytes, Peer]]:
        """What was sent since the last call."""
        found: list[tuple[bytes, Peer]] = []
        for key, client in self._clients.items():
            try:
                while True:
                    found.append((client.recv(LARGEST), key))
            except BlockingIOError:
                pass
        return found
