from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from msbot_agent.link import Link, Peer, Signal
from msbot_agent.link.net import UdpClientLink, UdpServerLink
from msbot_agent.link.net.host_address import cannot_reach
from msbot_agent.link.net.udp import DRAIN_PACKETS, NOBODY_LISTENS, QUEUE_PACKETS, UDP_MTU
from msbot_xrce.errors import LinkDown, LinkFull


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


class Inbox:
    """What came in over a link, and a way to wait for it."""

    def __init__(self, link: Link) -> None:
        self.packets: asyncio.Queue[tuple[bytes, Peer]] = asyncio.Queue()
        self.signals: list[Signal] = []
        self.room: asyncio.Queue[Peer | None] = asyncio.Queue()
        link.attach(packet=lambda packet, peer, now: self.packets.put_nowait((packet, peer)))
        link.attach(signal=lambda signal, peer, words, now: self.signals.append(signal))
        link.attach(room=self.room.put_nowait)


@asynccontextmanager
async def running(*links: UdpServerLink | UdpClientLink) -> AsyncIterator[None]:
    async with asyncio.timeout(20), asyncio.TaskGroup() as group:
        tasks = [group.create_task(link.run()) for link in links]
        while not all(link.port for link in links):  # noqa: ASYNC110 - the signal handler belongs to the test
            await asyncio.sleep(0)
        yield
        for task in tasks:
            task.cancel()


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1", "localhost", pytest.param("::1", marks=pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here"))],
)
async def test_one_server_answers_many_clients(host: str) -> None:
    server = UdpServerLink(host, 0)
    at_server = Inbox(server)
    async with running(server):
        clients = [UdpClientLink(host, server.port) for _ in range(3)]
        inboxes = [Inbox(client) for client in clients]
        async with running(*clients):
            for number, client in enumerate(clients):
                client.send(bytes([number]), client.remote)
            for _ in clients:
                packet, peer = await at_server.packets.get()
                server.send(packet + b"!", peer)
                assert server.describe(peer).endswith(f":{clients[packet[0]].port}")
            for number, inbox in enumerate(inboxes):
                assert await inbox.packets.get() == (bytes([number]) + b"!", clients[number].remote)
    assert (server.counters.packets_in, server.counters.packets_out) == (3, 3)
    assert (server.counters.bytes_in, server.counters.bytes_out) == (3, 6)
    assert at_server.signals == [Signal.LINK_UP, Signal.LINK_DOWN]


async def test_the_end_of_a_burst_is_told_once_however_many_packets_came() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    assert server.info.in_bursts
    inbox = Inbox(server)
    ends: list[int] = []
    server.attach(burst_end=lambda: ends.append(inbox.packets.qsize()))
    async with running(server):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            for number in range(3):
                client.sendto(bytes([number]), ("127.0.0.1", server.port))
            while not ends:  # noqa: ASYNC110 - the handler belongs to the test
                await asyncio.sleep(0)
    assert ends == [3]


