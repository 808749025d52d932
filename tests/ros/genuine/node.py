"""A genuine node, as a test asks it."""

from __future__ import annotations

import contextlib
import json
from collections.abc import AsyncIterator
from itertools import count
from typing import Any

from tests.ros.genuine.environment import ros_program
from tests.space.dds.peers import Program


class Node:
    """A running node."""

    def __init__(self, running: Program) -> None:
        self._running = running
        self._numbers = count(1)

    async def does(self, what: str, **arguments: object) -> Any:
        """Let it do something; its answer."""
        number = next(self._numbers)
        stdin = self._running.process.stdin
        assert stdin is not None
        stdin.write(json.dumps({"id": number, "do": what, **arguments}).encode() + b"\n")
        await stdin.drain()
        told = json.loads(await self._running.says(f'{{"id": {number}, '))
        assert "failed" not in told, told["failed"]
        return told["answer"]


@contextlib.asynccontextmanager
async def genuine_node(name: str = "peer", namespace: str = "/", **variables: str) -> AsyncIterator[Node]:
    """A node as long as the block lasts."""
    async with ros_program("node.py", name, namespace, **variables) as running:
        await running.says('{"ready"')
        yield Node(running)
