"""The homes: the same program under CPython, in the MicroPython VM, and in the MicroPython home's double on CPython.

A runner for another home (a browser) is one more class with `start`, `state`, `pull` and `close`; what it prints goes
to `world.log` (`said`).
"""

from __future__ import annotations

import asyncio
import atexit
import builtins
import contextlib
import io
import json
import logging
import shutil
import subprocess
import traceback
from pathlib import Path
from random import Random
from typing import IO, Any, Protocol
from unittest import mock

from msbot_xrce.errors import MsbotError
from tests import ROOT
from tests.homes import micro
from tests.homes.world import CODEC, UID, CanPartLink, Frame, Part, SimCanBus, World

VM = ROOT / "packages/msbot-web/src/msbot_web/static/micropython"
HERE = Path(__file__).parent
NODE = shutil.which("node")


def said(world: World, kind: str, text: str) -> None:
    """Take something that a program or its part said into the log; what is only for information is not compared."""
    if kind != "info":
        world.log.append(text if kind == "print" else f"! {text}")


class CPython:
    """The home on a PC: MsBOT's own `Part`, on the simulated bus."""

    name = "cpython"

    def __init__(self) -> None:
        self._part: Part | None = None
        self._task: asyncio.Task[None] | None = None
        self._world: World | None = None
        self._handler: logging.Handler | None = None
        self._states: list[str] = []

    def start(self, world: World, program: str, name: str) -> None:
        """See `Home`."""
        self._world = world
        parts: list[Part] = []
        self._handler = _ToLog(world)
        logging.getLogger("msbot.part").addHandler(self._handler)

        def told(*values: object, sep: str = " ", **_: object) -> None:
            said(world, "print", sep.join(map(str, values)))

        with mock.patch.object(Part, "run", lambda part: parts.append(part)):  # noqa: PLW0108 - a method
            try:
                exec(compile(program, name, "exec", dont_inherit=True), {"__name__": "__main__", "print": told})
            except MsbotError as error:
                said(world, "error", str(error))
        if parts:
            self._part = parts[0]
            self._part.uid = self._part.uid or UID
            self._task = world.spawn(self._run(self._part))

    async def _run(self, part: Part) -> None:
        assert self._world is not None
        part._random = Random(5)
        link = CanPartLink(self._world.driver.attach("mine"), uid=part.uid or UID, random=Random(4), codec=CODEC)
        try:
            await part.run_async(link, epoch_ns=lambda: 0)
        except MsbotError as error:
            said(self._world, "error", str(error))

    def state(self) -> str:
        """See `Home`."""
        return (
            "never: it has not run a part" if self._part is None else f"{self._part.state.value}: {self._part.reason}"
        )

    def pull(self) -> None:
        """See `Home`."""
        assert self._world is not None
        self._world.driver.detach("mine")

    def close(self) -> None:
        """See `Home`."""
        if self._handler is not None:
            logging.getLogger("msbot.part").removeHandler(self._handler)
        if self._task is not None:
            self._task.cancel()


class _ToLog(logging.Handler):
    """What a part reports to a person: errors; STOP and GO are said by the program itself."""

    def __init__(self, world: World) -> None:
        super().__init__(logging.ERROR)
        self._world = world

    def emit(self, record: logging.LogRecord) -> None:
        said(self._world, "error", record.getMessage())


class Engine(Protocol):
    """What answers the requests of `vm_host.py`."""

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """One request, one answer."""

    def close(self) -> None:
        """It is over."""


_IDLE: list[subprocess.Popen[str]] = []
"""Processes of node for the next engines: what one has loaded and compiled, the next has not to."""


