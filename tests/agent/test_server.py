"""The agent as clients and operators see it: samples, silence, links, the gate."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.agent import Agent, AgentSettings, ClientInfo, OpenGate, client_key_of
from msbot.agent.rpc import decode_identity
from msbot.errors import LinkDown, LinkFull
from msbot.link import InprocHub, Peer, Signal, run_virtual
from msbot.space import MemorySpace
from msbot.xrce import (
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    ClientState,
    DeliveryControl,
    EndpointQos,
    Pong,
    Status,
    TimeSynchronised,
    reader_variant,
)
from tests.agent.wiring import SUBSCRIBER, FakeLink, WiredClient, serving

LATCHED = EndpointQos(transient_local=True, depth=1)


class StrictGate(OpenGate):
    """Bars topics by client key, and remembers who came and went."""

    def __init__(self) -> None:
        self.barred: set[tuple[int, str]] = set()
        self.asked = 0
        self.events: list[str] = []

    def joined(self, client: ClientInfo) -> None:
        self.events.append(f"{client.key} joined from {client.address}")

    def left(self, client: ClientInfo, reason: str) -> None:
        self.events.append(f"{client.key} left: {reason}")

    def may_write(self, client: ClientInfo, topic: str) -> bool:
        self.asked += 1
        return (client.key, topic) not in self.barred

    def may_read(self, client: ClientInfo, topic: str) -> bool:
        self.asked += 1
        return (client.key, topic) not in self.barred


Scenario = Callable[[Agent, FakeLink], Awaitable[None]]


def play(scenario: Scenario, *, gate: OpenGate | None = None, settings: AgentSettings | None = None) -> None:
    """Run a scenario with an agent on one fake link, in virtual time."""

    async def main() -> None:
        agent = Agent(MemorySpace(), gate=gate, settings=settings, epoch_ns=lambda: 5_000_000_000)
        async with serving(agent) as link:
            await scenario(agent, link)

    run_virtual(main())


async def connected(link: FakeLink, *keys: int, mtu: int = 512) -> list[WiredClient]:
    """Clients with a session."""
    clients = [WiredClient(link, key=key, mtu=mtu) for key in keys]
    for client in clients:
        await client.connect()
    return clients


# Samples.


@pytest.mark.parametrize("stream_id", [STREAM_RELIABLE, STREAM_BEST_EFFORT])
def test_samples_of_one_client_reach_another(stream_id: int) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", stream_id=stream_id)
        writer = await one.add_writer("light")
        await one.write(writer, b"one", b"two", b"", stream_id=stream_id)
        assert other.received(reader) == [b"one", b"two", b""]
        assert agent.topics() == [("light", 3, 3)]

    play(scenario)


def test_samples_may_come_outside_of_all_streams() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light", stream_id=STREAM_NONE)
        await client.write(await client.add_writer("light"), b"x")
        assert client.received(reader) == [b"x"]

    play(scenario)


def test_a_large_sample_is_cut_and_joined_both_ways() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("picture")
        picture = bytes(range(256)) * 40
        await one.write(await one.add_writer("picture"), picture)
        await other.settle(40)
        assert other.received(reader) == [picture]

    play(scenario)


def test_a_burst_longer_than_the_window_arrives_whole_and_in_order() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", qos=EndpointQos(keep_all=True))
        writer = await one.add_writer("light")
        other.unplugged = True
        for number in range(60):
            await one.write(writer, bytes([number]))
        other.unplugged = False
        await asyncio.sleep(2.0)
        assert other.received(reader) == [bytes([number]) for number in range(60)]

    play(scenario)


@pytest.mark.parametrize("seed", range(3))
def test_reliable_samples_survive_a_lossy_link(seed: int) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        chance = random.Random(seed)
        one = WiredClient(link, key=1, lose=lambda _: chance.random() < 0.2)
        other = WiredClient(link, key=2, lose=lambda _: chance.random() < 0.2)
        for client in (one, other):
            client.session.connect(0.0)
            client.transmit()
        await asyncio.sleep(10.0)
        ids = {}
        for client, make in ((one, WiredClient.book_writer), (other, WiredClient.book_reader)):
            ids[client] = make(client, "light", qos=EndpointQos(keep_all=True))
        await asyncio.sleep(10.0)
        for number in range(100):
            await asyncio.sleep(0.3)
            one.session.write(ids[one], bytes([number]), STREAM_RELIABLE)
            one.transmit()
        await asyncio.sleep(10.0)
        assert other.received(ids[other]) == [bytes([number]) for number in range(100)]

    play(scenario)


def test_a_latched_sample_comes_to_a_late_reader() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        await one.write(await one.add_writer("profile", qos=LATCHED), b"old", b"new")
        assert other.received(await other.add_reader("profile")) == [b"new"]

    play(scenario)


def test_types_and_domains_keep_topics_apart() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", type_name="Lamp")
        await one.write(await one.add_writer("light", type_name="Light"), b"x")
        assert other.received(reader) == []

    play(scenario)


def test_pace_and_rate_are_kept_in_time() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", control=DeliveryControl(max_samples=3, min_pace_ms=100))
        await one.write(await one.add_writer("light"), b"1", b"2", b"3", b"4")
        counts = [len(other.received(reader))]
        for _ in range(3):
            await asyncio.sleep(0.1)
            await other.settle()
            counts.append(len(other.received(reader)))
        assert counts == [1, 1, 1, 0]

    play(scenario)


def test_a_read_of_nothing_is_refused_on_the_reliable_stream() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        writer = await client.add_writer("light")
        for object_id in (0x0996, writer):
            request_id = client.session.read(object_id, STREAM_BEST_EFFORT)
            assert await client.status_of(request_id) == Status.ERR_UNKNOWN_REFERENCE

    play(scenario)


def test_a_sample_for_nothing_is_counted_and_the_rest_of_the_message_counts() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light")
        writer = await client.add_writer("light")
        client.session.write(0x0995, b"lost", STREAM_RELIABLE)
        client.session.write(writer, b"found", STREAM_RELIABLE)
        await client.settle()
        assert client.received(reader) == [b"found"]
        assert agent.clients()[0].dropped == {"WRITE_DATA for an unknown object": 1}

    play(scenario)


def test_deleting_a_reader_ends_its_read() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        assert await other.delete(reader) == Status.OK
        await one.write(writer, b"x")
        assert other.received() == []

    play(scenario)


# Requests and replies.


def test_a_request_is_answered_and_the_replier_knows_who_asked() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        server, asker, stranger = await connected(link, 9, 0xAABBCCDD, 2)
        replier = await server.add_replier("add")
        requester = await asker.add_requester("add")
        await stranger.add_requester("add")
        request_id = await asker.write(requester, b"2+2")
        (request,) = server.received(replier)
        identity = decode_identity(request)
        assert identity is not None
        assert client_key_of(identity[0]) == 0xAABBCCDD
        await server.write(replier, request[:24] + b"4")
        assert asker.received(requester) == [request_id.to_bytes(2, "big") + requester.to_bytes(2, "big") + b"4"]
        assert stranger.received() == []

    play(scenario)


def test_a_beat_over_best_effort_is_answered_over_best_effort() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        server, asker = await connected(link, 9, 1)
        replier = await server.add_replier("inventory")
        requester = await asker.add_requester("inventory", stream_id=STREAM_BEST_EFFORT)
        await asker.write(requester, b"beat", stream_id=STREAM_BEST_EFFORT)
        (request,) = server.received(replier)
        await server.write(replier, request[:24] + b"yes", stream_id=STREAM_BEST_EFFORT)
        assert [reply[4:] for reply in asker.received(requester)] == [b"yes"]

    play(scenario)


# Sessions begin, are silent, end.


def test_deleting_the_session_takes_everything_along() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        await one.add_writer("profile", qos=LATCHED)
        one.session.close(0.0)
        await one.settle()
        assert one.session.state is ClientState.CLOSED
        assert [client.key for client in agent.clients()] == [2]
        assert gate.events[-1] == "1 left: session deleted"
        assert other.received(await other.add_reader("profile")) == []

    play(scenario, gate=gate)


def test_a_message_may_create_and_delete_the_session_in_one() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        link.inject(bytes.fromhex("8000000000011000585243450100010fbb0000078100fc01"))
        link.take_sent()
        participant = "01011000 000a {:04x} 01030000 02000000 0000 0000"
        link.inject(
            bytes.fromhex(
                "81800000"
                + participant.format(0x11)
                + participant.format(0x21)
                + "03010400 0002fffe"
                # What follows the end of the session is not done any more.
                + participant.format(0x31)
                + "07010800 0001 0015 00000000"
            )
        )
        assert [packet.hex() for packet in link.take_sent()] == [
            "8180000005010600000a00110000",
            "8180010005010600000a00210000",
            "81000000050106000002fffe0000",
            "810000000a0105000100000080",
        ]

    play(scenario)


@pytest.mark.parametrize("silence_s", [3.0, 30.0])
def test_a_silent_client_is_probed_three_times_and_then_gone(silence_s: float) -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        await client.add_writer("light")
        client.unplugged = True
        link.sent.clear()
        await asyncio.sleep(silence_s - 0.01)
        assert link.sent == []
        await asyncio.sleep(0.59)
        probes = [packet.hex() for _, packet in link.sent if packet[4] == 0x02]
        assert probes == ["81000000020108000000fffe01000000"] * 3
        assert len(agent.clients()) == 1
        await asyncio.sleep(0.1)
        assert agent.clients() == []
        assert gate.events[-1] == f"1 left: silent for {silence_s + 0.6:.1f} s, and did not answer"

    play(scenario, gate=gate, settings=AgentSettings(dead_after_s=silence_s))


def test_a_client_that_answers_probes_stays() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        await asyncio.sleep(100.0)
        (client,) = agent.clients()
        assert client.age_s == pytest.approx(100.0, abs=0.1)
        assert client.silent_s <= 3.0

    play(scenario, settings=AgentSettings(dead_after_s=3.0))


def test_hard_liveliness_of_a_client_overrides_the_setting() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        # seen: a genuine client built with hard liveliness; here 400 ms instead of its 10 s
        link.inject(
            bytes.fromhex(
                "80000000 00011000 58524345 0100 010f 11223344 81 01 0000 01000000 07000000 7578725f686c00 00"
                "07000000 30303034303000 7a fc01"
            )
        )
        assert len(agent.clients()) == 1
        link.sent.clear()
        await asyncio.sleep(0.9)
        assert len(link.sent) == 3
        # A C client answers with a header and eight octets of nothing; any packet is a sign of life.
        link.inject(bytes.fromhex("810000000000000000000000"))
        await asyncio.sleep(0.35)
        assert len(agent.clients()) == 1
        await asyncio.sleep(0.7)
        assert agent.clients() == []

    play(scenario)


def test_an_operator_may_end_a_session() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        assert agent.disconnect(1, "thrown out")
        assert not agent.disconnect(1, "thrown out")
        assert gate.events[-1] == "1 left: thrown out"
        client.session.ping(0.0)
        await client.settle()
        assert client.take(Pong) == [Pong(agent_knows_us=False)]

    play(scenario, gate=gate)


def test_a_vanished_peer_is_told_at_once_and_its_objects_wait_as_long_as_those_of_a_silent_one() -> None:
    gate = StrictGate()
    heard: list[tuple[Signal, Peer | None, str]] = []

    async def scenario(agent: Agent, link: FakeLink) -> None:
        agent.on_signal = lambda _link, signal, peer, reason, _now: heard.append((signal, peer, reason))
        one, other = await connected(link, 1, 2)
        await one.add_writer("light")
        link.signal(Signal.PEER_GONE, 1, "port unplugged")
        link.signal(Signal.PEER_GONE, 77, "never heard of")
        assert gate.events[-1] == "1 left: gone: port unplugged"
        assert heard == [(Signal.PEER_GONE, 1, "port unplugged"), (Signal.PEER_GONE, 77, "never heard of")]
        assert [client.gone for client in agent.clients()] == ["gone: port unplugged", None]
        link.sent.clear()
        await asyncio.sleep(29.9)
        assert [client.key for client in agent.clients()] == [1, 2]
        await asyncio.sleep(0.2)
        assert [client.key for client in agent.clients()] == [2]
        assert gate.events.count("1 left: gone: port unplugged") == 1
        assert gate.events[-1].startswith("1 left"), "it was told once"
        assert [peer for peer, _ in link.sent if peer == 1] == [], "and nobody asked it whether it was there"
        assert other.session.state is ClientState.CONNECTED

    play(scenario, gate=gate)


def test_a_client_whose_connection_broke_finds_its_objects_and_what_waited_for_it() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", qos=EndpointQos(keep_all=True))
        writer = await one.add_writer("light", qos=LATCHED)
        link.signal(Signal.PEER_GONE, 2, "connection closed")
        link.sent.clear()
        for number in range(20):
            await one.write(writer, bytes([number]))
        assert [peer for peer, _ in link.sent if peer == 2] == []
        again = WiredClient(link, key=2, peer="a new connection")
        await again.connect()
        await again.settle(40)
        assert gate.events[-2:] == ["2 left: gone: connection closed", "2 joined from peer a new connection"]
        assert again.received(reader) == [bytes([number]) for number in range(20)]
        status = await again.create(reader, reader_variant(0x12, SUBSCRIBER), reuse=False, replace=False)
        assert status == Status.ERR_ALREADY_EXISTS
        assert agent.clients()[1].gone is None
        link.signal(Signal.PEER_GONE, 2, "and now the old connection as well")
        assert agent.clients()[1].gone is None

    play(scenario, gate=gate)


def test_with_another_session_id_a_client_that_was_gone_begins_anew() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        await client.add_writer("light")
        link.signal(Signal.PEER_GONE, 1, "connection closed")
        again = WiredClient(link, key=1, session_id=0x82, peer="a new connection")
        await again.connect()
        (view,) = agent.clients()
        assert (view.session_id, view.objects, view.gone) == (0x82, (), None)
        assert gate.events == ["1 joined from peer 1", "1 left: gone: connection closed",
                               "1 joined from peer a new connection"]  # fmt: skip

    play(scenario, gate=gate)


def test_a_peer_that_is_back_goes_on_where_it_was() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", qos=EndpointQos(keep_all=True))
        writer = await one.add_writer("light")
        link.signal(Signal.PEER_GONE, 2, "port unplugged")
        other.unplugged = True
        await one.write(writer, b"while it was away")
        await asyncio.sleep(5.0)
        other.unplugged = False
        link.signal(Signal.PEER_BACK, 2, "its port is there again")
        link.signal(Signal.PEER_BACK, 77, "never heard of")
        await other.settle()
        await one.write(writer, b"now")
        assert other.received(reader) == [b"while it was away", b"now"]
        assert gate.events[-2:] == ["2 left: gone: port unplugged", "2 joined from peer 2"]
        assert agent.clients()[1].gone is None
        await asyncio.sleep(60.0)
        assert [client.key for client in agent.clients()] == [1, 2]

    play(scenario, gate=gate)


def test_the_gate_decides_what_a_client_that_is_gone_leaves_behind() -> None:
    class Leaving(StrictGate):
        def left(self, client: ClientInfo, reason: str) -> None:
            super().left(client, reason)
            self.barred.add((client.key, "light"))

        def joined(self, client: ClientInfo) -> None:
            super().joined(client)
            self.barred.discard((client.key, "light"))

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        await one.write(await one.add_writer("light", qos=LATCHED), b"latched")
        link.signal(Signal.PEER_GONE, 1, "port unplugged")
        assert [view.attached for view in agent.clients()[0].objects] == [True, True, True, False]
        reader = await other.add_reader("light")
        assert other.received(reader) == []
        link.signal(Signal.PEER_BACK, 1, "there again")
        assert [view.attached for view in agent.clients()[0].objects] == [True, True, True, True]

    play(scenario, gate=Leaving())


def test_whoever_logs_in_where_a_gone_client_was_takes_its_address() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        link.signal(Signal.PEER_GONE, 1, "port unplugged")
        other = WiredClient(link, key=2, peer=1)
        await other.connect()
        link.signal(Signal.PEER_BACK, 1, "there again")
        assert [(client.key, client.gone is None) for client in agent.clients()] == [(1, False), (2, True)]
        assert agent.disconnect(1, "thrown out")
        assert [client.key for client in agent.clients()] == [2]

    play(scenario)


def test_a_gone_client_is_kept_as_long_from_the_moment_it_went() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        await asyncio.sleep(2.5)
        link.signal(Signal.PEER_GONE, 1, "connection closed")
        await asyncio.sleep(2.9)
        assert len(agent.clients()) == 1, "counted from when it went"
        await asyncio.sleep(0.2)
        assert agent.clients() == []

    play(scenario, settings=AgentSettings(dead_after_s=3.0))


def test_logging_in_again_voids_grants_and_restarts_the_streams() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        gate.barred = {(1, "light")}
        await one.connect()
        assert gate.events[-1] == "1 joined from peer 1"
        await one.write(writer, b"x")
        assert other.received(reader) == []
        gate.barred.clear()
        agent.recheck(1)
        await one.write(writer, b"y")
        assert other.received(reader) == [b"y"]

    play(scenario, gate=gate)


def test_reads_go_on_after_logging_in_again() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        other.unplugged = True
        for number in range(30):
            await one.write(writer, bytes([number]))
        other.unplugged = False
        await other.connect()
        await other.settle(60)
        got = other.received(reader)
        # What was on its way is gone with the old streams; what waited in the history comes.
        assert got == [bytes([number]) for number in range(16, 30)]

    play(scenario)


def test_the_session_can_move_to_another_link() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        first, second = FakeLink("can:"), FakeLink("udp:", mtu=64)
        async with serving(agent, first, second):
            await connected(first, 1)
            assert (agent.clients()[0].link, agent.clients()[0].mtu) == ("can:", 508)
            await connected(second, 1)
            assert (agent.clients()[0].link, agent.clients()[0].mtu) == ("udp:", 64)

    run_virtual(main())


def test_a_session_with_its_key_in_every_header_is_found_from_any_address() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = [WiredClient(link, key=0xAABBCC07, session_id=0x01)]
        await client.connect()
        writer = await client.add_writer("light")
        reader = await client.add_reader("light")
        link.take_sent("elsewhere")
        link.inject(bytes.fromhex("01000000 aabbcc07 02010800 000a fffd 02000000"), "elsewhere")
        (pong,) = link.take_sent("elsewhere")
        assert pong.hex().startswith("01000000aabbcc0706011c00000afffd0001")
        await client.write(writer, b"x")
        assert client.received(reader) == [b"x"], "samples stay with the address of the login"
        link.inject(bytes.fromhex("01000000 aabbcc07 03010400 0002fffe"), "elsewhere")
        assert link.take_sent("elsewhere")[-1].hex() == "01000000aabbcc07050106000002fffe0000"
        assert agent.clients() == []

    play(scenario)


def test_several_sessions_with_keys_share_an_address() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        login = "00000000 {0:08x} 00011000 58524345 0100 010f {0:08x} 0100fc01"
        ping = "01000000 {:08x} 02010800 000a fffd 02000000"
        for key in (1, 2):
            link.inject(bytes.fromhex(login.format(key)), "gateway")
        link.take_sent()
        for key in (1, 2):
            link.inject(bytes.fromhex(ping.format(key)), "gateway")
        await asyncio.sleep(0)
        answers = [packet.hex() for packet in link.take_sent("gateway")]
        assert [answer[:16] for answer in answers] == ["0100000000000001", "0100000000000002"]
        assert all(answer[34:36] == "01" for answer in answers), "the agent knows them"
        link.inject(bytes.fromhex("80000000 02010800 000afffd 02000000"), "gateway")
        assert link.take_sent("gateway")[0][13] == 0, "not by address"
        link.signal(Signal.PEER_GONE, "gateway", "cable pulled")
        assert [client.gone for client in agent.clients()] == ["gone: cable pulled"] * 2
        link.inject(bytes.fromhex(ping.format(1)), "gateway")
        assert link.take_sent("gateway")[0][17] == 0, "its key opens nothing until it has logged in again"
        link.signal(Signal.PEER_BACK, "gateway", "there again")
        assert [client.gone for client in agent.clients()] == [None] * 2

    play(scenario, gate=gate)


def test_a_key_does_not_open_a_session_that_has_none_in_its_headers() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 7)
        link.sent.clear()
        link.inject(bytes.fromhex("01000000 00000007 03010400 0002fffe"), "thief")
        assert len(agent.clients()) == 1
        assert link.take_sent("thief")[0].hex().startswith("01000000000000070501")

    play(scenario)


def test_clocks_are_compared() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        client.session.sync_time()
        await client.settle()
        assert client.take(TimeSynchronised) == [TimeSynchronised(offset_ns=-5_000_000_000, round_trip_ns=0)]

    play(scenario)


# The gate.


def test_a_barred_client_is_heard_and_told_nothing() -> None:
    gate = StrictGate()
    gate.barred = {(1, "light"), (2, "light")}

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        writer = await one.add_writer("light", qos=LATCHED)
        reader = await other.add_reader("light")
        await one.write(writer, b"forbidden")
        assert agent.clients()[0].refused == {"light": 1}
        assert [view.attached for view in agent.clients()[0].objects] == [True, True, True, False]
        gate.barred = {(2, "light")}
        agent.recheck(1)
        await one.write(writer, b"latched")
        assert other.received(reader) == []
        gate.barred = set()
        agent.recheck(2)
        await other.settle()
        assert other.received(reader) == [b"latched"]
        gate.barred = {(2, "light")}
        agent.recheck(2)
        await one.write(writer, b"forbidden")
        assert other.received(reader) == []
        agent.recheck(99)

    play(scenario, gate=gate)


def test_the_gate_is_not_on_the_way_of_a_sample() -> None:
    gate = StrictGate()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        asked = gate.asked
        await one.write(writer, *[b"x"] * 10)
        assert len(other.received(reader)) == 10
        assert gate.asked == asked

    play(scenario, gate=gate)


# Links.


def test_samples_wait_for_a_full_link_and_the_newest_go_on() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light", qos=EndpointQos(depth=3), stream_id=STREAM_BEST_EFFORT)
        writer = await client.add_writer("light")
        link.room = 0
        await client.write(writer, *[bytes([number]) for number in range(10)], stream_id=STREAM_BEST_EFFORT)
        assert client.received(reader) == []
        link.make_room(1)
        await client.settle()
        assert agent.clients()[0].waiting <= 1
        link.make_room(None, client.peer)
        await client.settle()
        assert client.received(reader) == [b"\x00", b"\x07", b"\x08", b"\x09"]

    play(scenario)


def test_room_for_one_peer_is_not_room_for_all() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        readers = [await client.add_reader("light", stream_id=STREAM_BEST_EFFORT) for client in (one, other)]
        writer = await one.add_writer("light")
        link.room = 0
        await one.write(writer, b"x", stream_id=STREAM_BEST_EFFORT)
        link.make_room(None, 2)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert (one.received(readers[0]), other.received(readers[1])) == ([], [b"x"])
        link.make_room(None)
        await one.settle()
        assert one.received(readers[0]) == [b"x"]

    play(scenario)


def test_a_slow_link_takes_sample_by_sample_so_that_the_rest_stays_fresh() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        async with serving(agent, FakeLink("can:", bits_per_second=500_000)) as link:
            (client,) = await connected(link, 1)
            reader = await client.add_reader("light", qos=EndpointQos(depth=4), stream_id=STREAM_BEST_EFFORT)
            writer = await client.add_writer("light")
            link.room = 0
            for number in range(20):
                await client.write(writer, bytes([number]), stream_id=STREAM_BEST_EFFORT)
                if number > 3:
                    link.make_room(1)
            link.make_room(None)
            await client.settle()
            got = [payload[0] for payload in client.received(reader)]
            # Sample 0 was booked before the link was found full; of those behind it the newest four were kept.
            assert got == [0, *range(2, 20)]

    run_virtual(main())


def test_what_a_slow_link_lost_is_asked_for_again() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        async with serving(agent, FakeLink("can:", bits_per_second=500_000)) as link:
            one, other = await connected(link, 1, 2)
            reader = await other.add_reader("light")
            writer = await one.add_writer("light")
            await asyncio.sleep(1.0)
            link.room = 0
            await one.write(writer, b"x")
            other.unplugged = True
            link.make_room(None)
            await other.settle()
            other.unplugged = False
            await asyncio.sleep(0.25)
            assert other.received(reader) == [b"x"]

    run_virtual(main())


def test_an_ended_session_needs_no_timer() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        await client.add_reader("light")
        writer = await client.add_writer("light")
        client.session.write(writer, b"x", STREAM_RELIABLE)
        client.transmit()
        agent.disconnect(1, "in the same turn")
        link.sent.clear()
        await asyncio.sleep(100.0)
        assert link.sent == []

    play(scenario)


def test_a_link_that_fills_up_or_breaks_between_asking_and_sending() -> None:
    class Treacherous(FakeLink):
        error: Exception | None = None

        def send(self, packet: bytes, peer: Peer) -> None:
            if self.error is not None:
                raise self.error
            super().send(packet, peer)

    async def main() -> None:
        link = Treacherous()
        agent = Agent(MemorySpace())
        async with serving(agent, link):
            (client,) = await connected(link, 1)
            reader = await client.add_reader("light", stream_id=STREAM_BEST_EFFORT)
            writer = await client.add_writer("light")
            link.error = LinkFull("full after all")
            await client.write(writer, b"waits", stream_id=STREAM_BEST_EFFORT)
            link.inject(bytes.fromhex("80000000 02010800 000afffd 02000000"))
            assert agent.dropped() == {"answer not sent: LinkFull": 1}
            assert agent.clients()[0].waiting == 1
            link.error = LinkDown("gone")
            link.make_room(None)
            assert agent.clients()[0].dropped == {"packet for a link that is down": 1}
            link.error = None
            await client.write(writer, b"goes", stream_id=STREAM_BEST_EFFORT)
            assert client.received(reader) == [b"goes"]

    run_virtual(main())


def test_a_gate_may_end_other_sessions_when_one_leaves() -> None:
    class Chain(StrictGate):
        agent: Agent

        def left(self, client: ClientInfo, reason: str) -> None:
            super().left(client, reason)
            for key in (1, 2, 3):
                self.agent.disconnect(key, "with the others")

    gate = Chain()

    async def main() -> None:
        gate.agent = Agent(MemorySpace(), gate=gate)
        async with serving(gate.agent, FakeLink("first:"), FakeLink("second:")) as link:
            await connected(link, 1, 2, 3)
            gate.events.clear()
            link.break_down()
            await asyncio.sleep(0.1)
            assert sorted(gate.events) == [
                "1 left: link first: has ended", "2 left: with the others", "3 left: with the others"
            ]  # fmt: skip

    run_virtual(main())


def test_all_packets_of_one_turn_are_answered_in_one_flush() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        link.sent.clear()
        for number in range(5):
            link.inject(bytes.fromhex(f"81000000 02010800 {number:04x} fffd 02000000"), client.peer)
        assert link.sent == []
        await asyncio.sleep(0)
        assert len(link.sent) == 5

    play(scenario)


def test_a_burst_is_answered_at_its_end_without_a_turn_of_the_loop() -> None:
    class Bursts(FakeLink):
        end_burst: Callable[[], None]

        def on_burst_end(self, handler: Callable[[], None]) -> None:
            self.end_burst = handler

    async def main() -> None:
        link = Bursts()
        async with serving(Agent(MemorySpace()), link):
            link.inject(bytes.fromhex("80000000 0001 1000 58524345 01000f0f 00000001 81 00 0002"))
            link.sent.clear()
            ping = bytes.fromhex("81000000 02010800 000a fffd 02000000")
            link.inject(ping)
            link.inject(ping)
            assert link.sent == []
            link.end_burst()
            assert len(link.sent) == 2
            await asyncio.sleep(0)
            link.end_burst()
            assert len(link.sent) == 2

    run_virtual(main())


def test_a_link_that_cannot_be_opened_ends_the_agent() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        good, bad = FakeLink("good:"), FakeLink("bad:")
        bad.failure = LinkDown("port 8888 is in use: stop the other agent or choose another port")
        agent.add_link(good)
        agent.add_link(bad)
        with pytest.raises(LinkDown, match="port 8888 is in use"):
            await agent.run()

    run_virtual(main())


def test_a_link_that_breaks_later_leaves_the_others() -> None:
    gate = StrictGate()

    async def main() -> None:
        agent = Agent(MemorySpace(), gate=gate)
        first, second = FakeLink("first:"), FakeLink("second:")
        agent.add_link(first)
        task = asyncio.create_task(agent.run())
        await asyncio.sleep(0.1)
        agent.add_link(second)
        await asyncio.sleep(0.1)
        await connected(first, 1)
        (other,) = await connected(second, 2)
        first.break_down(LinkDown("adapter pulled"))
        await asyncio.sleep(0.1)
        assert gate.events[-1] == "1 left: link first: has ended"
        assert [client.key for client in agent.clients()] == [2]
        await other.add_writer("light")
        second.break_down(LinkDown("adapter pulled, too"))
        with pytest.raises(LinkDown, match="too"):
            await task

    run_virtual(main())


def test_a_link_that_ends_by_itself_ends_the_agent_quietly() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        link = FakeLink()
        agent.add_link(link)
        link.break_down()
        await agent.run()

    run_virtual(main())


def test_a_tap_hears_every_link() -> None:
    heard: list[tuple[float, str, Peer, bytes]] = []

    def tap(now: float, direction: str, peer: Peer, packet: bytes) -> None:
        heard.append((now, direction, peer, packet))

    agent = Agent(MemorySpace())
    first, second = FakeLink("first:"), FakeLink("second:")
    agent.add_link(first)
    agent.tap = tap
    agent.add_link(second)
    assert first.tap is second.tap is agent.tap is tap


def test_parts_in_the_same_process_are_served_like_all_others() -> None:
    async def main() -> None:
        agent = Agent(MemorySpace())
        hub = InprocHub()
        agent.add_link(hub.server)
        task = asyncio.create_task(agent.run())
        link = hub.connect()
        answers: list[bytes] = []
        link.on_packet(lambda packet, _peer, _now: answers.append(packet))
        client = asyncio.create_task(link.run())
        await asyncio.sleep(0.1)
        link.send(bytes.fromhex("80000000 02010800 000afffd 02000000"), link.remote)
        await asyncio.sleep(0.1)
        assert [answer[4] for answer in answers] == [0x06]
        for running in (client, task):
            running.cancel()
        await asyncio.gather(client, task, return_exceptions=True)

    run_virtual(main())


# Bad input.


def test_a_crowd_of_sessions_is_bounded_and_served() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        login = "80000000 00011000 58524345 0100 010f {:08x} 8100fc01"
        for key in range(1, 2001):
            link.inject(bytes.fromhex(login.format(key)), key)
        assert len(agent.clients()) == 1000
        statuses = [packet[8] for _, packet in link.sent]
        assert statuses == [0] * 1000 + [Status.ERR_RESOURCES] * 1000
        await asyncio.sleep(40.0)
        assert agent.clients() == [], "nobody answered the probes"

    play(scenario, settings=AgentSettings(max_clients=1000))


def _mutilated(packet: bytes, position: int, octet: int, length: int) -> bytes:
    changed = bytearray(packet)
    if changed:
        changed[position % len(changed)] = octet
    return bytes(changed[:length])


REAL = [
    bytes.fromhex(text)
    for text in (
        "8000000000011000585243450100010faaaabbbb8100fc01",
        "818000000105280000 0a00110101000019000000 64656661756c745f787263655f7061727469636970616e7400 00000000",
        "81800100010535 00000b0012 02030000 27000000 10000000 48656c6c6f576f726c64546f70696300 000188530b000000"
        "48656c6c6f576f726c640000 11000000",
        "818000000801100000 1d001680 0000 01ffff000000000000",
        "8180000007010c00001e00150001020304050607",
        "810000000a0105000000ffff80",
        "810000000b0105000000080080",
        "818000000d010a0007011400004000150001",
        "810000000e010800163e016ba3948a32",
        "810000000c010000",
        "81000000030104000002fffe",
        "8100000002010800000afffd02000000",
    )
]

packets = st.one_of(
    st.binary(max_size=80),
    st.builds(_mutilated, st.sampled_from(REAL), st.integers(0, 200), st.integers(0, 255), st.integers(0, 120)),
    st.sampled_from(REAL),
)


@settings(deadline=None, max_examples=150)
@given(st.lists(st.tuples(packets, st.sampled_from(["a", "b"])), max_size=30))
def test_any_octets_leave_the_agent_serving(inputs: list[tuple[bytes, str]]) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        for packet, peer in inputs:
            link.inject(packet, peer)
            await asyncio.sleep(0)
        await asyncio.sleep(1.0)
        (client,) = await connected(link, 0xC0FFEE)
        reader = await client.add_reader("alive")
        await client.write(await client.add_writer("alive"), b"!")
        assert client.received(reader) == [b"!"]

    play(scenario)


def test_what_people_see_of_a_client() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light")
        writer = await client.add_writer("light")
        await client.write(writer, b"x")
        await client.write(writer, b"y", stream_id=STREAM_BEST_EFFORT)
        (view,) = agent.clients()
        assert [(stream.stream_id, stream.outgoing, stream.unacked) for stream in view.streams] == [
            (0x01, False, 0), (0x80, False, 0), (0x80, True, 0)
        ]  # fmt: skip
        assert (view.published, view.delivered, view.resent, view.repeated) == (2, 2, 0, 0)
        assert view.streams[0].last == 0
        assert reader in {seen.object_id for seen in view.objects}

    play(scenario)


def test_late_packets_of_a_clients_last_session_change_nothing_in_the_new_one() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        late = [bytes.fromhex("81800300") + bytes([7, 1, 5, 0, 0, 9]) + writer.to_bytes(2, "big") + b"x"] * 2
        again = WiredClient(link, key=1, session_id=0x82)
        await again.connect()
        writer = await again.add_writer("light")
        for packet in [*late, bytes.fromhex("81000000030104000002fffe"), bytes.fromhex("810000000c010000")]:
            link.inject(packet, 1)
        await again.write(writer, b"1", b"2", b"3", b"4", b"5")
        assert other.received(reader) == [b"1", b"2", b"3", b"4", b"5"]
        assert agent.dropped() == {"packet without a session": 3}

    play(scenario)
