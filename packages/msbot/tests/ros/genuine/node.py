"""A genuine node, as a test asks it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
from collections import deque
from collections.abc import AsyncIterator
from itertools import count
from typing import Any

from tests.ros.genuine.environment import MIDDLEWARES, command, surroundings

MOST_LINES = 200


class Node:
    """A running node. It belongs to no event loop, so that the tests of a file can share it."""

    def __init__(
        self, name: str = "peer", namespace: str = "/", middleware: str = MIDDLEWARES[0], **variables: str
    ) -> None:
        self.middleware = middleware
        self._numbers = count(1)
        self._lines: deque[str] = deque(maxlen=MOST_LINES)
        self._process = subprocess.Popen(
            command("node.py", name, namespace),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=surroundings(middleware, **variables),
        )
        try:
            assert json.loads(self._says('{"ready"'))["rmw"] == middleware
        except BaseException:
            self.end()
            raise

    async def does(self, what: str, **arguments: object) -> Any:
        """Let it do something; its answer."""
        return await asyncio.to_thread(self.do, what, **arguments)

    def do(self, what: str, **arguments: object) -> Any:
        """The same, and this thread waits."""
        number = next(self._numbers)
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"id": number, "do": what, **arguments}) + "\n")
        self._process.stdin.flush()
        told = json.loads(self._says(f'{{"id": {number}, '))
        assert "failed" not in told, told["failed"]
        return told["answer"]

    def end(self) -> None:
        """Kill it."""
        self._process.kill()
        self._process.communicate()

    def _says(self, begin: str) -> str:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line.rstrip())
            if line.startswith(begin):
                return line
        raise AssertionError(f"the node ended: {[*self._lines]}")


@contextlib.asynccontextmanager
async def genuine_node(
    name: str = "another", namespace: str = "/", middleware: str = MIDDLEWARES[0], **variables: str
) -> AsyncIterator[Node]:
    """A node as long as the block lasts."""
    node = await asyncio.to_thread(Node, name, namespace, middleware, **variables)
    try:
        yield node
    finally:
        node.end()
