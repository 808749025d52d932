"""What a robot costs with its parts, its open pages and its days: per message, per part and per page.

    python -m bench.growth_of_robots [--quick] [--write]

Parts: see `bench/parts_of_a_robot.py`. A day: master and three parts in one process, joined by the in-process link, for
24 hours of virtual time; each says something to the next once a second, memory is looked at every two hours.
Pages: a real `msbot demo` with pages open in `bench/open_pages.py`, each number of them in several turns. Processor
time is compared, not rates. `--write` puts the tables into bench/results/growth_of_robots.md and the curves into
docs/explain/growth-robots.svg. Some 35 minutes; Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

from bench.class_on_a_pi import usage
from bench.crowd import PART_NUMBER, ROBOT, ring
from bench.growth_curves import Curve, curves
from bench.machine import describe_machine
from bench.parts_of_a_robot import be_parts, table
from bench.result import write_result
from bench.running_demo import READY_S, running_demo
from bench.scale import memory_mb
from msbot import HelloWorld
from msbot.config import load_library
from msbot.master import Master
from msbot.part import JoinState, Part
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.link import InprocHub
from msbot_agent.process.end_signals import collect_seldom
from msbot_agent.process.user_folders import PACKAGES

PICTURE = Path(__file__).parent.parent / "docs/explain/growth-robots.svg"
PARTS = (10, 30, 100, 300, 1000)
TURNS = 2
"""Masters for each number of parts, one after the other."""
DAY_S, LOOK_S = 24 * 3600.0, 2 * 3600.0
WARM_LOOKS = 2
"""Looks at a day's memory after which it should be flat: what is kept for minutes and hours is full."""
DAYS_PARTS = 3
PAGES = (1, 3, 10, 30)
PAGE_TURNS, TURN_S, SETTLED_S = 3, 10.0, 4.0


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="fewer rows, one turn, an hour in place of a day")
    options.add_argument("--write", action="store_true", help="keep tables in bench/results, curves in docs/explain")
    options.add_argument("--be-parts", help=argparse.SUPPRESS)
    options.add_argument("--be-day", type=float, help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.be_parts:
        size, address = chosen.be_parts.split()
        asyncio.run(be_parts(int(size), address))
        return
    if chosen.be_day:
        print(json.dumps(run_virtual(be_crowd(DAYS_PARTS, chosen.be_day, round(chosen.be_day / LOOK_S) or 4))))
        return
    drawn: list[Curve] = []
    lines = [f"{describe_machine()}; load {os.getloadavg()[0]:.1f}"]
    print(lines[0], flush=True)
    for made in (
        table(drawn, PARTS[::2], 1, 5) if chosen.quick else table(drawn, PARTS, TURNS),
        day(3600.0 if chosen.quick else DAY_S),
        pages(drawn, PAGES[::3] if chosen.quick else PAGES, 1 if chosen.quick else PAGE_TURNS),
    ):
        print("\n".join(["", *made]), flush=True)
        lines += ["", *made]
    if chosen.write:
        PICTURE.write_text(curves(drawn, "parts or pages"))
        write_result(
            "growth_of_robots",
            "Growth of a robot: parts, pages, days",
            lines,
            made_by="python -m bench.growth_of_robots --write",
        )


# A day.


async def be_crowd(size: int, seconds: float, looks: int) -> dict[str, object]:
    """So many parts in this process, each saying something to the next once a second; its memory."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    collect_seldom()  # as a master does
    random, heard, hub = Random(1), [0], InprocHub()
    with tempfile.TemporaryDirectory() as name, open_registry(Path(name) / "robot.db", epoch_ns=lambda: 0) as registry:
        blueprint = ring(Path(name), size)
        store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, load_library()))
        master = Master(blueprint, store, random=random, epoch_ns=lambda: 0)
        master.add_link(hub.server)
        tasks = [asyncio.ensure_future(master.run())]
        await master.ready.wait()
        crowd = [_part(slot.name, random, heard) for slot in blueprint.slots]
        tasks += [asyncio.ensure_future(part.run_async(hub.connect(), epoch_ns=lambda: 0)) for part in crowd]
        ends_at = asyncio.get_running_loop().time() + READY_S
        while any(part.state is not JoinState.ACTIVE for part in crowd):
            if asyncio.get_running_loop().time() > ends_at:
                raise SystemExit(f"not all of {size} parts became active")
            await asyncio.sleep(0.1)
        await asyncio.sleep(5.0)
        heard[0], memory = 0, [memory_mb(os.getpid())]
        for _ in range(looks):
            await asyncio.sleep(seconds / looks)
            memory.append(memory_mb(os.getpid()))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return {"heard": heard[0], "memory_mb": memory}


def _part(name: str, random: Random, heard: list[int]) -> Part:
    part = Part(
        PART_NUMBER,
        local_name=name,
        robot=ROBOT,
        uid=random.randbytes(8),
        random=Random(random.getrandbits(64)),
    )
    count = 0

    @part.every(1.0)
    def speak() -> None:
        nonlocal count
        count += 1
        part.publish("out", HelloWorld(index=count, message=name))

    @part.on("in", HelloWorld)
    def hear(_message: HelloWorld) -> None:
        heard[0] += 1

    return part


def _in_a_process(*words: str) -> dict[str, float]:
    command = [sys.executable, "-m", "bench.growth_of_robots", *words]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def day(seconds: float) -> list[str]:
    """A robot that runs for a day."""
    found = _in_a_process("--be-day", str(seconds))
    memory = found["memory_mb"]
    assert isinstance(memory, list)
    seen = " / ".join(f"{one:.1f}" for one in memory)
    after = memory[min(WARM_LOOKS, len(memory) - 2) :]
    return [
        f"{DAYS_PARTS} parts for {seconds / 3600:g} h of virtual time, {found['heard']:,.0f} messages: memory in MB, "
        f"{len(memory)} times, {seen}. From look {len(memory) - len(after) + 1} on it changes by "
        f"{after[-1] - after[0]:+.1f} MB.",
    ]


# Pages.


@contextlib.contextmanager
def _opened(link: str, number: int) -> Iterator[None]:
    command = [sys.executable, "-m", "bench.open_pages", link, "--pages", str(number), "--seconds", "3600"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as browsers:
        try:
            time.sleep(SETTLED_S + 0.3 * number)
            yield
        finally:
            browsers.terminate()
            browsers.wait()


def _used(pid: int) -> tuple[float, float]:
    """What a demo and its recorder take, of a core."""
    before, began = usage(pid), time.monotonic()
    time.sleep(TURN_S)
    after, span_s = usage(pid), time.monotonic() - began
    return (after.master_s - before.master_s) / span_s, (after.children_s - before.children_s) / span_s


def pages(drawn: list[Curve], numbers: tuple[int, ...], turns: int) -> list[str]:
    """A demo of ten parts, with nobody looking and with pages open."""
    alone, recorder, open_share = list[float](), list[float](), {number: list[float]() for number in numbers}
    with tempfile.TemporaryDirectory() as name, running_demo(Path(name)) as (pid, link):
        time.sleep(SETTLED_S)
        for _ in range(turns):
            for found, kept in zip(_used(pid), (alone, recorder), strict=True):
                kept.append(found)
        for _ in range(turns):
            for number in numbers:
                # Pages are kept for a minute when their browsers have gone: they are in both figures.
                before = _used(pid)[0]
                with _opened(link, number):
                    open_share[number].append(_used(pid)[0] - before)
        memory = memory_mb(pid)
    first = statistics.median(open_share[numbers[0]])
    lines = [
        "| open pages of a demo of ten parts | more of a core than with nobody looking | for each further page |",
        "|---|---|---|",
    ]
    for number in numbers:
        share = statistics.median(open_share[number])
        further = f"{100 * (share - first) / (number - numbers[0]):.3f} %" if number > numbers[0] else ""
        lines.append(f"| {number} | {100 * share:.2f} % | {further} |")
    drawn.append(
        Curve(
            "pages: share of a core, %", [(number, 100 * statistics.median(open_share[number])) for number in numbers]
        )
    )
    nobody, recording = 100 * statistics.median(alone), 100 * statistics.median(recorder)
    return [
        *lines,
        "",
        f"With nobody looking: {nobody:.2f} % of a core, its recorder {recording:.2f} %; {memory:.0f} MB afterwards.",
    ]


if __name__ == "__main__":
    main()
