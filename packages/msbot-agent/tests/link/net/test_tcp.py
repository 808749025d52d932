from __future__ import annotations

import asyncio
import contextlib
import gc
import itertools
import socket
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link import Link, Signal
from msbot_agent.link.byte_frames import MAX_PACKET, encode_tcp
from msbot_agent.link.net import TcpClientLink, TcpServerLink, connection_budget, tcp
from msbot_agent.link.net.tcp import BROKEN_AT_ONCE, MADE_ROOM, SILENT, TOO_MANY, WRITE_LIMIT, TcpStream
from msbot_xrce.errors import LinkDown, LinkFull
from tests.effort import tries
from tests.link.ends import End, running
from tests.link.net.test_udp import has_ipv6
from tests.space.own_network import own_network

needs_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", pytest.param("::1", marks=needs_ipv6)])
async def test_one_server_answers_many_clients(host: str) -> None:
    server = TcpServerLink(host, 0)
    async with running(server) as (at_server,):
        clients = [TcpClientLink(host, server.port) for _ in range(3)]
        async with running(*clients) as ends:
            for number, client in enumerate(clients):
                client.send(bytes([number]) * 3, client.remote)
            for _ in clients:
                packet, peer = await at_server.packets.get()
                assert server.has_room(peer)
                server.send(packet + b"!", peer)
                assert server.describe(peer).startswith(("127.0.0.1:", "[::1]:"))
            for number, end in enumerate(ends):
                assert await end.packets.get() == (bytes([number]) * 3 + b"!", clients[number].remote)
                assert clients[number].describe(clients[number].remote).endswith(f":{server.port}")
    assert server.port == 0
    assert (server.counters.packets_in, server.counters.packets_out) == (3, 3)
    assert (server.counters.bytes_in, server.counters.bytes_out) == (9, 12)


@needs_ipv6
async def test_a_server_on_every_interface_takes_both_kinds_of_addresses() -> None:
    server = TcpServerLink("::", 0)
    async with running(server) as (at_server,):
        clients = [TcpClientLink(host, server.port) for host in ("127.0.0.1", "::1")]
        async with running(*clients):
            for client in clients:
                client.send(b"x", client.remote)
            peers = {server.describe((await at_server.packets.get())[1]).rpartition(":")[0] for _ in clients}
    assert peers == {"[::ffff:127.0.0.1]", "[::1]"}


async def test_who_comes_and_goes_is_told_and_a_new_connection_is_a_new_peer() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        seen = []
        for _ in range(2):
            _, writer = await asyncio.open_connection("127.0.0.1", server.port)
            peer, words = await at_server.told(Signal.PEER_JOINED)
            assert words == "connected"
            writer.close()
            assert await at_server.told(Signal.PEER_GONE) == (peer, "connection closed")
            assert not server.has_room(peer)
            with pytest.raises(LinkDown, match=r"tcp:127.0.0.1:0: there is no connection with 127.0.0.1:"):
                server.send(b"x", peer)
            seen.append(peer)
    assert len(set(seen)) == 2


async def test_a_broken_connection_is_told_with_its_reason() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        raw = socket.create_connection(("127.0.0.1", server.port))
        await at_server.told(Signal.PEER_JOINED)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        raw.close()  # with this option: a reset instead of an end
        assert (await at_server.told(Signal.PEER_GONE))[1] == "connection broken: Connection reset by peer"


async def test_a_server_that_closes_says_that_of_itself_only() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        client = TcpClientLink("127.0.0.1", server.port)
        async with running(client):
            await at_server.told(Signal.PEER_JOINED)
            client.attach(signal=lambda *_: None)
    assert [signal for signal, *_ in at_server.signals._queue] == [Signal.PEER_GONE, Signal.LINK_DOWN]  # type: ignore[attr-defined]

    async with running(server) as (at_server,):
        _, writer = await asyncio.open_connection("127.0.0.1", server.port)
        await at_server.told(Signal.PEER_JOINED)
    assert at_server.signals.get_nowait() == (Signal.LINK_DOWN, None, "closed")
    assert at_server.signals.empty()
    writer.close()


