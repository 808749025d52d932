"""A thousand parts at once over UDP: when all are in, whom the master loses meanwhile, and what that costs.

    python -m bench.many_parts [--parts 1000] [--processes 2] [--kill] [--page] [--flood 50000] [--rest 20]

A real `msbot master` with a blueprint of so many slots; the parts are real ones with a socket each, in a few
processes, and all are switched on in the same instant. `--kill` ends the master with SIGKILL under them, starts it
again and measures once more; `--page` has a browser look at the home page all the time (needs Chromium); `--flood`
has one registered part send so many packets a second while the robot is at rest. Processor time is that of the
master's process. Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import os
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from random import randbytes

from bench.machine import cpu_s, describe_machine
from msbot.part import JoinState, Part
from msbot_agent.link import open_link
from msbot_agent.process.user_folders import PACKAGES

PART_NUMBER = "ABCD"
LONGEST_S = 120.0
"""A robot that is not complete by then never will be."""
STEP_S = 0.1
PASSWORD = "many parts at once"
BAD = ("late", "lost")
FLOODING = "P0000"
"""The part that floods, if one does."""
ITSELF, OTHERS = f"part = '{FLOODING}'", f"part != '{FLOODING}'"

_ROBOT = """\
[robot]
name = "CROWD"
version = "CROWD_V1"
serial_number = "C-0001"
released = "2026"
manufacturer = "MsBOT"
"""
_SLOT = '[[slot]]\nname = "P{0:04}"\npart = "{1}"\n'
_BINDING = '[[binding]]\ntopic = "ring_{0:04}"\ntype = "HelloWorld"\nfrom = "P{0:04}.out"\nto = ["P{1:04}.in"]\n'


def blueprint(size: int) -> str:
    """A ring: each part may write to the next; nothing is published."""
    slots = "".join(_SLOT.format(number, PART_NUMBER) for number in range(size))
    return _ROBOT + slots + "".join(_BINDING.format(number, (number + 1) % size) for number in range(size))


async def be_parts(first: int, count: int, address: str, flood: int) -> None:
    """Run that many parts; say how many are active whenever that changes."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    parts = [
        Part(PART_NUMBER, local_name=f"P{number:04}", robot="CROWD", uid=randbytes(8))
        for number in range(first, first + count)
    ]
    loop = asyncio.get_running_loop()
    await loop.run_in_executor(None, sys.stdin.readline)
    losses: Counter[str] = Counter()
    flooding, sent = asyncio.Event(), 0
    loop.run_in_executor(None, lambda: sys.stdin.readline() and loop.call_soon_threadsafe(flooding.set))

    async def report() -> None:
        said = ""
        while True:
            active = sum(part.state is JoinState.ACTIVE for part in parts)
            news = json.dumps({"active": active, "losses": losses, "sent": sent})
            if news != said:
                print(news, flush=True)
                said = news
            await asyncio.sleep(STEP_S)

    async def flood_master() -> None:
        """The first part's own session sends beats with a lease that nobody has, as fast as it is told to."""
        nonlocal sent
        await flooding.wait()
        link = links[0]
        assert link.remote is not None
        packet = bytes.fromhex("8101000007010c00001000170000000000000000")
        due = loop.time()
        while True:
            due = max(due, loop.time() - 0.5)
            while due <= loop.time():
                for _ in range(32):
                    with contextlib.suppress(Exception):
                        link.send(packet, link.remote)
                due, sent = due + 32 / flood, sent + 32
            await asyncio.sleep(0)

    links = [open_link(address) for _ in parts]
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(report())
        if flood and first == 0:
            tasks.create_task(flood_master())
        for part, link in zip(parts, links, strict=True):
            part.on_lost(lambda part=part: losses.update([part.reason]))
            tasks.create_task(part.run_async(link))


