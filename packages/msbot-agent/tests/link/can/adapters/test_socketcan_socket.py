"""What a CAN_RAW socket is told before it is used, with the numbers of linux/can/raw.h and asm-generic/socket.h."""

from __future__ import annotations

import errno
import os
import socket
import struct
from dataclasses import dataclass, field

import pytest

from msbot_agent.link.can.adapters.remedies import Wanted
from msbot_agent.link.can.adapters.socketcan import RECEIVE_BUFFER, SEND_BUFFER, open_socket
from msbot_agent.link.can.filters import one_id

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_CAN"), reason="SocketCAN is a part of Linux")

SOL_SOCKET, SO_SNDBUF, SO_RCVBUF, SO_RCVBUFFORCE, SO_RXQ_OVFL = 1, 7, 8, 33, 40
SOL_CAN_RAW, FILTER, ERR_FILTER, RECV_OWN_MSGS, FD_FRAMES = 101, 1, 2, 4, 5


@dataclass
class Raw:
    """A socket that writes down what it is told, and refuses one thing."""

    refuses: object = None
    told: list[object] = field(default_factory=list)
    closed: bool = False

    def __call__(self, *kind: int) -> Raw:
        assert kind == (29, 3, 1)  # AF_CAN, SOCK_RAW, CAN_RAW
        return self

    def _take(self, word: object) -> None:
        if word == self.refuses:
            raise OSError(errno.EPERM, os.strerror(errno.EPERM))
        self.told.append(word)

    def setblocking(self, blocks: bool) -> None:
        self._take(blocks)

    def setsockopt(self, level: int, option: int, value: int | bytes) -> None:
        self._take((level, option, value) if (level, option) != (SOL_SOCKET, SO_RCVBUFFORCE) else "force")

    def bind(self, address: tuple[str]) -> None:
        self._take(address)

    def close(self) -> None:
        self.closed = True


def opened(monkeypatch: pytest.MonkeyPatch, raw: Raw, *, fd: bool = False, filtered: bool = False) -> list[object]:
    monkeypatch.setattr(socket, "socket", raw)
    made: object = open_socket(Wanted("can7", fd), [one_id(0x123)] if filtered else None)
    assert made is raw
    return raw.told


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("may_force", [False, True])
def test_what_a_socket_is_told(fd: bool, filtered: bool, may_force: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = Raw(None if may_force else "force")
    assert opened(monkeypatch, raw, fd=fd, filtered=filtered) == [
        False,
        "force" if may_force else (SOL_SOCKET, SO_RCVBUF, RECEIVE_BUFFER),
        (SOL_SOCKET, SO_SNDBUF, SEND_BUFFER),
        (SOL_SOCKET, SO_RXQ_OVFL, 1),
        *([(SOL_CAN_RAW, FILTER, struct.pack("=II", 0x123, 0xC00007FF))] if filtered else []),
        (SOL_CAN_RAW, ERR_FILTER, 0x1FFFFFFF),
        (SOL_CAN_RAW, RECV_OWN_MSGS, 0),
        *([(SOL_CAN_RAW, FD_FRAMES, 1)] if fd else []),
        ("can7",),
    ]
    assert not raw.closed


@pytest.mark.parametrize("refuses", [False, (SOL_CAN_RAW, FD_FRAMES, 1), ("can7",)])
def test_a_socket_that_cannot_be_used_is_closed(refuses: object, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = Raw(refuses)
    with pytest.raises(OSError, match="not permitted"):
        opened(monkeypatch, raw, fd=True)
    assert raw.closed
