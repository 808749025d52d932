"""A process answers requests of its user, one JSON object each way, and nobody else's."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from msbot_agent.agent import Agent, Control, RunningProcess, StatusServer, read_statuses, running_processes
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import ConfigError


@asynccontextmanager
async def shown(folder: Path, control: Control | None = None) -> AsyncIterator[RunningProcess]:
    server = StatusServer(
        Agent(MemorySpace()),
        what="master",
        name="ROBOT V1",
        folder=folder,
        details=lambda: {"robot": "ROBOT"},
        control=control,
    )
    task = asyncio.create_task(server.run())
    while server.path is None:  # noqa: ASYNC110 - a file makes no sound
        await asyncio.sleep(0)
    try:
        (process,) = await asyncio.to_thread(lambda: list(running_processes(folder)))
        yield process
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def echo(request: Mapping[str, object]) -> Mapping[str, object]:
    return {"got": dict(request)}


async def test_a_request_is_answered_and_the_listing_goes_on_as_before(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    async with shown(folder, echo) as process:
        assert (process.what, process.name, process.details) == ("master", "ROBOT V1", {"robot": "ROBOT"})
        answer = await asyncio.to_thread(process.ask, {"do": "stop", "args": {"reason": "ü"}, "who": "ann"})
        assert answer == {"got": {"do": "stop", "args": {"reason": "ü"}, "who": "ann"}}
        (status,) = await asyncio.to_thread(read_statuses, folder)
        assert status.details == {"robot": "ROBOT"}


async def test_a_process_without_operations_says_so(tmp_path: Path) -> None:
    async with shown(tmp_path / "msbot") as process:
        answer = await asyncio.to_thread(process.ask, {"do": "stop"})
        assert answer == {"error": "this process (master ROBOT V1) takes no requests"}


@pytest.mark.parametrize("request_line", [b"[1]", b"stop", b'"stop"', b"{"])
async def test_what_is_no_object_is_told(request_line: bytes, tmp_path: Path) -> None:
    async with shown(tmp_path / "msbot", echo) as process:
        answer = await asyncio.to_thread(_send, process, process.file.token.encode() + b" " + request_line)
        assert b"the request is no JSON object" in answer


@pytest.mark.parametrize("token", [b"", b"wrong", b"x" * 32])
async def test_who_does_not_know_the_token_is_not_answered(token: bytes, tmp_path: Path) -> None:
    async with shown(tmp_path / "msbot", echo) as process:
        assert await asyncio.to_thread(_send, process, token + b' {"do": "stop"}') == b""


async def test_a_process_that_has_gone_is_a_sentence(tmp_path: Path) -> None:
    async with shown(tmp_path / "msbot", echo) as process:
        pass
    with pytest.raises(ConfigError, match=r"master ROBOT V1 .* does not answer"):
        process.ask({"do": "stop"})
    assert list(running_processes(tmp_path / "msbot")) == []


def _send(process: RunningProcess, line: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", process.file.port), timeout=5.0) as connection:
        connection.sendall(line + b"\n")
        try:
            return connection.makefile("rb").read()
        except ConnectionResetError:
            return b""


async def test_nobody_is_known_before_there_is_a_token() -> None:
    server = StatusServer(Agent(MemorySpace()), what="master", name="x", control=echo)
    near, far = socket.socketpair()
    with far:
        far.sendall(b"\n")
        await server._receive(near)
        await asyncio.sleep(0)
        assert far.recv(1000) == b""
