"""Master and inventory at work: real agent, real clients, virtual time (R43 to R48, R52, R57, T9, T10)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from random import Random

import pytest

from msbot.agent import Agent
from msbot.errors import LinkFull, RequestError
from msbot.link import InprocHub, LinkInfo, run_virtual
from msbot.part import Client, Entity, Service, plug
from msbot.pnp import PROFILE_TOPIC, PROFILE_TYPE, Access, Inventory, MemoryStore, PartState, Profile, compat
from msbot.pnp.services import InventoryService, MasterService, profile_message
from msbot.space import MemorySpace
from msbot.xrce import STREAM_BEST_EFFORT, STREAM_RELIABLE
from tests.pnp.robot import Binding, Configuration, sample_store, uid

INVENTORY = Service(plug.INVENTORY_SERVICE, plug.INVENTORY_REQUEST_TYPE, plug.INVENTORY_REPLY_TYPE)
ORIGINAL = Service(compat.SERVICE, compat.REQUEST_TYPE, compat.REPLY_TYPE)


def epoch_ns() -> int:
    return 1_600_000_000_000_000_000


class Robot:
    """One robot: agent, master and inventory on the in-process link; parts come in by another one."""

    def __init__(self, store: MemoryStore, *, explain: bool = False, limit: int | None = None) -> None:
        loop = asyncio.get_running_loop()
        self.inventory = Inventory(store, random=Random(1), now=loop.time())
        self.access = Access(self.inventory, clock=loop.time)
        self.agent = Agent(MemorySpace(), gate=self.access, epoch_ns=epoch_ns, agent_id=b"agent-id")
        self.access.recheck = self.agent.recheck
        inside, self.outside = InprocHub(), InprocHub()
        self.outside.server.info = LinkInfo("wire", 65535)
        self.agent.add_link(inside.server)
        self.agent.add_link(self.outside.server)
        self.master = MasterService(Client(inside.connect(), key=1, epoch_ns=epoch_ns), Profile(), limit=limit)
        client = Client(inside.connect(), key=2, epoch_ns=epoch_ns)
        self.service = InventoryService(client, self.inventory, explain=explain)

    def state(self, key: int) -> PartState:
        return [part.state for part in self.inventory.view(0.0) if part.client_key == key][-1]


class Visitor:
    """A client on the wire that reads the profile, may ask the inventory, publishes as AA and hears one ring topic."""

    def __init__(self, robot: Robot, key: int, service: Service = INVENTORY, *, hears: str = "3_to_1") -> None:
        self.client = Client(robot.outside.connect(), key=key, epoch_ns=epoch_ns)
        self.profiles: list[tuple[float, plug.ProfileMessage]] = []
        self.heard: list[bytes] = []
        self.replies: list[bytes] = []
        client = self.client
        participant = client.create_participant()
        publisher, subscriber = client.create_publisher(participant), client.create_subscriber(participant)
        self.reader = client.create_reader(subscriber, client.create_topic(participant, PROFILE_TOPIC, PROFILE_TYPE))
        out = client.create_topic(participant, "HelloWorldTopic_1_to_2", "HelloWorld")
        self.writer = client.create_writer(publisher, out)
        into = client.create_topic(participant, f"HelloWorldTopic_{hears}", "HelloWorld")
        self.ring_reader = client.create_reader(subscriber, into)
        self.requester = client.create_requester(participant, service)
        for entity in (self.reader, self.ring_reader, self.requester):
            client.read(entity)
        client.on_topic = self._sample
        client.on_reply = lambda _object, _request, payload: self.replies.append(payload)

    def _sample(self, object_id: int, _request_id: int, payload: bytes) -> None:
        if object_id == self.reader.object_id:
            self.profiles.append((asyncio.get_running_loop().time(), plug.ProfileMessage.decode(payload)))
        else:
            self.heard.append(payload)

    async def ask(self, body: bytes, *, patience_s: float = 0.2) -> bytes | None:
        """Send one request; the reply, or None if there is none in time."""
        self.replies.clear()
        self.client.write(self.requester, body, stream_id=STREAM_BEST_EFFORT)
        await asyncio.sleep(patience_s)
        return self.replies[-1] if self.replies else None

    async def claim(self, number: str = "ABCD", serial: int = 1) -> plug.Verdict | None:
        message = plug.Claim(part_number=number, local_name="", uid=uid(serial), session_nonce=1)
        reply = await self.ask(message.encode())
        return None if reply is None else plug.Verdict.decode(reply)

    def publish(self, payload: bytes) -> None:
        self.client.write(self.writer, payload)


async def with_robot(robot: Robot, *visitors: Visitor, play: Callable[[], Awaitable[None]]) -> None:
    """Run everybody until the play is over."""
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(robot.agent.run())]
        running += [tasks.create_task(service.run()) for service in (robot.service, robot.master)]
        await robot.service.until_ready()
        running += [tasks.create_task(visitor.client.run()) for visitor in visitors]
        for visitor in visitors:
            await visitor.client.connect(1.0)
            await visitor.client.until_all_statuses(1.0)
        await play()
        for task in running:
            task.cancel()


def test_the_profile_message_has_the_thesis_fields_by_position_in_103_octets() -> None:
    message = profile_message(Profile(), 3)
    assert (message.index, message.message, message.name) == (3, "MSBOT_MASTER", "MSBOT_V1")
    assert (message.id, message.dof, message.make) == ("X100Y100Z100", "8-4-2021", "MASSEY_ENGINEERING_DEP")
    assert len(message.encode()) == 103
    assert profile_message(Profile(), 1 << 32).index == 0


def test_a_new_part_gets_the_latched_profile_at_once_and_then_every_5_s() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        early, late = Visitor(robot, 0xA1), Visitor(robot, 0xA2)

        async def play() -> None:
            await asyncio.sleep(0.01)
            (first,) = early.profiles
            await asyncio.sleep(7.0)
            async with asyncio.TaskGroup() as tasks:
                task = tasks.create_task(late.client.run())
                plugged_in_at = asyncio.get_running_loop().time()
                await asyncio.sleep(0.05)
                assert [profile.index for _, profile in late.profiles] == [2]
                assert late.profiles[0][0] - plugged_in_at < 0.05
                task.cancel()
            await asyncio.sleep(4.0)
            times = [at for at, _ in early.profiles]
            assert times[1] - times[0] == pytest.approx(5.0, abs=0.05)
            assert times[2] - times[1] == pytest.approx(5.0, abs=0.01)
            assert first[1].index == 1

        await with_robot(robot, early, play=play)

    run_virtual(scene())


def test_the_master_falls_silent_after_its_limit() -> None:
    async def scene() -> None:
        robot = Robot(sample_store(), limit=2)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            await asyncio.sleep(30.0)
            assert [profile.index for _, profile in visitor.profiles] == [1, 2]
            assert robot.master.published == 2

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_a_part_registers_beats_and_fetches_its_configuration_through_the_agent() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            verdict = await visitor.claim()
            assert verdict is not None
            assert verdict.lease
            beat = plug.Beat(lease=verdict.lease).encode()
            assert await visitor.ask(beat) == plug.BeatReply(configuration_version=1).encode()
            reply = await visitor.ask(plug.ConfigurationRequest(lease=verdict.lease, have_version=0).encode())
            assert reply is not None
            assert plug.Configuration.decode(reply).slot == "AA"
            (part,) = robot.inventory.view(0.0)
            assert (part.client_key, part.address, part.beats) == (0xA1, "in-process client 1", 1)

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_a_configuration_longer_than_a_packet_arrives_whole() -> None:
    async def scene() -> None:
        store = sample_store()
        bindings = tuple(Binding(f"port{n}", f"topic{n}", "HelloWorld", publishes=True) for n in range(100))
        store.configurations["AA"] = Configuration(5, "AA", bindings)
        robot = Robot(store)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            verdict = await visitor.claim()
            assert verdict is not None
            reply = await visitor.ask(plug.ConfigurationRequest(lease=verdict.lease, have_version=0).encode())
            assert reply is not None
            assert len(plug.Configuration.decode(reply).bindings) == 100

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_nobody_publishes_before_both_steps_are_done_nor_after_delisting() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        sender, partner = Visitor(robot, 0xA1), Visitor(robot, 0xB1)
        topic = "HelloWorldTopic_1_to_2"

        def published() -> int:
            return dict((name, count) for name, count, _ in robot.agent.topics()).get(topic, 0)

        async def play() -> None:
            sender.publish(b"too early")
            await asyncio.sleep(0.1)
            assert published() == 0
            await sender.claim()
            sender.publish(b"now")
            await asyncio.sleep(0.1)
            assert published() == 1
            await asyncio.sleep(6.1)
            assert robot.state(0xA1) is PartState.LOST
            sender.publish(b"too late")
            await asyncio.sleep(0.1)
            assert published() == 1
            assert await sender.claim() is not None
            sender.publish(b"again")
            await asyncio.sleep(0.1)
            assert published() == 2
            assert partner.heard == []

        await with_robot(robot, sender, partner, play=play)

    run_virtual(scene())


def test_unknown_part_gets_no_reply_and_the_journal_tells_why() -> None:
    async def scene() -> None:
        store = sample_store()
        robot = Robot(store)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            assert await visitor.claim("NOPE") is None
            assert store.events[-1].reason == "part number NOPE is not in the library"
            assert store.events[-1].address == "in-process client 1"

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_two_different_parts_at_once_are_both_registered_and_keep_beating() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        first, second = Visitor(robot, 0xA1), Visitor(robot, 0xB1)

        async def play() -> None:
            verdicts = await asyncio.gather(first.claim("ABCD", 1), second.claim("EFGH", 2))
            assert all(verdict is not None and verdict.lease for verdict in verdicts)
            assert {part.slot for part in robot.inventory.view(0.0)} == {"AA", "BB"}

        await with_robot(robot, first, second, play=play)

    run_virtual(scene())


def test_an_original_program_registers_beats_and_publishes() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        visitor = Visitor(robot, 0xAAAAAAAA, ORIGINAL)

        async def play() -> None:
            request = compat.encode_request("ABCD", "ABCD-local")
            for _ in range(8):
                assert await visitor.ask(request, patience_s=1.0) == compat.encode_reply("ABCD")
            assert robot.state(0xAAAAAAAA) is PartState.ACTIVE
            assert await visitor.ask(compat.encode_request("NOPE", "x")) is None

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_leaving_politely_is_noticed_at_once() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            await visitor.claim()
            await visitor.client.close()
            await asyncio.sleep(0.1)
            assert robot.state(0xA1) is PartState.LEFT

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_a_part_that_the_link_sees_vanish_is_lost_at_once() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            async with asyncio.TaskGroup() as tasks:
                task = tasks.create_task(visitor.client.run())
                await visitor.client.connect(1.0)
                await visitor.client.until_all_statuses(1.0)
                await visitor.claim()
                task.cancel()
            await asyncio.sleep(0.1)
            assert robot.state(0xA1) is PartState.LOST

        await with_robot(robot, play=play)

    run_virtual(scene())


def test_nobody_on_the_wire_may_take_a_services_key() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        thief = Client(robot.outside.connect(), key=1, epoch_ns=epoch_ns)

        async def play() -> None:
            async with asyncio.TaskGroup() as tasks:
                task = tasks.create_task(thief.run())
                await asyncio.sleep(3.0)
                assert robot.access.denied["client key in use on another link"] > 0
                task.cancel()

        await with_robot(robot, play=play)

    run_virtual(scene())


class ClumsyClient(Client):
    """Fails as often as it is told."""

    not_ready = 0
    full = 0

    async def until_all_statuses(self, timeout_s: float = 1.0) -> None:
        if self.not_ready:
            self.not_ready -= 1
            raise RequestError("not every creation was answered")
        await super().until_all_statuses(timeout_s)

    def write(self, entity: Entity, payload: bytes, *, stream_id: int = STREAM_RELIABLE) -> int:
        if self.full:
            self.full -= 1
            raise LinkFull("the stream is full")
        return super().write(entity, payload, stream_id=stream_id)


def test_the_master_waits_until_the_agent_is_ready_and_repeats_what_found_no_room() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        clumsy = ClumsyClient(robot.outside.connect(), key=3, epoch_ns=epoch_ns)
        clumsy.not_ready, clumsy.full = 2, 1
        service = MasterService(clumsy, Profile(name="second"), period_s=3.0)

        async def play() -> None:
            async with asyncio.TaskGroup() as tasks:
                task = tasks.create_task(service.run())
                await asyncio.sleep(1.9)
                assert service.published == 0
                await asyncio.sleep(0.2)
                assert (service.published, clumsy.counters.samples_out) == (1, 0)
                await asyncio.sleep(3.0)
                assert (service.published, clumsy.counters.samples_out) == (2, 1)
                task.cancel()

        await with_robot(robot, play=play)

    run_virtual(scene())


def test_an_answer_that_finds_no_room_is_counted_and_the_part_asks_again() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        inside = InprocHub()
        robot.agent.add_link(inside.server)
        clumsy = ClumsyClient(inside.connect(), key=2, epoch_ns=epoch_ns)
        clumsy.full = 1
        robot.service = InventoryService(clumsy, robot.inventory)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            assert await visitor.claim() is None
            assert robot.service.desk.dropped == {"answer: the stream is full": 1}
            assert await visitor.claim() is not None

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_a_master_that_the_agent_has_forgotten_publishes_again_as_soon_as_it_is_back() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())

        async def play() -> None:
            await asyncio.sleep(1.0)
            assert robot.master.published == 1
            assert robot.agent.disconnect(1, "test")
            await asyncio.sleep(3.5)
            assert robot.master.published == 2

        await with_robot(robot, play=play)

    run_virtual(scene())


def test_two_robots_side_by_side_do_not_see_each_others_parts() -> None:
    async def scene() -> None:
        ours, theirs = Robot(sample_store()), Robot(sample_store())
        sender, partner = Visitor(ours, 0xA1), Visitor(ours, 0xB1, hears="1_to_2")
        stranger = Visitor(theirs, 0xB2, hears="1_to_2")

        async def play() -> None:
            other = asyncio.ensure_future(with_robot(theirs, stranger, play=lambda: asyncio.sleep(3.0)))
            await asyncio.sleep(1.0)
            for visitor, number in ((sender, "ABCD"), (partner, "EFGH"), (stranger, "EFGH")):
                assert await visitor.claim(number, visitor.client.key) is not None
            sender.publish(b"ours only")
            await asyncio.sleep(0.5)
            assert (partner.heard, stranger.heard) == ([b"ours only"], [])
            assert [part.client_key for part in ours.inventory.view(0.0)] == [0xA1, 0xB1]
            assert [part.client_key for part in theirs.inventory.view(0.0)] == [0xB2]
            await other

        await with_robot(ours, sender, partner, play=play)

    run_virtual(scene())
