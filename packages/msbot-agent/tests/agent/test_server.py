"""The agent as operators see it, and what no packet can do to it."""

from __future__ import annotations

import asyncio

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.agent import Agent, AgentSettings
from msbot_xrce import Status
from msbot_xrce.messages import STREAM_BEST_EFFORT
from tests.agent.scenes import connected, play
from tests.agent.wiring import FakeLink
from tests.effort import tries


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


@settings(deadline=None, max_examples=tries(150, 3000))
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
            (0x01, False, 0),
            (0x80, False, 0),
            (0x80, True, 0),
        ]
        assert (view.published, view.delivered, view.resent, view.repeated) == (2, 2, 0, 0)
        assert view.streams[0].last == 0
        assert reader in {seen.object_id for seen in view.objects}

    play(scenario)
