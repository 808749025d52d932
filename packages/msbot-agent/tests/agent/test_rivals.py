"""Two sessions of one client key where the gate keeps sessions (`msbot_agent.agent.stale_sessions`)."""

from __future__ import annotations

import asyncio

import pytest

from msbot_agent.agent import Agent, ClientInfo
from msbot_agent.agent.stale_sessions import DOUBLE_LOGIN_PATIENCE_S, HELD_S, MOST_BESIDE
from msbot_xrce.messages import CreateClient, Header, encode_message
from tests.agent.scenes import StrictGate, connected, play
from tests.agent.wiring import FakeLink, WiredClient


class Keeper(StrictGate):
    """Keeps sessions; some hold a place."""

    def __init__(self, *settled: int) -> None:
        super().__init__()
        self.settled = set(settled)

    def keeps(self, client: ClientInfo) -> bool:
        return True

    def is_settled(self, client: ClientInfo) -> bool:
        return client.key in self.settled


def addresses(agent: Agent) -> list[str]:
    return sorted(view.address for view in agent.clients())


def log_in(link: FakeLink, peer: str, key: int = 1, session_id: int = 0x81) -> None:
    login = CreateClient(client_key=key, session_id=session_id, mtu=512)
    header = Header(session_id & 0x80, 0, 0, None if session_id & 0x80 else key)
    link.inject(encode_message(header, [login], pad_end=False), peer)


@pytest.mark.parametrize("settled", [(), (1,)])
def test_a_living_session_stays_and_the_newcomer_goes_when_it_comes_to_nothing(settled: tuple[int, ...]) -> None:
    gate = Keeper(*settled)

    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        writer = await client.add_writer("light")
        log_in(link, "thief")
        for _ in range(5):
            await asyncio.sleep(DOUBLE_LOGIN_PATIENCE_S / 3)
            await client.settle()  # a wired client answers probes when it is looked at
        assert addresses(agent) == ["peer 1", "peer thief"]
        client.session.write(writer, b"still", 0x80)
        await client.settle()
        assert [(name, count) for name, count, _ in agent.topics()] == [("light", 1)]
        await asyncio.sleep(HELD_S)
        assert addresses(agent) == ["peer 1"]
        assert not any(event.startswith("1 left") for event in gate.events)

    play(scenario, gate=gate)


def test_a_silent_session_without_a_place_goes_as_soon_as_that_is_clear() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        client.unplugged = True
        log_in(link, "again")
        await asyncio.sleep(DOUBLE_LOGIN_PATIENCE_S - 0.01)
        assert addresses(agent) == ["peer 1", "peer again"]
        await asyncio.sleep(0.02)
        assert addresses(agent) == ["peer again"]
        await asyncio.sleep(HELD_S)
        assert addresses(agent) == ["peer again"]

    play(scenario, gate=Keeper())


def test_a_silent_session_with_a_place_is_the_gates_to_end() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        client.unplugged = True
        log_in(link, "again")
        await asyncio.sleep(1.0)
        assert addresses(agent) == ["peer 1", "peer again"]
        (newcomer,) = [view.key for view in agent.clients() if view.key != 1]
        assert agent.disconnect(1, "taken over")
        await asyncio.sleep(HELD_S)
        assert [view.key for view in agent.clients()] == [newcomer]

    play(scenario, gate=Keeper(1))


def test_a_restart_at_the_same_address_is_as_quick_as_ever() -> None:
    gate = Keeper(1)

    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        log_in(link, "thief")
        log_in(link, 1, session_id=0x82)  # type: ignore[arg-type]
        assert gate.events[-2:] == ["1 left: replaced by a new session of the same key", "1 joined from peer 1"]

    play(scenario, gate=gate)


def test_a_newcomer_that_repeats_its_login_is_one_session() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        for _ in range(3):
            log_in(link, "thief")
        assert len(agent.clients()) == 2

    play(scenario, gate=Keeper(1))


def test_few_sessions_are_held_beside_one() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        await connected(link, 1)
        for number in range(3 * MOST_BESIDE):
            log_in(link, f"thief {number}")
        assert "peer 1" in addresses(agent)
        assert len(agent.clients()) == 1 + MOST_BESIDE

    play(scenario, gate=Keeper(1))


def test_a_key_in_the_header_is_good_at_the_address_of_its_login_only() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        client = WiredClient(link, key=1, session_id=0x01)
        await client.connect()
        writer = await client.add_writer("light")
        client.session.write(writer, b"mine", 0x80)
        packets = client.session.packets_to_send(0.0)
        for packet in packets:
            link.inject(packet, "thief")
        assert agent.topics() == [("light", 0, 0)]
        for packet in packets:
            link.inject(packet, 1)
        assert agent.topics() == [("light", 1, 0)]
        log_in(link, "thief", session_id=0x01)
        for packet in packets:
            link.inject(packet, "thief")
        assert agent.topics() == [("light", 1, 0)]

    play(scenario, gate=Keeper(1))