async def test_case_73_a_length_that_comes_in_single_octets_and_empty_packets_between() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for octet in b"\0\0\x03\0abc\0\0\0\0\x02\0de":
            writer.write(bytes([octet]))
            await writer.drain()
        packet, peer = await at_server.packets.get()
        assert (packet, await at_server.heard()) == (b"abc", b"de")
        server.send(b"answer", peer)
        assert await reader.readexactly(8) == b"\x06\0answer"
        writer.close()


@given(packets=st.lists(st.binary(max_size=40), max_size=20), cuts=st.lists(st.integers(0, 400), max_size=20))
@settings(max_examples=tries(60, 2000), deadline=None)
def test_packets_do_not_depend_on_the_chunks_they_come_in(packets: list[bytes], cuts: list[int]) -> None:
    class Recorder(TcpServerLink):
        def received(self, packet: bytes, peer: object) -> None:
            came.append(packet)

    async def main() -> None:
        stream = TcpStream(Recorder("127.0.0.1", 0), peer=1)
        octets = b"".join(stream.encode(packet, 1) for packet in packets)
        edges = sorted({0, len(octets), *(cut for cut in cuts if cut < len(octets))})
        for start, end in itertools.pairwise(edges):
            buffer = stream.get_buffer(-1)
            buffer[: end - start] = octets[start:end]
            stream.buffer_updated(end - start)

    came: list[bytes] = []
    asyncio.run(main())
    assert came == [packet for packet in packets if packet]


async def test_a_packet_as_long_as_the_length_can_say() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    assert server.info.mtu == MAX_PACKET
    async with running(server) as (at_server,):
        client = TcpClientLink("127.0.0.1", server.port)
        async with running(client):
            packet = bytes(range(256)) * 255 + bytes(255)
            client.send(packet, client.remote)
            assert await at_server.heard() == packet


async def test_a_peer_that_does_not_read_fills_up_and_only_that_one() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port, limit=1)
        slow, _ = await at_server.told(Signal.PEER_JOINED)
        client = TcpClientLink("127.0.0.1", server.port)
        async with running(client) as (at_client,):
            quick, _ = await at_server.told(Signal.PEER_JOINED)
            sent = 0
            while server.has_room(slow):
                server.send(bytes(8000), slow)
                sent += 8002
            with pytest.raises(LinkFull, match="does not take its data"):
                server.send(b"x", slow)
            server.send(b"x", quick)
            assert await at_client.heard() == b"x"
            assert sent > WRITE_LIMIT
            while sent:
                sent -= len(await reader.read(1 << 20))
            assert await at_server.room.get() == slow
            assert server.has_room(slow)
        writer.close()


async def test_a_connection_that_never_said_anything_makes_room_for_another() -> None:
    server = TcpServerLink("127.0.0.1", 0, max_connections=2)
    async with running(server) as (at_server,):
        pairs = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(2)]
        for _ in pairs:
            await at_server.told(Signal.PEER_JOINED)
        pairs.append(await asyncio.open_connection("127.0.0.1", server.port))
        await at_server.told(Signal.PEER_JOINED)
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await pairs[0][0].readexactly(1)
        assert server.counters.dropped == {MADE_ROOM: 1}
        for _, each in pairs:
            each.close()


async def test_what_a_connection_took_to_be_opened_is_given_back() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server) as (at_server,):
        writers = [(await asyncio.open_connection("127.0.0.1", server.port))[1] for _ in range(3)]
        peers = [(await at_server.told(Signal.PEER_JOINED))[0] for _ in writers]
        assert [peer[2] for peer in peers if isinstance(peer, tuple)] == [1, 2, 3]
        await asyncio.sleep(0)
        assert not server._opening
        for each in writers:
            each.close()


async def test_one_computer_has_a_share_of_the_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_budget, "MAX_OF_ADDRESS", 2)
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server):
        pairs = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(3)]
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await pairs[0][0].readexactly(1)
        assert server.counters.dropped == {MADE_ROOM: 1}
        for _, each in pairs:
            each.close()


