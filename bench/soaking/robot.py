"""A robot in real processes: a master with its page and its database, a bus, parts behind ways that can be cut.

Every process is started, stopped and killed here and nowhere else; what they say goes to the caller.
"""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

import httpx

from bench.soaking.proxies import Way, open_way
from msbot.registry import open_registry
from msbot.registry.edits import users
from msbot_web.access.sessions import digest_of
from tests.e2e.prepared import Copy, start

ROOT = Path(__file__).parent.parent.parent
PATIENCE_S = 180.0
"""A process that does not come up by then never will."""
TRIES = 10
TOKEN = "msbot_a_token_of_the_soak"
BEST_EFFORT_EVERY = 4
"""Every so many wires, one is best effort."""
LIBRARY = """\
number = "SOAK-{0}"
name = "Part of the soak"
category = "other"

[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"
rate_hz = 10

[[port]]
name = "in"
direction = "subscribe"
type = "HelloWorld"
rate_hz = 10

[[parameter]]
name = "note"
type = "text"
default = "first"
"""
ROBOT = """\
library = ["library"]

[robot]
name = "SOAK"
serial_number = "1"

[options]
authentication = "{0}"
"""
SLOT = '[[slot]]\nname = "{0}"\npart = "SOAK-{0}"\n'
BINDING = '[[binding]]\ntopic = "{0}"\ntype = "HelloWorld"\nfrom = "{1}.out"\nto = ["{2}.in"]\nreliable = {3}\n'

Hear = Callable[[str, list[object]], None]
"""Is given the name of a process and one event it told."""


def free_port() -> int:
    """A port of UDP and TCP that nobody uses."""
    with socket.socket() as one, socket.socket(type=socket.SOCK_DGRAM) as other:
        one.bind(("127.0.0.1", 0))
        port = int(one.getsockname()[1])
        other.bind(("127.0.0.1", port))
        return port


@dataclass(slots=True)
class Member:
    """A part of the robot, whether it runs or not."""

    slot: str
    kind: str
    uid: bytes
    key: str | None
    way: Way | None
    process: asyncio.subprocess.Process | None = None
    boot: str = ""
    """What its present process calls itself; empty until it has told."""


