"""Answers clients that look for an agent by multicast (DDS-XRCE discovery over UDP).

A client sends GET_INFO to 239.255.0.2:7400. The answer comes from the same port, by unicast: an INFO with the addresses
and the port of the agent's UDP service. Asking the discovery port directly works as well.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import struct
import time
from collections.abc import Callable, Sequence
from functools import partial

from msbot_agent.pace import SteadyRate
from msbot_agent.text.untrusted_input import read_system_file
from msbot_xrce.errors import LinkDown, RemoteProtocolError
from msbot_xrce.messages import (
    SESSION_NONE,
    GetInfo,
    Header,
    Info,
    Locator,
    LocatorFormat,
    decode_header,
    encode_message,
    iter_submessages,
)

logger = logging.getLogger(__name__)

DISCOVERY_GROUP = "239.255.0.2"
DISCOVERY_PORT = 7400

_PER_TURN = 32
"""Requests read before others get their turn."""
_DATAGRAM_MAX = 2048
ANSWERS_PER_S, ANSWERS_AT_ONCE = 5.0, 40.0
"""To another computer: an answer is longer than its question, and whoever asks may have forged the address."""
LOOK_AGAIN_S = 10.0
"""How often it is looked for interfaces that have come up: a network adapter may be plugged in later."""
_NO_ADDRESS = "0.0.0.0"  # noqa: S104 - whom a packet comes from, not where to listen
_LOOPBACK = "127."
_ONLY_JOINED_GROUPS = 49
"""IP_MULTICAST_ALL of Linux, which the socket module does not name: when set to 0, a socket hears only its own
groups."""
_ADDRESS_OF_INTERFACE = 0x8915
"""SIOCGIFADDR of Linux."""
_PACKET_INFO = 8
"""IP_PKTINFO of Linux: with each packet comes the address of the interface by which it came."""
_ANCILLARY_MAX = 64


def discovery_answer(packet: bytes, addresses: Callable[[], Sequence[str]], service_port: int) -> bytes | None:
    """The INFO for a discovery request, or None when the packet is something else, or there is nothing to tell.

    Args:
        packet: the packet that came in on the discovery port.
        addresses: returns the addresses at which the agent serves, IPv4 or IPv6; called for valid requests only.
        service_port: its UDP port.
    """
    try:
        header = decode_header(packet)
        request = next(iter(iter_submessages(packet, header.size)), None)
    except RemoteProtocolError:
        return None
    if header.session_id != SESSION_NONE or not isinstance(request, GetInfo):
        return None
    locators = tuple(_locator(address, service_port) for address in addresses())
    if not locators:
        return None
    info = Info(request.request_id, request.object_id, locators=locators)
    return encode_message(Header(SESSION_NONE), [info], pad_end=False)


def _locator(address: str, port: int) -> Locator:
    if ":" in address:
        return Locator(LocatorFormat.LARGE, socket.inet_pton(socket.AF_INET6, address), port)
    return Locator(LocatorFormat.MEDIUM, socket.inet_aton(address), port)


def _came_in_at(ancillary: Sequence[tuple[int, int, bytes]]) -> str | None:
    """Our address on the interface by which a packet came; None: the system does not say."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.IPPROTO_IP, _PACKET_INFO) and len(data) >= 8:
            return socket.inet_ntoa(data[4:8])
    return None


def host_ipv6_addresses() -> list[str]:
    """The IPv6 addresses of this machine without link-local ones; loopback if it has no other."""
    try:
        lines = read_system_file("/proc/net/if_inet6").splitlines()
        found = [socket.inet_ntop(socket.AF_INET6, bytes.fromhex(line.split()[0])) for line in lines]
    except OSError:  # not Linux
        found = [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET6)]
    return [address for address in found if not address.startswith("fe80")] or ["::1"]


def host_addresses() -> list[str]:
    """The IPv4 addresses of this machine's interfaces, loopback included; loopback alone where the system does not
    tell."""
    try:
        import fcntl
    except ImportError:
        return sorted({"127.0.0.1", *socket.gethostbyname_ex(socket.gethostname())[2]})
    addresses = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            request = struct.pack("256s", name.encode()[:15])
            try:
                answer = fcntl.ioctl(probe.fileno(), _ADDRESS_OF_INTERFACE, request)
            except OSError:
                logger.debug("interface %s has no IPv4 address", name)
            else:
                addresses.append(socket.inet_ntoa(answer[20:24]))
    return addresses or ["127.0.0.1"]


