"""Keeps a flood of strangers away from a UDP socket: in the kernel, before it takes room in the socket's buffer.

While there is a flood (`msbot_agent.link.net.stranger_filter`), a filter of classic BPF, which needs no privileges, is
attached to the socket. It lets the datagrams of known peers through, and those of the strangers whose turn it is. What
is not let through costs some hundred nanoseconds, and cannot push a known peer's datagrams out of the buffer. Where the
system has no such filters, what a stranger sends is dropped here, after it was read.
"""

from __future__ import annotations

import asyncio
import ctypes
import errno
import logging
import math
import socket
import struct
import sys
from collections.abc import Hashable
from ipaddress import IPv4Address, IPv6Address, ip_address

from msbot_agent.link.contract import Peer, PeerDirectory
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

# When a socket's strangers send more than can be read, and which of them are heard then. Pure: time is handed in.
#
# How it works. Who has a session is known, and is always heard. The datagrams of everybody else are counted a few times
# a second. While they are few, all are read. More than `FLOOD_PER_S` of them are a flood, and from then on
#
# * strangers are heard in turns: a hash of the address (without the port: a client may ask from ever new ones) puts
#   each of them into one of several groups, and each group has its turn of `TURN_S`, one after the other. There are
#   as many groups as it takes for a turn to bring no more than `READ_PER_S`. So a newcomer waits for one round of
#   turns at most, from however many addresses the flood comes;
# * should a turn bring more all the same, because few addresses send most, only a part of it is read, by chance;
# * of what is read, only an address that was heard before, `AGAIN_S` ago or earlier, is answered: clients ask again,
#   and a flood from ever new addresses does not.
#
# The groups and the chance are what a filter in the kernel can decide, where a datagram costs least
# (`msbot_agent.link.net.stranger_filter`). When fewer than `CALM_PER_S` have come for `CALM_S`, it is over.


LOOK_S = 0.25
"""Time between two looks at the counts."""
FLOOD_PER_S = 1500.0
"""Datagrams of strangers a second that are a flood; a thousand parts that are switched on at once send fewer."""
CALM_PER_S = 500.0
CALM_S = 2.0
READ_PER_S = 3000.0
"""Datagrams of strangers a second that are read during a flood; one that is not answered costs some microseconds."""
TURN_S = 2.25
"""As long as two attempts of a micro-ROS client to log in, which are a second apart, and its first answers."""
MOST_TURNS = 16
CHANCES = 256
"""A chance is so many of these."""
AGAIN_S = 0.03
"""A flood that sends everything twice shall not pass."""
MOST_HEARD = 16384
"""Addresses that are remembered as heard; then those heard longest ago are forgotten, half of them at once."""


@dataclass(frozen=True, slots=True)
class StrangersHeard:
    """Which strangers are heard now."""

    turns: int
    """Groups of addresses."""
    turn: int
    """The group that is heard, counted from 0."""
    chance: int
    """Of `CHANCES` datagrams of that group, so many are read."""


