"""Floods of strangers over UDP: parts are heard, STOP is confirmed, and a newcomer comes in while it goes on."""

from __future__ import annotations

import asyncio
import random
import socket
import sys

import pytest

from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import JoinState, Part
from msbot.pnp import Configuration, MemoryStore, PartEvent, PartState
from msbot_agent.link.net import UdpClientLink, UdpServerLink
from msbot_agent.link.net.stranger_filter import NOT_READ
from tests.hostile.test_crowd import _login

PATIENCE_S = 90.0
NAMES = ("a", "b", "newcomer")
BURST, PAUSE_S = 60, 0.01
"""About 5,000 datagrams a second, or what a busy computer makes of it."""


async def flood(port: int) -> None:
    """Logins and garbage, each from an address that was not seen before."""
    chance = random.Random(1)
    while True:
        for number in range(BURST):
            host = f"127.{chance.randrange(1, 255)}.{chance.randrange(256)}.{chance.randrange(1, 255)}"
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
                one.setblocking(False)
                one.bind((host, 0))
                one.sendto(
                    _login(chance.randrange(1, 1 << 32)) if number % 2 else chance.randbytes(40), ("127.0.0.1", port)
                )
        await asyncio.sleep(PAUSE_S)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives every user all addresses of 127.0.0.0/8")
def test_known_parts_are_heard_and_stopped_and_a_newcomer_comes_in_while_strangers_flood() -> None:
    async def scene() -> None:
        loop = asyncio.get_running_loop()
        store = MemoryStore(
            types=(PartType("X", "x"),),
            slots=tuple(Slot(name, "X") for name in NAMES),
            configurations=tuple(Configuration(1, name, (), ()) for name in NAMES),
        )
        master = Master(Blueprint(RobotProfile("R", "1", "1", "today", "us"), ()), store, random=random.Random(1))
        events: list[PartEvent] = []
        master.inventory.on_event(events.append)
        link = UdpServerLink("127.0.0.1", 0)
        master.add_link(link)
        tasks = [loop.create_task(master.run())]
        await master.ready.wait()
        while not link.port:  # noqa: ASYNC110 - it is opened in a moment
            await asyncio.sleep(0.01)
        parts = [
            Part("X", local_name=name, uid=random.Random(name).randbytes(8), random=random.Random(name))
            for name in NAMES
        ]

        def switch_on(part: Part) -> None:
            tasks.append(loop.create_task(part.run_async(UdpClientLink("127.0.0.1", link.port))))

        async def until_active(wanted: list[Part]) -> None:
            async with asyncio.timeout(PATIENCE_S):
                while any(part.state is not JoinState.ACTIVE for part in wanted):  # noqa: ASYNC110
                    await asyncio.sleep(0.01)

        for part in parts[:2]:
            switch_on(part)
        await until_active(parts[:2])
        tasks.append(loop.create_task(flood(link.port)))
        async with asyncio.timeout(PATIENCE_S):
            while NOT_READ not in link.counters.dropped:  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        master.say_stop("somebody", "")
        async with asyncio.timeout(PATIENCE_S):
            while master.stop.silent:  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        assert {one.part for one in master.stop.confirmed} == {"a", "b"}
        master.say_go("somebody")
        switch_on(parts[2])
        await until_active(parts)
        assert not [event for event in events if event.to_state is PartState.LOST]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run(scene())
