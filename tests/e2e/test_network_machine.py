"""Whatever happens to network, agent, clients and gate: when it is over, everybody is connected and nothing is lost.

A real agent and three real clients in virtual time. `MSBOT_EXAMPLES=2000` runs it for longer.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Coroutine
from random import Random
from typing import TypeVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from msbot.part import Client, ClientSettings, ConnectionState, Entity, ServiceNames
from msbot.process.virtual_time import VirtualTimeLoop
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, OpenGate
from msbot_agent.link import InprocHub, LinkInfo, LossyLink, PacketHandler, RoomHandler, SignalHandler
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot_xrce.objects import EndpointQos
from tests.effort import tries

EXAMPLES = int(os.environ.get("MSBOT_EXAMPLES") or tries(50, 2000))
NODES = 3
HEALED_S = 40.0
"""Longer than anybody waits for anything: a stall is noticed after 5 s, a lost agent after 2.6 s, both may follow."""
KEEP_ALL = EndpointQos(keep_all=True)
ADD = ServiceNames("add", "Q", "A")

_T = TypeVar("_T")


class SilentLink(LossyLink):
    """A lossy link that says nothing about the other side, as UDP does not."""

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        super().attach(packet=packet, room=room, burst_end=burst_end)


class Gate(OpenGate):
    """Bars single clients from all topics."""

    def __init__(self) -> None:
        self.barred: set[int] = set()

    def may_write(self, client: ClientInfo, topic: str) -> bool:
        return client.key not in self.barred

    def may_read(self, client: ClientInfo, topic: str) -> bool:
        return client.key not in self.barred


class Node:
    """One client: writes topic n, reads topic n - 1; node 0 answers requests, the others ask."""

    def __init__(self, number: int, hub: InprocHub, random: Random, *, silent: bool) -> None:
        self.number = number
        self.key = 100 + number
        self.heard: list[bytes] = []
        self.replies: list[tuple[int, bytes]] = []
        self._hub = hub
        self._random = random
        self._silent = silent
        self._room = asyncio.Event()
        self.link = self._plug_in()
        self.client, self.task = self._start()

    def _plug_in(self) -> LossyLink:
        end = self._hub.connect()
        end.info = LinkInfo("inproc", 512)
        return (SilentLink if self._silent else LossyLink)(end, random=self._random)

    def _start(self) -> tuple[Client, asyncio.Task[None]]:
        options = ClientSettings(session_id=1 if self.number == 1 else 0x81)
        client = Client(
            self.link,
            key=self.key,
            settings=options,
            epoch_ns=lambda: 0,
            random=Random(self.key),
            on_topic=lambda _object, _request, payload: self.heard.append(payload),
            on_reply=lambda _object, request_id, payload: self.replies.append((request_id, payload)),
            on_request=self._answer,
            on_room=self._room.set,
        )
        participant = client.create_participant(f"node {self.number}")
        publisher, subscriber = client.create_publisher(participant), client.create_subscriber(participant)
        out = client.create_topic(participant, f"topic {self.number}", "T")
        into = client.create_topic(participant, f"topic {(self.number - 1) % NODES}", "T")
        self.writer = client.create_writer(publisher, out, KEEP_ALL)
        self.reader = client.create_reader(subscriber, into, KEEP_ALL)
        make = client.create_replier if self.number == 0 else client.create_requester
        self.service = make(participant, ADD)
        for entity in (self.reader, self.service):
            client.read(entity)
        self.participant = participant
        self.more: list[Entity] = []
        return client, asyncio.get_running_loop().create_task(client.run())

    def _answer(self, _object: int, _request: int, identity: bytes, payload: bytes) -> None:
        try:
            self.client.reply(self.service, identity, b"sum of " + payload)
        except (LinkFull, LocalProtocolError):
            return  # the one who asked asks again

    def write(self, payload: bytes, *, stream_id: int = STREAM_RELIABLE) -> None:
        """Write a sample if that is possible now."""
        try:
            self.client.write(self.writer, payload, stream_id=stream_id)
        except (LinkFull, LocalProtocolError):
            return

    async def write_when_there_is_room(self, payload: bytes) -> None:
        """Write a sample, now or after others were acknowledged."""
        while not self.client.has_room():
            self._room.clear()
            await self._room.wait()
        self.client.write(self.writer, payload)

    async def stop(self) -> None:
        """The process dies."""
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)

    def start(self, *, elsewhere: bool) -> None:
        """A new process begins, at the same address or another one."""
        if elsewhere:
            was = self.link.disturbance
            self.link = self._plug_in()
            new = self.link.disturbance
            new.drop, new.duplicate, new.reorder = was.drop, was.duplicate, was.reorder
        self.client, self.task = self._start()


class NetworkMachine(RuleBasedStateMachine):
    """Samples carry a number that is never used again."""

    @initialize(seed=st.integers(0, 1000), silent=st.lists(st.booleans(), min_size=NODES, max_size=NODES))
    def begin(self, seed: int, silent: list[bool]) -> None:
        self.loop = VirtualTimeLoop()
        self.errors: list[dict[str, object]] = []
        self.loop.set_exception_handler(lambda _loop, context: self.errors.append(context))
        self.number = 0
        self.gate = Gate()
        self.hub = InprocHub()
        random = Random(seed)

        async def start() -> None:
            self.nodes = [Node(number, self.hub, random, silent=silent[number]) for number in range(NODES)]
            self._start_agent()

        self._run(start())

    # What may happen.

    @rule(
        node=st.integers(0, NODES - 1),
        drop=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
        duplicate=st.sampled_from([0.0, 0.3]),
        reorder=st.sampled_from([0.0, 0.3]),
    )
    def network_changes(self, node: int, drop: float, duplicate: float, reorder: float) -> None:
        link = self.nodes[node].link.disturbance
        link.drop, link.duplicate, link.reorder = drop, duplicate, reorder

    @rule(seconds=st.sampled_from([0.001, 0.02, 0.3, 1.0, 3.0, 9.0]))
    def time_passes(self, seconds: float) -> None:
        self._run(asyncio.sleep(seconds))

    @rule(node=st.integers(0, NODES - 1), count=st.integers(1, 20), size=st.sampled_from([0, 30, 400, 2000]))
    def somebody_writes(self, node: int, count: int, size: int) -> None:
        async def write() -> None:
            for _ in range(count):
                self.nodes[node].write(self._sample(size))

        self._run(write())

    @rule(node=st.integers(0, NODES - 1))
    def somebody_writes_best_effort_and_asks(self, node: int) -> None:
        async def write() -> None:
            self.nodes[node].write(self._sample(4), stream_id=STREAM_BEST_EFFORT)
            await self._ask(self.nodes[node], b"?")

        self._run(write())

    @rule(gap_s=st.sampled_from([0.0, 0.5, 4.0]))
    def agent_restarts(self, gap_s: float) -> None:
        async def restart() -> None:
            await self._stop_agent()
            await asyncio.sleep(gap_s)
            self._start_agent()

        self._run(restart())

    @rule(node=st.integers(0, NODES - 1), gap_s=st.sampled_from([0.0, 0.5, 35.0]), elsewhere=st.booleans())
    def client_restarts(self, node: int, gap_s: float, elsewhere: bool) -> None:
        async def restart() -> None:
            await self.nodes[node].stop()
            await asyncio.sleep(gap_s)
            self.nodes[node].start(elsewhere=elsewhere)

        self._run(restart())

    @rule(node=st.integers(0, NODES - 1))
    def client_ends_politely_and_comes_again(self, node: int) -> None:
        async def restart() -> None:
            await self.nodes[node].client.close()
            await self.nodes[node].task
            self.nodes[node].start(elsewhere=False)

        self._run(restart())

    @rule(node=st.integers(0, NODES - 1))
    def client_begins_its_session_anew(self, node: int) -> None:
        async def begin_anew() -> None:
            self.nodes[node].client.reconnect("a whim")

        self._run(begin_anew())

    @rule(node=st.integers(0, NODES - 1))
    def agent_throws_somebody_out(self, node: int) -> None:
        async def throw_out() -> None:
            self.agent.disconnect(self.nodes[node].key, "a whim")

        self._run(throw_out())

    @rule(barred=st.sets(st.integers(0, NODES - 1)))
    def gate_changes(self, barred: set[int]) -> None:
        self._run(self._bar({self.nodes[number].key for number in barred}))

    @rule(node=st.integers(0, NODES - 1), create=st.booleans())
    def objects_change(self, node: int, create: bool) -> None:
        async def change() -> None:
            one = self.nodes[node]
            if create:
                one.more.append(one.client.create_topic(one.participant, f"more {len(one.more)}", "T"))
            elif one.more:
                one.client.delete(one.more.pop())

        self._run(change())

    # What must hold.

    @invariant()
    def nothing_is_raised_and_nobody_ends(self) -> None:
        if hasattr(self, "nodes"):
            assert self.errors == []
            assert not self.agent_task.done()
            assert not any(node.task.done() for node in self.nodes)

    @rule()
    def everything_heals(self) -> None:
        self._run(self._heal())

    def teardown(self) -> None:
        if not hasattr(self, "nodes"):
            return
        try:
            self._run(self._heal())
            assert self.errors == []
        finally:
            self._run(self._end())
            self.loop.close()

    async def _heal(self) -> None:
        for node in self.nodes:
            disturbance = node.link.disturbance
            disturbance.drop = disturbance.duplicate = disturbance.reorder = 0.0
        await self._bar(set())
        await asyncio.sleep(HEALED_S)
        for node in self.nodes:
            assert node.client.state is ConnectionState.CONNECTED, (node.number, node.client.reason)
            missing = [entity.describe for entity in node.client.entities if not entity.created]
            assert missing == [], node.number
        views = self.agent.clients()
        assert [view.key for view in views] == [node.key for node in self.nodes]
        for view, node in zip(views, self.nodes, strict=True):
            # What an earlier process of that client made may still be there: the agent keeps objects over a new login.
            assert {item.object_id for item in view.objects} >= {entity.object_id for entity in node.client.entities}
        await self._samples_arrive()
        await self._requests_are_answered()

    async def _samples_arrive(self) -> None:
        written: dict[int, list[bytes]] = {}
        for node in self.nodes:
            node.heard.clear()
            written[node.number] = [self._sample(size) for size in [0, 100, 2000, *[8] * 30]]
        for payloads in zip(*written.values(), strict=True):
            for node, payload in zip(self.nodes, payloads, strict=True):
                async with asyncio.timeout(10.0):
                    await node.write_when_there_is_room(payload)
        await asyncio.sleep(3.0)
        for node in self.nodes:
            assert node.heard == written[(node.number - 1) % NODES], f"what node {node.number} heard"

    async def _requests_are_answered(self) -> None:
        for node in self.nodes[1:]:
            node.replies.clear()
            asked = [await self._ask(node, bytes([number])) for number in range(3)]
            await asyncio.sleep(1.0)
            assert node.replies == [(asked[number], b"sum of " + bytes([number])) for number in range(3)]

    # Tools.

    def _run(self, what: Coroutine[object, object, _T]) -> _T:
        return self.loop.run_until_complete(what)

    def _sample(self, size: int) -> bytes:
        self.number += 1
        return self.number.to_bytes(4, "big") + bytes(size)

    async def _ask(self, node: Node, question: bytes) -> int:
        if node.number == 0:
            return 0
        try:
            return node.client.write(node.service, question)
        except (LinkFull, LocalProtocolError):
            return 0

    async def _bar(self, keys: set[int]) -> None:
        self.gate.barred = keys
        for node in self.nodes:
            self.agent.recheck(node.key)

    def _start_agent(self) -> None:
        self.agent = Agent(MemorySpace(), gate=self.gate, settings=AgentSettings(dead_after_s=10.0), epoch_ns=lambda: 0)
        self.agent.add_link(self.hub.server)
        self.agent_task = self.loop.create_task(self.agent.run())

    async def _stop_agent(self) -> None:
        self.agent_task.cancel()
        await asyncio.gather(self.agent_task, return_exceptions=True)

    async def _end(self) -> None:
        for node in self.nodes:
            await node.stop()
        await self._stop_agent()


NetworkMachine.TestCase.settings = settings(max_examples=EXAMPLES, stateful_step_count=20)
TestNetwork = NetworkMachine.TestCase