def _begin_node() -> subprocess.Popen[str]:
    assert NODE is not None
    process = subprocess.Popen(
        [NODE, str(HERE / "vm.mjs"), str(VM)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    atexit.register(_end_node, process)
    return process


def _end_node(process: subprocess.Popen[str]) -> None:
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        pipe.close()
    process.wait(30)


class NodeEngine:
    """The real MicroPython VM, in node.

    Args:
        library: the folder of the package: sources, or .mpy files.
        more: further hosts, and modules as NAME=FILE.
    """

    def __init__(self, library: Path = micro.FOLDER, *more: str) -> None:
        self._process = _IDLE.pop() if _IDLE else _begin_node()
        self._tell([str(library), str(HERE / "vm_host.py"), *more])

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """See `Engine`."""
        return self._tell(request)

    def _tell(self, request: dict[str, Any] | list[str]) -> dict[str, Any]:
        request_pipe, answer_pipe = self._pipes()
        request_pipe.write(json.dumps(request) + "\n")
        request_pipe.flush()
        answer: dict[str, Any] = json.loads(answer_pipe.readline())
        assert "broken" not in answer, answer["broken"]
        return answer

    def close(self) -> None:
        """See `Engine`."""
        _IDLE.append(self._process)

    def _pipes(self) -> tuple[IO[str], IO[str]]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout


class DoubleEngine:
    """The same files under CPython: quick, and seen by debuggers; `more` are further hosts."""

    def __init__(self, *more: Path) -> None:
        micro.forget()
        micro.load()
        real_import = builtins.__import__

        def find(name: str, *rest: Any) -> Any:
            if name.partition(".")[0] != "msbot":
                return real_import(name, *rest)
            module = micro.load(name[6:])
            return module if len(rest) > 2 and rest[2] else micro.load()

        self._space: dict[str, Any] = {"__builtins__": {**vars(builtins), "__import__": find}, "__name__": "host"}
        for host in (HERE / "vm_host.py", *more):
            exec(compile(host.read_text(), host.name, "exec", dont_inherit=True), self._space)

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """See `Engine`."""
        answer: dict[str, Any] = json.loads(self._space["answer"](json.dumps(request)))
        return answer

    def close(self) -> None:
        """See `Engine`."""


class MicroPython:
    """The MicroPython home: an engine, joined to the master by CAN frames or by the octets of a serial line."""

    def __init__(self, engine: Engine, link: str = "can") -> None:
        self._engine = engine
        self._link = link
        self._state = ("never", "it has not run a part")
        self._world: World | None = None
        self._port: SimCanBus | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._soon: asyncio.Handle | None = None
        self._came: list[Any] = []
        self._over = False

    def start(self, world: World, program: str, name: str) -> None:
        """See `Home`."""
        self._world = world
        if self._link == "can":
            self._port = world.driver.attach("mine")
            self._port.attach(frame=self._frame_came, room=lambda _now: self._step_soon())
        else:
            world.lines.written = self._octets_came
        self._take(self._engine.ask({**self._first(program, name), "now": self._now()}))

    def _first(self, program: str, name: str) -> dict[str, Any]:
        return {"do": "start", "program": program, "name": name, "link": self._link, "uid": UID.hex()}

    def state(self) -> str:
        """See `Home`."""
        return ": ".join(self._state)

    def pull(self) -> None:
        """See `Home`."""
        assert self._world is not None
        if self._port is not None:
            self._world.driver.detach("mine")
            self._port = None
        self._over = True

    def close(self) -> None:
        """See `Home`."""
        for handle in (self._timer, self._soon):
            if handle is not None:
                handle.cancel()
        self._over = True
        self._engine.close()

    def _frame_came(self, frame: Frame, _now: float) -> None:
        self._came.append([frame.can_id, frame.extended, frame.data.hex()])
        self._step_soon()

    def _octets_came(self, octets: bytes) -> None:
        self._came.append(octets.hex())
        self._step_soon()

    def _step_soon(self) -> None:
        if self._soon is None and not self._over:
            self._soon = asyncio.get_running_loop().call_soon(self._step)

    def _step(self) -> None:
        self._soon = None
        if self._over:
            return
        came, self._came = self._came, []
        room = pending = 0
        if self._port is not None:
            pending = self._port.pending()
            room = 3 - pending
        request = {"do": "step", "now": self._now(), "in": came, "room": room, "pending": pending}
        self._take(self._engine.ask(request))

    def _take(self, answer: dict[str, Any]) -> None:
        assert self._world is not None
        for kind, text in answer["said"]:
            said(self._world, kind, text)
        self._state = tuple(answer["state"])
        for out in answer["out"]:
            if self._port is not None:
                self._port.send(Frame(out[0], bytes.fromhex(out[2]), extended=out[1]))
            else:
                self._world.lines.feed(bytes.fromhex(out))
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if answer["due"] is None:
            self._over = True
        else:
            self._timer = asyncio.get_running_loop().call_at(answer["due"] / 1000, self._step_soon)

    @staticmethod
    def _now() -> int:
        return int(asyncio.get_running_loop().time() * 1000 + 1e-6)


def print_exception(error: BaseException, file: io.StringIO) -> None:
    """MicroPython's `sys.print_exception`, for its double."""
    traceback.print_exception(error, file=file)


@contextlib.contextmanager
def as_micropython() -> Any:
    """What MicroPython's `sys` has and CPython's has not."""
    with mock.patch("sys.print_exception", print_exception, create=True):
        yield
