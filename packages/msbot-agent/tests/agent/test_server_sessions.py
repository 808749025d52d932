"""The agent as clients see it: how sessions begin, pause, move and end, and what the gate lets them do."""

from __future__ import annotations

import asyncio
import gc
import weakref

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings, ClientInfo
from msbot_agent.link import Link, Peer, Signal
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientState, Status
from msbot_xrce.objects import EndpointQos, reader_variant
from msbot_xrce.sessions import Pong, TimeSynchronised
from tests.agent.scenes import LATCHED, StrictGate, connected, play
from tests.agent.wiring import SUBSCRIBER, FakeLink, WiredClient, serving


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


def test_a_session_that_is_over_is_forgotten_without_the_garbage_collector() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        await client.add_writer("light")
        await client.add_reader("light")
        (proxy,) = (weakref.ref(one) for one in agent._clients)
        (session,) = (weakref.ref(one.session) for one in agent._clients)
        client.session.close(0.0)
        await client.settle()
        assert agent.clients() == []
        await asyncio.sleep(5)  # who sends too much is compared now and then; until then its packets are remembered
        (other,) = await connected(link, 2)
        await other.add_writer("light")
        assert (proxy(), session()) == (None, None)

    gc.disable()
    try:
        play(scenario)
    finally:
        gc.enable()


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

    # One submessage in a message, so that the octets can be those of the genuine agent.
    play(scenario, settings=AgentSettings(packs=False))


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
        one, other = await connected(link, 1, 2)
        await one.add_writer("light")
        link.signal(Signal.PEER_GONE, 1, "port unplugged")
        link.signal(Signal.PEER_GONE, 77, "never heard of")
        assert gate.events[-1] == "1 left: gone: port unplugged"
        assert [told for told in heard if told[0] is not Signal.LINK_UP] == [
            (Signal.PEER_GONE, 1, "port unplugged"),
            (Signal.PEER_GONE, 77, "never heard of"),
        ]
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

    def hear(link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        heard.append((signal, peer, reason))

    play(scenario, gate=gate, signal=hear)


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
        assert gate.events == [
            "1 joined from peer 1",
            "1 left: gone: connection closed",
            "1 joined from peer a new connection",
        ]

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
        def session_ended(self, client: ClientInfo, reason: str) -> None:
            super().session_ended(client, reason)
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


@pytest.mark.promise("A board that comes again leaves no session behind, whatever its key")
@pytest.mark.parametrize("ids", [(0x81, 0x81), (0x01, 0x01), (0x01, 0x02), (0x01, 0x81), (0x81, 0x01)])
def test_a_board_that_resets_and_has_another_key_leaves_no_session_behind(ids: tuple[int, int]) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        first = WiredClient(link, key=0xAABBCC01, peer="board", session_id=ids[0])
        await first.connect()
        await first.add_writer("light")
        first.unplugged = True
        for key in (0xAABBCC02, 0xAABBCC03, 0xAABBCC04):  # a loop of resets
            again = WiredClient(link, key=key, peer="board", session_id=ids[1])
            await again.connect()
            await again.add_writer("light")
            await asyncio.sleep(1)
            again.unplugged = key != 0xAABBCC04
        for _ in range(30):
            await asyncio.sleep(0.5)
            await again.settle()
        assert [(client.key, len(client.objects)) for client in agent.clients()] == [(0xAABBCC04, 4)]
        await again.add_writer("dark", number=2)

    play(scenario)


def test_clients_with_keys_in_their_headers_go_on_beside_each_other_at_one_address() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        clients: list[WiredClient] = []
        for key in range(1, 6):
            clients.append(WiredClient(link, key=key, peer="gateway", session_id=key))

            def to_all(packet: bytes) -> None:
                for client in clients:
                    client._receive(packet)

            link.plug("gateway", to_all)
            await clients[-1].connect()
        for _ in range(30):
            await asyncio.sleep(1)
            for client in clients:
                await client.settle()
        assert [client.key for client in agent.clients()] == [1, 2, 3, 4, 5]

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
        reader = await other.add_reader("light", qos=LATCHED)
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
