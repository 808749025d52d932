"""The thesis' own programs: they name their topics themselves, and the gate opens exactly those of their slot (R50)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from random import Random

from msbot.part import Client, Entity, HelloWorld
from msbot.part.join import thesis_messages
from msbot.pnp import MemoryStore, PartState, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import LossyLink
from msbot_xrce.messages import Format, ObjectKind, ObjectVariant
from tests.pnp.robot import configuration, sample_store
from tests.pnp.scene import Robot, epoch_ns

REQUESTER = (
    '<dds><requester profile_name="my_requester"service_name="service_name"'
    'request_type="request_type"reply_type="reply_type"></requester></dds>'
)
"""As it stands in the programs: without blanks between the attributes."""


class Program:
    """What uclient_AA, BB and CC do: create everything by XML, then publish and ask once a second, from the start."""

    def __init__(self, robot: Robot, key: int, number: str, writes: str, reads: str) -> None:
        self.wire = LossyLink(robot.outside.connect(), random=Random(1))
        self.client = Client(
            self.wire,
            key=key,
            epoch_ns=epoch_ns,
            on_topic=lambda _object, _request, payload: self.heard.append(HelloWorld.decode(payload).message),
            on_reply=lambda *_: setattr(self, "replies", self.replies + 1),
        )
        self.number = number
        self.heard: list[str] = []
        self.replies = 0
        self.silent = False
        """Asks no more, and so neither claims nor beats."""
        self.is_held_up = False
        """Its loop never gets to its own lines, because samples keep coming; its library answers what it must."""
        participant = self._create(
            ObjectKind.PARTICIPANT, "<dds><participant><rtps><name>p</name></rtps></participant></dds>"
        )
        self.requester = self._create(ObjectKind.REQUESTER, REQUESTER, participant)
        for topic in (writes, reads):
            text = f"<dds><topic><name>{topic}</name><dataType>HelloWorld</dataType></topic></dds>"
            self._create(ObjectKind.TOPIC, text, participant)
        publisher = self._create(ObjectKind.PUBLISHER, "", participant)
        subscriber = self._create(ObjectKind.SUBSCRIBER, "", participant)
        end = "<dds><{0}><topic><kind>NO_KEY</kind><name>{1}</name><dataType>HelloWorld</dataType></topic></{0}></dds>"
        self.writer = self._create(ObjectKind.DATAWRITER, end.format("data_writer", writes), publisher)
        reader = self._create(ObjectKind.DATAREADER, end.format("data_reader", reads), subscriber)
        self.client.read(reader)
        self.client.read(self.requester)

    def _create(self, kind: ObjectKind, text: str, parent: Entity | None = None) -> Entity:
        parent_id = 0 if parent is None else parent.object_id
        return self.client.create(ObjectVariant(kind, Format.XML, text=text, parent_id=parent_id))

    async def loop(self) -> None:
        """The programs' main loop."""
        await self.client.connect(1.0)
        await self.client.until_all_statuses(1.0)
        count = 0
        while True:
            await self.client.connect()
            if self.is_held_up:
                await asyncio.sleep(1.0)
                continue
            count += 1
            self.client.write(self.writer, HelloWorld(index=count, message=f"{self.number} {count}").encode())
            if not self.silent:
                self.client.write(self.requester, thesis_messages.encode_request(self.number, f"{self.number}-local"))
            await asyncio.sleep(1.0)


def play(
    scene: Callable[[Robot, Program, Program], Awaitable[None]],
    store: MemoryStore,
    first: tuple[str, str, str] = ("ABCD", "HelloWorldTopic_1_to_2", "HelloWorldTopic_3_to_1"),
    second: tuple[str, str, str] = ("EFGH", "HelloWorldTopic_2_to_3", "HelloWorldTopic_1_to_2"),
) -> None:
    async def main() -> None:
        robot = Robot(store)
        programs = [Program(robot, 0xAAAAAAAA, *first), Program(robot, 0xBBBBBBBB, *second)]
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(service.run()) for service in (robot.agent, robot.service, robot.master)]
            await robot.service.until_ready()
            for program in programs:
                running += [tasks.create_task(program.client.run()), tasks.create_task(program.loop())]
            await scene(robot, *programs)
            for task in running:
                task.cancel()

    run_virtual(main())


def test_two_original_programs_talk_over_the_topics_that_they_name() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(10.5)
        assert robot.state(0xAAAAAAAA) is robot.state(0xBBBBBBBB) is PartState.ACTIVE
        assert bb.heard[-1] == "ABCD 11"
        assert len(bb.heard) >= 10
        assert aa.heard == []
        assert aa.replies == bb.replies == 11

    play(scene, sample_store())


