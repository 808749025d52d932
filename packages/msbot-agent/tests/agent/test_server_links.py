"""The agent and its links: room, bursts, failures, taps."""

from __future__ import annotations

import asyncio

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, ClientInfo
from msbot_agent.link import InprocHub, Peer
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import LinkDown, LinkFull
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot_xrce.objects import EndpointQos
from tests.agent.scenes import StrictGate, connected, play
from tests.agent.wiring import FakeLink, serving


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

        def session_ended(self, client: ClientInfo, reason: str) -> None:
            super().session_ended(client, reason)
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
                "1 left: link first: has ended",
                "2 left: with the others",
                "3 left: with the others",
            ]

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
    async def main() -> None:
        link = FakeLink(in_bursts=True)
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
        link.attach(packet=lambda packet, _peer, _now: answers.append(packet))
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
