"""Hours of a demo that is used: whether the memory of master and recorder stays flat.

    python -m bench.hours [--hours 2] [--looks 12] [--write]

A real `msbot demo` of ten parts with its database and the recorder on. Three pages are open all the time
(`bench/open_pages.py`), closed and replaced by the next three each minute, so that each page of the menu is opened many
times. Every two minutes a part is blocked and let in again, every five there is a STOP and a GO. Before that, all of it
happens some twenty times as often for a quarter of an hour: what keeps the latest hundreds of something, such as the
page of the journal, has them then. Memory is looked at `--looks` times, every ten minutes by default. `--write` puts
the table into bench/results/hours.md. Ended by SIGTERM, it makes the table of the time so far. Takes a few percent of a
core; Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import signal
import sqlite3
import statistics
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from random import Random

import httpx

from bench.class_on_a_pi import children_of, usage
from bench.machine import describe_machine
from bench.open_pages import Heard, OpenPage, Site, enter
from bench.result import write_result
from bench.running_demo import running_demo
from bench.scale import memory_mb
from msbot_xrce.lazy import dataclass

PATHS = (
    *("/", "/plots", "/journal", "/wires", "/bus", "/timeline", "/library", "/settings"),
    *("/arrivals", "/doctor", "/program", "/learn", "/admin", "/handbook", "/arena", "/missions"),
)
OPEN = 3
BACK_S = 60.0
"""A part that is let in again is active within this time."""
WARM_S = 900.0


@dataclass(frozen=True, slots=True)
class Pace:
    """How quickly a robot is used, seconds."""

    page_s: float
    """A page is open for so long."""
    part_s: float
    """A part is blocked so often, each time for `away_s`."""
    away_s: float
    stop_s: float
    """STOP is said so often, each time for `stopped_s`."""
    stopped_s: float


USUAL = Pace(page_s=60.0, part_s=120.0, away_s=20.0, stop_s=300.0, stopped_s=5.0)
WARM_UP = Pace(page_s=5.0, part_s=4.0, away_s=1.0, stop_s=9.0, stopped_s=0.5)


@dataclass(frozen=True, slots=True)
class Look:
    """What the processes have at one moment."""

    at_s: float
    """Since the beginning."""
    master_mb: float
    recorder_mb: float
    cpu_share: float | None
    """Of master and recorder, of a core, since the look before."""
    journal_lines: int
    database_mb: float

    def cells(self) -> str:
        """A row of the table."""
        share = "" if self.cpu_share is None else f"{self.cpu_share:.1%}"
        return (
            f"| {self.at_s / 60:.0f} | {self.master_mb:.1f} MB | {self.recorder_mb:.1f} MB | {share} "
            f"| {self.journal_lines:,} | {self.database_mb:.1f} MB |"
        )


HEAD = (
    "| minutes since its start | memory of the master | of the recorder | both, of a core | lines of journal "
    "| database |",
    "|---|---|---|---|---|---|",
)


@dataclass(slots=True)
class Done:
    """What was done to the robot."""

    pages: int = 0
    blocks: int = 0
    stops: int = 0
    late: int = 0
    """Parts that were not active again in time."""


class Person:
    """Somebody who is signed in and changes things by the API."""

    def __init__(self, site: Site) -> None:
        base = f"http://{site.address}"
        self._client = httpx.AsyncClient(base_url=base, headers={"origin": base, "cookie": site.cookies}, timeout=60)

    async def begin(self) -> None:
        """Ask for what changes need."""
        self._client.headers["x-csrf-token"] = (await self._client.get("/api/me")).json()["csrf"]

    async def ask(self, path: str) -> dict[str, object]:
        """What the API says."""
        answer = await self._client.get(f"/api{path}")
        assert answer.status_code == httpx.codes.OK, (path, answer.text)
        return dict(answer.json())

    async def do(self, path: str, **body: object) -> None:
        """Change something."""
        answer = await self._client.post(f"/api{path}", json=body)
        assert answer.status_code == httpx.codes.OK, (path, answer.text)

    async def states(self) -> dict[str, str]:
        """Slot -> state of its part."""
        slots = (await self.ask("/robot"))["slots"]
        assert isinstance(slots, list)
        return {slot["name"]: slot["state"] for slot in slots}

    async def until_active(self) -> bool:
        """Whether all parts are active in time."""
        ends_at = time.monotonic() + BACK_S
        while any(state != "active" for state in (await self.states()).values()):
            if time.monotonic() > ends_at:
                return False
            await asyncio.sleep(1.0)
        return True


async def _again_and_again(period_s: float, deed: Callable[[], Awaitable[None]]) -> None:
    while True:
        await asyncio.sleep(period_s)
        await deed()


async def use(site: Site, done: Done, heard: Heard, pace: Pace) -> None:
    """Use the robot at that pace until cancelled."""
    person, random = Person(site), Random(1)
    await person.begin()

    async def other_pages() -> None:
        shown = [PATHS[(done.pages + number) % len(PATHS)] for number in range(OPEN)]
        done.pages += OPEN
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(pace.page_s), asyncio.TaskGroup() as group:
                for path in shown:
                    group.create_task(OpenPage(site, path, heard).run())

    async def block_a_part() -> None:
        slots = (await person.ask("/robot"))["slots"]
        assert isinstance(slots, list)
        uid = random.choice([slot["part"]["uid"] for slot in slots if slot["part"]])
        await person.do(f"/parts/{uid}/block", reason="bench")
        try:
            await asyncio.sleep(pace.away_s)
        finally:  # also when the warm-up ends meanwhile
            await person.do(f"/parts/{uid}/unblock")
        done.blocks += 1
        done.late += not await person.until_active()

    async def stop_and_go() -> None:
        await person.do("/stop", reason="bench")
        try:
            await asyncio.sleep(pace.stopped_s)
        finally:
            await person.do("/go")
        done.stops += 1

    async with asyncio.TaskGroup() as group:
        group.create_task(_again_and_again(0.0, other_pages))
        group.create_task(_again_and_again(pace.part_s - pace.away_s, block_a_part))
        group.create_task(_again_and_again(pace.stop_s - pace.stopped_s, stop_and_go))


class Eye:
    """Looks at the processes and at the database."""

    def __init__(self, pid: int, database: Path) -> None:
        self._pid = pid
        self._database = database
        self._began = time.monotonic()
        self._before: tuple[float, float] | None = None

    def _cpu_s(self) -> float:
        found = usage(self._pid)
        return found.master_s + found.children_s

    def look(self) -> Look:
        """See `Look`."""
        now, used_s = time.monotonic(), self._cpu_s()
        share = (used_s - self._before[1]) / (now - self._before[0]) if self._before else None
        self._before = now, used_s
        with contextlib.closing(sqlite3.connect(f"file:{self._database}?mode=ro", uri=True)) as database:
            lines = int(database.execute("select count(*) from journal").fetchone()[0])
        octets = sum(path.stat().st_size for path in self._database.parent.glob(self._database.name + "*"))
        return Look(
            now - self._began,
            memory_mb(self._pid, "Rss"),
            sum(memory_mb(child, "Rss") for child in children_of(self._pid)),
            share,
            lines,
            octets / 2**20,
        )


def growth(looks: Sequence[Look]) -> str:
    """How the memory changes after the warm-up, in words."""
    hours = [look.at_s / 3600 for look in looks]
    if len(looks) < 2:
        return "It has not run for longer than its warm-up."
    words = []
    for name, memory in (
        ("the master", [look.master_mb for look in looks]),
        ("the recorder", [look.recorder_mb for look in looks]),
    ):
        slope = statistics.linear_regression(hours, memory).slope
        words.append(
            f"{name} {memory[0]:.1f} to {memory[-1]:.1f} MB, at most {max(memory):.1f} ({slope:+.2f} MB an hour)"
        )
    return f"After the warm-up: {'; '.join(words)}."


async def watch(eye: Eye, site: Site, hours: float, looks: int) -> tuple[list[Look], Done, Heard]:
    """Use the robot for so long after its warm-up, and look at it so often."""
    done, heard = Done(), Heard()
    print(eye.look().cells(), flush=True)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(WARM_S):
            await use(site, done, heard, WARM_UP)
    seen = [eye.look()]
    print(seen[0].cells(), flush=True)
    clock = asyncio.get_running_loop().time
    using, began = asyncio.create_task(use(site, done, heard, USUAL)), clock()
    enough = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, enough.set)
    ending = asyncio.create_task(enough.wait())
    for number in range(1, looks + 1):
        rest_s = began + number * hours * 3600 / looks - clock()
        await asyncio.wait([using, ending], timeout=max(rest_s, 0.0), return_when=asyncio.FIRST_COMPLETED)
        if using.done():
            await using  # it never ends but by an error
        if ending.done():
            break
        seen.append(await asyncio.to_thread(eye.look))
        print(seen[-1].cells(), flush=True)
    ending.cancel()
    using.cancel()
    await asyncio.gather(using, return_exceptions=True)
    return seen, done, heard


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--hours", type=float, default=2.0)
    options.add_argument("--looks", type=int, default=12, help="so often memory is looked at")
    options.add_argument("--write", action="store_true", help="keep the table in bench/results")
    chosen = options.parse_args()
    lines = [f"{describe_machine()}; load {os.getloadavg()[0]:.1f}"]
    print("\n".join([*lines, "", *HEAD]), flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with running_demo(folder, "--db", "robot.db") as (pid, link):
            eye, site = Eye(pid, folder / "robot.db"), asyncio.run(enter(link))
            seen, done, heard = asyncio.run(watch(eye, site, chosen.hours, chosen.looks))
    table = [
        *HEAD,
        *(look.cells() for look in seen),
        "",
        growth(seen),
        "",
        f"{done.pages} pages opened ({heard.broken} of them lost their connection), {done.blocks} times a part blocked "
        f"and let in again ({done.late} not active again within {BACK_S:.0f} s), {done.stops} times STOP and GO.",
    ]
    print("\n".join(["", *table]), flush=True)
    if chosen.write:
        write_result(
            "hours", "Hours of a demo that is used", [*lines, "", *table], made_by="python -m bench.hours --write"
        )


if __name__ == "__main__":
    main()