async def test_connections_that_are_in_use_are_kept_and_the_newcomer_is_refused() -> None:
    server = TcpServerLink("127.0.0.1", 0, max_connections=2)
    async with running(server) as (at_server,):
        writers = [(await asyncio.open_connection("127.0.0.1", server.port))[1] for _ in range(2)]
        for each in writers:
            each.write(encode_tcp(b"hello"))
            await at_server.packets.get()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await reader.readexactly(1)
        assert server.counters.dropped == {TOO_MANY: 1}
        for each in (*writers, writer):
            each.close()


async def test_a_connection_without_a_packet_is_closed_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "FIRST_PACKET_S", 0.01)
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"\x05\x00half")
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await reader.readexactly(1)
        assert server.counters.dropped == {SILENT: 1}
        writer.close()


async def test_a_connection_that_breaks_while_it_is_accepted_is_counted() -> None:
    class BrokenSocket:
        def setsockopt(self, *_: object) -> None:
            raise OSError("already broken")

    class Transport(asyncio.Transport):
        def __init__(self) -> None:
            super().__init__({"socket": BrokenSocket()})
            self.aborted = False

        def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
            pass

        def abort(self) -> None:
            self.aborted = True

    server = TcpServerLink("127.0.0.1", 0)
    transport = Transport()
    TcpStream(server).connection_made(transport)
    assert transport.aborted
    assert server.counters.dropped == {BROKEN_AT_ONCE: 1}


async def test_a_client_waits_for_its_server_and_comes_back_after_it_was_restarted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tcp, "RECONNECT_S", 0.001)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = TcpClientLink("127.0.0.1", port)
    end = End(client)
    async with asyncio.timeout(20):
        task = asyncio.create_task(client.run())
        assert not client.has_room(client.remote)
        for number in (b"1", b"2"):
            server = TcpServerLink("127.0.0.1", port)
            async with running(server) as (at_server,):
                await end.told(Signal.LINK_UP)
                client.send(number, client.remote)
                assert await at_server.heard() == number
            assert await end.told(Signal.LINK_DOWN) == (client.remote, "connection closed")
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_connection_of_a_client_with_itself_is_none() -> None:
    with socket.socket() as both:
        both.bind(("127.0.0.1", 0))
        both.connect(both.getsockname())
        both.setblocking(False)
        client = TcpClientLink(*both.getsockname())
        end = End(client)
        loop = asyncio.get_running_loop()
        _, stream = await loop.create_connection(lambda: TcpStream(client, client.remote), sock=both)
        await asyncio.wait([stream.closed])
        assert end.signals.empty()
        assert not client.has_room(client.remote)


async def test_a_client_that_ends_says_so() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server):
        client = TcpClientLink("127.0.0.1", server.port)
        async with running(client) as (end,):
            pass
        assert end.signals.get_nowait() == (Signal.LINK_DOWN, client.remote, "closed")


