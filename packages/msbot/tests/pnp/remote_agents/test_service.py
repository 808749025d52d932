"""The master's service for agents: what goes on which stream, to whom, and what waits; without a network."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from msbot.pnp import Inventory, Profile, RobotGate
from msbot.pnp.emergency_stop import EmergencyStop
from msbot.pnp.inventory_service import LONGEST_BEST_EFFORT
from msbot.pnp.remote_agents.agent_messages import (
    AgentBeat,
    AgentHello,
    AgentRefused,
    AgentWelcome,
    Answer,
    Ask,
    Close,
    Forgotten,
    FromAgent,
    Held,
    MasterHeard,
    Remark,
    Rights,
    SessionOpen,
    SessionOver,
    Sign,
    Sought,
    WhoIsThat,
    decode_from_master,
    encode,
)
from msbot.pnp.remote_agents.agents_service import ReliableSendQueue, RemoteAgentsService, goes_at_once
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from tests.pnp.remote_agents.test_ends import TIMING, sample_slots

IDENTITY = bytes(24)


@pytest.mark.parametrize(
    ("message", "at_once"),
    [
        (AgentHello(boot=1, name="pi"), True),
        (AgentBeat(count=1, stops_said=0, words=""), True),
        (SessionOpen(number=1, times=1, client_key=1, reads_profile=0, address=""), False),
        (Rights(number=1, times=1, reads_profile=0, settled=0, topics=[]), False),
        (Ask(number=1, compat=0, identity=IDENTITY, body=bytes(6)), True),  # a beat of a part
        (Ask(number=1, compat=0, identity=IDENTITY, body=bytes(7)), False),
        (Answer(number=1, compat=0, identity=IDENTITY, body=bytes(512)), True),
        (Answer(number=1, compat=0, identity=IDENTITY, body=bytes(513)), False),
    ],
)
def test_what_is_repeated_or_worth_nothing_later_goes_at_once(message: Any, at_once: bool) -> None:
    assert goes_at_once(message) is at_once


@pytest.mark.parametrize(
    ("message", "number"),
    [
        (AgentHello(boot=1, name="pi"), 1),
        (SessionOpen(number=1, times=1, client_key=1, reads_profile=0, address=""), 2),
        (SessionOver(number=1, reason=""), 3),
        (Ask(number=1, compat=0, identity=IDENTITY, body=b""), 4),
        (AgentBeat(count=1, stops_said=0, words=""), 5),
        (Sign(number=1, silent_ms=0), 6),
        (Remark(number=1, words=""), 7),
        (AgentRefused(reason=""), 17),
        (Rights(number=1, times=1, reads_profile=0, settled=0, topics=[]), 18),
        (Forgotten(number=1), 19),
        (Answer(number=1, compat=0, identity=IDENTITY, body=b""), 20),
        (MasterHeard(count=1, stop=0, holds=0, stops_confirmed=0), 21),
        (WhoIsThat(), 22),
        (Sought(number=1), 23),
        (Close(number=1, reason=""), 24),
        (Held(number=1, why=""), 25),
    ],
)
def test_agents_and_masters_of_other_versions_know_a_message_by_its_number(message: Any, number: int) -> None:
    assert encode(message)[0] == number


class Way:
    """A stream with room for so many, or with an error."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.written: list[bytes] = []
        self.error: Exception | None = None

    def write(self, octets: bytes) -> None:
        if self.error is not None:
            raise self.error
        if not self.room:
            raise LinkFull("full")
        self.room -= 1
        self.written.append(octets)


def test_what_finds_no_room_waits_in_order() -> None:
    way = Way(1)
    sayings = ReliableSendQueue(way.write)
    for number in range(4):
        sayings.send(bytes((number,)))
    assert way.written == [b"\0"]
    way.room = 2
    sayings.go_on()
    assert way.written == [b"\0", b"\1", b"\2"]
    way.room = 9
    sayings.send(b"\4")
    sayings.go_on()
    assert way.written == [b"\0", b"\1", b"\2", b"\3", b"\4"]


