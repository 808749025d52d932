"""Gate, inventory and agent together: what the thesis demands and its program did not do (R45, R52, R57, T9, T10)."""

from __future__ import annotations

import asyncio

from msbot.part import Client
from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp import PartState
from msbot.process.virtual_time import run_virtual
from tests.pnp.robot import sample_store
from tests.pnp.scene import ORIGINAL, Robot, Visitor, epoch_ns, with_robot


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
            request = thesis_messages.encode_request("ABCD", "ABCD-local")
            for _ in range(8):
                assert await visitor.ask(request, patience_s=1.0) == thesis_messages.encode_reply("ABCD")
            assert robot.state(0xAAAAAAAA) is PartState.ACTIVE
            assert await visitor.ask(thesis_messages.encode_request("NOPE", "x")) is None

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


def test_nobody_overhears_the_inventorys_answers_to_others() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        visitor = Visitor(robot, 0xA1)
        overheard: list[bytes] = []
        spy = Client(
            robot.outside.connect(),
            key=0x99,
            epoch_ns=epoch_ns,
            on_topic=lambda _object, _request, payload: overheard.append(payload),
        )
        participant = spy.create_participant()
        topic = spy.create_topic(participant, pnp_messages.INVENTORY_REPLY_TOPIC, pnp_messages.INVENTORY_REPLY_TYPE)
        spy.read(spy.create_reader(spy.create_subscriber(participant), topic))

        async def play() -> None:
            async with asyncio.TaskGroup() as tasks:
                task = tasks.create_task(spy.run())
                await spy.connect(1.0)
                await spy.until_all_statuses(1.0)
                assert await visitor.claim() is not None
                task.cancel()
            assert overheard == []

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())
