"""All datagrams that wait in a socket, taken by one system call: Linux' recvmmsg(2), which Python does not have.

Where eight wait, it takes a third off what it costs to receive them one by one; for one alone it costs half as much
again. Elsewhere than on Linux there is none.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import socket
import sys
from collections.abc import Callable
from typing import Any

from msbot_agent.link.net.host_address import Address

BATCH = 16
"""Datagrams that one call takes at most."""

_SIZE = 1 << 16
"""Octets for each: more than a datagram can have. Pages of memory that were never needed take up none."""
_NAME = 32
"""Octets for the address of each sender: `struct sockaddr_in6` has 28."""
_KNOWN = 4096
"""Addresses that are kept as they are read; beyond, they are forgotten and read again."""


class _Piece(ctypes.Structure):
    """`struct iovec`."""

    _fields_ = (("start", ctypes.c_void_p), ("size", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """`struct msghdr`."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_size", ctypes.c_uint32),
        ("pieces", ctypes.POINTER(_Piece)),
        ("piece_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_size", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Message(ctypes.Structure):
    """`struct mmsghdr`."""

    _fields_ = (("header", _Header), ("size", ctypes.c_uint32))


class BatchedReceiver:
    """Takes what waits in one socket of UDP, and who has sent it.

    Args:
        opened: the socket; it must outlive this.
        call: the system's function.
    """

    def __init__(self, opened: socket.socket, call: Any) -> None:  # noqa: ANN401 - ctypes has no type for it
        self._call = call
        self._descriptor = opened.fileno()
        self._is_ipv6 = opened.family == socket.AF_INET6
        self._name_size = 28 if self._is_ipv6 else 16
        # Memory of this kind gives its octets in one step where others give a view of them first.
        self._octets = mmap.mmap(-1, BATCH * _SIZE)
        self._names = mmap.mmap(-1, BATCH * _NAME)
        self._pieces = (_Piece * BATCH)()
        self._messages = (_Message * BATCH)()
        first = ctypes.addressof(ctypes.c_char.from_buffer(self._octets))
        first_name = ctypes.addressof(ctypes.c_char.from_buffer(self._names))
        for number, message in enumerate(self._messages):
            self._pieces[number].start = first + number * _SIZE
            self._pieces[number].size = _SIZE
            message.header.name = first_name + number * _NAME
            message.header.name_size = self._name_size
            message.header.pieces = ctypes.pointer(self._pieces[number])
            message.header.piece_count = 1
        self._sizes = memoryview(self._messages).cast("B").cast("I")
        step, at = ctypes.sizeof(_Message) // 4, _Message.size.offset // 4
        self._places = [
            (number * _SIZE, number * step + at, slice(number * _NAME, number * _NAME + self._name_size))
            for number in range(BATCH)
        ]
        """Of each datagram: where it begins, which of the sizes is its own, and where its sender's address is."""
        self._known: dict[bytes, Address] = {}

    def receive(self) -> list[tuple[bytes, Address]]:
        """Up to `BATCH` datagrams, as `recvfrom` would give them; fewer: there were no more.

        Raises:
            OSError: as of `recvfrom`, but for that there is nothing; no datagram is lost by it.
        """
        count = self._call(self._descriptor, ctypes.addressof(self._messages), BATCH, socket.MSG_DONTWAIT, None)
        if count < 0:
            error = ctypes.get_errno()
            if error in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR):  # whoever waits for the socket is told again
                return []
            raise OSError(error, os.strerror(error))
        octets, names, sizes, known = self._octets, self._names, self._sizes, self._known
        found = []
        for start, size_at, name_at in self._places[:count]:
            name = names[name_at]
            found.append((octets[start : start + sizes[size_at]], known.get(name) or self._address(name)))
        return found

    def _address(self, name: bytes) -> Address:
        if len(self._known) >= _KNOWN:
            self._known.clear()
        port = int.from_bytes(name[2:4], "big")
        found: Address
        if self._is_ipv6:
            flow, scope = int.from_bytes(name[4:8], "big"), int.from_bytes(name[24:28], sys.byteorder)
            found = (socket.inet_ntop(socket.AF_INET6, name[8:24]), port, flow, scope)
        else:
            found = (socket.inet_ntop(socket.AF_INET, name[4:8]), port)
        self._known[name] = found
        return found


def batched_receiver(opened: socket.socket) -> BatchedReceiver | None:
    """What takes many datagrams at a time from this socket; None where the system has nothing for it."""
    if sys.platform != "linux" or sys.byteorder != "little":  # where musl's `struct msghdr` has other holes
        return None
    call = getattr(ctypes.CDLL(None, use_errno=True), "recvmmsg", None)
    if call is None:
        return None
    call.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
    call.restype = ctypes.c_int
    return BatchedReceiver(opened, call)


# Whether a socket that has just been emptied is watched for a moment before the program goes to sleep.
#
# To sleep and to be woken up by the next packet takes a processor some 30 to 50 µs, more than a packet's whole way
# through the agent. So where packets usually follow each other faster than that, it is cheaper to look again until the
# next one is there, and its answer is earlier. Where they do not, nobody looks: what decides is how long the latest
# pauses were.


LINGER_S = 50e-6
"""The longest watch: what it would cost to sleep instead. So a watch in vain at most doubles that cost."""

WAKING_S = 20e-6
"""The part of a pause that was slept through in which the packet was there already."""

LOOKS_MAX = 200
"""Looks in one watch, should the clock stand still."""

_LONG = 8
"""A pause counts as at most so many of the longest watches, so that a few short ones make up for a very long one."""

_WEIGHT = 1 / 8
"""Of the latest pause in the average."""


class AdaptivePolling:
    """The pauses between the packets of one socket, and whether it is worth while to wait for the next one awake."""

    __slots__ = ("_latest_s", "_longest_s", "_rested_at", "_usual_s")

    def __init__(self, longest_s: float = LINGER_S) -> None:
        """`longest_s`: bound of one watch; 0 = never watch."""
        self._longest_s = longest_s
        self._usual_s = longest_s * _LONG
        self._latest_s: float | None = None  # a pause that is to be learned when there is time
        self._rested_at: float | None = None

    def woken(self, now: float) -> None:
        """A packet is there, and the program has slept until it came."""
        if self._rested_at is not None:
            self._learn(now - self._rested_at - WAKING_S)
            self._rested_at = None

    def watch(self, look: Callable[[], object], clock: Callable[[], float]) -> bool:
        """Call `look` until it finds something (True), or until it is time to sleep (False)."""
        if self._latest_s is not None:
            self._learn(self._latest_s)
            self._latest_s = None
        start = now = clock()
        if self._usual_s < self._longest_s:
            until = start + self._longest_s
            for _ in range(LOOKS_MAX):
                if look():
                    self._latest_s = now - start  # what came is answered first
                    return True
                now = clock()
                if now >= until:
                    break
        self._rested_at = start
        return False

    def _learn(self, pause_s: float) -> None:
        self._usual_s += (min(pause_s, _LONG * self._longest_s) - self._usual_s) * _WEIGHT