class Crowd:
    """The parts in their processes, and what they say."""

    def __init__(self, size: int, processes: int, address: str, flood: int) -> None:
        self.active: dict[int, int] = {}
        self.sent = 0
        """Packets of the one that floods."""
        self._losses: dict[int, Counter[str]] = {}
        self._processes = []
        edges = [size * number // processes for number in range(processes + 1)]
        if flood:
            edges.insert(1, 1)  # the one that floods is busy with that
        for number, (first, last) in enumerate(pairwise(edges)):
            words = ["--be-parts", str(first), "--parts", str(last - first), "--link", address, "--flood", str(flood)]
            process = subprocess.Popen(
                [sys.executable, "-m", "bench.many_parts", *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            self._processes.append(process)
            threading.Thread(target=self._read, args=(number, process), daemon=True).start()

    def _read(self, number: int, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            news = json.loads(line)
            self.sent = max(self.sent, news["sent"])
            self.active[number], self._losses[number] = news["active"], Counter(news["losses"])

    def tell(self) -> None:
        """Switch the parts on; the second time: let the first of them flood."""
        for process in self._processes:
            assert process.stdin is not None
            process.stdin.write("\n")
            process.stdin.flush()

    def is_complete(self, size: int) -> bool:
        """Whether all parts are active, as they see it."""
        return sum(self.active.values()) == size

    @property
    def lost(self) -> Counter[str]:
        """How often a part that was active has lost its master, by what it says."""
        return sum(self._losses.values(), Counter())

    @property
    def cpu_s(self) -> float:
        """Processor time of all parts."""
        return sum(cpu_s(process.pid) for process in self._processes)

    def end(self) -> None:
        """Take them away without a word."""
        for process in self._processes:
            process.kill()
            process.wait()


class Robot:
    """The master in its process, and its journal."""

    def __init__(self, folder: Path, *, page: bool) -> None:
        self.folder = folder
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"udp:127.0.0.1:{free.getsockname()[1]}"
        self._page = ["--port", "0"] if page else ["--no-page"]
        self._env = {**os.environ, "XDG_STATE_HOME": str(folder / "state"), "XDG_RUNTIME_DIR": str(folder / "run")}
        (folder / "run").mkdir(mode=0o700)
        self._log = folder / "master.log"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, and wait until it serves."""
        sign = "The page is at" if "--port" in self._page else "is up on"
        before = self._said().count(sign)
        with self._log.open("ab") as log:
            words = [sys.executable, "-m", "msbot", "master", "--link", self.address, *self._page, "robot.toml"]
            self._process = subprocess.Popen(
                words, cwd=self.folder, env={**self._env, "PYTHONUNBUFFERED": "1"}, stdout=log, stderr=log
            )
        end = time.monotonic() + LONGEST_S
        while self._said().count(sign) == before:
            if self._process.poll() is not None or time.monotonic() > end:
                raise SystemExit(f"the master does not come up:\n{self._said()}")
            time.sleep(0.02)

    def kill(self) -> None:
        """End it with SIGKILL."""
        assert self._process is not None
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    @property
    def pid(self) -> int:
        """The number of its process."""
        assert self._process is not None
        return self._process.pid

    def mark(self) -> int:
        """The last line of its journal."""
        return int(str(self._ask("select coalesce(max(id), 0) from journal")[0][0]))

    def events(self, since: int, whose: str = "1") -> Counter[str]:
        """How often a part got into which state since that line of the journal, other than by the master's own end."""
        rows = self._ask(
            f"select to_state, count(*) from journal where id > {since} and {whose} "
            "and reason != 'the master was restarted' group by to_state"
        )
        return Counter({str(state): int(str(count)) for state, count in rows})

    def said_of_flood(self) -> str:
        """What the journal says of the part that floods."""
        rows = self._ask("select reason from journal where reason like '%more than its share%' order by id")
        return str(rows[-1][0]) if rows else "nothing"

    def link_to_page(self) -> str:
        """Where its page is: at first the form that makes a visitor its administrator, later the one to sign in."""
        return str(re.findall(r"The page is at (\S+)", self._said())[-1])

    def _ask(self, query: str) -> list[tuple[object, ...]]:
        with contextlib.closing(sqlite3.connect(f"file:{self.folder / 'robot.db'}?mode=ro", uri=True)) as database:
            return database.execute(query).fetchall()

    def _said(self) -> str:
        return self._log.read_text(errors="replace") if self._log.exists() else ""


@contextlib.contextmanager
def visitor(robot: Robot, *, wanted: bool) -> Iterator[None]:
    """A browser that looks at the home page."""
    if not wanted:
        yield
        return
    from playwright.sync_api import sync_playwright

    from bench.page import ARGUMENTS, PATIENCE_MS

    with sync_playwright() as playwright:
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(robot.link_to_page())
        page.fill("[name=name]", "ada")
        for field in page.locator("[type=password]").all():
            field.fill(PASSWORD)
        page.click("[type=submit]")
        page.get_by_role("button", name="Open slot P0000").wait_for()
        yield
        browser.close()


def see(title: str, robot: Robot, crowd: Crowd, *, size: int, rest_s: float, since: tuple[float, int, float]) -> None:
    """Wait until all are in, then for some time of rest; print what happened."""
    began_at, mark, parts_cpu_s = since
    lost_before = crowd.lost
    before_s = cpu_s(robot.pid)
    while not crowd.is_complete(size):
        if time.monotonic() - began_at > LONGEST_S:
            print(f"{title}: after {LONGEST_S:g} s only {sum(crowd.active.values())} of {size} are in", flush=True)
            break
        time.sleep(0.02)
    took_s, joined_s = time.monotonic() - began_at, cpu_s(robot.pid)
    joining, lost, in_s = robot.events(mark), crowd.lost - lost_before, crowd.cpu_s - parts_cpu_s
    print(
        f"{title}: {sum(crowd.active.values())} in after {took_s:.1f} s; the master's processor time "
        f"{joined_s - before_s:.1f} s, the parts' {in_s:.1f} s; {told(joining)}; {lost_words(lost)}",
        flush=True,
    )
    mark, at, lost, sent = robot.mark(), time.monotonic(), crowd.lost, crowd.sent
    time.sleep(rest_s)
    used = 100 * (cpu_s(robot.pid) - joined_s) / (time.monotonic() - at)
    events = robot.events(mark, OTHERS if crowd.sent else "1")
    print(
        f"  at rest for {rest_s:g} s: {sum(crowd.active.values())} active; the master needs {used:.0f} % of a core; "
        f"{told(events)}; {lost_words(crowd.lost - lost)}; load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    if crowd.sent > sent:
        rate = (crowd.sent - sent) / (time.monotonic() - at)
        itself = told(robot.events(mark, ITSELF))
        print(f"  {FLOODING} sent {rate:.0f} packets/s; itself: {itself}; told: {robot.said_of_flood()}")


def told(events: Counter[str]) -> str:
    """The states that should not be."""
    return ", ".join(f"{state} {events[state]}" for state in (*BAD, "left"))


def lost_words(losses: Counter[str]) -> str:
    """How many parts were active and lost their master, and why."""
    why = ", ".join(f"{reason} {count}" for reason, count in losses.most_common(3))
    return f"parts that lost it {losses.total()}" + (f" ({why})" if why else "")


def measure(options: argparse.Namespace) -> None:
    """Switch on, rest, and what else was asked for."""
    size = options.parts
    print(f"{describe_machine()}, load {os.getloadavg()[0]:.1f}; {size} parts in {options.processes} processes")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(blueprint(size))
        robot = Robot(folder, page=options.page)
        robot.start()
        print(f"master {robot.pid}", flush=True)
        crowd = Crowd(size, options.processes, robot.address, options.flood)
        try:
            with visitor(robot, wanted=options.page):
                time.sleep(3.0)
                since = (time.monotonic(), robot.mark(), crowd.cpu_s)
                crowd.tell()
                see("switched on", robot, crowd, size=size, rest_s=options.rest, since=since)
                if options.flood:
                    crowd.tell()
                    since = (time.monotonic(), robot.mark(), crowd.cpu_s)
                    see(
                        f"with {options.flood} packets/s of one part",
                        robot,
                        crowd,
                        size=size,
                        rest_s=options.rest,
                        since=since,
                    )
            if options.kill:
                robot.kill()
                since = (time.monotonic(), robot.mark(), crowd.cpu_s)
                robot.start()
                with visitor(robot, wanted=options.page):
                    crowd.active.clear()
                    see("after kill -9", robot, crowd, size=size, rest_s=options.rest, since=since)
        finally:
            crowd.end()
            robot.kill()


def main() -> None:
    """Measure, or be some of the parts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--parts", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--kill", action="store_true", help="end the master with SIGKILL and start it again")
    parser.add_argument("--page", action="store_true", help="with a browser on the home page")
    parser.add_argument("--flood", type=int, default=0, metavar="N", help="one part sends N packets a second")
    parser.add_argument("--rest", type=float, default=20.0, help="seconds of rest afterwards")
    parser.add_argument("--be-parts", type=int, metavar="FIRST", help=argparse.SUPPRESS)
    parser.add_argument("--link", default="", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.be_parts is not None:
        asyncio.run(be_parts(options.be_parts, options.parts, options.link, options.flood))
    else:
        measure(options)


if __name__ == "__main__":
    main()