class DiscoveryResponder:
    """Tells clients that look for an agent where this one is."""

    def __init__(
        self,
        service_port: int,
        *,
        port: int = DISCOVERY_PORT,
        group: str = DISCOVERY_GROUP,
        interface: str | None = None,
        told: Callable[[], Sequence[str]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Answer for the service on that UDP port.

        Args:
            service_port: where the agent serves clients.
            port: where clients look for it; 0 = any free port (see `address`).
            group: multicast group that clients ask.
            interface: IPv4 address of the one interface to announce, whose network is answered; all if absent. Programs
                of this machine are answered by whatever interface they ask; with a loopback address nobody else is.
            told: returns the addresses to announce; those of the interfaces if absent. An agent on IPv6 is also asked
                over IPv4, like the genuine one, and announces IPv6 addresses.
            clock: seconds.
        """
        self._service_port = service_port
        self._port = port
        self._group = group
        self._interface = interface
        self._told = told
        self._clock = clock
        self._pace = SteadyRate(ANSWERS_PER_S, ANSWERS_AT_ONCE)
        self._is_local = interface is not None and interface.startswith(_LOOPBACK)
        self.address: tuple[str, int] | None = None
        """Where it listens, once it runs."""
        self.answers = 0
        """Requests answered so far."""
        self.left_out = 0
        """Requests of computers that had asked too often."""

    async def run(self) -> None:
        """Answer until cancelled.

        Raises:
            LinkDown: the port or the group cannot be used; the text says why.
        """
        sock = self._open()
        loop = asyncio.get_running_loop()
        try:
            self.address = sock.getsockname()
            loop.add_reader(sock, self._drain, sock)
            while True:
                await asyncio.sleep(LOOK_AGAIN_S)
                self._join_group(sock)
        finally:
            loop.remove_reader(sock)
            sock.close()
            self.address = None

    def _open(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(("", self._port))
            failure = self._join_group(sock)
            if failure is not None:
                raise failure
        except OSError as error:
            sock.close()
            raise LinkDown(
                f"discovery on {self._group}:{self._port} is not possible ({error.strerror}): "
                "choose another port, name an interface that is up, or serve without discovery"
            ) from error
        try:
            sock.setsockopt(socket.IPPROTO_IP, _PACKET_INFO, 1)
            sock.setsockopt(socket.IPPROTO_IP, _ONLY_JOINED_GROUPS, 0)
        except OSError:
            logger.debug("this system has no IP_PKTINFO or no IP_MULTICAST_ALL")
        return sock

    def _join_group(self, sock: socket.socket) -> OSError | None:
        """Join the group on every interface where it is not joined yet.

        Returns:
            Why it is not possible. One interface that cannot (it is down) does not matter if another can, unless it is
            the one that is served.
        """
        failure: OSError | None = None
        joined = 0
        # A client of this computer asks by whichever interface its system chooses, also where another one is served.
        addresses = dict.fromkeys([*self._addresses(), *host_addresses()])
        for address in addresses:
            member = socket.inet_aton(self._group) + socket.inet_aton(address)
            try:
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
                joined += 1
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    joined += 1
                    continue
                logger.debug("no discovery on the interface of %s: %s", address, error)
                failure = error
                if address == self._interface and not self._is_local:
                    return error
        return None if joined else failure

    def _addresses(self) -> list[str]:
        return [self._interface] if self._interface else host_addresses()

    def _is_from_here(self, address: str) -> bool:
        """Whether a program of this computer asks: from any of its addresses, or before it has one."""
        return address.startswith(_LOOPBACK) or address == _NO_ADDRESS or address in host_addresses()

    def _told_to(self, sender: str, at: str | None) -> list[str]:
        """The addresses to announce to somebody whose question came in at one of ours; none: it gets no answer."""
        is_here = self._is_from_here(sender)
        if not is_here and (self._is_local or (self._interface is not None and at not in (None, self._interface))):
            return []
        if self._told is not None:
            return list(self._told())
        addresses = self._addresses()
        if is_here:
            return addresses
        # DEVIATION: the genuine agent begins with loopback, and a board that takes the first address finds nobody.
        reachable = [address for address in addresses if not address.startswith(_LOOPBACK)]
        return sorted(reachable, key=lambda address: address != at)

    def _drain(self, sock: socket.socket) -> None:
        for _ in range(_PER_TURN):
            try:
                packet, ancillary, _, sender = sock.recvmsg(_DATAGRAM_MAX, _ANCILLARY_MAX)
            except BlockingIOError:
                return
            except OSError as error:  # of an earlier answer, or an interface that is down: the next request may come
                logger.debug("no discovery request could be read: %s", error)
                return
            is_too_often = self._pace.wait_s(sender[0], self._clock()) > 0.0
            if is_too_often and not sender[0].startswith(_LOOPBACK):
                if not self.left_out:
                    logger.warning("%s looks for an agent too often: not every question is answered", sender[0])
                self.left_out += 1
                continue
            told = partial(self._told_to, sender[0], _came_in_at(ancillary))
            if (answer := discovery_answer(packet, told, self._service_port)) is None:
                logger.debug("no discovery request from %s", sender)
                continue
            try:
                sock.sendto(answer, sender)
                self._pace.note(sender[0], self._clock())
                self.answers += 1
            except OSError as error:
                logger.debug("discovery answer to %s not sent: %s", sender, error)
