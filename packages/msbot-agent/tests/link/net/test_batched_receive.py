"""Many datagrams in one call: the same as one by one, and errors as they are told one by one."""

from __future__ import annotations

import asyncio
import ctypes
import errno
import os
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from msbot_agent.link.net import UdpServerLink, batched_receive, udp
from msbot_agent.link.net.batched_receive import BATCH, BatchedReceiver, batched_receiver
from msbot_xrce.errors import LinkDown
from tests.link.net.test_udp import Inbox, has_ipv6, running

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="recvmmsg is Linux' own")
HOSTS = ("127.0.0.1", pytest.param("::1", marks=pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")))
SIZES = (0, 1, 64, 1472, 9000, 65_000)


@pytest.fixture
def sockets() -> Iterator[Callable[[str], socket.socket]]:
    """Makes sockets at a free port of this computer, which do not wait."""
    with ExitStack() as stack:

        def make(host: str) -> socket.socket:
            found = stack.enter_context(
                socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
            )
            found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            found.bind((host, 0))
            found.setblocking(False)
            return found

        yield make


def receiver(opened: socket.socket) -> BatchedReceiver:
    found = batched_receiver(opened)
    assert found is not None
    return found


@pytest.mark.parametrize("host", HOSTS)
def test_it_takes_what_recvfrom_would(host: str, sockets: Callable[[str], socket.socket]) -> None:
    one, other, *senders = (sockets(host) for _ in range(5))
    batches = receiver(one)
    assert batches.receive() == []
    for number in range(BATCH + 3):
        packet = bytes([number]) * SIZES[number % (len(SIZES) - 1)]
        for target in (one, other):
            senders[number % len(senders)].sendto(packet, target.getsockname())
    first, rest = batches.receive(), batches.receive()
    assert (len(first), len(rest)) == (BATCH, 3)
    assert first + rest == [other.recvfrom(1 << 16) for _ in range(BATCH + 3)]
    assert batches.receive() == []


@pytest.mark.parametrize("size", SIZES)
def test_a_datagram_of_any_size_is_whole(size: int, sockets: Callable[[str], socket.socket]) -> None:
    one, sender = sockets("127.0.0.1"), sockets("127.0.0.1")
    batches = receiver(one)
    packet = os.urandom(size)
    sender.sendto(b"before", one.getsockname())
    sender.sendto(packet, one.getsockname())
    assert [found for found, _ in batches.receive()] == [b"before", packet]


def test_more_senders_than_are_kept_are_told_apart(
    sockets: Callable[[str], socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batched_receive, "_KNOWN", 2)
    one = sockets("127.0.0.1")
    batches, senders = receiver(one), [sockets("127.0.0.1") for _ in range(5)]
    for _ in range(3):
        for sender in senders:
            sender.sendto(b"", one.getsockname())
        assert [peer for _, peer in batches.receive()] == [sender.getsockname() for sender in senders]
    assert len(batches._known) <= 2


def test_errors_are_those_of_the_socket(sockets: Callable[[str], socket.socket]) -> None:
    one, gone = sockets("127.0.0.1"), sockets("127.0.0.1")
    batches = receiver(one)
    one.connect(gone.getsockname())
    gone.close()
    one.send(b"to nobody")
    with pytest.raises(ConnectionRefusedError):
        batches.receive()
    one.close()
    with pytest.raises(OSError, match="Bad file descriptor") as caught:
        batches.receive()
    assert caught.value.errno == errno.EBADF


@pytest.mark.parametrize(("name", "value"), [("sys.platform", "win32"), ("sys.byteorder", "big")])
def test_elsewhere_there_is_none(
    name: str, value: str, sockets: Callable[[str], socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(name, value)
    assert batched_receiver(sockets("127.0.0.1")) is None


def test_a_system_without_the_call_has_none(
    sockets: Callable[[str], socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda *_args, **_named: object())
    assert batched_receiver(sockets("127.0.0.1")) is None


async def hear(link: UdpServerLink, count: int) -> list[bytes]:
    """What the link hears of that many datagrams, which wait in its socket before it takes the first."""
    inbox = Inbox(link)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        async with running(link):
            for number in range(count):
                sender.sendto(bytes([number]), ("127.0.0.1", link.port))
            found = [await inbox.packets.get() for _ in range(count)]
            assert {peer for _, peer in found} == {("127.0.0.1", sender.getsockname()[1])}
    return [packet for packet, _ in found]


@pytest.mark.parametrize("has_batches", [True, False])
async def test_a_link_takes_a_burst_in_order_with_and_without(
    has_batches: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_batches:
        monkeypatch.setattr(udp, "batched_receiver", lambda _opened: None)
    assert await hear(UdpServerLink("127.0.0.1", 0), 100) == [bytes([number]) for number in range(100)]


async def test_after_a_burst_the_next_one_is_taken_by_one_call_and_after_a_lone_datagram_it_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = []
    real = BatchedReceiver.receive

    def counted(batches: BatchedReceiver) -> object:
        calls.append(found := real(batches))
        return found

    monkeypatch.setattr(BatchedReceiver, "receive", counted)
    link = UdpServerLink("127.0.0.1", 0, linger_s=0)
    inbox = Inbox(link)
    taken = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        async with running(link):
            for burst in (b"one", b"two", b"3", b"4", b"five"):
                for number in burst:
                    sender.sendto(bytes([number]), ("127.0.0.1", link.port))
                assert b"".join([(await inbox.packets.get())[0] for _ in burst]) == burst
                taken.append([len(found) for found in calls])
                calls.clear()
    assert taken == [[2], [3], [1], [], [3]]


async def test_what_passes_in_the_middle_of_a_burst_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = [errno.ENETDOWN, errno.ECONNREFUSED]
    real = BatchedReceiver.receive

    def faulty(batches: BatchedReceiver) -> object:
        if errors:
            raise OSError(error := errors.pop(), os.strerror(error))
        return real(batches)

    monkeypatch.setattr(BatchedReceiver, "receive", faulty)
    link = UdpServerLink("127.0.0.1", 0)
    assert len(await hear(link, 40)) == 40
    assert sum(link.counters.dropped.values()) == 2


async def test_a_socket_that_fails_in_the_middle_of_a_burst_ends_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_batches: BatchedReceiver) -> object:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(BatchedReceiver, "receive", broken)
    link = UdpServerLink("127.0.0.1", 0)
    inbox = Inbox(link)
    task = asyncio.create_task(link.run())
    while not link.port:  # noqa: ASYNC110 - one turn of the loop is enough
        await asyncio.sleep(0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(3):
            sender.sendto(bytes([number]), ("127.0.0.1", link.port))
    with pytest.raises(LinkDown, match="failed: Input/output error: start it again"):
        await task
    assert inbox.packets.qsize() == 1
