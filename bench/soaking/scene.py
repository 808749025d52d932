"""A robot, what is wrong with it, and the oracles: where everything that happens comes together."""

from __future__ import annotations

import asyncio
import os
import sqlite3
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random

import httpx

from bench.soaking.flatness import Sample
from bench.soaking.journal import JournalOracle, read_edits, read_journal
from bench.soaking.oracle import SampleOracle, Violation
from bench.soaking.robot import PATIENCE_S, AnyProcess, Robot
from bench.soaking.states import Expected, StateOracle
from bench.soaking.troubles import ALL, Trouble, Troubles

REORDER_S = 1.0
"""Events of different processes are put into the order of their times; so long one may be under way."""
STALL_S = 0.5
NAP_S = 0.1
WAITED_S = 1.0
"""Over so long it is seen how long a process has waited for a processor."""
LOOK_S = 1.0
CHECK_S = 0.5
JOURNAL_S = 10.0
MEASURE_S = 10.0
RECENT_ACTS = 8
MOST_SAID = 200
"""Violations that are printed in full."""


class Scene:
    """Everything about one run.

    Args:
        robot: what is abused.
        seed: of its chance, for people who want to see the same again.
        say: prints.
    """

    def __init__(
        self, folder: Path, kinds: list[str], authentication: str, seed: int, say: Callable[[str], None]
    ) -> None:
        self.began = time.monotonic()
        self.dice = Random(seed)
        self.robot = Robot(folder, kinds, authentication, self.dice, self._hear)
        self.seed, self._say = seed, say
        self.troubles = Troubles(self.began)
        self.samples = SampleOracle(self.troubles.clear_since)
        self.states = StateOracle(self.troubles.clear_since, self.complain)
        self.journal = JournalOracle(self.complain)
        self.master_since: float | None = None
        """Since when the master serves; None: it does not."""
        self.acts: Counter[str] = Counter()
        self.recent: deque[str] = deque(maxlen=RECENT_ACTS)
        self.back: dict[str, list[float]] = defaultdict(list)
        """By what was wrong: seconds from its end until the part was active again."""
        self.acknowledged: deque[tuple[int, float]] = deque(maxlen=2000)
        self.tried: Counter[str] = Counter()
        self.growth: list[list[Sample]] = []
        """For each master process: what it needs."""
        self.pages = 0
        self.stalls = 0.0
        self.database_is_there = True
        self.violations: list[Violation] = self.samples.violations
        self._told = 0
        self._events: list[tuple[float, int, str, list[object]]] = []
        self._count = 0
        self._joined_after: dict[str, Trouble] = {}
        self._last_tasks = 0

    def clock(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.began

    def act(self, words: str) -> None:
        """Something is done to the robot."""
        self.recent.append(f"{self.clock():.1f} s: {words}")

    def complain(self, at: float, rule: str, words: str) -> None:
        """A violation."""
        self.violations.append(Violation(at, rule, words))

    def tell_violations(self) -> None:
        """Print what is new."""
        for one in self.violations[self._told : MOST_SAID]:
            acts = "; ".join(self.recent)
            self._say(f"VIOLATION seed {self.seed}, {one.at - self.began:.1f} s, {one.rule}: {one.words}")
            self._say(f"    last acts: {acts}")
        self._told = len(self.violations)

    # What processes say.

    def _hear(self, name: str, event: list[object]) -> None:
        self._count += 1
        self._events.append((float(str(event[1])), self._count, name, event))

    def died(self, slot: str, boot: str) -> None:
        """A process was ended by the script; what it has said before counts before."""
        self._hear(slot, ["died", time.monotonic(), boot])

    def _judge_events(self, until: float) -> None:
        due = sorted(one for one in self._events if one[0] <= until)
        self._events = [one for one in self._events if one[0] > until]
        for at, _, name, event in due:
            if name.startswith("intruders"):
                if event[0] == "tried":
                    self.tried[name] = int(str(event[3]))
                else:
                    self.complain(at, "intruder", f"{name}: {event[3:]}")
            else:
                self._judge_event(at, name, event)

    def _judge_event(self, at: float, slot: str, event: list[object]) -> None:
        boot, rest = str(event[2]), event[3:]
        part, samples = self.states.parts[slot], self.samples
        is_present = self.robot.members[slot].boot == boot
        match event[0]:
            case "boot":
                samples.boot(slot, boot)
            case "join":
                epoch, where, stopped = rest
                samples.join(at, boot, int(str(epoch)), str(where), stopped=bool(stopped))
                if part.may_return:
                    part.absent = None
                if is_present:
                    part.joined, part.told_stop = at, bool(stopped)
                self._returned(at, slot)
            case "lost":
                samples.lost(at, boot)
                part.joined = None
            case "died":
                samples.died(at, boot)
            case "stop" | "go":
                getattr(samples, str(event[0]))(at, boot)
                part.told_stop = event[0] == "stop"
            case "note":
                part.told_note = str(rest[0])
            case "sent":
                samples.sent(at, boot, int(str(rest[0])), int(str(rest[1])))
            case "got":
                epoch, whose, its_boot, its_epoch, number = rest
                sample = (str(whose), str(its_boot), int(str(its_epoch)), int(str(number)))
                samples.got(at, boot, int(str(epoch)), sample)
            case "stall":
                self.troubles.note(at, at + float(str(rest[0])), "stall", [slot])
            case "damaged":
                self.complain(at, "damaged", f"{slot} hears {rest}")

    def _returned(self, at: float, slot: str) -> None:
        """A part is active again: how long after the last trouble?"""
        latest = next((one for one in self.troubles.of(slot) if one.what != "stall"), None)
        if latest is None or latest.ended is None or self._joined_after.get(slot) is latest:
            return
        self._joined_after[slot] = latest
        self.back[latest.what].append(at - latest.ended)

    # What is looked at all the time.

    async def watch(self) -> None:
        """Everything, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for look in (self._watch_itself, self._judge, self._look_at_page, self._read_journal, self._measure):
                tasks.create_task(look())

    async def _watch_itself(self) -> None:
        """The ways go through this process: if it gets no turn, neither do they. Others wait for theirs, too."""
        waited: dict[int, float] = {}
        looked = time.monotonic()
        while True:
            began = time.monotonic()
            await asyncio.sleep(NAP_S)
            now = time.monotonic()
            if now - began - NAP_S > STALL_S:
                self._stalled(began, now, ALL)
            if now - looked < WAITED_S:
                continue
            for pid, whom in self._processes():
                total = waited_s(pid)
                if total - waited.get(pid, total) > STALL_S:
                    self._stalled(looked, now, *whom)
                waited[pid] = total
            looked = now

    def _stalled(self, began: float, ended: float, *whom: str) -> None:
        self.troubles.note(began, ended, "stall", whom)
        self.stalls += ended - began

    def _processes(self) -> list[tuple[int, list[str]]]:
        """All of the robot's, with whom they concern."""
        robot = self.robot
        on_bus = [name for name, member in robot.members.items() if member.kind == robot.bus]
        everybody: list[tuple[AnyProcess | None, list[str]]] = [(robot.master, [ALL]), (robot.bus_process, on_bus)]
        everybody += [(member.process, [name]) for name, member in robot.members.items()]
        return [
            (process.pid, whom) for process, whom in everybody if process is not None and process.returncode is None
        ]

    async def _judge(self) -> None:
        while True:
            await asyncio.sleep(CHECK_S)
            now = time.monotonic()
            self._judge_events(now - REORDER_S)
            self.samples.check(now - REORDER_S)
            self.states.check(now - REORDER_S)
            self.tell_violations()

    def judge_all(self) -> None:
        """What has been said until now."""
        self._judge_events(time.monotonic())
        self.tell_violations()

    async def _look_at_page(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            asked = time.monotonic()
            trouble = ""
            try:
                answer = await self.robot.web.get("/api/robot")
                if answer.status_code == httpx.codes.OK:
                    self._shown(asked, answer.json())
                else:
                    trouble = f"the page answers {answer.status_code}: {answer.text[:200]}"
            except httpx.HTTPError as error:
                trouble = f"the page does not answer for {time.monotonic() - asked:.1f} s: {error!r}"
            clear = None if self.master_since is None else self._master_clear()
            self.states.page(time.monotonic(), trouble, None if clear is None else max(clear, self.master_since or 0.0))

    def _shown(self, asked: float, robot: dict[str, object]) -> None:
        self.pages += 1
        slots = robot["slots"]
        assert isinstance(slots, list)
        if self.master_since is not None and self._master_clear() is not None:
            found = {one["name"]: (one["state"], (one["part"] or {}).get("uid", "")) for one in slots}
            for one in slots:
                if one["part"] and one["wear"]:
                    self.samples.worn(asked, one["name"], str(one["part"]["client_key"]), int(one["wear"]["unread"]))
            self.states.shown(asked, found, stopped=bool(robot["stopped"]), master_since=self.master_since)

    def _master_clear(self) -> float | None:
        return self.troubles.clear_since(ALL)

    async def _read_journal(self) -> None:
        while True:
            await asyncio.sleep(JOURNAL_S)
            await self.read_journal()

    async def read_journal(self) -> None:
        """What is new in the database."""
        if not self.database_is_there:
            return
        database = self.robot.database
        with suppress(sqlite3.Error):  # locked, gone or being written anew: the next time
            acknowledged = list(self.acknowledged)
            rows = await asyncio.to_thread(read_journal, database, self.journal.last)
            kept = await asyncio.to_thread(read_edits, database)
            if self.database_is_there:
                now = time.monotonic()
                self.journal.follow(now, rows)
                self.journal.edits(now, kept, acknowledged)

    async def _measure(self) -> None:
        while True:
            await asyncio.sleep(MEASURE_S)
            master, since = self.robot.master, self.master_since
            if master is None or since is None or self._master_clear() is None:
                continue
            with suppress(OSError, httpx.HTTPError):  # it is ended in this moment
                figures = (await self.robot.web.get("/metrics")).text
                if master is self.robot.master:
                    self.growth[-1].append(look_at(master.pid, time.monotonic() - since, figures))

    # The beginning.

    async def begin(self, intruders: int | None = None) -> None:
        """Everything is plugged in; intruders try so many of the robot's links, or all."""
        await self.robot.prepare()
        for slot, member in self.robot.members.items():
            self.states.parts[slot] = Expected(
                member.uid.hex(), on_bus=member.kind == self.robot.bus, absent=time.monotonic(), note=("first", 0.0)
            )
        await self.robot.start_bus()
        with_master = self.troubles.begin(time.monotonic(), "first start", [ALL])
        await self.start_master()
        with_master.ended = time.monotonic()
        for _, writer, reader, reliable in self.robot.ring():
            self.samples.wire(time.monotonic(), writer, reader, reliable=reliable)
        for slot in self.robot.slots:
            await self.start_part(slot)
        await self.robot.start_intruders(intruders)

    async def start_master(self) -> None:
        """Until it serves."""
        await self.robot.start_master()
        self.master_since = time.monotonic()
        self.growth.append([])

    async def start_part(self, slot: str) -> None:
        """Until it says that it is there."""
        await self.robot.start_part(slot)
        member = self.robot.members[slot]
        end = time.monotonic() + PATIENCE_S
        while not member.boot:
            process = member.process
            if time.monotonic() > end or process is None or process.returncode is not None:
                self.complain(time.monotonic(), "start", f"the part of {slot} does not start")
                return
            await asyncio.sleep(0.02)
        self.states.parts[slot].absent = None

    def is_well(self) -> bool:
        """Whether every part has joined, as it says."""
        return all(part.joined is not None for part in self.states.parts.values())


def waited_s(pid: int) -> float:
    """How long a process has waited for a processor so far; 0 where the kernel does not tell."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, IndexError):
        return 0.0


def look_at(pid: int, age_s: float, figures: str) -> Sample:
    """What a process needs, by its figures for Prometheus and by the kernel's.

    Raises:
        OSError: it has ended.
    """
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    found = dict(line.split(":", 1) for line in lines if ":" in line)
    tasks = next((line for line in figures.splitlines() if line.startswith("msbot_loop_tasks ")), "msbot_loop_tasks 0")
    files = len(os.listdir(f"/proc/{pid}/fd"))
    return Sample(
        age_s, int(found["VmRSS"].split()[0]) / 1024, int(float(tasks.split()[1])), int(found["Threads"]), files
    )
