"""A pupil who knows the protocols: whatever a pupil's connection carries is held and grouped with the pupil."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from random import Random

import pytest

from msbot.master.remote_agent import RemoteAgent
from msbot.operations.rights import Role
from msbot.part import HelloWorld, Part
from msbot.pnp import Freeze, Group
from msbot.pnp.pupils import TakeOverByTeacher
from msbot_agent.link import InprocHub, Link, LinkInfo
from msbot_agent.link.relay import PartsRelay
from msbot_agent.space import Qos, Sample, Topic
from msbot_web import part_websocket
from msbot_xrce.errors import ConfigError, MsbotError
from tests.web.part_site import PartSite, part_site

DOORS = ("a part", "a relay", "an agent")


@asynccontextmanager
async def running(*tasks: asyncio.Task[None]) -> AsyncIterator[None]:
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        for task in tasks:
            with contextlib.suppress(asyncio.CancelledError, MsbotError):
                await task


@asynccontextmanager
async def by(door: str, site: PartSite, number: int, token: str, name: str = "body") -> AsyncIterator[InprocHub]:
    """The part of that number comes in by the page, spoken by a part, a relay or an agent; and says something."""
    part = Part(f"T{number}", uid=number.to_bytes(8, "big"), random=Random(number))
    part.every(0.05)(lambda: part.publish("out", HelloWorld(index=number, message="x")))
    hub, start = InprocHub(), asyncio.create_task
    hub.server.info = LinkInfo("desk", 1400)
    way: Link = site.client(token)
    if door == "a part":
        async with running(start(part.run_async(way))):
            yield hub
        return
    carrier = (
        PartsRelay(lambda _: hub.server, way, name=name, say=lambda _: None)
        if door == "a relay"
        else RemoteAgent(lambda _: hub.server, way, name=name, say=lambda _: None)
    )
    async with running(start(carrier.run()), start(part.run_async(hub.connect()))):
        yield hub


def counted(site: PartSite, topic: str) -> Callable[[], int]:
    """How many samples of a topic the robot has taken in."""
    heard = [0]

    def count(_: Sample) -> bool:
        heard[0] += 1
        return True

    site.master.space.reader(Topic(topic, "HelloWorld"), Qos(reliable=False), count)
    return lambda: heard[0]


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("hold", ["freeze", "take-over"])
async def test_a_pupil_is_held_whatever_the_own_connection_carries(door: str, hold: str) -> None:
    async with part_site() as site:
        pupils, teachers = counted(site, "out0"), counted(site, "out1")
        parts, now = site.master.inventory.pupil_parts, asyncio.get_running_loop().time
        async with by(door, site, 0, await site.token("bob")), by("a part", site, 1, await site.token("ada")):
            await site.until(lambda: site.active() == {"S0", "S1"} and pupils() > 2 and teachers() > 2)
            assert parts.here()["bob"] == ("S0",)
            if hold == "freeze":
                parts.pupils.freeze = Freeze("ada", "", now())
            else:
                parts.pupils.taken["bob"] = TakeOverByTeacher("ada", now())
            parts.follow(now())
            before, others = pupils(), teachers()
            await site.until(lambda: teachers() > others + 10)
            assert pupils() == before
            parts.pupils.freeze = None
            parts.pupils.taken.clear()
            parts.follow(now())
            await site.until(lambda: pupils() > before + 2)


@pytest.mark.parametrize("door", DOORS)
async def test_a_pupil_gets_no_slot_of_another_group_whatever_the_own_connection_carries(door: str) -> None:
    async with part_site() as site:
        parts, now = site.master.inventory.pupil_parts, asyncio.get_running_loop().time
        parts.pupils.use_groups([Group("Red", ("eve",), ("S0",))])
        async with by(door, site, 0, await site.token("bob")):
            await site.until(lambda: any(one.refused_claims for one in site.master.inventory.view(now())))
            assert site.active() == set()
            parts.pupils.use_groups([Group("Red", ("bob",), ("S0",))])
            await site.until(lambda: site.active() == {"S0"})
            parts.pupils.use_groups([Group("Red", ("eve",), ("S0",))])
            parts.regroup(now())
            await site.until(lambda: site.active() == set())


@pytest.mark.parametrize("door", ["a relay", "an agent"])
async def test_what_a_teacher_carries_is_held_from_the_moment_on_when_the_role_is_lost(
    door: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_websocket, "CHECK_S", 0.1)
    async with part_site() as site:
        await site.accounts.add_user("tim", Role.TEACHER, "correct horse", who="ada")
        said, now = counted(site, "out0"), asyncio.get_running_loop().time
        async with by(door, site, 0, await site.token("tim")):
            await site.until(lambda: said() > 2)
            assert "tim" not in site.master.inventory.pupil_parts.here()
            await site.accounts.change_role("tim", "student", who="ada")
            parts = site.master.inventory.pupil_parts
            parts.pupils.freeze = Freeze("ada", "", now())
            parts.follow(now())
            await site.until(lambda: parts.here().get("tim") == ("S0",))
            before = said()
            await site.until(lambda: site.master.inventory.holder("S0", now()) is not None)
            assert said() == before


@pytest.mark.parametrize("door", ["a relay", "an agent"])
async def test_a_pupil_takes_nobodys_name_and_fills_nobodys_place(door: str) -> None:
    async with part_site() as site, contextlib.AsyncExitStack() as stack:
        token = await site.token("bob")
        await stack.enter_async_context(by(door, site, 0, token, "body"))
        await site.until(lambda: site.active() == {"S0"})
        await stack.enter_async_context(by(door, site, 1, await site.token("ada"), "body"))
        await site.until(lambda: site.active() == {"S0", "S1"})
        assert site.lost == []
        names = {
            info.address.partition(" by ")[2] or info.address.partition(" behind ")[2]
            for info in site.master.inventory.view(asyncio.get_running_loop().time())
            if info.slot
        }
        kind = door.split()[1]
        assert names == {f"{kind} body of bob", f"{kind} body"}


async def test_guests_of_a_pupil_are_held_with_the_pupil() -> None:
    async with part_site() as site:
        bob = site.accounts.sessions.begin("bob", Role.STUDENT)
        word, _ = site.accounts.guests.invite(bob, "/program", 1)
        guest, _ = site.accounts.guests.admit(word)
        assert site.accounts.guests.pupil_behind(guest) == "bob"
        ada = site.accounts.sessions.begin("ada", Role.ADMINISTRATOR)
        word, _ = site.accounts.guests.invite(ada, "/program", 30)
        guest, _ = site.accounts.guests.admit(word)
        assert site.accounts.guests.pupil_behind(guest) == "guest of ada"
        assert site.accounts.guests.pupil_behind(ada) == ""


@pytest.mark.parametrize("door", ["a relay", "an agent"])
async def test_a_ticket_of_a_teacher_brings_parts_that_are_no_pupils_until_it_is_removed(
    door: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_websocket, "CHECK_S", 0.1)
    async with part_site() as site:
        with pytest.raises(ConfigError, match="bob is none"):
            await site.accounts.new_ticket("bob", "body", who="ada")
        ticket = await site.accounts.new_ticket("ada", "body", who="ada")
        assert site.accounts.by_api_token(ticket) is None
        parts, now = site.master.inventory.pupil_parts, asyncio.get_running_loop().time
        parts.pupils.freeze = Freeze("ada", "", now())
        said = counted(site, "out0")
        async with by(door, site, 0, ticket):
            await site.until(lambda: said() > 2)
            assert parts.here() == {}
            await site.accounts.remove_token("ada", "body", who="ada")
            await site.until(lambda: len(site.link._peers) == 0)