class FloodWatch:
    """When a socket's strangers send more than can be read, and who is heard then. Pure: time is handed in."""

    def __init__(self) -> None:
        self.admission: StrangersHeard | None = None
        """Who is heard; None: everybody, it is calm."""
        self.per_s = 0.0
        """How many datagrams a second came from strangers at the latest look."""
        self._looked_at: float | None = None
        self._turn_ends_at = 0.0
        self._calm_since: float | None = None
        self._usual = 0.0
        """The rate of the flood, smoothed: what comes in differs from turn to turn."""
        self._heard: dict[Hashable, float] = {}
        self._heard_before: dict[Hashable, float] = {}

    def update(self, read: int, dropped: int, now: float) -> StrangersHeard | None:
        """Take the counts since the last look into account; returns who is heard from now on.

        Args:
            read: datagrams of strangers that were read.
            dropped: those that the kernel has dropped.
            now: seconds.
        """
        since, self._looked_at = self._looked_at, now
        if since is None or now <= since:
            return self.admission
        self.per_s = (read + dropped) / (now - since)
        if self.admission is None:
            if self.per_s > FLOOD_PER_S:
                self._usual, self._calm_since = self.per_s, None
                self._begin_turn(0, now)
            return self.admission
        self._usual += (self.per_s - self._usual) / 4
        if self._is_over(now):
            self.admission = None
            self._heard, self._heard_before = {}, {}
        elif now >= self._turn_ends_at:
            self._begin_turn(self.admission.turn + 1, now)
        else:
            self._bound(read / (now - since))
        return self.admission

    def answers(self, origin: Hashable, now: float) -> bool:
        """Whether what a stranger at that address has sent during a flood, and was read, is answered."""
        at = self._heard.get(origin)
        if at is None:
            at = self._heard_before.get(origin)
            if len(self._heard) >= MOST_HEARD // 2:
                self._heard, self._heard_before = {}, self._heard
            self._heard[origin] = now if at is None else at
        return at is not None and now - at >= AGAIN_S

    def _begin_turn(self, turn: int, now: float) -> None:
        turns = min(MOST_TURNS, max(2, math.ceil(self._usual / READ_PER_S)))
        self.admission = StrangersHeard(turns, turn % turns, CHANCES)
        self._turn_ends_at = now + TURN_S

    def _bound(self, read_per_s: float) -> None:
        """Read less of this turn if it brings too much."""
        admission = self.admission
        assert admission is not None
        if read_per_s > 1.5 * READ_PER_S:
            chance = max(1, int(admission.chance * READ_PER_S / read_per_s))
            self.admission = StrangersHeard(admission.turns, admission.turn, chance)

    def _is_over(self, now: float) -> bool:
        if self.per_s >= CALM_PER_S:
            self._calm_since = None
            return False
        if self._calm_since is None:
            self._calm_since = now
        return now - self._calm_since >= CALM_S


NOT_READ = "datagram of a stranger during a flood: not read"
NOT_ANSWERED = "datagram of a stranger during a flood: not answered at once"
MOST_KNOWN = 800
"""Known peers that the filter lets through."""
FEW_KNOWN = 200
"""Where the kernel has little memory for filters (net.core.optmem_max)."""
LONGEST_PROGRAM = 4096
"""Instructions that Linux takes (BPF_MAXINSNS)."""
TOLD_S = 60.0

_SALT = 0x9E3779B1
_ATTACH, _DETACH, _MEMINFO, _DROPS = 26, 27, 55, 8
"""SO_ATTACH_FILTER, SO_DETACH_FILTER, SO_MEMINFO, and SK_MEMINFO_DROPS of linux/sock_diag.h."""
_NETWORK, _RANDOM = 0xFFF00000, 0xFFFFF000 + 56
"""Where the header of IP begins (SKF_NET_OFF), and a random number (SKF_AD_OFF + SKF_AD_RANDOM)."""
_WORD, _HALF, _OCTET = 0x20, 0x28, 0x30
_EQUAL, _AT_LEAST, _JUMP, _RETURN = 0x15, 0x35, 0x05, 0x06
_AND, _SHIFT, _MULTIPLY, _MODULO, _XOR_X, _TO_X = 0x54, 0x74, 0x24, 0x94, 0xAC, 0x07
_WHOLE = 0xFFFFFFFF
_PORT = 0
"""A filter of UDP begins at its header, with the sender's port."""

_log = logging.getLogger(__name__)

_Ports = dict[IPv4Address | IPv6Address, list[int]]
Instruction = tuple[int, int, int, int]
"""Code, how many to skip if true, if not, value."""


