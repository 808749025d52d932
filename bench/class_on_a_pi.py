"""A class on a small computer: what a master of thirty pupils costs, and whether it keeps up with a fifth of a core.

    python -m bench.class_on_a_pi [--pupils 30] [--pages 30] [--seconds 20] [--quota 20] [--write]

A real `msbot master` with a page and the recorder on; five parts for each pupil, four of them simulated in the master,
the fifth the pupil's program over a WebSocket (`bench/classroom.py`); and pages open in browsers
(`bench/open_pages.py`), each with a pupil signed in. Programs and browsers are processes of their own. The second
column limits the master with its recorder to a share of a core, once the class is complete: a core of a Raspberry Pi 4
does a fifth to a quarter of one here. `--write` puts the table into bench/results/class_on_a_pi.md. Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx

from bench.classroom import PASSWORD, PERIOD_S, Pupil, Site
from bench.machine import cpu_s, describe_machine
from bench.open_pages import Heard, look_on
from bench.open_pages import Site as PageSite
from bench.quota import limited
from bench.result import write_result
from msbot_agent.link.net import WebSocketClientLink
from msbot_xrce.lazy import dataclass

READY_S = 300.0
SETTLE_S = 5.0
GO_S = 30.0
ROUNDS = 20
"""Of freeze, and of STOP."""
GOALS = {
    "master and recorder, of one core": "20 %",
    "memory of the master": "150 MB",
    "freeze: nothing passes any more, median / longest": "1,000 ms",
    "STOP: answered, median / longest": "100 ms",
    "parts that were late or lost": "0",
}


@dataclass(frozen=True, slots=True)
class Usage:
    """What processes have used so far."""

    master_s: float
    children_s: float


def children_of(pid: int) -> list[int]:
    """The processes that a process has started."""
    own: list[int] = []
    for task in Path(f"/proc/{pid}/task").iterdir():  # each thread has those that it has started
        with contextlib.suppress(OSError):  # it has ended
            own += [int(word) for word in (task / "children").read_text().split()]
    return own + [further for child in own for further in children_of(child)]


def _cpu_s(pid: int) -> float:
    try:
        return cpu_s(pid)
    except OSError:  # it has ended
        return 0.0


def usage(pid: int) -> Usage:
    """Processor time of a master and of its children."""
    return Usage(_cpu_s(pid), sum(map(_cpu_s, children_of(pid))))


def cookies_of(site: Site, name: str) -> str:
    """Sign a pupil in."""
    with httpx.Client(base_url=site.base, timeout=120) as browser:
        answer = browser.post(
            "/login", data={"name": f"pupil {name}", "password": PASSWORD}, headers={"origin": site.base}
        )
        if answer.status_code != httpx.codes.SEE_OTHER:
            raise SystemExit(f"pupil {name} cannot sign in: {answer.status_code} {answer.text[:200]}")
        return "; ".join(f"{cookie}={value}" for cookie, value in browser.cookies.items())


@contextlib.contextmanager
def open_pages(site: Site, pages: int) -> Iterator[None]:
    """So many pages open, in a process of their own."""
    if not pages:
        yield
        return
    names = [site.names[number % len(site.names)] for number in range(pages)]
    known = {name: cookies_of(site, name) for name in dict.fromkeys(names)}
    task = json.dumps({"base": site.base, "cookies": [known[name] for name in names]})
    command = [sys.executable, "-m", "bench.class_on_a_pi", "--be-browsers", task]
    with subprocess.Popen(command) as browsers:
        try:
            time.sleep(SETTLE_S + 0.3 * pages)
            yield
        finally:
            browsers.terminate()
            browsers.wait()


async def be_browsers(task: str) -> None:
    """Have pages open until killed."""
    wanted = json.loads(task)
    place = httpx.URL(wanted["base"])
    async with asyncio.TaskGroup() as group:
        for cookies in wanted["cookies"]:
            where = PageSite(place.host, place.port or 80, cookies)
            group.create_task(look_on(where, "/", 1, Heard()))
            await asyncio.sleep(0.2)


def _late(site: Site, since_ms: int) -> int:
    """How many times a part was late or lost since then."""
    answer = site.client.get("/api/journal", params={"limit": 1000})
    lines = answer.json()
    lines = lines if isinstance(lines, list) else lines["lines"]
    return sum(line["at_ms"] >= since_ms and line["to_state"] in ("late", "lost") for line in lines)


async def _freezes(site: Site) -> list[float]:
    found = []
    for _ in range(ROUNDS):
        at = time.monotonic()
        await asyncio.to_thread(site.do, "POST", "/class/freeze", reason="")
        found.append(1000 * (time.monotonic() - at))
        await asyncio.to_thread(site.do, "POST", "/class/thaw")
        await asyncio.sleep(1.0)
    return found


async def _stops(site: Site, parts: int) -> tuple[list[float], list[float], int]:
    """Milliseconds until the answer to each STOP, until its last part has confirmed, and how many had not."""
    answered, confirmed, silent = [], [], 0
    for _ in range(ROUNDS):
        at = time.monotonic()
        await asyncio.to_thread(site.do, "POST", "/stop", reason="bench")
        answered.append(1000 * (time.monotonic() - at))
        stop: dict[str, object] = {}
        for _ in range(50):
            await asyncio.sleep(0.2)
            found = (await asyncio.to_thread(site.do, "GET", "/robot"))["stop"]
            assert isinstance(found, dict)
            stop = found
            if not stop["silent"] and len(found["confirmed"]) == parts:
                break
        known = stop["confirmed"]
        assert isinstance(known, list)
        confirmed.append(max((float(one["ms"]) for one in known), default=float("inf")))
        silent += parts - len(known)
        await _go(site, stop["number"])
        await asyncio.sleep(1.0)
    return answered, confirmed, silent


async def _go(site: Site, number: object) -> None:
    """Say GO until it is heard: a part that has been late may still say STOP itself."""
    end = time.monotonic() + GO_S
    while True:
        answer = await asyncio.to_thread(site.client.post, "/api/go", json={"stop": number})
        if answer.status_code == httpx.codes.OK:
            return
        if time.monotonic() > end:
            raise SystemExit(f"GO is refused: {answer.text}")
        await asyncio.sleep(0.5)


def _middle(values: list[float]) -> str:
    ordered = sorted(values)
    return f"{ordered[len(ordered) // 2]:,.0f} / {ordered[-1]:,.0f} ms"


async def measure(site: Site, pupils: dict[str, Pupil], seconds: float) -> dict[str, str]:
    """One column of the table."""
    parts = 5 * len(site.names)
    pid, since_ms = site.process.pid, round(time.time() * 1000)
    for pupil in pupils.values():
        pupil.heard = 0
    used, start = usage(pid), time.monotonic()
    await asyncio.sleep(seconds)
    span, now = time.monotonic() - start, usage(pid)
    rate = sum(pupil.heard for pupil in pupils.values()) / span / max(len(pupils), 1)
    master, children = now.master_s - used.master_s, now.children_s - used.children_s
    figures = {
        "master and recorder, of one core": f"{100 * (master + children) / span:.1f} %",
        "of it the recorder": f"{100 * children / span:.1f} %",
        "memory of the master": f"{site.memory_mb():.0f} MB",
        "distances that a program gets, of 10 a second": f"{rate:.1f}",
    }
    figures["freeze: nothing passes any more, median / longest"] = _middle(await _freezes(site))
    answered, confirmed, silent = await _stops(site, parts)
    figures["STOP: answered, median / longest"] = _middle(answered)
    figures["STOP: last part has confirmed, median / longest"] = _middle(confirmed)
    figures["parts that did not confirm a STOP"] = str(silent)
    figures["parts that were late or lost"] = str(await asyncio.to_thread(_late, site, since_ms))
    return figures


async def play(site: Site, tokens: dict[str, str], wishes: argparse.Namespace) -> list[tuple[str, dict[str, str]]]:
    """Let the programs run, and measure with and without a limit."""
    pupils = {name: Pupil(number) for number, name in enumerate(site.names)}
    address, columns = site.base.replace("http", "ws"), []
    async with asyncio.TaskGroup() as group:
        tasks = [
            group.create_task(pupil.part.run_async(WebSocketClientLink(address, tokens[name])))
            for name, pupil in pupils.items()
        ]
        began, parts = time.monotonic(), 5 * len(site.names)
        while (here := await asyncio.to_thread(site.active)) < parts:
            if time.monotonic() - began > READY_S:
                raise SystemExit(f"only {here} of {parts} parts became active")
            await asyncio.sleep(PERIOD_S)
        pages = open_pages(site, wishes.pages)
        await asyncio.to_thread(pages.__enter__)
        try:
            columns.append(("no limit", await measure(site, pupils, wishes.seconds)))
            pid = site.process.pid
            with limited([pid, *children_of(pid)], wishes.quota / 100) as way:
                await asyncio.sleep(SETTLE_S)
                title = f"{wishes.quota:g} % of a core ({way})"
                columns.append((title, await measure(site, pupils, wishes.seconds)))
        finally:
            await asyncio.to_thread(pages.__exit__, None, None, None)
        for task in tasks:
            task.cancel()
    return columns


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pupils", type=int, default=30)
    parser.add_argument("--pages", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--quota", type=float, default=20.0)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--be-browsers", help=argparse.SUPPRESS)
    wishes = parser.parse_args()
    if wishes.be_browsers:
        asyncio.run(be_browsers(wishes.be_browsers))
        return
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        site = Site(Path(folder), wishes.pupils)
        try:
            columns = asyncio.run(play(site, site.prepare(), wishes))
        finally:
            site.close()
    heads = [title for title, _ in columns]
    lines = [
        f"{describe_machine()}; load {load:.1f} before",
        "",
        f"| {wishes.pupils} pupils' programs, {5 * wishes.pupils} parts, {wishes.pages} open pages, recorder on "
        f"| goal | {' | '.join(heads)} |",
        "|---|---|" + "---|" * len(heads),
    ]
    for what in columns[0][1]:
        lines.append(f"| {what} | {GOALS.get(what, '')} | {' | '.join(figures[what] for _, figures in columns)} |")
    print("\n".join(lines))
    if wishes.write:
        write_result(
            "class_on_a_pi", "A class on a small computer", lines, made_by="python -m bench.class_on_a_pi --write"
        )


if __name__ == "__main__":
    main()
