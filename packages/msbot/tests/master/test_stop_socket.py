"""The socket at which a master takes STOP: it stays where it is looked for, and nothing of it runs out."""

from __future__ import annotations

import asyncio
import json
import os
import select
import shutil
import socket
from collections.abc import Awaitable, Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from msbot.master import StopSocket, stop_socket
from msbot.master.stop_socket import MOST_LINES
from msbot.pnp import StopStatus
from msbot.stop.socket_folders import IS_LINUX, IS_THERE, open_folder, own_user
from msbot.stop.socket_names import GROUP_VARIABLE
from msbot.stop.stop_request import ask_masters
from msbot_agent.process.end_signals import run_to_end
from tests.runtime.stop_stage import PATIENCE_S, own_places

pytestmark = pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")


@pytest.fixture(autouse=True)
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv(GROUP_VARIABLE)
    monkeypatch.setattr(stop_socket, "LOOK_S", 0.01)
    return own_places(tmp_path, monkeypatch)


class Robot:
    """What the socket needs of a master."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.stop_group = "bench"
        self.stop = StopStatus(stopped=True, number=1)
        self.is_stored = asyncio.Event()
        self.is_stored.set()

    def say_stop(self, by: str, _reason: str = "", _place: str = "") -> StopStatus:
        self.said.append(by)
        return self.stop

    async def until_stop_is_stored(self) -> StopStatus:
        await self.is_stored.wait()
        return self.stop


class Scene:
    def __init__(self, shared: Path) -> None:
        self.shared = shared
        self.robot = Robot()
        self.details = {"robot": "ROVER", "serial_number": "X1", "database": "/r.db"}
        self.sock = StopSocket(self.robot, lambda: self.details)  # type: ignore[arg-type]

    def sockets(self) -> list[Path]:
        return [path for path in self.shared.glob("*/*") if not path.name.startswith(".")]

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - files and sockets make no sound
                await asyncio.sleep(0.005)

    async def ask(self, do: str, who: str = "ann", group: str = "bench") -> list[dict[str, Any]]:
        return (await asyncio.to_thread(ask_masters, {"do": do, "who": who}, PATIENCE_S, group))[0]

    def connect(self) -> socket.socket:
        """A connection of another program."""
        (path,) = self.sockets()
        folder = open_folder(str(path.parent), own_user())
        assert folder is not None
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        made.connect(folder.address(path.name))  # the path itself may be too long
        made.setblocking(False)
        folder.close()
        return made


def play(shared: Path, act: Callable[[Scene], Awaitable[None]]) -> None:
    async def main() -> None:
        scene = Scene(shared)
        serving = asyncio.create_task(scene.sock.run())
        await scene.until(lambda: bool(scene.sockets()) or serving.done())
        try:
            await act(scene)
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
        assert scene.sockets() == []

    run_to_end(main())


def test_stop_is_said_and_answered_with_what_there_is_to_know(shared: Path) -> None:
    async def act(scene: Scene) -> None:
        (answer,) = await scene.ask("stop")
        assert scene.robot.said == ["ann"]
        assert {name: answer[name] for name in ("robot", "serial_number", "stopped", "told")} == {
            "robot": "ROVER",
            "serial_number": "X1",
            "stopped": True,
            "told": 0,
        }
        assert await scene.ask("stop", group="other") == []

    play(shared, act)


@pytest.mark.parametrize("how", ["a cleaner removes the socket", "a cleaner removes the folder", "it was moved"])
def test_what_is_removed_is_made_anew(how: str, shared: Path) -> None:
    async def act(scene: Scene) -> None:
        (old,) = scene.sockets()
        if "socket" in how:
            old.unlink()
        elif "folder" in how:
            shutil.rmtree(old.parent)
        else:
            old.parent.rename(scene.shared / "elsewhere")
        await scene.until(
            lambda: [path for path in scene.sockets() if path.parent.name != "elsewhere"] not in ([], [old])
        )
        assert len(await scene.ask("stop")) == 1
        shutil.rmtree(scene.shared / "elsewhere", ignore_errors=True)

    play(shared, act)


def test_its_name_follows_the_robots_and_the_groups(shared: Path) -> None:
    async def act(scene: Scene) -> None:
        scene.details = {**scene.details, "robot": "BUGGY"}
        scene.robot.stop_group = "other"
        await scene.until(lambda: any(".other." in path.name and "BUGGY" in path.name for path in scene.sockets()))
        assert await scene.ask("stop") == []
        assert len(await scene.ask("stop", group="other")) == 1

    play(shared, act)


def test_connections_that_say_nothing_go_when_another_one_comes(shared: Path) -> None:
    async def act(scene: Scene) -> None:
        with ExitStack() as held:
            silent = [held.enter_context(scene.connect()) for _ in range(3 * MOST_LINES)]
            silent[-1].send(b'{"do": "sto')
            assert len(await scene.ask("stop")) == 1
            assert len(scene.sock._lines) <= MOST_LINES
            assert silent[0].recv(10) == b"", "the oldest has gone"

    play(shared, act)


def test_who_waits_for_the_disk_is_answered_when_others_come(shared: Path) -> None:
    """What is not stored is said so; nobody waits for a place."""

    async def act(scene: Scene) -> None:
        scene.robot.is_stored.clear()
        scene.robot.stop = StopStatus(stopped=True, number=1, is_stored=False)
        answers: dict[int, bytes] = {}

        def heard(count: int) -> bool:
            for number, one in enumerate(asking):
                with suppress(BlockingIOError):
                    answers[number] = answers.get(number, b"") + one.recv(1 << 16)
            return sum(octets.endswith(b"\n") for octets in answers.values()) == count

        with ExitStack() as held:
            asking = [held.enter_context(scene.connect()) for _ in range(MOST_LINES + 4)]
            for number, one in enumerate(asking):
                one.send(json.dumps({"do": "stop", "who": f"p{number}"}).encode() + b"\n")
            await scene.until(lambda: heard(4))
            assert len(scene.robot.said) == MOST_LINES + 4, "each was said at once"
            assert {json.loads(octets)["stored"] for octets in answers.values()} == {False}
            scene.robot.stop = StopStatus(stopped=True, number=1)
            scene.robot.is_stored.set()
            await scene.until(lambda: heard(MOST_LINES + 4))
            assert sum(json.loads(octets)["stored"] for octets in answers.values()) == MOST_LINES

    play(shared, act)


@pytest.mark.parametrize(
    "octets", [b"\n", b"[]\n", b"\xff\xfe\n", b'{"do": 1}\n', b"[" * 2000 + b"\n", b'{"do": "go", "expires": 1}\n']
)
def test_what_makes_no_sense_ends_nothing(octets: bytes, shared: Path) -> None:
    async def act(scene: Scene) -> None:
        with scene.connect() as odd, scene.connect() as long:
            odd.send(octets)
            long.send(b"x" * 10_000)
            assert len(await scene.ask("stop")) == 1
            await scene.until(lambda: not scene.sock._lines)

    play(shared, act)


def test_who_does_not_read_the_answer_is_not_waited_for(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_socket, "LINE_S", 0.05)

    async def act(scene: Scene) -> None:
        scene.details = {**scene.details, "page": "x" * 1_000_000}
        with scene.connect() as deaf:
            deaf.send(json.dumps({"do": "status"}).encode() + b"\n")
            await scene.until(lambda: bool(select.select([deaf], [], [], 0)[0]))
            await scene.until(lambda: not scene.sock._lines)
            deaf.setblocking(True)
            with deaf.makefile("rb") as rest:
                assert len(rest.read()) < 1_000_000

    play(shared, act)


@pytest.mark.skipif(not IS_LINUX, reason="the descriptors of a process are counted in /proc")
def test_it_takes_a_stop_when_the_process_has_no_descriptor_left(shared: Path) -> None:
    resource = pytest.importorskip("resource")

    async def act(scene: Scene) -> None:
        with scene.connect() as asking:
            before = resource.getrlimit(resource.RLIMIT_NOFILE)
            highest = max(int(name) for name in os.listdir("/proc/self/fd"))
            with ExitStack() as held:
                resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1, before[1]))
                try:
                    while True:
                        try:
                            held.callback(os.close, os.open(os.devnull, os.O_RDONLY))
                        except OSError:
                            break
                    asking.send(json.dumps({"do": "stop", "who": "bob"}).encode() + b"\n")
                    await scene.until(lambda: scene.robot.said == ["bob"])
                finally:
                    resource.setrlimit(resource.RLIMIT_NOFILE, before)
            assert len(await scene.ask("stop")) == 1

    play(shared, act)


@pytest.mark.skipif(not IS_LINUX, reason="who connects is known on Linux")
def test_others_are_refused_before_anything_of_theirs_is_read(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_socket, "peer_of", lambda _connection: (1, 65534))

    async def act(scene: Scene) -> None:
        with scene.connect() as other:
            other.send(b'{"do": "stop"}\n')
            await scene.until(lambda: scene.sock.refused == 1)
        assert scene.robot.said == []
        assert scene.sock._lines == {}

    play(shared, act)