async def test_a_client_makes_a_new_connection_when_the_old_one_takes_octets_and_answers_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tcp, "UNANSWERED_S", 0.05)
    monkeypatch.setattr(tcp, "RECONNECT_S", 0.0)
    mute: list[asyncio.StreamWriter] = []

    async def swallow(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """The first connection is forgotten, as by a router between the two; the next one is answered."""
        first = not mute
        mute.append(writer)
        while await reader.read(100):
            if not first:
                writer.write(encode_tcp(b"here"))
        writer.close()

    between = await asyncio.start_server(swallow, "127.0.0.1", 0)
    client = TcpClientLink("127.0.0.1", between.sockets[0].getsockname()[1])
    async with between, running(client) as (end,):
        while end.signals.empty():
            with contextlib.suppress(LinkDown):
                client.send(b"who is there?", client.remote)
            await asyncio.sleep(0.01)
        assert await end.told(Signal.LINK_DOWN) == (client.remote, "connection given up: no answer for 0.05 s")
        await end.told(Signal.LINK_UP)
        client.send(b"who is there?", client.remote)
        assert await end.heard() == b"here"
        for _ in range(12):  # who is answered keeps the connection
            client.send(b"who is there?", client.remote)
            assert await end.heard() == b"here"
            await asyncio.sleep(0.01)
        assert end.signals.empty()
        assert len(mute) == 2


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="an option of Linux")
async def test_a_peer_that_vanishes_is_gone_although_octets_wait_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert tcp.VANISHED["TCP_USER_TIMEOUT"] == 25_000
    monkeypatch.setitem(tcp.VANISHED, "TCP_USER_TIMEOUT", 300)
    with own_network():
        server = TcpServerLink("127.0.0.1", 0)
        async with running(server) as (at_server,):
            client = TcpClientLink("127.0.0.1", server.port)
            async with running(client) as (at_client,):
                client.send(b"x", client.remote)
                _, peer = await at_server.packets.get()
                unplug = await asyncio.create_subprocess_exec("ip", "link", "set", "lo", "down")
                assert await unplug.wait() == 0
                client.send(b"x", client.remote)
                server.send(b"x", peer)
                assert (await at_client.told(Signal.LINK_DOWN))[1] == "connection broken: Connection timed out"
                assert await at_server.told(Signal.PEER_GONE) == (peer, "connection broken: Connection timed out")


async def test_taps_see_both_ways() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    tapped: list[tuple[str, str, bytes]] = []
    server.tap = lambda now, way, peer, packet: tapped.append(("server", way, packet))
    async with running(server) as (at_server,):
        client = TcpClientLink("127.0.0.1", server.port)
        client.tap = lambda now, way, peer, packet: tapped.append(("client", way, packet))
        async with running(client):
            client.send(b"x", client.remote)
            await at_server.heard()
    assert tapped == [("client", "out", b"x"), ("server", "in", b"x")]


async def test_a_port_in_use_is_named_with_the_remedy() -> None:
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server):
        with pytest.raises(LinkDown, match=rf"tcp:127.0.0.1:{server.port}: another program listens .*ss -tlnp"):
            await TcpServerLink("127.0.0.1", server.port).run()


@pytest.mark.parametrize(
    ("link", "words"),
    [
        (TcpServerLink("192.0.2.77", 8888), "no interface of this machine has the address 192.0.2.77"),
        (TcpServerLink("no-such-host.invalid", 8888), "no such host as 'no-such-host.invalid'"),
        (TcpClientLink("no-such-host.invalid", 8888), "no such host as 'no-such-host.invalid'"),
    ],
)
async def test_an_address_that_cannot_be_is_explained(link: Link, words: str) -> None:
    with pytest.raises(LinkDown, match=words):
        await link.run()


async def test_a_machine_without_ipv6_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_socket(*_: object) -> socket.socket:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", no_socket)
    with pytest.raises(LinkDown, match="no IPv6: use an IPv4 address"):
        await TcpServerLink("::1", 8888).run()


def test_peers_are_described_as_addresses() -> None:
    link = TcpServerLink("127.0.0.1", 1)
    assert link.describe(("127.0.0.1", 5, 1)) == "127.0.0.1:5"
    assert link.describe(("::1", 5, 2)) == "[::1]:5"
    assert link.describe("who?") == "who?"


async def test_ending_while_it_is_being_opened_leaves_nothing_behind() -> None:
    for turns in range(8):
        task = asyncio.create_task(TcpServerLink("127.0.0.1", 0).run())
        for _ in range(turns):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    gc.collect()


async def test_a_connection_that_is_still_being_opened_is_closed_with_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    opening: asyncio.Queue[socket.socket] = asyncio.Queue()

    async def never(_make: object, connection: socket.socket) -> None:
        opening.put_nowait(connection)
        await asyncio.get_running_loop().create_future()

    monkeypatch.setattr(asyncio.get_running_loop(), "connect_accepted_socket", never)
    server = TcpServerLink("127.0.0.1", 0)
    async with running(server):
        _, writer = await asyncio.open_connection("127.0.0.1", server.port)
        connection = await opening.get()
        assert connection.fileno() >= 0
    assert connection.fileno() == -1, "not left to the garbage collector"
    writer.close()
