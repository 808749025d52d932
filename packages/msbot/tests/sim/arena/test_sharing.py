"""A world and the robot of another program: by TCP on this computer, and what strangers say to it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

import pytest

from msbot.cli.run.world_options import WorldOptions, remote_world
from msbot.sim import make_simulator
from msbot.sim.arena import arena_server as server_module
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.arena_server import ArenaServer
from msbot.sim.arena.remote_world_connection import RemoteWorldConnection
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_messages import LONGEST_LINE, from_line, to_line, values_of
from msbot.sim.arena.world_reader import open_world
from msbot_xrce.errors import ConfigError, LinkDown

PASSWORD = "maze runner"


@contextlib.asynccontextmanager
async def shared(world: str) -> AsyncIterator[tuple[RunningArena, ArenaServer]]:
    living = RunningArena(Arena(open_world(world)))
    server = ArenaServer(living, "127.0.0.1", 0, password=PASSWORD, say=lambda words: None)
    serving = [asyncio.create_task(server.run()), asyncio.create_task(living.run())]
    await server.ready.wait()
    try:
        yield living, server
    finally:
        for task in serving:
            task.cancel()
        await asyncio.gather(*serving, return_exceptions=True)


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not true():  # noqa: ASYNC110 - of another connection
            await asyncio.sleep(0.01)


async def test_parts_of_another_program_drive_and_see_and_are_gone_with_it() -> None:
    async with shared("warehouse") as (living, server):
        said: list[str] = []
        door = RemoteWorldConnection("127.0.0.1", server.port, "second", password=PASSWORD, say=said.append)
        eyes, wheels, button = make_simulator("HC-SR04"), make_simulator("TB6612FNG"), make_simulator("BUTTON")
        door.enter("eyes", eyes)
        coming = asyncio.create_task(door.run())
        await until(lambda: eyes.value("obstacle") != 1.0)
        door.enter("wheels", wheels)
        door.enter("button", button)  # nothing in the world file says that it is a bumper
        begin = living.arena.robot("second").pose
        wheels._world.receive("left", {"percent": 60.0}, wheels._time())
        wheels._world.receive("right", {"percent": 60.0}, wheels._time())
        await until(lambda: abs(living.arena.robot("second").pose.x - begin.x) > 0.02)
        assert living.slots("second") == ("eyes", "wheels")
        assert said == [f'in the world "Warehouse" at 127.0.0.1:{server.port}, as second']
        door.leave("eyes")
        await until(lambda: living.slots("second") == ("wheels",))
        coming.cancel()
        await asyncio.gather(coming, return_exceptions=True)
        await until(lambda: living.slots("second") == ())


async def test_a_world_without_a_free_place_says_so() -> None:
    async with shared("line") as (living, server):
        living.seat("robot", "eyes", ["distance"], _Nobody())
        with pytest.raises(ConfigError, match="each robot of the world is somebody's already: robot"):
            await RemoteWorldConnection("127.0.0.1", server.port, password=PASSWORD, say=print).run()
        with pytest.raises(ConfigError, match='no robot "third"; there are robot'):
            await RemoteWorldConnection("127.0.0.1", server.port, "third", password=PASSWORD, say=print).run()


async def test_who_does_not_know_the_password_stays_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "WRONG_S", 0.0)
    async with shared("line") as (living, server):
        for wrong in ("", "maze", PASSWORD + "x"):
            with pytest.raises(ConfigError, match="asks for its password: --world tcp:PASSWORD@HOST:PORT"):
                await RemoteWorldConnection("127.0.0.1", server.port, password=wrong, say=print).run()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(to_line({"arena": 1, "password": ["x"]}) + to_line({"seat": "w", "can": ["motor.left"]}))
        assert b"password" in await reader.read()
        writer.close()
        assert server.refused["wrong password"] == 4
        assert living.slots("robot") == ()


def test_wishes_about_a_password_are_checked() -> None:
    for wishes, words in (
        (WorldOptions("line", password="long enough"), "say where with --share-world"),
        (WorldOptions("line", share="7600", password="short"), "at least 8 characters"),
    ):
        with pytest.raises(ConfigError, match=words):
            wishes.check()
    WorldOptions("line", share="7600", password="long enough").check()


def test_a_password_need_not_stand_on_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSBOT_WORLD_PASSWORD", "short")
    WorldOptions("line").check()  # of this world nobody asks for it
    with pytest.raises(ConfigError, match=r"^\$MSBOT_WORLD_PASSWORD has at least 8 characters"):
        WorldOptions("line", share="7600").check()
    assert WorldOptions("line", share="7600", password="on the line").guests_password == "on the line"
    monkeypatch.setenv("MSBOT_WORLD_PASSWORD", PASSWORD)
    WorldOptions("line", share="7600").check()
    assert WorldOptions("line", share="7600").guests_password == PASSWORD


async def test_a_guest_takes_the_password_from_its_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "WRONG_S", 0.0)
    monkeypatch.setenv("MSBOT_WORLD_PASSWORD", PASSWORD)
    async with shared("line") as (living, server):
        eyes = make_simulator("HC-SR04")
        door = remote_world(f"tcp:127.0.0.1:{server.port}", None, print)
        door.enter("eyes", eyes)
        coming = asyncio.create_task(door.run())
        await until(lambda: living.slots("robot") == ("eyes",))
        coming.cancel()
        await asyncio.gather(coming, return_exceptions=True)
        with pytest.raises(ConfigError, match="asks for its password"):
            await remote_world(f"tcp:not this one@127.0.0.1:{server.port}", None, print).run()


async def test_nonsense_is_counted_and_hurts_nobody() -> None:
    async with shared("line") as (living, server):
        hello = to_line({"arena": 1, "password": PASSWORD})
        for first, rest in (
            (b"GET / HTTP/1.1\r\n", b""),
            (hello, b"\xff{}\n[1]\n" + to_line({"seat": "a", "can": ["flying"]}) + to_line({"no": 1})),
            (hello, b"x" * (2 * LONGEST_LINE)),
            (
                to_line({"arena": 1, "password": PASSWORD}),
                to_line({"seat": "w", "can": ["motor.left"]}) + b'{"do":{"w":{"motor.left":NaN}}}\n',
            ),
        ):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(first + rest)
            writer.write_eof()
            await reader.read()
            writer.close()
        await until(lambda: living.slots("robot") == ())
        assert server.refused["no greeting"] == 1
        assert server.refused["no JSON"] == 2
        assert server.refused["seat"] == server.refused["no such message"] == 1
        living.arena.step()
        assert living.arena.robot("robot").pose.x == pytest.approx(1.2)


async def test_a_port_that_is_taken_is_told() -> None:
    async with shared("line") as (living, server):
        with pytest.raises(LinkDown, match="name another port, for example --share-world 7601"):
            await ArenaServer(living, "127.0.0.1", server.port, password=PASSWORD, say=print).run()


def test_only_what_makes_sense_is_taken_from_a_line() -> None:
    assert from_line(b"nonsense") is None
    assert from_line(b"[]") is None
    assert values_of({"a": {"light": 3, "lamp": True, "x": 1, "sound": "loud"}, "": {}, "b": 2}) == {
        "a": {"light": 3, "lamp": True}
    }


class _Nobody:
    def drive_values(self) -> dict[str, float]:
        return {}

    def sense(self, values: object) -> None:
        pass


@pytest.mark.promise("Idle connections keep nobody out")
async def test_who_says_nothing_keeps_nobody_out() -> None:
    async with shared("line") as (_, server), contextlib.AsyncExitStack() as stack:
        for _ in range(2 * server_module.MOST_STRANGERS):
            _, writer = await asyncio.open_connection("127.0.0.1", server.port)
            stack.callback(writer.close)
        said: list[str] = []
        door = RemoteWorldConnection("127.0.0.1", server.port, password=PASSWORD, say=said.append)
        coming = asyncio.create_task(door.run())
        await until(lambda: bool(said))
        coming.cancel()
        await asyncio.gather(coming, return_exceptions=True)
        assert said[0].startswith('in the world "'), said
