"""The other side in these tests: spaces of their own participant in this process, and how to wait for them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from asyncio.subprocess import PIPE, STDOUT, Process
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from msbot_agent.space import Sample

GENEROUS_S = 30.0
"""Far more than anything here takes; a test that waits so long has failed."""


async def until(condition: Callable[[], object], what: str = "") -> None:
    """Wait until it is so."""
    deadline = asyncio.get_running_loop().time() + GENEROUS_S
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, f"it never came to that: {what}"
        await asyncio.sleep(0.005)


class Inbox:
    """Takes samples, or refuses them as a client does whose window is full."""

    def __init__(self, *, takes: bool = True) -> None:
        self.samples: list[Sample] = []
        self.takes = takes

    def __call__(self, sample: Sample) -> bool:
        if self.takes:
            self.samples.append(sample)
        return self.takes

    @property
    def payloads(self) -> list[bytes]:
        """What came."""
        return [sample.payload for sample in self.samples]


def arrived(inbox: Inbox, payload: bytes) -> bool:
    """Whether that came last."""
    return inbox.payloads[-1:] == [payload]


@contextlib.asynccontextmanager
async def program(*command: str | Path, environment: dict[str, str] | None = None) -> AsyncIterator[Program]:
    """Run a program as long as the block lasts."""
    process = await asyncio.create_subprocess_exec(
        *command, stdin=PIPE, stdout=PIPE, stderr=STDOUT, env={**os.environ, **(environment or {})}
    )
    running = Program(process)
    try:
        yield running
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()
        await running.read_to_end()


def far_side(**wish: object) -> AbstractAsyncContextManager[Program]:
    """`far_side.py`, asked for that."""
    return program(sys.executable, str(Path(__file__).with_name("far_side.py")), json.dumps(wish))


class Program:
    """A running program and the lines it says."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self.lines: list[str] = []
        self._reading = asyncio.create_task(self._read())

    @property
    def heard(self) -> list[str]:
        """What it says it got."""
        return [line for line in self.lines if line.startswith("got ")]

    async def says(self, words: str) -> str:
        """Wait for a line with these words in it; returns it."""
        await until(
            lambda: any(words in line for line in self.lines) or self._reading.done(), f"{words!r} in {self.lines}"
        )
        found = next((line for line in self.lines if words in line), None)
        assert found is not None, f"it ended ({self.process.returncode}) without {words!r}: {self.lines}"
        return found

    async def tell(self) -> None:
        """Let it go on: a writer that was started with `when_told` waits for a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(b"\n")
        await self.process.stdin.drain()

    async def read_to_end(self) -> None:
        """Nothing of what it said is missing after this."""
        await self._reading

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.lines.append(line.decode().rstrip())