def test_what_was_published_before_both_steps_were_done_went_nowhere() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        aa.silent = True
        await asyncio.sleep(5.5)
        assert bb.heard == []
        aa.silent = False
        await asyncio.sleep(3.0)
        assert bb.heard == ["ABCD 8", "ABCD 9"]

    play(scene, sample_store())


def test_a_topic_that_is_not_the_slots_stays_closed_whatever_the_program_names() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(5.5)
        assert robot.state(0xAAAAAAAA) is robot.state(0xBBBBBBBB) is PartState.ACTIVE
        assert (aa.heard, bb.heard) == ([], [])

    # AA writes what BB may read, but may only read itself what it writes; BB reads what it may only write.
    play(
        scene,
        sample_store(),
        ("ABCD", "secret", "HelloWorldTopic_1_to_2"),
        ("EFGH", "secret", "HelloWorldTopic_2_to_3"),
    )


def test_a_program_with_an_unknown_part_number_is_neither_answered_nor_heard() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(5.5)
        assert robot.state(0xAAAAAAAA) is PartState.REFUSED
        assert aa.replies == 0
        assert bb.heard == []

    play(scene, sample_store(), ("NOPE", "HelloWorldTopic_1_to_2", "HelloWorldTopic_3_to_1"))


def test_a_program_that_falls_silent_is_delisted_and_heard_no_more_until_it_asks_again() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(3.5)
        aa.silent, aa.wire.disturbance.drop = True, 1.0
        await asyncio.sleep(7.0)
        assert robot.state(0xAAAAAAAA) is PartState.LOST
        aa.wire.disturbance.drop = 0.0
        before = len(bb.heard)
        await asyncio.sleep(3.0)
        assert len(bb.heard) == before
        aa.silent = False
        await asyncio.sleep(3.0)
        assert robot.state(0xAAAAAAAA) is PartState.ACTIVE
        assert len(bb.heard) > before

    play(scene, sample_store())


def test_whoever_only_listens_is_asked_for_a_sign_of_life() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(3.5)
        before = robot.agent.last_heard(0xBBBBBBBB)
        bb.is_held_up, aa.is_held_up = True, True
        await asyncio.sleep(1.6)
        assert before is not None
        assert (robot.agent.last_heard(0xBBBBBBBB) or 0.0) > before + 1.0
        await asyncio.sleep(8.0)
        assert robot.state(0xBBBBBBBB) is PartState.ACTIVE

    play(scene, sample_store())


def test_a_program_that_samples_keep_from_asking_stays_active_without_a_flicker() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        changes: list[PartState] = []
        await asyncio.sleep(3.5)
        robot.inventory.on_event(lambda event: changes.append(event.to_state))
        bb.is_held_up = True
        await asyncio.sleep(30.0)
        assert changes == []
        assert len(bb.heard) > 30
        bb.wire.disturbance.drop = 1.0
        await asyncio.sleep(8.0)
        assert changes == [PartState.LATE, PartState.LOST]

    play(scene, sample_store())


def test_a_program_that_was_late_and_is_heard_again_is_active_again() -> None:
    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        changes: list[tuple[PartState, str]] = []
        await asyncio.sleep(3.5)
        robot.inventory.on_event(lambda event: changes.append((event.to_state, event.reason)))
        bb.is_held_up, bb.wire.disturbance.drop = True, 1.0
        await asyncio.sleep(1.9)
        assert [state for state, _ in changes] == [PartState.LATE]
        bb.wire.disturbance.drop = 0.0
        await asyncio.sleep(2.5)
        assert [state for state, _ in changes] == [PartState.LATE, PartState.ACTIVE]
        assert changes[1][1].startswith("heard again after ")

    play(scene, sample_store())


def test_when_the_binding_changes_the_old_topic_is_closed_at_once_and_opened_again_when_it_is_back() -> None:
    store = sample_store()

    async def scene(robot: Robot, aa: Program, bb: Program) -> None:
        await asyncio.sleep(3.5)
        heard = len(bb.heard)
        assert heard > 0
        ring = configuration("BB")
        elsewhere = SlotBinding("in", "HelloWorldTopic_9", "HelloWorld", publishes=False)
        store.configurations["BB"] = replace(ring, version=2, bindings=(ring.bindings[0], elsewhere))
        robot.inventory.configuration_changed("BB")
        await asyncio.sleep(3.0)
        assert len(bb.heard) == heard
        store.configurations["BB"] = replace(ring, version=3)
        robot.inventory.configuration_changed("BB")
        await asyncio.sleep(3.0)
        assert len(bb.heard) == heard + 3

    play(scene, store)