def test_without_a_session_what_waits_is_worth_nothing() -> None:
    way = Way(0)
    sayings = ReliableSendQueue(way.write)
    sayings.send(b"1")
    way.error, way.room = LocalProtocolError("no session"), 9
    sayings.send(b"2")
    way.error = None
    sayings.send(b"3")
    assert way.written == [b"3"]


class FakeClient:
    """The client that speaks for the service: keeps what is written."""

    def __init__(self, *, on_request: Callable[..., None], on_room: Callable[[], None]) -> None:
        self.on_request = on_request
        self.on_room = on_room
        self.written: list[tuple[bytes, int]] = []
        self.error: Exception | None = None
        self.reads: list[int] = []

    def create_participant(self, name: str) -> int:
        return 1

    def create_replier(self, participant: int, names: object) -> int:
        return 2

    def read(self, replier: int) -> None:
        self.reads.append(replier)

    def write(self, replier: int, octets: bytes, *, stream_id: int = STREAM_RELIABLE) -> None:
        assert replier == 2
        if self.error is not None:
            raise self.error
        self.written.append((octets, stream_id))


class Stage:
    """A service, and one agent with a requester on each stream."""

    def __init__(self) -> None:
        self.client: Any = None
        self.stops: list[tuple[str, str]] = []
        self.topics: list[int] = []
        self.said: list[str] = []

        def make_client(**handlers: Any) -> Any:
            self.client = FakeClient(**handlers)
            return self.client

        inventory = Inventory(sample_slots(), random=Random(1), now=0.0, timing=TIMING)
        access = RobotGate(inventory, clock=lambda: 0.0)
        self.service = RemoteAgentsService(
            make_client,
            access=access,
            inventory=inventory,
            services=None,  # type: ignore[arg-type]
            profile=Profile(),
            stop=EmergencyStop(),
            random=Random(2),
            sealed=False,
            on_stop=lambda *said: self.stops.append(said),
            on_topics=self.topics.append,
            say=self.said.append,
        )
        access.use_agents(self.service.end, lambda _: None)

    def ask(self, guid: bytes, message: FromAgent) -> list[tuple[bytes, Any, int]]:
        """The agent speaks through the requester with that GUID; what is answered: to whom, what, on which stream."""
        self.client.on_request(2, 1, guid + bytes(8), encode(message))
        return self.written()

    def written(self) -> list[tuple[bytes, Any, int]]:
        written, self.client.written = self.client.written, []
        return [(octets[:24], decode_from_master(octets[24:]), stream) for octets, stream in written]


AGENT = 0x0A0B0C0D


def guid_of(entity: int) -> bytes:
    """Of a requester of the agent: eight octets of the agent that made it, the client's key, the entity."""
    return bytes(8) + AGENT.to_bytes(4, "big") + bytes((0, 0, 0, entity))


def test_each_answer_goes_to_the_requester_of_its_stream() -> None:
    async def main() -> None:
        stage, quick, in_order = Stage(), guid_of(1), guid_of(2)
        ((to, welcome, stream),) = stage.ask(quick, AgentHello(boot=7, name="pi"))
        assert (to, stream) == (quick + bytes(8), STREAM_BEST_EFFORT)
        assert isinstance(welcome, AgentWelcome)
        assert stage.said == ["the agent pi brings parts"]
        opened = SessionOpen(number=1, times=1, client_key=5, reads_profile=0, address="node 1")
        ((to, rights, stream),) = stage.ask(in_order, opened)
        assert (to, stream) == (in_order + bytes(8), STREAM_RELIABLE)
        assert isinstance(rights, Rights)
        stage.ask(quick, AgentBeat(count=1, stops_said=1, words="button"))
        assert stage.stops == [("pi", "button")]
        stage.service.agent_left(AGENT)
        assert stage.said[-1] == "the agent pi has ended"
        stage.service.send(AGENT, welcome)
        assert stage.written() == []
        assert stage.service.end.dropped == {"message to an agent that cannot be said": 1}

    run_virtual(main())