class Robot:
    """The processes.

    Args:
        folder: where everything is kept.
        kinds: by which link each part is connected: `udp`, `tcp`, `ws`, or the address of a bus.
        authentication: `open`, `key` or `key+data`.
        dice: source of chance.
        hear: is told what the parts and intruders say.
    """

    def __init__(self, folder: Path, kinds: list[str], authentication: str, dice: Random, hear: Hear) -> None:
        self.folder, self.authentication, self._dice, self._hear = folder, authentication, dice, hear
        self.kinds = kinds
        self.more_links: list[str] = []
        """Links of the master besides UDP, TCP and the bus."""
        self.members: dict[str, Member] = {}
        self.bus = next((kind for kind in kinds if kind.startswith(("sim:", "can:"))), None)
        self.link_port, self.page_port = free_port(), free_port()
        self.master: Running | None = None
        self.bus_process: asyncio.subprocess.Process | None = None
        self.intruders: list[asyncio.subprocess.Process] = []
        self.web = httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{self.page_port}", headers={"authorization": f"Bearer {TOKEN}"}, timeout=5.0
        )
        self.database = folder / "robot.db"
        self.master_log = folder / "master.log"
        self.environment = {
            **os.environ,
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "MSBOT_TOKEN": TOKEN,
            "PYTHONUNBUFFERED": "1",
        }
        self._readers: set[asyncio.Task[None]] = set()

    # The robot itself.

    @property
    def links(self) -> list[str]:
        """Where the master serves."""
        net = [f"udp:127.0.0.1:{self.link_port}", f"tcp:127.0.0.1:{self.link_port}"]
        return [*net, *([self.bus] if self.bus else []), *self.more_links]

    @property
    def slots(self) -> list[str]:
        """Its slots, one for each part."""
        return [f"S{number}" for number in range(len(self.kinds))]

    def ring(self) -> list[tuple[str, str, str, bool]]:
        """Topic, writer, reader, whether reliable."""
        slots = self.slots
        return [
            (f"ring_{number}", slot, slots[(number + 1) % len(slots)], number % BEST_EFFORT_EVERY != 3)
            for number, slot in enumerate(slots)
        ]

    async def prepare(self) -> None:
        """Write blueprint, library and database; open the ways."""
        (self.folder / "run").mkdir(mode=0o700)
        (self.folder / "library").mkdir()
        for slot in self.slots:  # a number of its own for each: a part that was put out finds no other slot
            (self.folder / "library" / f"{slot}.toml").write_text(LIBRARY.format(slot))
        bindings = "".join(
            BINDING.format(topic, writer, reader, str(reliable).lower())
            for topic, writer, reader, reliable in self.ring()
        )
        text = ROBOT.format(self.authentication) + "".join(map(SLOT.format, self.slots)) + bindings
        (self.folder / "robot.toml").write_text(text)
        person = users.Person("ada", "administrator", tokens=(("soak", digest_of(TOKEN)),))
        with open_registry(self.database) as registry:
            registry.edits.make(None, "soak", partial(users.keep, people=[person]))
            for slot, kind in zip(self.slots, self.kinds, strict=True):
                uid, key = self._dice.randbytes(8), None
                if self.authentication != "open":
                    octets = secrets.token_bytes(16)
                    registry.keys.store(uid, octets, "soak")
                    key = octets.hex()
                way = await open_way(kind, self.link_port, self._dice) if kind in ("udp", "tcp") else None
                self.members[slot] = Member(slot, kind, uid, key, way)

    # Processes.

    async def start_master(self) -> float:
        """Start it, again where its database is locked; returns when it serves: how many seconds that took.

        Raises:
            MasterDown: it does not come up.
        """
        for _ in range(TRIES):
            try:
                return await self._start_master()
            except MasterDown as error:
                if "is locked by another program" not in str(error):
                    raise
        raise MasterDown("the database stays locked")

    async def _start_master(self) -> float:
        links = self.links
        words = [word for link in links for word in ("--link", link)]
        said = self.master_log.stat().st_size if self.master_log.exists() else 0
        began = time.monotonic()
        with self.master_log.open("ab") as log:
            arguments = ("master", "robot.toml", *words, "--port", str(self.page_port))
            started = await asyncio.to_thread(
                start, arguments, cwd=self.folder, env=self.environment, stdout=log, stderr=log
            )
        self.master = Running(started)
        while b"The page is at" not in (words_of := self._said(said)):
            if self.master.returncode is not None or time.monotonic() - began > PATIENCE_S:
                await self.end(self.master, signal.SIGKILL)
                raise MasterDown(f"the master does not come up: {words_of[-2000:].decode(errors='replace')}")
            await asyncio.sleep(0.02)
        return time.monotonic() - began

    def _said(self, since: int) -> bytes:
        with self.master_log.open("rb") as log:
            log.seek(since)
            return log.read()

    async def start_bus(self) -> None:
        """Serve the simulated bus in a process of its own."""
        if self.bus is None or not self.bus.startswith("sim:"):
            return
        with (self.folder / "bus.log").open("ab") as log:
            self.bus_process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "msbot",
                "bus",
                "serve",
                self.bus.removeprefix("sim:"),
                cwd=self.folder,
                env=self.environment,
                stdout=log,
                stderr=log,
                stdin=asyncio.subprocess.DEVNULL,
            )

    async def start_part(self, slot: str) -> None:
        """Start the part of that slot."""
        member = self.members[slot]
        words = [slot, "--uid", member.uid.hex(), "--link", self._link(member)]
        if member.key is not None:
            words += ["--key", member.key]
        if member.kind.startswith(("sim:", "can:")):
            words += ["--period", "0.5", "--large", "600"]
        with (self.folder / f"{slot}.log").open("ab") as log:
            member.process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "bench.soaking.part_program",
                *words,
                cwd=ROOT,
                env=self.environment,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                stdin=asyncio.subprocess.DEVNULL,
            )
        member.boot = ""
        self._read(slot, member.process)

    def _link(self, member: Member) -> str:
        if member.way is not None:
            return member.way.address
        return f"ws://127.0.0.1:{self.page_port}" if member.kind == "ws" else member.kind

    async def start_intruders(self, most: int | None = None) -> None:
        """Those who must get nothing, on every link, or on so many."""
        links = self.links
        for link in links[:most]:
            words = [link, "--topics", ",".join(topic for topic, *_ in self.ring())]
            words += ["--uids", ",".join(member.uid.hex() for member in self.members.values())]
            words += ["--keys"] if self.authentication != "open" else []
            with (self.folder / "intruders.log").open("ab") as log:
                process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-m",
                    "bench.soaking.intruder_program",
                    *words,
                    cwd=ROOT,
                    env=self.environment,
                    stdout=asyncio.subprocess.PIPE,
                    stderr=log,
                    stdin=asyncio.subprocess.DEVNULL,
                )
            self.intruders.append(process)
            self._read(f"intruders {link}", process)

    def _read(self, name: str, process: asyncio.subprocess.Process) -> None:
        task = asyncio.create_task(self._read_lines(name, process))
        self._readers.add(task)
        task.add_done_callback(self._readers.discard)

    async def _read_lines(self, name: str, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        boot = ""
        async for line in process.stdout:
            if not line.endswith(b"\n"):
                return  # it was killed in the midst of a line
            event = json.loads(line)
            if event[0] == "boot":
                boot = event[2]
                if name in self.members and self.members[name].process is process:
                    self.members[name].boot = boot
            self._hear(name, [*event[:2], boot, *event[2:]])

    # Ends.

    @staticmethod
    async def end(process: AnyProcess | None, number: signal.Signals, patience_s: float = 20.0) -> bool:
        """End a process; returns False where it had to be killed for it."""
        if process is None or process.returncode is not None:
            return True
        with suppress(ProcessLookupError):
            process.send_signal(number)
        try:
            await asyncio.wait_for(process.wait(), patience_s)
        except TimeoutError:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
            return False
        return True

    @staticmethod
    def signal(process: AnyProcess | None, number: signal.Signals) -> None:
        """Send a signal to a process, if it is there."""
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                process.send_signal(number)

    async def close(self) -> None:
        """End everything."""
        everybody: list[AnyProcess | None] = [
            self.master,
            self.bus_process,
            *self.intruders,
            *(one.process for one in self.members.values()),
        ]
        for process in everybody:
            self.signal(process, signal.SIGCONT)
            await self.end(process, signal.SIGKILL)
        for member in self.members.values():
            if member.way is not None:
                member.way.close()
        await self.web.aclose()
        await asyncio.gather(*self._readers, return_exceptions=True)


class Running:
    """A process of `tests.e2e.prepared`, a copy of one with all modules loaded, as asyncio has its own processes."""

    def __init__(self, process: subprocess.Popen[bytes] | Copy) -> None:
        self._process = process
        self.pid = process.pid
        self.send_signal, self.kill = process.send_signal, process.kill

    @property
    def returncode(self) -> int | None:
        """Its exit status; None: it still runs."""
        return self._process.poll()

    async def wait(self) -> int:
        """Until it ends."""
        while (status := self._process.poll()) is None:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.01)
        return status


AnyProcess = asyncio.subprocess.Process | Running


class MasterDown(Exception):
    """The master does not come up."""
