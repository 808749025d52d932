"""What comes from other computers and from others' files is shown in a terminal as text: it controls no terminal, and
no line that it brings looks like one of `msbot`."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner
from mcap.writer import Writer

from msbot.cli.record.log import command as log
from msbot.cli.record.play import command as play
from msbot.cli.record.plot import command as plot
from msbot.config import Blueprint, RobotProfile
from msbot.master import Master
from msbot.master.remote_agent import RemoteAgent
from msbot.sim.arena.remote_world_connection import RemoteWorldConnection
from msbot.sim.arena.world_messages import to_line as world_line
from msbot_agent.link import InprocHub
from msbot_school.cli.classroom.access_commands import join
from msbot_xrce.errors import ConfigError
from tests.web.part_site import store

PROMISE = "Names and texts of strangers are shown as text, in a terminal too"
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e\r\nmsbot: everything is stopped"
STATUS = dict.fromkeys(
    ("name", "robot", "serial_number", "version", "role", "state", "stop_group", "blueprint", "msbot", "trouble"), EVIL
)


def is_plain(text: str) -> bool:
    """Whether each line is what a terminal shows as it is, and begins as ours do."""
    return all(line.isprintable() and not line.startswith("msbot: everything") for line in text.split("\n"))


class Hostile(BaseHTTPRequestHandler):
    """A page that answers as `server.answers` says."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        status, reason, content = self.server.answers  # type: ignore[attr-defined]
        body = json.dumps(content).encode()
        self.wfile.write(f"HTTP/1.1 {status} {reason}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body)

    do_POST = do_GET

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def page() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Hostile) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


ANSWERS = [
    (500, "\x1b]0;owned\x07 \x9b31m", {}), (400, "Bad", {"error": EVIL}), (403, "No", {"error": [EVIL]}),
    (409, "No", {"error": {EVIL: EVIL}}), (200, "OK", STATUS), (200, "OK", {**STATUS, "rights": [EVIL]}),
]  # fmt: skip


@pytest.mark.promise(PROMISE)
@pytest.mark.parametrize("answers", ANSWERS)
def test_a_page_elsewhere(
    page: ThreadingHTTPServer, answers: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.answers = answers  # type: ignore[attr-defined]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("MSBOT_TOKEN", "msbot_secret")
    address = f"http://127.0.0.1:{page.server_port}"
    done = CliRunner().invoke(join, [address])
    assert is_plain(done.output)
    if isinstance(done.exception, ConfigError):
        assert is_plain(str(done.exception))
    elif done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception


class World:
    """A world of another program that says one line to whoever comes."""

    def __init__(self, *lines: dict[str, object]) -> None:
        self.lines = lines

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        for line in self.lines:
            writer.write(world_line(line))
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


@pytest.mark.promise(PROMISE)
@pytest.mark.parametrize(
    "lines",
    [
        [{"error": EVIL}],
        [{"robot": EVIL, "world": EVIL, "named": [EVIL]}],
        [{"robot": "a", "world": {EVIL: 1}, "named": []}, {"error": EVIL}, {"error": [EVIL]}],
    ],
)
async def test_a_world_elsewhere(lines: list[dict[str, object]]) -> None:
    server = await asyncio.start_server(World(*lines).serve, "127.0.0.1", 0)
    said: list[str] = []
    async with server:
        port = server.sockets[0].getsockname()[1]
        door = RemoteWorldConnection("127.0.0.1", port, password="x", say=said.append)
        coming = asyncio.create_task(door.run())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(60):
                while not coming.done() and not any("looking for it" in one for one in said):  # noqa: ASYNC110
                    await asyncio.sleep(0.01)
        if coming.done() and (error := coming.exception()) is not None:
            said.append(str(error))
        coming.cancel()
        await asyncio.gather(coming, return_exceptions=True)
    assert said
    assert [one for one in said if not is_plain(one) or "\n" in one] == []


@pytest.mark.promise(PROMISE)
async def test_a_master_elsewhere() -> None:
    evil, hub, said = EVIL[:40], InprocHub(), list[str]()
    master = Master(Blueprint(RobotProfile(evil, evil, evil, evil, evil), ()), store(1), random=Random(1))
    master.add_link(hub.server)
    agent = RemoteAgent(lambda _: InprocHub().server, hub.connect(), name="desk", say=said.append)
    tasks = [asyncio.create_task(master.run()), asyncio.create_task(agent.run())]
    try:
        async with asyncio.timeout(60):
            while not any("takes the parts of this agent" in one for one in said):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    assert [one for one in said if not is_plain(one) or "\n" in one] == []


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recording in which everything that can be named is hostile."""
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=EVIL, library=EVIL)
        for encoding, data in (
            ("jsonschema", json.dumps({"type": "object", "title": EVIL}).encode()),
            ("ros2msg", b"float64 x\n"),
        ):
            schema = writer.register_schema(name=f"pkg/{EVIL}", encoding=encoding, data=data)
            kind = "json" if encoding == "jsonschema" else "cdr"
            for topic in (f"/{EVIL}", EVIL, f"/msbot/{EVIL}/out"):
                channel = writer.register_channel(topic, kind, schema, metadata={"slot": EVIL, "part_number": EVIL})
                content = json.dumps({"x": 1.0, EVIL: EVIL, "words": EVIL, "who": EVIL}).encode()
                octets = content if kind == "json" else bytes([0, 1, 0, 0]) + bytes(8)
                for at in (10**18, 10**18 + 10**9):
                    writer.add_message(channel, log_time=at, publish_time=at, data=octets)
        writer.add_metadata(EVIL, {EVIL: EVIL})
        writer.finish()  # type: ignore[no-untyped-call]
    return path


COMMANDS = (
    (log, ["info", "FILE"]), (log, ["show", "FILE"]), (log, ["show", "FILE", "--topic", f"/{EVIL}"]),
    (log, ["diff", "FILE", "FILE"]), (plot, ["--file", "FILE"]), (plot, [EVIL, "--file", "FILE"]),
    (play, ["FILE", "--acts"]), (play, ["FILE", "--slot", EVIL]), (play, ["FILE"]),
)  # fmt: skip


@pytest.mark.promise(PROMISE)
@pytest.mark.parametrize(("command", "words"), COMMANDS)
def test_a_recording_of_somebody(recording: Path, command: object, words: list[str]) -> None:
    done = CliRunner().invoke(command, [str(recording) if word == "FILE" else word for word in words])  # type: ignore[arg-type]
    shown = done.output + (str(done.exception) if isinstance(done.exception, ConfigError) else "")
    if done.exception is not None and not isinstance(done.exception, SystemExit | ConfigError):
        raise done.exception
    assert is_plain(shown), repr(shown)
