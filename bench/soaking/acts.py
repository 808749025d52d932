"""What is done to a robot: each act is a coroutine that tells the oracle first, does it, and undoes it after a while.

Two acts never touch the same thing at once; acts on different things overlap.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sqlite3
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

import httpx

from bench.soaking.robot import Robot
from bench.soaking.scene import Scene
from bench.soaking.troubles import ALL, Trouble

UNTIL_S = 60.0
"""What has not been possible by then is a violation; time in which the master gets no processor does not count."""
NEVER_S = 600.0
"""But what has not been possible by then is one in any case."""
CONNECTIONS = 30
FRAMES = 300


@dataclass(frozen=True, slots=True)
class Act:
    """Something that may be done."""

    name: str
    weight: float
    touches: Callable[[str], str]
    """What it touches, for the slot it was drawn for."""
    do: Callable[[str], Awaitable[None]]
    possible: Callable[[str], bool] = lambda _slot: True


class Acts:
    """All acts on one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.robot, self._dice = scene, scene.robot, scene.dice
        self._touched: set[str] = set()
        self._running: set[asyncio.Task[None]] = set()
        self._set_last: dict[str, tuple[int, str]] = {}
        """By slot: the latest change of its setting, and the value before."""

        def slot(name: str) -> str:
            return name

        def kind(*kinds: str) -> Callable[[str], bool]:
            return lambda name: self.robot.members[name].kind in kinds

        def fixed(name: str) -> Callable[[str], str]:
            return lambda _slot: name

        def on_bus(_slot: str) -> bool:
            bus = self.robot.bus_process
            return bus is not None and bus.returncode is None

        self.all = [
            Act("kill a part (kill -9)", 4, slot, self.kill_part),
            Act("end a part", 2, slot, self.end_part),
            Act("freeze a part", 3, slot, self.freeze_part),
            Act("cut a part's network", 4, slot, self.cut_part, kind("udp", "tcp")),
            Act("lose and double packets", 2, slot, self.spoil_part, kind("udp")),
            Act("kill the master (kill -9)", 1, fixed("master"), self.kill_master),
            Act("end the master", 0.5, fixed("master"), self.end_master),
            Act("freeze the master", 1, fixed("master"), self.freeze_master),
            Act("kill the bus (kill -9)", 1, fixed("bus"), self.kill_bus, on_bus),
            Act("fill the bus with foreign frames", 1, fixed("bus"), self.fill_bus, on_bus),
            Act("lock the database", 2, fixed("database"), self.lock_database),
            Act("delete the database", 0.5, fixed("master"), self.delete_database),
            Act("replace the database", 0.2, fixed("master"), self.replace_database),
            Act("set", 5, slot, self.set_note),
            Act("undo", 2, slot, self.undo, lambda name: name in self._set_last),
            Act("take a wire away", 2, lambda name: f"wire {name}", self.rewire),
            Act("STOP", 2, fixed("stop"), self.stop),
            Act("release a part", 1, slot, self.release),
            Act("block a part", 1, slot, self.block),
            Act("silent connections to the page", 1, fixed("page"), self.connect_silently),
        ]

    def start(self, without: frozenset[str] = frozenset()) -> None:
        """Begin one that is possible now."""
        found = [
            (act, name)
            for act in self.all
            for name in [self._dice.choice(self.robot.slots)]
            if act.name not in without and act.touches(name) not in self._touched and act.possible(name)
        ]
        if not found:
            return
        (act, name) = self._dice.choices(found, [act.weight for act, _ in found])[0]
        task = asyncio.create_task(self._do(act, name))
        self._running.add(task)
        task.add_done_callback(self._done)

    async def _do(self, act: Act, name: str) -> None:
        touched = act.touches(name)
        self._touched.add(touched)
        self.scene.acts[act.name] += 1
        self.scene.act(f"{act.name} ({name})" if touched in (name, f"wire {name}") else act.name)
        try:
            await act.do(name)
        finally:
            self._touched.discard(touched)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._running.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self.scene.complain(time.monotonic(), "script", f"{type(error).__name__}: {error}")

    @property
    def running(self) -> int:
        """How many are going on."""
        return len(self._running)

    async def finish(self) -> None:
        """Wait until all that was begun is undone."""
        while self._running:
            await asyncio.wait(set(self._running))

    def _while(self, least: float, most: float) -> float:
        """A time; short ones are more frequent."""
        return least + (most - least) * self._dice.random() ** 2

    @contextlib.contextmanager
    def _trouble(self, what: str, *whom: str) -> Iterator[Trouble]:
        trouble = self.scene.troubles.begin(time.monotonic(), what, whom)
        try:
            yield trouble
        finally:
            trouble.ended = time.monotonic()

    # Parts.

    async def kill_part(self, name: str) -> None:
        await self._restart_part(name, signal.SIGKILL, "part killed", self._while(0.2, 12.0))

    async def end_part(self, name: str) -> None:
        await self._restart_part(name, signal.SIGTERM, "part ended", self._while(0.2, 12.0))

    async def _restart_part(self, name: str, number: signal.Signals, what: str, seconds: float) -> None:
        member, expected = self.robot.members[name], self.scene.states.parts[name]
        with self._trouble(what, name):
            if not await self.robot.end(member.process, number):
                self.scene.complain(time.monotonic(), "end", f"the part of {name} does not end")
            now = time.monotonic()
            expected.absent, expected.joined = now, None
            self.scene.died(name, member.boot)
            await asyncio.sleep(seconds)
            await self.scene.start_part(name)

    async def freeze_part(self, name: str) -> None:
        process = self.robot.members[name].process
        with self._trouble("part frozen", name):
            self.robot.signal(process, signal.SIGSTOP)
            await asyncio.sleep(self._while(0.3, 10.0))
            self.robot.signal(process, signal.SIGCONT)

    async def cut_part(self, name: str) -> None:
        way = self.robot.members[name].way
        assert way is not None
        with self._trouble("network cut", name):
            way.cut()
            await asyncio.sleep(self._while(0.2, 10.0))
            way.heal()

    async def spoil_part(self, name: str) -> None:
        way = self.robot.members[name].way
        assert way is not None
        with self._trouble("packets lost and doubled", name):
            way.spoil(0.3 * self._dice.random(), 0.5 * self._dice.random())
            await asyncio.sleep(self._while(1.0, 10.0))
            way.heal()

    # The master and the bus.

    async def kill_master(self, _name: str) -> None:
        await self._restart_master(signal.SIGKILL, "master killed")

    async def end_master(self, _name: str) -> None:
        await self._restart_master(signal.SIGTERM, "master ended")

    async def _restart_master(self, number: signal.Signals, what: str) -> None:
        with self._trouble(what, ALL):
            self.scene.master_since = None
            if not await self.robot.end(self.robot.master, number, 30.0):
                self.scene.complain(time.monotonic(), "end", "the master does not end")
            await asyncio.sleep(self._while(0.0, 4.0))
            await self.scene.start_master()

    async def freeze_master(self, _name: str) -> None:
        with self._trouble("master frozen", ALL):
            self.robot.signal(self.robot.master, signal.SIGSTOP)
            await asyncio.sleep(self._while(0.3, 10.0))
            self.robot.signal(self.robot.master, signal.SIGCONT)

    def _bus_slots(self) -> list[str]:
        return [name for name, member in self.robot.members.items() if member.kind == self.robot.bus]

    async def kill_bus(self, _name: str) -> None:
        with self._trouble("bus killed", *self._bus_slots()):
            await Robot.end(self.robot.bus_process, signal.SIGKILL)
            await asyncio.sleep(self._while(0.2, 6.0))
            await self.robot.start_bus()

    async def fill_bus(self, _name: str) -> None:
        with self._trouble("bus filled", *self._bus_slots()):
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "msbot",
                "bus",
                "send",
                str(self.robot.bus),
                "001#DEADBEEF01020304",
                "--repeat",
                str(FRAMES),
                "--period",
                "0.002",
                cwd=self.robot.folder,
                env=self.robot.environment,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.DEVNULL,
            )
            await Robot.end(process, signal.SIGCONT, 30.0)

    # The database.

    async def lock_database(self, _name: str) -> None:
        def hold(seconds: float) -> None:
            address = f"file:{self.robot.database}?mode=rw"  # where there is none, none is made
            with contextlib.closing(sqlite3.connect(address, uri=True, isolation_level=None, timeout=2.0)) as other:
                other.execute("BEGIN IMMEDIATE")
                time.sleep(seconds)
                other.execute("ROLLBACK")

        with contextlib.suppress(sqlite3.OperationalError):  # the master itself was faster
            await asyncio.to_thread(hold, self._while(0.3, 10.0))

    async def delete_database(self, _name: str) -> None:
        """It has to be there again, with everything that was in it (the journal oracle looks); a master must run."""
        for ending in ("", "-wal", "-shm"):
            self.robot.database.with_name(self.robot.database.name + ending).unlink(missing_ok=True)
        await asyncio.sleep(self._while(2.0, 5.0))

    async def replace_database(self, _name: str) -> None:
        """Another file lies there: nothing is acknowledged, the robot goes on; then its own is put back."""
        database = self.robot.database
        self.scene.database_is_there = False
        with self._trouble("database replaced", ALL):
            for ending in ("-wal", "-shm"):
                database.with_name(database.name + ending).unlink(missing_ok=True)
            other = database.with_name("other")
            with contextlib.closing(sqlite3.connect(other)) as made:
                made.execute("create table strange (x)")
            other.replace(database)
            await self._until("the robot says that its database was replaced", self._says_replaced)
            answer = await self._ask("PUT", "/api/slots/S0/values/note", {"value": "never"})
            if answer is not None and answer.status_code == httpx.codes.OK:
                self.scene.complain(time.monotonic(), "edits", "a change was acknowledged without a database")
            self.scene.master_since = None
            await self.robot.end(self.robot.master, signal.SIGTERM, 30.0)
            rescued = sorted(database.parent.glob(f"{database.name}.rescued.*"))
            if not rescued or rescued[-1].name.endswith(("-wal", "-shm")):
                self.scene.complain(time.monotonic(), "edits", f"nothing was rescued: {rescued}")
            else:
                rescued[-1].replace(database)
            for ending in ("-wal", "-shm"):
                database.with_name(database.name + ending).unlink(missing_ok=True)
            await self.scene.start_master()
        self.scene.database_is_there = True

    async def _says_replaced(self) -> bool:
        answer = await self._ask("GET", "/api/robot")
        return answer is not None and "replaced" in str(answer.json().get("trouble"))

    # People.

    async def _ask(self, how: str, path: str, content: object = None) -> httpx.Response | None:
        """A request; None: nobody knows what has become of it."""
        try:
            return await self.robot.web.request(how, path, json=content, timeout=8.0)
        except httpx.HTTPError:
            return None

    async def _until(self, what: str, condition: Callable[[], Awaitable[bool]], why: Callable[[], str] = str) -> bool:
        began = time.monotonic()
        while not self._took_too_long(began):
            if await condition():
                return True
            await asyncio.sleep(0.2)
        self.scene.complain(time.monotonic(), "act", f"not within {UNTIL_S:g} s: {what} {why()}")
        return False

    def _took_too_long(self, began: float) -> bool:
        now, clear, since = time.monotonic(), self.scene.troubles.clear_since(ALL), self.scene.master_since
        is_due = clear is not None and since is not None and now - max(began, clear, since) > UNTIL_S
        return is_due or now - began > NEVER_S

    async def _insist(self, what: str, how: str, path: str, content: object, done: str = "nothing else") -> bool:
        """Ask until it is done, or the answer says that it is, by these words."""
        said, is_known = "", True

        async def is_done() -> bool:
            nonlocal said, is_known
            answer = await self._ask(how, path, content)
            if answer is None:
                is_known = False
                return False
            said = answer.text[:200]
            if answer.status_code == httpx.codes.OK:
                self._acknowledged(answer)
                return True
            # It was done, and the answer was lost on its way: it cannot be done again.
            return done in said or (not is_known and answer.status_code == httpx.codes.BAD_REQUEST)

        return await self._until(what, is_done, lambda: said)

    def _acknowledged(self, answer: httpx.Response) -> int | None:
        edit = answer.json().get("edit")
        if edit is not None:
            self.scene.acknowledged.append((int(edit), time.monotonic()))
            return int(edit)
        return None

    async def set_note(self, name: str) -> None:
        part = self.scene.states.parts[name]
        value = f"{self._dice.getrandbits(32):08x}"
        before, part.note = part.note, None
        self._set_last.pop(name, None)
        answer = await self._ask("PUT", f"/api/slots/{name}/values/note", {"value": value})
        if answer is None:
            return
        if answer.status_code == httpx.codes.OK:
            part.note = (value, time.monotonic())
            edit = self._acknowledged(answer)
            if edit is not None and before is not None:
                self._set_last[name] = (edit, before[0])
        elif "nothing was changed" in answer.text:
            part.note = before

    async def undo(self, name: str) -> None:
        part = self.scene.states.parts[name]
        edit, value = self._set_last.pop(name)
        before, part.note = part.note, None
        answer = await self._ask("POST", "/api/undo", {"edit": edit})
        if answer is None:
            return
        if answer.status_code == httpx.codes.OK:
            part.note = (value, time.monotonic())
            self._acknowledged(answer)
        elif "nothing was changed" in answer.text:
            part.note = before

    async def rewire(self, name: str) -> None:
        topic, writer, reader, reliable = self.robot.ring()[int(name[1:])]
        samples = self.scene.samples
        samples.unwire(time.monotonic(), writer, reader)
        if not await self._insist("unbind", "POST", f"/api/topics/{topic}/unbind", {"port": f"{reader}.in"}):
            return
        samples.unwired(time.monotonic(), writer, reader)
        await asyncio.sleep(self._while(0.5, 8.0))
        wire = {"from": f"{writer}.out", "to": [f"{reader}.in"], "type": "HelloWorld", "reliable": reliable}
        samples.binds(time.monotonic(), writer, reader)
        if await self._insist("bind", "POST", f"/api/topics/{topic}/bind", wire):
            samples.wire(time.monotonic(), writer, reader, reliable=reliable)

    async def stop(self, _name: str) -> None:
        states = self.scene.states
        states.stop = None
        if not await self._insist("STOP", "POST", "/api/stop", {}):
            return
        states.stop = (True, time.monotonic())
        await asyncio.sleep(self._while(0.5, 10.0))
        states.stop = None
        if await self._insist("GO", "POST", "/api/go", {}):
            states.stop = (False, time.monotonic())

    async def release(self, name: str) -> None:
        """Out of its slot, and back by a person: or by itself, when it is plugged in again or the master restarted."""
        uid, expected = self.robot.members[name].uid.hex(), self.scene.states.parts[name]
        with self._trouble("released", name):
            answer = await self._ask("POST", f"/api/slots/{name}/release", {})
            if answer is not None:
                if answer.status_code != httpx.codes.OK:
                    return  # it is not there now
                self._acknowledged(answer)
            # Without an answer it may have been released, or will be.
            expected.absent, expected.may_return = time.monotonic(), True
            await asyncio.sleep(self._while(1.0, 12.0))
            await self._insist("adopt", "POST", f"/api/parts/{uid}/adopt", {"slot": name}, " already")
            expected.absent, expected.may_return = None, False

    async def block(self, name: str) -> None:
        uid, expected = self.robot.members[name].uid.hex(), self.scene.states.parts[name]
        with self._trouble("blocked", name):
            if await self._insist("block", "POST", f"/api/parts/{uid}/block", {"reason": "the soak"}):
                expected.absent = time.monotonic()
                await asyncio.sleep(self._while(1.0, 12.0))
                expected.absent = None  # it may be back before the answer is here
                await self._insist("unblock", "POST", f"/api/parts/{uid}/unblock", {})

    async def connect_silently(self, _name: str) -> None:
        """Connections that say half a request and no more."""
        with contextlib.ExitStack() as held:
            for _ in range(CONNECTIONS):
                one = held.enter_context(socket.socket())
                one.setblocking(False)
                one.connect_ex(("127.0.0.1", self.robot.page_port))
                with contextlib.suppress(OSError):
                    one.send(b"GET / HT")
                await asyncio.sleep(0)
            await asyncio.sleep(self._while(1.0, 8.0))
