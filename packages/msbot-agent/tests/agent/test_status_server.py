"""A running agent shows its clients to its user, and to nobody else."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from msbot_agent.agent import Agent, AgentStatus, StatusServer, read_statuses
from msbot_agent.agent import status_server as status_module
from msbot_agent.agent.status_files import StatusFile, find_status_files
from msbot_agent.link import Signal
from msbot_agent.space import MemorySpace
from tests.agent.wiring import FakeLink, WiredClient, serving


@asynccontextmanager
async def shown(agent: Agent, folder: Path, name: str = "test") -> AsyncIterator[StatusFile]:
    """The agent with its status server; yields the file."""
    server = StatusServer(agent, what="agent", name=name, folder=folder)
    task = asyncio.create_task(server.run())
    while server.path is None:  # noqa: ASYNC110 - a file makes no sound
        await asyncio.sleep(0)
    try:
        yield next(file for file in find_status_files(folder) if file.path == server.path)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert server.path is None


async def read(folder: Path) -> list[AgentStatus]:
    return await asyncio.to_thread(read_statuses, folder)


async def test_everything_a_person_wants_to_know_is_shown(tmp_path: Path) -> None:
    agent, folder = Agent(MemorySpace()), tmp_path / "msbot"
    async with serving(agent, FakeLink("udp:127.0.0.1:8888")) as link, shown(agent, folder, "udp"):
        one, other = WiredClient(link, key=0xAABBCCDD), WiredClient(link, key=2)
        for client in (one, other):
            await client.connect()
        await one.write(await one.add_writer("light"), b"x")
        link.inject(b"???")
        link.counters.dropped.count("nobody listens")
        link.signal(Signal.PEER_GONE, 2, "unplugged")
        (status,) = await read(folder)
        assert [view.key for view in status.clients] == [2, 0xAABBCCDD]
        gone, there = status.clients
        assert (gone.gone, there.gone) == ("gone: unplugged", None)
        assert [seen.topic for seen in there.objects] == [None, "light", None, "light"]
        assert {stream.stream_id for stream in there.streams} == {0x80}
        assert there.published == 1
        assert status.topics == (("light", 1, 0),)
        assert status.dropped == {"packet shorter than a header": 1}
        assert (status.pid, status.what, status.name) == (os.getpid(), "agent", "udp")
        assert [(seen.name, seen.dropped) for seen in status.links] == [("udp:127.0.0.1:8888", {"nobody listens": 1})]
    assert list(folder.iterdir()) == []


async def test_several_agents_are_shown_one_after_the_other(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    async with shown(Agent(MemorySpace()), folder, "first"), shown(Agent(MemorySpace()), folder, "second"):
        assert {status.name for status in await read(folder)} == {"first", "second"}
    assert await read(folder) == []


async def test_a_crowd_of_clients_is_shown_whole(tmp_path: Path) -> None:
    agent, folder = Agent(MemorySpace()), tmp_path / "msbot"
    async with serving(agent) as link, shown(agent, folder):
        for key in range(1, 301):
            link.inject(bytes.fromhex(f"80000000 00011000 58524345 0100010f {key:08x} 8100fc01"), key)
        (status,) = await read(folder)
        assert [view.key for view in status.clients] == list(range(1, 301))


@pytest.mark.parametrize("shown_token", [b"\n", b"wrong\n", b"x" * 1000 + b"\n", b"", b"\xff\xfe\n"])
async def test_without_the_token_nothing_is_shown(tmp_path: Path, shown_token: bytes) -> None:
    async with shown(Agent(MemorySpace()), tmp_path / "msbot") as file:
        reader, writer = await asyncio.open_connection("127.0.0.1", file.port)
        writer.write(shown_token)
        if not shown_token:
            writer.write_eof()
        with contextlib.suppress(ConnectionResetError):  # when it closes before it has read everything
            assert await reader.read() == b""
        writer.close()


async def test_who_shows_nothing_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_module, "TOKEN_S", 0.01)
    async with shown(Agent(MemorySpace()), tmp_path / "msbot") as file:
        reader, writer = await asyncio.open_connection("127.0.0.1", file.port)
        assert await reader.read() == b""
        writer.close()


async def test_silent_connections_keep_nobody_out_who_knows_the_token(tmp_path: Path) -> None:
    async with shown(Agent(MemorySpace()), tmp_path / "msbot") as file:
        silent = [await asyncio.open_connection("127.0.0.1", file.port) for _ in range(40)]
        reader, writer = await asyncio.open_connection("127.0.0.1", file.port)
        writer.write(file.token.encode() + b"\n")
        assert b'{"end":0}' in await reader.read()
        assert await silent[0][0].read() == b"", "the oldest stranger made room"
        for _, each in (*silent, (reader, writer)):
            each.close()


async def test_with_the_server_ends_what_nobody_reads_and_who_was_just_let_in(tmp_path: Path) -> None:
    long = {"long": "x" * 50_000_000}
    server = StatusServer(Agent(MemorySpace()), what="agent", name="x", details=lambda: long, folder=tmp_path)
    task = asyncio.create_task(server.run())
    while server.path is None:  # noqa: ASYNC110 - a file makes no sound
        await asyncio.sleep(0)
    (file,) = find_status_files(tmp_path)
    reader, writer = await asyncio.open_connection("127.0.0.1", file.port)
    writer.write(file.token.encode() + b' {"do":"describe"}\n')
    assert await reader.readexactly(1) == b"{"
    ours, theirs = socket.socketpair()
    with ours, theirs:
        server._take(theirs)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert theirs.fileno() == -1, "its visit was cancelled before its first step"
    read = 0
    with contextlib.suppress(ConnectionResetError):
        while piece := await reader.read(1 << 20):
            read += len(piece)
    assert read < len(long["long"])
    writer.close()


async def test_many_readers_take_turns(tmp_path: Path) -> None:
    async with shown(Agent(MemorySpace()), tmp_path / "msbot") as file:
        readers = [await asyncio.open_connection("127.0.0.1", file.port) for _ in range(12)]
        for _, writer in readers:
            writer.write(file.token.encode() + b"\n")
        for reader, writer in readers:
            assert b'{"end":0}' in await reader.read()
            writer.close()


async def test_an_agent_can_do_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "msbot"
    folder.write_text("in the way")
    await StatusServer(Agent(MemorySpace()), what="agent", name="x", folder=folder).run()

    def refuse(*_: object, **__: object) -> None:
        raise OSError("no sockets left")

    monkeypatch.setattr(socket, "create_server", refuse)
    await StatusServer(Agent(MemorySpace()), what="agent", name="x").run()
    said = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    assert len(said) == 2
    assert all("no other msbot command will see this process" in line for line in said)


def answering(folder: Path, answer: bytes | None) -> tuple[socket.socket, StatusFile]:
    """A file that leads to a server with its answer ready; None = nobody listens there."""
    folder.mkdir(mode=0o700, exist_ok=True)
    server = socket.create_server(("127.0.0.1", 0))
    file = StatusFile(folder / "status-1-a.json", server.getsockname()[1], "token", os.getpid())
    file.path.write_text(json.dumps({"port": file.port, "token": file.token, "pid": file.pid}))
    if answer is None:
        server.close()
    return server, file


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", "it is of another version, or no agent"),
        (b"HTTP/1.0 400 Bad Request\n", "Expecting value"),
        (b'{"format": 999}\n', "another version"),
        (b'{"format": 1}\n{"key": 1}\n', "its answer broke off"),
        (b'{"format": 1}\n{"end": 0}\n', "'what'"),
        (b'{"format": 1}\n{"key": 1, "objects": [], "streams": []}\n{"end": 1}\n', "missing"),
    ],
)
async def test_strange_answers_are_left_out_with_a_warning(
    tmp_path: Path, answer: bytes, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    server, file = answering(tmp_path / "msbot", answer)

    async def reply(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(answer)
        writer.close()

    async with await asyncio.start_server(reply, sock=server):
        assert await read(tmp_path / "msbot") == []
    assert f"process {file.pid} did not say how it is" in caplog.text
    assert words in caplog.text


async def test_a_file_that_leads_nowhere_is_removed(tmp_path: Path) -> None:
    _, file = answering(tmp_path / "msbot", None)
    assert await read(tmp_path / "msbot") == []
    assert not file.path.exists()


async def test_a_file_that_somebody_has_removed_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_module, "LOOK_AFTER_S", 0.001)
    folder = tmp_path / "msbot"
    async with shown(Agent(MemorySpace()), folder) as file:
        file.path.unlink()
        folder.rmdir()
        while not file.path.exists() or not await read(folder):  # noqa: ASYNC110 - a file makes no sound
            await asyncio.sleep(0)
        assert file.path.stat().st_mode & 0o777 == 0o600
    assert list(folder.iterdir()) == []
