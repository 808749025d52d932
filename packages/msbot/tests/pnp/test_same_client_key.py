"""Somebody logs in with the client key of a part that is there: a restart, or a thief (issue 11, point 16)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from itertools import pairwise
from random import Random

from msbot.part import HelloWorld, Part
from msbot.pnp import Keys, PartState, Refusal
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import LossyLink
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages import CreateClient, Header, encode_message
from tests.pnp.robot import sample_store, uid
from tests.pnp.scene import Robot, epoch_ns

CLIENT_KEY = Random(7).randrange(1, 1 << 32)
"""The first that a part draws whose random source begins there."""
KEY, OTHER_KEY = bytes(range(16)), bytes(16)


class Device:
    """A part AA whose client key is known, and which counts what it publishes."""

    def __init__(self, robot: Robot, key: bytes | None = None, name: str = "") -> None:
        self.part = Part("ABCD", local_name=name or "AA", uid=uid(1), random=Random(7), key=key)
        self.wire = LossyLink(robot.outside.connect(), random=Random(1))
        self.part.every(0.25)(self._speak)
        self.joined_at: list[float] = []
        self.part.on_join(lambda: self.joined_at.append(asyncio.get_running_loop().time()))
        self._count = 0

    def _speak(self) -> None:
        self._count += 1
        self.part.publish("out", HelloWorld(index=self._count, message=self.part.local_name))

    async def run(self) -> None:
        await self.part.run_async(self.wire, epoch_ns=epoch_ns)


class Ear:
    """The part BB, which hears what AA says."""

    def __init__(self, robot: Robot, key: bytes | None = None) -> None:
        self.part = Part("EFGH", local_name="BB", uid=uid(2), random=Random(8), key=key)
        self.heard: list[tuple[float, str]] = []
        self.part.on("in", HelloWorld)(self._hear)
        self.wire = robot.outside.connect()

    def _hear(self, message: HelloWorld) -> None:
        self.heard.append((asyncio.get_running_loop().time(), message.message))

    async def run(self) -> None:
        await self.part.run_async(self.wire, epoch_ns=epoch_ns)

    def longest_silence(self) -> float:
        times = [at for at, _ in self.heard]
        return max(after - before for before, after in pairwise(times))


class Story:
    """A robot, AA in its slot, BB that hears it."""

    def __init__(self, *, keyed: bool) -> None:
        store = sample_store()
        store.keys = {uid(1): KEY, uid(2): KEY} if keyed else {}
        self.key = KEY if keyed else None
        self.robot = Robot(store, explain=True, keys=Keys(store, Random(3)) if keyed else None)
        self.aa, self.bb = Device(self.robot, self.key), Ear(self.robot, self.key)
        self.changes: list[str] = []
        self.tasks: list[asyncio.Task[None]] = []

    def start(self, run: Callable[[], Awaitable[None]]) -> None:
        async def main() -> None:
            await run()

        self.tasks.append(asyncio.create_task(main()))

    async def knock(self, times: int, period_s: float) -> None:
        """Log in with AA's client key, each time from another address and no further."""
        login = CreateClient(client_key=CLIENT_KEY, session_id=0x81, mtu=512)
        for _ in range(times):
            end = self.robot.outside.connect()
            self.start(end.run)
            await asyncio.sleep(0)
            assert end.remote is not None
            end.send(encode_message(Header(0x80, 0, 0, None), [login], pad_end=False), end.remote)
            await asyncio.sleep(period_s)

    def watch(self) -> None:
        self.robot.inventory.on_event(
            lambda event: self.changes.append(f"{event.part} {event.to_state.value}") if event.slot else None
        )

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def holder(self) -> str:
        found = self.robot.inventory.holder("AA", self.now)
        return "" if found is None or found.state is not PartState.ACTIVE else found.address


def tell(story: Callable[[Story], Awaitable[None]], *, keyed: bool = False) -> None:
    async def main() -> None:
        scene = Story(keyed=keyed)
        for service in (scene.robot.agent, scene.robot.service, scene.robot.master):
            scene.start(service.run)
        await scene.robot.service.until_ready()
        scene.start(scene.aa.run)
        scene.start(scene.bb.run)
        await asyncio.sleep(2.0)
        assert scene.robot.agent.last_heard(CLIENT_KEY) is not None
        scene.watch()
        try:
            await story(scene)
        finally:
            for task in scene.tasks:
                task.cancel()
            results = await asyncio.gather(*scene.tasks, return_exceptions=True)
        assert [result for result in results if isinstance(result, LocalProtocolError)] == []

    run_virtual(main())


def knocked_on(story: Story) -> Awaitable[None]:
    async def play() -> None:
        first = story.holder()
        await story.knock(57, 30 / 57)
        assert story.holder() == first
        assert story.changes == []
        assert story.bb.longest_silence() < 0.3
        await asyncio.sleep(11.0)
        assert [view.address for view in story.robot.agent.clients() if view.link == "wire"].count(first) == 1
        assert len(story.robot.agent.clients()) == 4

    return play()


def test_57_datagrams_with_its_client_key_do_not_disturb_an_active_part() -> None:
    tell(knocked_on)


def test_nor_do_they_where_parts_have_keys() -> None:
    tell(knocked_on, keyed=True)


def taken_over(story: Story) -> Awaitable[None]:
    async def play() -> None:
        first = story.holder()
        story.aa.wire.disturbance.drop = 1.0
        crashed_at = story.now
        again = Device(story.robot, story.key, "AA again")
        story.start(again.run)
        await asyncio.sleep(1.0)
        assert again.joined_at
        assert again.joined_at[0] - crashed_at <= 0.15
        assert story.holder() not in ("", first)
        assert [view.address for view in story.robot.agent.clients() if view.link == "wire"].count(first) == 0
        assert story.bb.heard[-1][1] == "AA again"
        assert story.changes[0] == "AA lost"

    return play()


def test_a_part_that_died_and_came_back_elsewhere_is_active_after_150_ms() -> None:
    tell(taken_over)


def test_so_is_one_that_has_a_key() -> None:
    tell(taken_over, keyed=True)


def test_a_twin_that_walks_through_both_steps_is_a_duplicate_while_the_part_lives() -> None:
    async def story(scene: Story) -> None:
        first = scene.holder()
        twin = Device(scene.robot, name="twin")
        scene.start(twin.run)
        await asyncio.sleep(8.0)
        assert scene.holder() == first
        assert twin.joined_at == []
        assert Refusal.DUPLICATE.describe in twin.part.reason
        assert scene.bb.longest_silence() < 0.3
        assert "AA lost" not in scene.changes

    tell(story)


def test_without_the_key_nobody_takes_the_place_of_a_part_that_is_held_up() -> None:
    async def story(scene: Story) -> None:
        first = scene.holder()
        scene.aa.wire.disturbance.drop = 1.0
        thief = Device(scene.robot, OTHER_KEY, "thief")
        scene.start(thief.run)
        await asyncio.sleep(1.0)
        scene.aa.wire.disturbance.drop = 0.0
        await asyncio.sleep(5.0)
        assert scene.holder() == first
        assert thief.joined_at == []
        assert thief.part.reason == Refusal.WRONG_KEY.describe
        assert "AA lost" not in scene.changes

    tell(story, keyed=True)
