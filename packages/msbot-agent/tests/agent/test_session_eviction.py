"""However many strangers log in: who holds a place keeps it, and who comes gets in."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, OpenGate
from msbot_agent.link import Peer, Signal
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientState, Status
from msbot_xrce.messages import SESSION_NONE, CreateClient, Header, ObjectKind, encode_message, make_object_id
from msbot_xrce.objects import participant_variant
from tests.agent.wiring import FakeLink, WiredClient, serving


class Places(OpenGate):
    """Some clients hold a place."""

    def __init__(self) -> None:
        self.settled: set[int] = set()
        self.left_with: dict[int, str] = {}

    def is_settled(self, client: ClientInfo) -> bool:
        return client.key in self.settled

    def session_ended(self, client: ClientInfo, reason: str) -> None:
        self.left_with[client.key] = reason


class Hosts(FakeLink):
    """Peers are `(host, port)`."""

    def origin(self, peer: Peer) -> Peer:
        return peer[0] if isinstance(peer, tuple) else peer


def log_in(link: FakeLink, key: int, peer: tuple[str, int], *, liveliness_ms: int | None = None) -> None:
    """A CREATE_CLIENT, answered or not."""
    properties = None if liveliness_ms is None else (("uxr_hl", str(liveliness_ms)),)
    request = CreateClient(key, 0x81, 512, properties)
    link.inject(encode_message(Header(SESSION_NONE), [request], pad_end=False), peer)


def keys(agent: Agent) -> list[int]:
    return [view.key for view in agent.clients()]


Scenario = Callable[[Agent, FakeLink], Awaitable[None]]


def play(scenario: Scenario, gate: OpenGate | None, settings: AgentSettings) -> None:
    async def main() -> None:
        agent = Agent(MemorySpace(), gate=gate, settings=settings)
        async with serving(agent, Hosts()) as link:
            await scenario(agent, link)

    run_virtual(main())


def test_ten_thousand_logins_from_one_address_put_nobody_out_who_holds_a_place_or_lives_elsewhere() -> None:
    gate = Places()
    settings = AgentSettings(max_clients=60, max_unsettled=40, max_unsettled_of_address=20)

    async def scenario(agent: Agent, link: FakeLink) -> None:
        for key in (1, 2, 3):
            log_in(link, key, ("part", key))
            gate.settled.add(key)
        log_in(link, 4, ("new part", 1))
        for number in range(10_000):
            log_in(link, 1000 + number, ("attacker", number))
        assert keys(agent)[:4] == [1, 2, 3, 4]
        assert len(keys(agent)) == 4 + 20
        log_in(link, 5, ("another part", 1))
        log_in(link, 6, ("attacker", 99_999))
        assert {5, 6} < set(keys(agent))
        assert gate.left_with[1000].startswith("made room for a newcomer")

    play(scenario, gate, settings)


def test_strangers_from_many_addresses_share_one_bound_and_the_oldest_goes_first() -> None:
    gate = Places()
    settings = AgentSettings(max_clients=60, max_unsettled=40, max_unsettled_of_address=20)

    async def scenario(agent: Agent, link: FakeLink) -> None:
        log_in(link, 1, ("part", 1))
        gate.settled.add(1)
        for number in range(1000):
            log_in(link, 1000 + number, (f"host {number}", 1))
        assert keys(agent) == [1, *range(1960, 2000)]

    play(scenario, gate, settings)


def test_a_stranger_that_found_its_place_is_a_stranger_no_more() -> None:
    gate = Places()
    settings = AgentSettings(max_clients=60, max_unsettled=10, max_unsettled_of_address=10)

    async def scenario(agent: Agent, link: FakeLink) -> None:
        for key in range(1, 31):
            log_in(link, key, ("class", key))
            gate.settled.add(key)
        assert keys(agent) == list(range(1, 31))

    play(scenario, gate, settings)


@pytest.mark.parametrize(("settled", "gone"), [(False, True), (True, False)])
def test_only_who_holds_a_place_may_be_silent_as_long_as_it_says(settled: bool, gone: bool) -> None:
    gate = Places()

    async def scenario(agent: Agent, link: FakeLink) -> None:
        log_in(link, 1, ("part", 1), liveliness_ms=3_600_000)
        if settled:
            gate.settled.add(1)
        await asyncio.sleep(40.0)
        assert (keys(agent) == []) is gone

    play(scenario, gate, AgentSettings(dead_after_s=10.0))


def test_objects_of_strangers_end_before_those_of_the_parts() -> None:
    gate = Places()
    settings = AgentSettings(max_objects_unsettled=8, max_objects_in_all=20)

    async def create(client: WiredClient, numbers: range) -> list[int]:
        return [
            await client.create(make_object_id(number, ObjectKind.PARTICIPANT), participant_variant(""))
            for number in numbers
        ]

    async def scenario(agent: Agent, link: FakeLink) -> None:
        part, one, other = (WiredClient(link, key=key) for key in (1, 2, 3))
        for client in (part, one, other):
            await client.connect()
            assert client.session.state is ClientState.CONNECTED
        gate.settled.add(1)
        assert await create(one, range(1, 10)) == [Status.OK] * 8 + [Status.ERR_RESOURCES]
        assert await create(other, range(1, 5)) == [Status.OK] * 2 + [Status.ERR_RESOURCES] * 2
        assert await create(part, range(1, 11)) == [Status.OK] * 10
        assert await create(part, range(11, 12)) == [Status.ERR_RESOURCES]

    play(scenario, gate, settings)


def test_without_a_gate_a_full_agent_forgets_who_was_silent_for_long_and_nobody_else() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        for key in range(1, 6):
            log_in(link, key, ("here", key))
        log_in(link, 6, ("here", 6))
        assert keys(agent) == [1, 2, 3, 4, 5]
        await asyncio.sleep(31.0)
        log_in(link, 6, ("here", 6))
        assert keys(agent) == [2, 3, 4, 5, 6]

    play(scenario, None, AgentSettings(max_clients=5, dead_after_s=float("inf")))


def test_with_an_infinite_limit_silent_clients_stay_and_those_seen_to_go_are_kept_for_a_while() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        log_in(link, 1, ("here", 1))
        log_in(link, 2, ("here", 2))
        link.sent.clear()
        await asyncio.sleep(3600.0)
        assert keys(agent) == [1, 2]
        assert link.sent == [], "nobody is asked whether it is there"
        link.signal(Signal.PEER_GONE, ("here", 2), "unplugged")
        await asyncio.sleep(29.0)
        assert keys(agent) == [1, 2]
        await asyncio.sleep(2.0)
        assert keys(agent) == [1]

    play(scenario, None, AgentSettings(dead_after_s=float("inf")))
