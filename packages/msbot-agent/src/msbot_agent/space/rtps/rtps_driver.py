"""Carries a participant's datagrams: two UDP sockets and a timer on the event loop."""

from __future__ import annotations

import asyncio
import math
import secrets
import socket
import time
from collections.abc import Collection

from msbot_agent.space.rtps.descriptions import Address
from msbot_agent.space.rtps.participant import RtpsParticipant
from msbot_agent.space.rtps.rtps_messages import VENDOR, Prefix

GROUP = "239.255.0.1"
MOST_INDICES = 100
"""Participants on one computer that others find without multicast."""
TRIED_INDICES = 32
"""Ports of other participants of this computer that are told where there is no network."""
MOST_AT_ONCE = 128
"""Datagrams that are read in one turn of the loop."""
LARGEST = 65536
RECEIVE_BUFFER = 1 << 20


class RtpsDriver:
    """A participant in one domain. Must be made on the event loop; `close` ends it."""

    def __init__(
        self,
        domain: int,
        addresses: tuple[str, ...],
        *,
        is_local: bool,
        peers: tuple[str, ...] = (),
        strangers: Collection[Prefix] = (),
    ) -> None:
        """Begin to announce a participant.

        Args:
            domain: the DDS domain.
            addresses: IPv4 addresses of this computer on which others reach it.
            is_local: no other computer can reach it.
            peers: computers that are told by address.
            strangers: participants of this process, which it does not listen to.
        """
        self._loop = asyncio.get_running_loop()
        port = 7400 + 250 * domain
        self._addresses = addresses
        self._unicast, own_port = _open_unicast(addresses[0] if len(addresses) == 1 else "", port + 10)
        self._multicast = _open_multicast(port, addresses)
        self._group: Address = (GROUP, port)
        tried = [*peers, *(["127.0.0.1"] if is_local else [])]
        self.participant = RtpsParticipant(
            VENDOR + secrets.token_bytes(10),
            addresses=tuple((address, own_port) for address in addresses),
            group=self._group,
            peers=tuple((peer, port + 10 + 2 * index) for peer in tried for index in range(TRIED_INDICES)),
            now=self._loop.time(),
            strangers=strangers,
            epoch_ns=time.time_ns,
        )
        self._timer: asyncio.TimerHandle | None = None
        self._transports: list[asyncio.Task[object]] = []
        for one in (self._unicast, self._multicast):
            if one is not None:
                self._listen(one)
        self._tick()

    def now(self) -> float:
        """The participant's time."""
        return self._loop.time()

    def flush(self) -> None:
        """Send what waits, and see to it that the participant gets its time."""
        outbox = self.participant.outbox
        for datagram, address in outbox:
            try:
                if address == self._group:
                    self._to_group(datagram)
                else:
                    self._unicast.sendto(datagram, address)
            except OSError as error:  # the network has gone, or there is no room: what is lost is asked for again
                self.participant.dropped.count(f"not sent: {error.strerror}")
        outbox.clear()
        due = self.participant.deadline()
        if due < math.inf and (self._timer is None or due < self._timer.when()):
            if self._timer is not None:
                self._timer.cancel()
            self._timer = self._loop.call_at(due, self._tick)

    def close(self) -> None:
        """Tell the others that it is gone."""
        self.participant.leave()
        self.flush()
        if self._timer is not None:
            self._timer.cancel()
        for task in self._transports:
            task.cancel()
        for one in (self._unicast, self._multicast):
            if one is not None:
                if not self._transports:
                    self._loop.remove_reader(one)
                one.close()

    def _tick(self) -> None:
        self._timer = None
        self.participant.tick(self._loop.time())
        self.flush()

    def _to_group(self, datagram: bytes) -> None:
        for address in self._addresses:
            self._unicast.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
            self._unicast.sendto(datagram, self._group)

    def _listen(self, one: socket.socket) -> None:
        try:
            self._loop.add_reader(one, self._read, one)
        except NotImplementedError:  # Windows
            made = self._loop.create_datagram_endpoint(lambda: _Protocol(self), sock=one)
            self._transports.append(self._loop.create_task(made))

    def _read(self, one: socket.socket) -> None:
        for _ in range(MOST_AT_ONCE):
            try:
                datagram, source = one.recvfrom(LARGEST)
            except BlockingIOError:
                break
            except OSError:
                continue  # a peer's port is closed: ICMP says so here
            self.participant.receive(datagram, source[:2], self._loop.time())
        self.flush()

    def received(self, datagram: bytes, source: Address) -> None:
        """A datagram has come where the loop reads it itself."""
        self.participant.receive(datagram, source[:2], self._loop.time())
        self.flush()


class _Protocol(asyncio.DatagramProtocol):
    def __init__(self, driver: RtpsDriver) -> None:
        self._driver = driver

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._driver.received(data, addr)


def _open_unicast(address: str, first: int) -> tuple[socket.socket, int]:
    """A socket on the first free port of those where others look, else on any."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    for port in (*range(first, first + 2 * MOST_INDICES, 2), 0):
        try:
            made.bind((address, port))
        except OSError:
            if port == 0:
                made.close()
                raise
        else:
            break
    return made, int(made.getsockname()[1])


def _open_multicast(port: int, addresses: tuple[str, ...]) -> socket.socket | None:
    """A socket that hears the group; None where that is not possible: then others are found by their addresses."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "SO_REUSEPORT"):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        made.bind(("", port))
    except OSError:
        made.close()
        return None
    for address in addresses:
        try:
            made.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + socket.inet_aton(address)
            )
        except OSError:
            continue  # an interface without multicast
    return made