async def test_what_comes_while_a_burst_is_answered_is_taken_in_the_same_turn() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    inbox = Inbox(server)
    turns: list[int] = []
    ends: list[tuple[int, int]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:

        def answer() -> None:
            ends.append((inbox.packets.qsize(), len(turns)))
            if len(ends) < 3:
                client.sendto(b"more", ("127.0.0.1", server.port))

        server.attach(burst_end=answer)
        async with running(server):
            client.sendto(b"first", ("127.0.0.1", server.port))
            while not ends:
                turns.append(1)
                await asyncio.sleep(0)
    assert [packets for packets, _ in ends] == [1, 2, 3]
    assert len({turn for _, turn in ends}) == 1


@pytest.mark.parametrize("linger_s", [0.0, 0.01])
async def test_a_server_answers_a_client_that_waits_for_each_answer(linger_s: float) -> None:
    server = UdpServerLink("127.0.0.1", 0, linger_s=linger_s)
    server.attach(packet=lambda packet, peer, now: server.send(packet, peer))
    async with running(server):
        client = UdpClientLink("127.0.0.1", server.port)
        inbox = Inbox(client)
        async with running(client):
            for number in range(50):
                client.send(bytes([number]), client.remote)
                assert (await inbox.packets.get())[0] == bytes([number])


@pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")
async def test_a_server_on_every_interface_takes_both_kinds_of_addresses() -> None:
    server = UdpServerLink("::", 0)
    at_server = Inbox(server)
    async with running(server):
        clients = [UdpClientLink(host, server.port) for host in ("127.0.0.1", "::1")]
        inboxes = [Inbox(client) for client in clients]
        async with running(*clients):
            for client, inbox in zip(clients, inboxes, strict=True):
                client.send(b"x", client.remote)
                packet, peer = await at_server.packets.get()
                server.send(packet + b"!", peer)
                assert (await inbox.packets.get())[0] == b"x!"
                assert server.describe(peer).startswith(("[::1]:", "[::ffff:127.0.0.1]:"))


async def test_a_burst_longer_than_one_drain_arrives_whole() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    inbox = Inbox(server)
    async with running(server):
        client = UdpClientLink("127.0.0.1", server.port)
        async with running(client):
            count = DRAIN_PACKETS + 10
            for number in range(count):
                client.send(number.to_bytes(2), client.remote)
            assert [int.from_bytes((await inbox.packets.get())[0]) for _ in range(count)] == list(range(count))


async def test_taps_see_both_ways() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    inbox = Inbox(server)
    async with running(server):
        client = UdpClientLink("127.0.0.1", server.port)
        tapped: list[tuple[str, str, bytes]] = []
        server.tap = lambda now, way, peer, packet: tapped.append(("server", way, packet))
        client.tap = lambda now, way, peer, packet: tapped.append(("client", way, packet))
        async with running(client):
            client.send(b"x", client.remote)
            await inbox.packets.get()
    assert tapped == [("client", "out", b"x"), ("server", "in", b"x")]


async def test_a_client_lives_on_when_nobody_listens_and_reaches_a_server_that_comes_later() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = UdpClientLink("127.0.0.1", port)
    async with running(client):
        client.send(b"1", client.remote)
        client.send(b"2", client.remote)  # meets the error that the first one caused, unless it was read before
        while not client.counters.dropped:  # noqa: ASYNC110 - a counter has no event
            await asyncio.sleep(0)
        assert set(client.counters.dropped) == {NOBODY_LISTENS}
        server = UdpServerLink("127.0.0.1", port)
        inbox = Inbox(server)
        async with running(server):
            client.send(b"3", client.remote)
            assert (await inbox.packets.get())[0] == b"3"


async def test_a_link_can_run_again() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    inbox = Inbox(server)
    for _ in range(2):
        async with running(server):
            pass
        assert server.port == 0
    assert inbox.signals == [Signal.LINK_UP, Signal.LINK_DOWN] * 2


async def test_a_closed_link_sends_nothing() -> None:
    client = UdpClientLink("127.0.0.1", 9)
    assert not client.has_room(client.remote)
    with pytest.raises(LinkDown, match=r"udp:127\.0\.0\.1:9 is not open"):
        client.send(b"x", client.remote)


async def test_a_port_in_use_is_named_with_the_remedy() -> None:
    first = UdpServerLink("127.0.0.1", 0)
    async with running(first):
        second = UdpServerLink("127.0.0.1", first.port)
        with pytest.raises(LinkDown, match=rf"cannot listen at udp:127.0.0.1:{first.port}: another program listens"):
            await second.run()


@pytest.mark.parametrize(
    ("link", "words"),
    [
        (UdpServerLink("192.0.2.1", 8888), "no interface of this machine has the address 192.0.2.1"),
        (UdpServerLink("no-such-host.invalid", 8888), "no such host as 'no-such-host.invalid'"),
        (UdpClientLink("255.255.255.255", 8888), "that is a broadcast address"),
    ],
)
async def test_an_address_that_cannot_be_is_explained(link: UdpServerLink | UdpClientLink, words: str) -> None:
    with pytest.raises(LinkDown, match=words):
        await link.run()


@pytest.mark.parametrize(
    ("host", "words"),
    [("255.255.255.255", "that is a broadcast address"), ("192.0.2.1", "no way to that network")],
)
def test_without_a_network_it_is_explained_too(host: str, words: str) -> None:
    assert words in str(cannot_reach(f"udp:{host}:8888", host, OSError(errno.ENETUNREACH, "Network is unreachable")))


async def test_a_machine_without_ipv6_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_socket(*_: object) -> socket.socket:
        raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))

    monkeypatch.setattr(socket, "socket", no_socket)
    with pytest.raises(LinkDown, match="no IPv6: use an IPv4 address"):
        await UdpServerLink("::1", 8888).run()


