"""What a world tells its bridge, for tests to wait for; and processes whose lines they wait for."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from subprocess import PIPE, Popen

from msbot_bridges.bridge import ForeignDevice, World

PATIENCE_S = 180.0
PROGRAMS = Path(__file__).parent / "programs"


class Host:
    def __init__(self) -> None:
        self.devices = asyncio.Queue[ForeignDevice]()
        self.lost_why = asyncio.Queue[str]()
        self.warned = asyncio.Queue[str]()
        self.told = asyncio.Event()
        self.said: list[str] = []
        self.saying = asyncio.Queue[str]()

    def found(self, device: ForeignDevice) -> None:
        self.devices.put_nowait(device)

    def lost(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def explain(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def news(self, device: ForeignDevice) -> None:
        self.told.set()

    def warn(self, device: ForeignDevice, words: str) -> None:
        self.warned.put_nowait(words)

    def say(self, words: str) -> None:
        self.said.append(words)
        self.saying.put_nowait(words)


@asynccontextmanager
async def running(world: World) -> AsyncIterator[Host]:
    """The world runs as long as the block; what it raises comes out at once."""
    host = Host()
    task = asyncio.create_task(world.run(host))
    inside = asyncio.current_task()
    assert inside is not None
    task.add_done_callback(lambda ended: None if ended.cancelled() or ended.exception() is None else inside.cancel())
    try:
        async with asyncio.timeout(PATIENCE_S):
            yield host
    finally:
        task.cancel()
        await asyncio.wait([task])


class Program:
    """A program of `programs`, in a process of its own."""

    def __init__(self, name: str, *words: str) -> None:
        self._process = Popen([sys.executable, str(PROGRAMS / name), *words], stdin=PIPE, stdout=PIPE, text=True)

    async def line(self, start: str) -> str:
        """The rest of the next line that begins so."""
        assert self._process.stdout is not None
        while True:
            line = await asyncio.to_thread(self._process.stdout.readline)
            assert line, f"the program ended without {start!r}"
            if line.startswith(start):
                return line.removeprefix(start).strip()

    async def tell(self, words: str) -> None:
        """A line for the program: on return the program has done what it says."""
        assert self._process.stdin is not None
        self._process.stdin.write(words + "\n")
        self._process.stdin.flush()
        await self.line("done")

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


@contextmanager
def program(name: str, *words: str) -> Iterator[Program]:
    """It runs as long as the block."""
    made = Program(name, *words)
    try:
        yield made
    finally:
        made.kill()
        for pipe in (made._process.stdin, made._process.stdout):
            assert pipe is not None
            pipe.close()