class StrangerFilter:
    """See the module's docstring.

    Args:
        opened: a socket of UDP.
        name: the link's name, for the log.
        known: who the link's owner knows.
        dropped: where what is not read is counted.
    """

    def __init__(self, opened: socket.socket, name: str, known: PeerDirectory, dropped: Tally) -> None:
        self.next_at = 0.0
        """When `update` is to be called."""
        self._socket = opened
        self._name = name
        self._known = known
        self._dropped = dropped
        self._watch = FloodWatch()
        self._read = 0
        self._strangers = known.stranger_count
        self._drops = _drops(opened)
        self._set: tuple[StrangersHeard, tuple[Peer, ...]] | None = None
        self._told_at: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_on(self) -> bool:
        """Whether there is a flood, and `takes` decides."""
        return self._watch.admission is not None

    def update(self, now: float) -> None:
        """Look at the counts, and set the filter accordingly."""
        was_on = self.is_on
        heard, self._strangers = self._known.stranger_count - self._strangers, self._known.stranger_count
        drops = _drops(self._socket)
        # While it is calm, the kernel drops only what a full buffer has no room for, whoever has sent it.
        dropped = (drops - self._drops) & _WHOLE if was_on else 0
        read, self._read, self._drops = self._read if was_on else heard, 0, drops
        if dropped:
            self._dropped.count(NOT_READ, dropped)
        admission = self._watch.update(read, dropped, now)
        self.next_at = now + LOOK_S
        if admission is None:
            if was_on:
                self._detach()
            return
        self._attach(admission)
        if not was_on:
            self._tell(now)
        self._timer = asyncio.get_running_loop().call_later(LOOK_S, self._look_again)

    def takes(self, peer: Peer, now: float) -> bool:
        """Whether a datagram that was read during a flood goes on to the owner."""
        if self._known.knows(peer):
            return True
        self._read += 1
        origin: Hashable = peer[0] if isinstance(peer, tuple) else peer
        if self._watch.answers(origin, now):
            return True
        self._dropped.count(NOT_ANSWERED)
        return False

    def stop(self) -> None:
        """Look no more; the socket is about to be closed."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look_again(self) -> None:
        self._timer = None
        now = asyncio.get_running_loop().time()
        if self.is_on and now >= self.next_at - LOOK_S / 2:
            self.update(now)

    def _tell(self, now: float) -> None:
        if self._told_at is None or now - self._told_at >= TOLD_S:
            self._told_at = now
            _log.warning(
                "%s: %.0f packets a second come from strangers: known parts go first, newcomers are heard in turns",
                self._name,
                self._watch.per_s,
            )

    def _attach(self, admission: StrangersHeard) -> None:
        wanted = (admission, tuple(self._known.preferred_peers(MOST_KNOWN)))
        if wanted == self._set or sys.platform != "linux":
            return
        is_ipv6 = self._socket.family == socket.AF_INET6
        for most, by_port in ((MOST_KNOWN, True), (MOST_KNOWN, False), (FEW_KNOWN, False)):
            program = strangers_program(admission, wanted[1][:most], is_ipv6=is_ipv6, by_port=by_port)
            try:
                attach(self._socket, program)
            except OSError as error:  # too long; no memory for it; or no such filters
                _log.debug("%s: no filter of %d instructions: %s", self._name, len(program), error)
            else:
                self._set = wanted
                return

    def _detach(self) -> None:
        if self._set is not None:
            self._set = None
            self._socket.setsockopt(socket.SOL_SOCKET, _DETACH, 0)


def strangers_program(
    admission: StrangersHeard, known: tuple[Peer, ...], *, is_ipv6: bool = False, by_port: bool = True
) -> list[Instruction]:
    """The filter, in classic BPF.

    Args:
        admission: which strangers are let through.
        known: addresses of peers that always are, as `recvfrom` gives them.
        is_ipv6: whether the socket is one of IPv6, which has datagrams of IPv4 as well.
        by_port: whether a known peer is known by its port as well; if not, the program is shorter, and all programs of
            its computer come through.
    """
    ports: _Ports = {}
    for peer in known:
        match peer:
            case (str() as host, int() as port, *_):
                address = ip_address(host.partition("%")[0])
                mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
                ports.setdefault(mapped or address, []).append(port)
    if not by_port:
        ports = {one: [] for one in ports}
    four = _section(4, admission, {one: found for one, found in ports.items() if one.version == 4})
    if not is_ipv6:
        return four
    six = _section(6, admission, {one: found for one, found in ports.items() if one.version == 6})
    version = [(_OCTET, 0, 0, _NETWORK), (_SHIFT, 0, 0, 4), (_EQUAL, 1, 0, 6), (_JUMP, 0, 0, len(six))]
    return [*version, *six, *four]


def attach(opened: socket.socket, program: list[Instruction]) -> None:
    """Have the kernel filter what comes to a socket.

    Raises:
        OSError: it does not.
    """
    if len(program) > LONGEST_PROGRAM:
        raise OSError(errno.EINVAL, "the filter is too long")
    octets = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *one) for one in program))
    what = struct.pack("@HP", len(program), ctypes.addressof(octets))
    opened.setsockopt(socket.SOL_SOCKET, _ATTACH, what)


def _section(version: int, admission: StrangersHeard, ports: _Ports) -> list[Instruction]:
    """The filter for one version of IP: first each known address with its ports, then the strangers."""
    source = [_NETWORK + 12] if version == 4 else [_NETWORK + 8 + 4 * number for number in range(4)]
    program: list[Instruction] = [(_WORD, 0, 0, source[0])] if version == 4 else []
    for address, found in ports.items():
        then = [(_HALF, 0, 0, _PORT), *_ports(found), (_WORD, 0, 0, source[0])] if found else [(_RETURN, 0, 0, _WHOLE)]
        parts = struct.unpack(f">{len(source)}I", address.packed)
        # If a part of the address is another one, on to the next address: by one jump at the end of the comparison,
        # since a comparison itself skips 255 instructions at most.
        if version == 4:
            program += [(_EQUAL, 1, 0, parts[0])]
        else:
            for number, (at, part) in enumerate(zip(source, parts, strict=True)):
                is_last = number == len(source) - 1
                away = 0 if is_last else 2 * (len(source) - number) - 2
                program += [(_WORD, 0, 0, at), (_EQUAL, int(is_last), away, part)]
        program += [(_JUMP, 0, 0, len(then)), *then]
    return [*program, *_strangers(source, admission)]


def _ports(ports: list[int]) -> list[Instruction]:
    return [one for port in sorted(set(ports)) for one in ((_EQUAL, 0, 1, port), (_RETURN, 0, 0, _WHOLE))]


def _strangers(source: list[int], admission: StrangersHeard) -> list[Instruction]:
    program: list[Instruction] = [(_WORD, 0, 0, source[0])]
    for at in source[1:]:
        program += [(_TO_X, 0, 0, 0), (_WORD, 0, 0, at), (_XOR_X, 0, 0, 0)]
    program += [
        (_MULTIPLY, 0, 0, _SALT),
        (_SHIFT, 0, 0, 12),
        (_MODULO, 0, 0, admission.turns),
        (_EQUAL, 1, 0, admission.turn),
        (_RETURN, 0, 0, 0),
    ]
    if admission.chance < CHANCES:
        program += [
            (_WORD, 0, 0, _RANDOM),
            (_AND, 0, 0, CHANCES - 1),
            (_AT_LEAST, 0, 1, admission.chance),
            (_RETURN, 0, 0, 0),
        ]
    return [*program, (_RETURN, 0, 0, _WHOLE)]


def _drops(opened: socket.socket) -> int:
    """How many datagrams the kernel has dropped for this socket, modulo 2 ** 32; 0 where it does not say."""
    if sys.platform != "linux":
        return 0
    try:
        found = opened.getsockopt(socket.SOL_SOCKET, _MEMINFO, 64)
    except OSError:
        return 0
    return int.from_bytes(found[4 * _DROPS : 4 * _DROPS + 4], sys.byteorder)
