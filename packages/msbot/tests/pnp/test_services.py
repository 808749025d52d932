"""Master and inventory as clients of a real agent, in virtual time (R43, R44, R50)."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest

from msbot.part import Client, Entity
from msbot.part.join import pnp_messages
from msbot.pnp import Configuration, InventoryService, MasterService, Profile, SlotBinding
from msbot.pnp.master_service import profile_message
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub
from msbot_xrce.errors import LinkFull, RequestError
from msbot_xrce.messages import STREAM_RELIABLE
from tests.pnp.robot import sample_store
from tests.pnp.scene import Robot, Visitor, epoch_ns, with_robot


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
            beat = pnp_messages.Beat(lease=verdict.lease).encode()
            assert await visitor.ask(beat) == pnp_messages.BeatReply(configuration_version=1).encode()
            reply = await visitor.ask(pnp_messages.ConfigurationRequest(lease=verdict.lease, have_version=0).encode())
            assert reply is not None
            assert pnp_messages.ConfigurationMessage.decode(reply).slot == "AA"
            (part,) = robot.inventory.view(0.0)
            assert (part.client_key, part.address, part.beats) == (0xA1, "in-process client 1", 1)

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_a_configuration_longer_than_a_packet_arrives_whole() -> None:
    async def scene() -> None:
        store = sample_store()
        bindings = tuple(SlotBinding(f"port{n}", f"topic{n}", "HelloWorld", publishes=True) for n in range(100))
        store.configurations["AA"] = Configuration(5, "AA", bindings)
        robot = Robot(store)
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            verdict = await visitor.claim()
            assert verdict is not None
            reply = await visitor.ask(pnp_messages.ConfigurationRequest(lease=verdict.lease, have_version=0).encode())
            assert reply is not None
            assert len(pnp_messages.ConfigurationMessage.decode(reply).bindings) == 100

        await with_robot(robot, visitor, play=play)

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
        make_client = partial(ClumsyClient, robot.outside.connect(), key=3, epoch_ns=epoch_ns)
        service = MasterService(make_client, Profile(name="second"), period_s=3.0)
        clumsy = service._client
        assert isinstance(clumsy, ClumsyClient)
        clumsy.not_ready, clumsy.full = 2, 1

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
        robot.service = InventoryService(
            partial(ClumsyClient, inside.connect(), key=2, epoch_ns=epoch_ns), robot.inventory
        )
        clumsy = robot.service._client
        assert isinstance(clumsy, ClumsyClient)
        clumsy.full = 1
        visitor = Visitor(robot, 0xA1)

        async def play() -> None:
            assert await visitor.claim() is None
            assert robot.service.requests.dropped == {"answer: the stream is full": 1}
            assert await visitor.claim() is not None

        await with_robot(robot, visitor, play=play)

    run_virtual(scene())


def test_without_an_agent_the_inventory_says_that_there_is_no_session() -> None:
    async def scene() -> None:
        robot = Robot(sample_store())
        with pytest.raises(RequestError, match="no session on "):
            await robot.service.until_ready(0.5)

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
