"""A robot in virtual time for operations: master, database, and parts that tests plug in and pull out."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from msbot.config import load_blueprint, load_library, write_sample
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations, Operations
from msbot.operations.operation import Outcome
from msbot.operations.table import OPERATIONS
from msbot.part import HelloWorld, Part
from msbot.pnp import PartEvent, PartInfo
from msbot.process.virtual_time import run_virtual
from msbot.registry import Registry, open_registry
from msbot_agent.link import InprocHub, Link, LinkInfo, LossyLink
from msbot_xrce.errors import MsbotError

DIAL = """
number = "DIAL"
name = "Dial"
compatible_with = ["ABCD"]
[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"
[[port]]
name = "in"
direction = "subscribe"
type = "HelloWorld"
[[port]]
name = "echo"
direction = "serve"
request = "HelloWorld"
reply = "HelloWorld"
[[port]]
name = "ask"
direction = "call"
request = "HelloWorld"
reply = "HelloWorld"
[[parameter]]
name = "period_s"
type = "float"
default = 1.0
unit = "s"
min = 0.1
max = 10
"""
"""A part type with a parameter; the thesis' three have none."""
AA_IS_A_DIAL = ('part = "ABCD"', 'part = "DIAL"')
"""A change of the sample blueprint, for `play`."""


@cache
def _empty_database() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "robot.db"
        open_registry(path).close()
        return path.read_bytes()


def put_database(path: Path) -> None:
    """A database with tables and no rows, if there is none: copying it is quicker than making it."""
    if not path.exists():
        path.write_bytes(_empty_database())


class Deeds:
    """The operations as methods: `await stage.do.swap("BB", "DD", who="ann")`."""

    def __init__(self, operations: Operations) -> None:
        self._operations = operations

    def __getattr__(self, name: str) -> Callable[..., Awaitable[Outcome]]:
        names = [argument.name for argument in OPERATIONS[name].arguments]

        def do(*values: object, who: str, **named: object) -> Awaitable[Outcome]:
            return self._operations.do(name, who=who, **dict(zip(names, values, strict=False)), **named)

        return do


class Stage:
    """A running robot and its parts, by the names that tests give them."""

    def __init__(self, master: Master, operations: InProcessOperations, registry: Registry, hub: InprocHub) -> None:
        self.master = master
        self.operations = operations
        self.do = Deeds(operations)
        self.registry = registry
        self.parts: dict[str, Part] = {}
        self.events: list[PartEvent] = []
        self.heard: dict[str, list[str]] = {}
        """What came in at each part's port `in`, newest last."""
        self.tasks: asyncio.TaskGroup | None = None
        self._hub = hub
        self._running: dict[str, asyncio.Task[None]] = {}
        master.inventory.on_event(self.events.append)

    def plug(self, name: str, number: str, *, uid: int | None = None, drop: float = 0.0) -> Part:
        """Plug a part in; it has that local name, and a UID made from it if none is given.

        `drop` is the probability that one of its packets is lost.
        """
        octets = name.encode().ljust(8, b".")[:8] if uid is None else uid.to_bytes(8, "big")
        part = Part(number, local_name=name, uid=octets, random=Random(f"{name} {len(self.events)}"))
        heard = self.heard.setdefault(name, [])
        part.on("in", HelloWorld)(lambda message: heard.append(message.message))
        part.serves("echo", HelloWorld, HelloWorld, optional=True)(lambda request: request)
        assert self.tasks is not None
        self.parts[name] = part
        link = LossyLink(self._hub.connect(), random=Random(name), drop=drop)
        self._running[name] = self.tasks.create_task(part.run_async(link, epoch_ns=lambda: 0))
        return part

    def connect(self) -> Link:
        """A link for a part that a test makes itself."""
        return self._hub.connect()

    def pull(self, name: str) -> None:
        """Pull a part out without a word."""
        self._running.pop(name).cancel()

    def pull_all(self) -> None:
        """The end."""
        for name in list(self._running):
            self.pull(name)

    def info(self, name: str) -> PartInfo:
        """The part of that local name, as the inventory has it."""
        return [info for info in self.master.inventory.view(self.now()) if info.part == name][-1]

    def slot(self, name: str) -> str | None:
        """The slot that a part holds."""
        info = self.info(name)
        return info.slot if info.state.is_registered else None

    def state(self, name: str) -> str:
        """How a part stands."""
        return self.info(name).state.value

    @staticmethod
    def message(text: str) -> HelloWorld:
        """A message of the ring."""
        return HelloWorld(index=1, message=text)

    @staticmethod
    async def refusal(deed: Awaitable[object]) -> str:
        """What an operation says that cannot be done."""
        try:
            done = await deed
        except MsbotError as error:
            return str(error)
        raise AssertionError(f"it was done: {done}")

    @staticmethod
    def now() -> float:
        return asyncio.get_running_loop().time()


def play(
    folder: Path,
    scene: Callable[[Stage], Awaitable[None]],
    *changes: tuple[str, str],
    parts: tuple[str, ...] = (),
    busy_timeout_s: float = 2.0,
    dial: str = DIAL,
) -> None:
    """Run a scene with the sample robot; `parts` are plugged in at the start, as `NAME=NUMBER`."""

    async def main() -> None:
        path = folder / "robot.toml"
        if not path.exists():
            write_sample(path)
        text = path.read_text()
        for before, after in changes:
            assert before in text
            text = text.replace(before, after)
        path.write_text(text)
        (folder / "library").mkdir(exist_ok=True)
        (folder / "library" / "DIAL.toml").write_text(dial)
        library = load_library(folder / "library")
        blueprint = load_blueprint(path, library)
        put_database(folder / "robot.db")
        with open_registry(folder / "robot.db", busy_timeout_s=busy_timeout_s) as registry:
            robot = registry.robots.apply_blueprint(blueprint, library)
            master = Master(
                blueprint, registry.runs.begin(robot), random=Random(1), epoch_ns=lambda: 0, library=library
            )
            hub = InprocHub()
            hub.server.info = LinkInfo("wire", 65535)
            master.add_link(hub.server)
            stage = Stage(master, InProcessOperations(master, registry, robot, library=library), registry, hub)
            async with asyncio.TaskGroup() as tasks:
                stage.tasks = tasks
                running = tasks.create_task(master.run())
                await master.ready.wait()
                for part in parts:
                    name, _, number = part.partition("=")
                    stage.plug(name, number)
                await asyncio.sleep(1.0)
                await scene(stage)
                running.cancel()
                await asyncio.wait([running])
                stage.pull_all()

    run_virtual(main())