def test_an_agent_that_spoke_on_one_stream_only_is_answered_there() -> None:
    async def main() -> None:
        stage, quick = Stage(), guid_of(1)
        stage.ask(quick, AgentHello(boot=7, name="pi"))
        opened = SessionOpen(number=1, times=1, client_key=5, reads_profile=0, address="node 1")
        stage.service.end.receive(AGENT, opened, 0.0)
        ((to, _, stream),) = stage.written()
        assert (to, stream) == (quick + bytes(8), STREAM_RELIABLE)

    run_virtual(main())


def test_what_cannot_be_read_or_said_is_counted() -> None:
    async def main() -> None:
        stage, quick = Stage(), guid_of(1)
        stage.client.on_request(2, 1, quick + bytes(8), b"\xff")
        assert stage.service.end.dropped == {"message of an agent that cannot be read": 1}
        stage.client.error = LinkFull("the stream is full")
        assert stage.ask(quick, AgentHello(boot=7, name="pi")) == []
        assert stage.service.end.dropped["message to an agent: the stream is full"] == 1
        opened = SessionOpen(number=1, times=1, client_key=5, reads_profile=0, address="node 1")
        assert stage.ask(quick, opened) == []  # it waits
        stage.client.error = None
        stage.client.on_room()
        assert [type(message) for _, message, _ in stage.written()] == [Rights]

    run_virtual(main())


def test_time_passes_for_agents_that_came_later() -> None:
    async def main() -> None:
        stage = Stage()
        keeping = asyncio.create_task(stage.service._keep_time())
        await asyncio.sleep(5)
        stage.ask(guid_of(1), AgentHello(boot=7, name="pi"))
        await asyncio.sleep(1.9)
        assert stage.service.end.names() == [("pi", 0, False)]
        await asyncio.sleep(0.2)
        assert stage.service.end.names() == [("pi", 0, True)]
        await asyncio.sleep(60)
        assert stage.service.end.names() == []
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)

    run_virtual(main())


@pytest.mark.parametrize("more", [0, 1])
def test_what_is_too_long_for_one_packet_goes_in_order(more: int) -> None:
    async def main() -> None:
        stage, quick = Stage(), guid_of(1)
        stage.ask(quick, AgentHello(boot=7, name="pi"))
        rest = len(encode(Answer(number=1, compat=0, identity=IDENTITY, body=b"")))
        long = Answer(number=1, compat=0, identity=IDENTITY, body=bytes(LONGEST_BEST_EFFORT - rest + more))
        stage.service.send(AGENT, long)
        ((to, said, stream),) = stage.written()
        assert (to, said) == (quick + bytes(8), long)
        assert stream == (STREAM_RELIABLE if more else STREAM_BEST_EFFORT)

    run_virtual(main())


def test_what_is_asked_and_what_changes_is_passed_on() -> None:
    async def main() -> None:
        stage, quick = Stage(), guid_of(1)
        passed: list[tuple[int, dict[str, Any]]] = []

        class Services:
            def request_from_elsewhere(self, key: int, **more: Any) -> None:
                passed.append((key, more))

        stage.service._services = Services()  # type: ignore[assignment]
        stage.ask(quick, AgentHello(boot=7, name="pi"))
        stage.ask(quick, SessionOpen(number=1, times=1, client_key=5, reads_profile=0, address="node 1"))
        (key,) = stage.service.end._places
        stage.ask(quick, Ask(number=1, compat=1, identity=IDENTITY, body=b"body"))
        assert passed == [(key, {"in_compat": True, "identity": IDENTITY, "body": b"body"})]
        stage.service.recheck(AGENT)
        assert stage.topics == [AGENT]

    run_virtual(main())


def test_the_service_asks_for_requests_of_its_replier() -> None:
    async def main() -> None:
        stage = Stage()
        assert stage.client.reads == [2]

    run_virtual(main())
