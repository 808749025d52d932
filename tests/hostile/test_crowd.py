"""Many parts at once: all come in, a bounded number at a time, and who is in stays in. In virtual time."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from dataclasses import replace
from random import Random

import pytest

from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import JoinState, Part
from msbot.pnp import Configuration, MemoryStore, PartEvent, PartState
from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import AgentSettings
from msbot_agent.agent.fair_share import BEYOND_OUTSIDE
from msbot_agent.agent.join_queue import FORGET_S
from msbot_agent.link import InprocHub
from msbot_xrce.messages import SESSION_NONE, CreateClient, Header, encode_message
from tests.agent.wiring import FakeLink

SIZE = 120
AT_A_TIME = 8
NAMES = [f"p{number}" for number in range(SIZE)]


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_a_crowd_comes_in_a_few_at_a_time_also_after_the_master_was_killed() -> None:
    async def scene() -> None:
        random, loop = Random(1), asyncio.get_running_loop()
        store = MemoryStore(
            types=(PartType("X", "x"),),
            slots=tuple(Slot(name, "X") for name in NAMES),
            configurations=tuple(Configuration(1, name, (), ()) for name in NAMES),
        )
        hub = InprocHub()
        hub.server.info = replace(hub.server.info, name="wire")  # whoever is on "inproc" is trusted
        states: Counter[PartState] = Counter()
        most_at_a_time = 0

        async def start() -> tuple[Master, asyncio.Task[None]]:
            settings = AgentSettings(max_joining=AT_A_TIME)
            blueprint = Blueprint(RobotProfile("R", "1", "1", "today", "us"), ())
            master = Master(blueprint, store, random=random, agent_settings=settings)

            def changed(event: PartEvent) -> None:
                nonlocal most_at_a_time
                states[event.to_state] += 1
                infos = master.inventory.view(event.at) if event.to_state is PartState.NEW else ()
                at_a_time = sum(info.state in {PartState.NEW, PartState.CHECKING} for info in infos)
                most_at_a_time = max(most_at_a_time, at_a_time)

            master.inventory.on_event(changed)
            master.add_link(hub.server)
            task = loop.create_task(master.run())
            await master.ready.wait()
            return master, task

        async def all_active(master: Master) -> None:
            async with asyncio.timeout(120):
                while len(master.inventory.members()) < SIZE or any(  # noqa: ASYNC110 - virtual time costs nothing
                    part.state is not JoinState.ACTIVE for part in parts
                ):
                    await asyncio.sleep(0.1)

        parts = [Part("X", local_name=name, uid=random.randbytes(8), random=Random(name)) for name in NAMES]
        master, serving = await start()
        tasks = [loop.create_task(part.run_async(hub.connect(), epoch_ns=lambda: 0)) for part in parts]
        await all_active(master)
        assert sum(master.agent.dropped().values()) > 0, "some were put off"
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
        await asyncio.sleep(1.0)
        states.clear()  # what the old master said at its end
        master, serving = await start()
        await all_active(master)
        await asyncio.sleep(10.0)
        assert states[PartState.LATE] == states[PartState.LOST] == 0
        assert len(master.inventory.members()) == SIZE
        assert most_at_a_time <= AT_A_TIME
        for task in (*tasks, serving):
            task.cancel()
        await asyncio.gather(*tasks, serving, return_exceptions=True)

    run_virtual(scene())


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_a_part_that_floods_gets_its_share_and_is_told_of_and_no_other_part_is_late() -> None:
    async def scene() -> None:
        random, loop = Random(1), asyncio.get_running_loop()
        names = NAMES[:10]
        store = MemoryStore(
            types=(PartType("X", "x"),),
            slots=tuple(Slot(name, "X") for name in names),
            configurations=tuple(Configuration(1, name, (), ()) for name in names),
        )
        hub = InprocHub()
        hub.server.info = replace(hub.server.info, name="wire")
        master = Master(Blueprint(RobotProfile("R", "1", "1", "today", "us"), ()), store, random=random)
        events: list[PartEvent] = []
        master.inventory.on_event(events.append)
        master.add_link(hub.server)
        tasks = [loop.create_task(master.run())]
        await master.ready.wait()
        parts = [Part("X", local_name=name, uid=random.randbytes(8), random=Random(name)) for name in names]
        links = [hub.connect() for _ in parts]
        for part, link in zip(parts, links, strict=True):
            tasks.append(loop.create_task(part.run_async(link, epoch_ns=lambda: 0)))
        async with asyncio.timeout(30):
            while len(master.inventory.members()) < len(names):  # noqa: ASYNC110 - virtual time costs nothing
                await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)
        link = links[0]
        assert link.remote is not None
        for _ in range(1000):  # for 2 s 50,000 a second: WRITE_DATA for an object that is not there
            for _ in range(100):
                link.send(bytes.fromhex("81010000 07010800 00100075 00000000"), link.remote)
            await asyncio.sleep(0.002)
        (flooding,) = [
            view for view in master.agent.clients() if view.dropped.get("packet beyond its share: not read", 0)
        ]
        assert flooding.dropped["packet beyond its share: not read"] > 50_000
        assert flooding.packets_in < 40_000
        told = [event for event in events if "more than its share" in event.reason]
        assert [event.part for event in told] == ["p0"]
        assert any("more than its share" in line for line in master.why("p0"))
        await asyncio.sleep(5.0)
        bad = {PartState.LATE, PartState.LOST}
        assert {event.part for event in events if event.to_state in bad} <= {"p0"}
        assert all(part.state is JoinState.ACTIVE for part in parts)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(scene())


EVER_NEW = 1 << 40
"""More addresses than a flood has packets: each of its packets looks like a newcomer."""


@pytest.mark.parametrize(
    ("addresses", "patience_s"),
    [(1, 1), (200, 2), (EVER_NEW, FORGET_S + 2)],  # the places of who never asks again are free after FORGET_S
)
@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_a_flood_of_strangers_is_read_in_part_and_nobody_is_late_or_kept_out_when_it_is_over(
    addresses: int, patience_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    async def scene() -> None:
        random, loop = Random(1), asyncio.get_running_loop()
        names = NAMES[:10]
        store = MemoryStore(
            types=(PartType("X", "x"),),
            slots=tuple(Slot(name, "X") for name in names),
            configurations=tuple(Configuration(1, name, (), ()) for name in names),
        )
        hub, outside = InprocHub(), FakeLink("outside")
        hub.server.info = replace(hub.server.info, name="wire")
        master = Master(Blueprint(RobotProfile("R", "1", "1", "today", "us"), ()), store, random=random)
        states: Counter[PartState] = Counter()
        master.inventory.on_event(lambda event: states.update([event.to_state]))
        for link in (hub.server, outside):
            master.add_link(link)
        tasks = [loop.create_task(master.run())]
        await master.ready.wait()
        parts = [Part("X", local_name=name, uid=random.randbytes(8), random=Random(name)) for name in names]

        def switch_on(part: Part) -> None:
            tasks.append(loop.create_task(part.run_async(hub.connect(), epoch_ns=lambda: 0)))

        async def all_in(count: int, patience_s: float = 5.0) -> None:
            async with asyncio.timeout(patience_s):
                while sum(part.state is JoinState.ACTIVE for part in parts) < count:  # noqa: ASYNC110 - virtual time
                    await asyncio.sleep(0.01)

        for part in parts[:-1]:
            switch_on(part)
        await all_in(9)
        sent = 0
        for step in range(1000):  # for 2 s 20,000 a second: the half are no packets, the others logins
            for _ in range(20):
                key = random.randrange(1, 1 << 32)
                outside.inject(_login(key), f"address {sent % addresses}")
                outside.inject(random.randbytes(20), f"address {sent % addresses}")
                sent += 2
            if step == 500:
                switch_on(parts[-1])
            await asyncio.sleep(0.002)
        await all_in(10, patience_s)
        most = AgentSettings().max_outside_per_s
        unread = master.agent.dropped()[BEYOND_OUTSIDE]
        assert sent - most * 2.5 <= unread <= sent - most / 4
        assert states[PartState.LATE] == states[PartState.LOST] == 0
        assert sum("packets outside of sessions" in record.message for record in caplog.records) == 1
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    with caplog.at_level(logging.WARNING):
        run_virtual(scene())


def _login(key: int) -> bytes:
    return encode_message(Header(SESSION_NONE), [CreateClient(key, 0x81, 512)], pad_end=False)