class BusyLink(UdpClientLink):
    """A client whose kernel takes no packets until told."""

    error: OSError | None = BlockingIOError(errno.EAGAIN, "busy")

    def _transmitter(self, opened: socket.socket) -> Callable[[bytes, Peer], object]:
        transmit = super()._transmitter(opened)

        def busy(packet: bytes, peer: Peer) -> None:
            if self.error is not None:
                raise self.error
            transmit(packet, peer)

        return busy


async def test_what_the_kernel_does_not_take_waits_in_order() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    at_server = Inbox(server)
    async with running(server):
        client = BusyLink("127.0.0.1", server.port)
        inbox = Inbox(client)
        async with running(client):
            for number in range(QUEUE_PACKETS):
                assert client.has_room(client.remote)
                client.send(number.to_bytes(2), client.remote)
            assert not client.has_room(client.remote)
            with pytest.raises(LinkFull, match="512 packets wait for the network"):
                client.send(b"too many", client.remote)
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            assert at_server.packets.empty()
            client.error = None
            assert await inbox.room.get() is None
            assert client.has_room(client.remote)
            arrived = [int.from_bytes((await at_server.packets.get())[0]) for _ in range(QUEUE_PACKETS)]
    assert arrived == list(range(QUEUE_PACKETS))


async def test_what_waited_when_the_link_was_closed_is_counted_and_not_sent_later() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    at_server = Inbox(server)
    async with running(server):
        client = BusyLink("127.0.0.1", server.port)
        async with running(client):
            client.send(b"too late", client.remote)
        assert client.counters.dropped == {"the link was closed before the network took it": 1}
        client.error = None
        async with running(client):
            client.send(b"in time", client.remote)
            assert (await at_server.packets.get())[0] == b"in time"


async def test_a_short_wait_is_not_announced_as_room() -> None:
    server = UdpServerLink("127.0.0.1", 0)
    at_server = Inbox(server)
    async with running(server):
        client = BusyLink("127.0.0.1", server.port)
        inbox = Inbox(client)
        async with running(client):
            client.send(b"1", client.remote)
            client.error = None
            client.send(b"2", client.remote)
            assert [(await at_server.packets.get())[0] for _ in range(2)] == [b"1", b"2"]
            assert inbox.room.empty()


async def test_what_waits_when_the_link_closes_is_counted() -> None:
    client = BusyLink("127.0.0.1", 9)
    async with running(client):
        client.send(b"1", client.remote)
    assert client.counters.dropped == {"the link was closed before the network took it": 1}


async def test_a_packet_longer_than_a_datagram_is_counted_and_the_link_lives_on() -> None:
    client = UdpClientLink("127.0.0.1", 9)
    async with running(client):
        client.send(bytes(UDP_MTU + 1), client.remote)
        assert client.counters.dropped == {"longer than a datagram may be": 1}
        assert client.has_room(client.remote)


async def test_an_error_of_the_socket_itself_ends_the_link() -> None:
    client = BusyLink("127.0.0.1", 9)
    client.error = OSError(errno.EIO, "Input/output error")

    def send_twice(signal: Signal, *_: object) -> None:
        if signal is Signal.LINK_UP:
            client.send(b"1", client.remote)
            client.send(b"2", client.remote)

    client.attach(signal=send_twice)
    with pytest.raises(LinkDown, match=r"udp:127\.0\.0\.1:9 failed: Input/output error"):
        await client.run()


async def test_an_error_while_receiving_ends_the_link_or_passes() -> None:
    class Broken:
        """A socket that fails as the system may."""

        def __init__(self, *errors: int) -> None:
            self.errors = list(errors)

        def recvfrom(self, size: int) -> tuple[bytes, Peer]:
            raise OSError(self.errors.pop(0), "failed")

    client = UdpClientLink("127.0.0.1", 9)
    broken = Broken(errno.ENETDOWN, errno.EIO)

    def receive(signal: Signal, *_: object) -> None:
        if signal is Signal.LINK_UP:
            client._drain(broken, asyncio.get_running_loop())  # type: ignore[arg-type]  # has all that is needed

    client.attach(signal=receive)
    with pytest.raises(LinkDown, match="failed"):
        await client.run()
    assert client.counters.dropped == {"the network interface is down": 1}


def test_peers_are_described_as_addresses() -> None:
    link = UdpServerLink("127.0.0.1", 1)
    assert link.describe(("127.0.0.1", 5)) == "127.0.0.1:5"
    assert link.describe(("::1", 5, 0, 0)) == "[::1]:5"
    assert link.describe("who?") == "who?"
