"""Finds agents in the network: by multicast, or by asking given addresses (DDS-XRCE discovery over UDP).

A client sends GET_INFO to 239.255.0.2:7400; every agent that has discovery switched on (`msbot agent ... -d`) sends
back the addresses of its service. Seen on the wire with eProsima's agent, which answers in the same way.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Sequence

from msbot_xrce.errors import LinkDown, RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import (
    OBJECT_AGENT,
    REQUEST_DISCOVERY,
    SESSION_NONE,
    VERSION,
    GetInfo,
    Header,
    Info,
    LocatorFormat,
    decode_header,
    encode_message,
    iter_submessages,
)

_log = logging.getLogger(__name__)

MULTICAST = ("239.255.0.2", 7400)
"""The group and port that agents listen to by default."""

_LOOPBACK = "127.0.0.1"
_DATAGRAM_MAX = 2048
_PER_TURN = 64
"""Answers that are read in one turn of the loop; others have their turn in between."""
_CONFIGURATION_AND_ACTIVITY = 3


@dataclass(frozen=True, slots=True)
class FoundAgent:
    """An agent that has answered."""

    host: str
    """Where its answer came from."""
    addresses: tuple[tuple[str, int], ...]
    """Host and port of its service, one for each interface of its machine."""

    @property
    def address(self) -> tuple[str, int]:
        """The address to use: the one that answered, if its service listens there, else the first."""
        return next((address for address in self.addresses if address[0] == self.host), self.addresses[0])


async def find_agents(
    ask: Sequence[tuple[str, int]] = (MULTICAST,),
    *,
    enough: int | None = None,
    attempts: int = 3,
    period_s: float = 0.25,
    interface: str | None = None,
) -> list[FoundAgent]:
    """The agents that answer, in the order of their answers.

    Args:
        ask: groups or single hosts, IPv4, with the port on which their agents listen for GET_INFO.
        enough: stop waiting after this many answers; None = wait the full time.
        attempts: how often to ask.
        period_s: how long to wait for answers after each time.
        interface: IPv4 address of the one interface to ask on; by default this machine and the default interface.

    Raises:
        LinkDown: there is no network to ask on.
    """
    loop = asyncio.get_running_loop()
    search = _Search(enough)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        loop.add_reader(sock, search.drain, sock)
        try:
            for _ in range(attempts):
                _ask(sock, ask, interface)
                try:
                    async with asyncio.timeout(period_s):
                        await search.done.wait()
                    break
                except TimeoutError:
                    continue
        finally:
            loop.remove_reader(sock)
    return list(search.found.values())


def read_answer(packet: bytes, host: str) -> FoundAgent | None:
    """The agent in an answer from that host; None when the packet is something else, or of another version."""
    try:
        header = decode_header(packet)
        info = next(iter(iter_submessages(packet, header.size)), None)
    except RemoteProtocolError:
        return None
    if not isinstance(info, Info) or info.request_id != REQUEST_DISCOVERY or info.version != VERSION:
        return None
    addresses = []
    for locator in info.locators:
        if locator.format is LocatorFormat.MEDIUM:
            addresses.append((socket.inet_ntop(socket.AF_INET, locator.address), locator.port))
        elif locator.format is LocatorFormat.LARGE:
            addresses.append((socket.inet_ntop(socket.AF_INET6, locator.address), locator.port))
    return FoundAgent(host, tuple(addresses)) if addresses else None


class _Search:
    """What has come in so far."""

    def __init__(self, enough: int | None) -> None:
        self.found: dict[tuple[tuple[str, int], ...], FoundAgent] = {}
        self.done = asyncio.Event()
        self._enough = enough

    def drain(self, sock: socket.socket) -> None:
        """Take waiting answers; for the rest of them, the loop calls again."""
        for _ in range(_PER_TURN):
            try:
                packet, sender = sock.recvfrom(_DATAGRAM_MAX)
            except BlockingIOError:
                return
            except OSError as error:
                # Of an earlier question, or a socket that fails for good: then the search ends with its time.
                _log.debug("asked in vain: %s", error)
                return
            agent = read_answer(packet, sender[0])
            # An agent that is asked on several interfaces answers on each, with the same addresses.
            if agent is not None and agent.addresses not in self.found:
                self.found[agent.addresses] = agent
                if self._enough is not None and len(self.found) >= self._enough:
                    self.done.set()


def _ask(sock: socket.socket, targets: Sequence[tuple[str, int]], interface: str | None) -> None:
    """Send the question to every target; one that cannot be reached does not matter if another can."""
    info = GetInfo(REQUEST_DISCOVERY, OBJECT_AGENT, _CONFIGURATION_AND_ACTIVITY)
    question = encode_message(Header(SESSION_NONE), [info], pad_end=False)
    failure: OSError | None = None
    sent = 0
    for way in (_LOOPBACK, "0.0.0.0") if interface is None else (interface,):
        for target in targets:
            try:
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(way))
                sock.sendto(question, target)
                sent += 1
            except OSError as error:
                _log.debug("cannot ask %s on %s: %s", target, way, error)
                failure = error
    if failure is not None and not sent:
        raise LinkDown(
            f"nobody can be asked for an agent ({failure.strerror}): "
            "check the network and the interface, or name the agent's address"
        ) from failure
