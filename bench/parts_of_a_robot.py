"""What a master spends on each message and on each part, with few parts and with many.

The master is a real `msbot master` on one core; its parts are real ones, over UDP, in a process on the other core. They
speak at times of their own, as parts on computers of their own do. First they are at rest, and the master's processor
time is that of beats; then each says something to the next, in turn seldom and often: a message costs what the master
spends more, by the messages that are more.

A neighbour of a virtual machine makes it slower for seconds at a time, by up to a half. So a probe on the master's
core, a small piece of work again and again, shows how quick the core is: turns in which it was slow do not count.
"""

from __future__ import annotations

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
from dataclasses import dataclass
from pathlib import Path
from random import Random

from bench.growth_curves import Curve
from bench.machine import cpu_s
from bench.many_parts import PART_NUMBER, Robot, blueprint
from bench.scale import memory_mb
from msbot import HelloWorld
from msbot.part import JoinState, Part
from msbot_agent.link import open_link
from msbot_agent.process.user_folders import PACKAGES

SELDOM_PER_S, OFTEN_PER_S = 200, 1000
"""Messages a second of all parts together."""
PAIRS, REST_TURNS, TURN_S = 60, 15, 1.0
"""Turns of each rate and at rest, and how long one lasts."""
PROBE_S = 0.02
"""The probe's period."""
QUIET = 1.07
"""In a turn that counts, the probe takes at most so many times as long as in the quickest quarter of all turns."""
SETTLED_S = 4.0
LONGEST_S = 120.0
MASTER_CORE, PARTS_CORE = 0, 1


@dataclass(frozen=True)
class Turn:
    """A second or so of a master."""

    cpu: float
    """Its processor time, of a core."""
    probe_us: float
    """What the probe took meanwhile."""


@dataclass(frozen=True)
class Found:
    """One run."""

    resting: list[Turn]
    pairs: list[tuple[Turn, Turn]]
    """Few messages, and many."""
    part_kb: float
    """Memory of the master for a part."""
    arrived: float
    """Part of the messages that arrived."""


async def be_parts(size: int, address: str) -> None:
    """The parts; they begin when a line is read, speak as often as the next ones say, and report after 0."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    random, loop, heard, said = Random(1), asyncio.get_running_loop(), 0, 0
    pace = 0  # which of the paces that were told is the latest

    def hear(_message: HelloWorld) -> None:
        nonlocal heard
        heard += 1

    def speak(part: Part, due: float, period_s: float, of_pace: int) -> None:
        nonlocal said
        if of_pace == pace:
            said += 1  # also what a part that has lost its robot cannot say
            if part.state is JoinState.ACTIVE:
                part.publish("out", HelloWorld(index=said, message="as a small part says it"))
            due += period_s
            loop.call_at(due, speak, part, due, period_s, pace)

    parts = [Part(PART_NUMBER, local_name=f"P{at:04}", robot="CROWD", uid=random.randbytes(8)) for at in range(size)]
    await asyncio.to_thread(sys.stdin.readline)
    async with asyncio.TaskGroup() as tasks:
        running = []
        for part in parts:
            part.on("in", HelloWorld)(hear)
            running.append(tasks.create_task(part.run_async(open_link(address))))
            await asyncio.sleep(random.expovariate(1.0) * min(0.02, 2.0 / size))
        while any(part.state is not JoinState.ACTIVE for part in parts):  # noqa: ASYNC110 - nothing says "all"
            await asyncio.sleep(0.02)
        print("active", flush=True)
        while (per_s := float(await asyncio.to_thread(sys.stdin.readline))) > 0:
            pace, period_s, now = pace + 1, size / per_s, loop.time()
            for part in parts:
                due = now + random.random() * period_s
                loop.call_at(due, speak, part, due, period_s, pace)
        pace += 1
        await asyncio.sleep(0.5)
        print(json.dumps({"said": said, "heard": heard}), flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        for task in running:
            task.cancel()


def measure(size: int, pair_count: int) -> Found:
    """A master with so many parts."""
    with _on_core(MASTER_CORE), tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(blueprint(size))
        robot = Robot(folder, page=False)
        robot.start()
        os.sched_setaffinity(robot.pid, {MASTER_CORE})
        empty_mb = memory_mb(robot.pid)
        words = [sys.executable, "-m", "bench.growth_of_robots", "--be-parts", f"{size} {robot.address}"]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parts:
            try:
                os.sched_setaffinity(parts.pid, {PARTS_CORE})
                _tell(parts)
                assert parts.stdout is not None
                if parts.stdout.readline() != "active\n":
                    raise SystemExit(f"not all of {size} parts became active")
                time.sleep(SETTLED_S)
                memory = memory_mb(robot.pid) - empty_mb
                resting = [_spent(robot.pid) for _ in range(REST_TURNS)]
                pairs = []
                for at in range(pair_count):
                    spent = {}
                    for per_s in (SELDOM_PER_S, OFTEN_PER_S)[:: -1 if at % 2 else 1]:
                        _tell(parts, per_s)
                        time.sleep(0.2)
                        spent[per_s] = _spent(robot.pid)
                    pairs.append((spent[SELDOM_PER_S], spent[OFTEN_PER_S]))
                _tell(parts)
                count = json.loads(parts.stdout.readline())
                _tell(parts)
            finally:
                parts.kill()
                robot.kill()
    return Found(resting, pairs, part_kb=1024 * memory / size, arrived=count["heard"] / count["said"])


@contextlib.contextmanager
def _on_core(core: int) -> Iterator[None]:
    """This process and what it starts, as long as the block lasts."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _tell(parts: subprocess.Popen[str], number: int = 0) -> None:
    assert parts.stdin is not None
    parts.stdin.write(f"{number}\n")
    parts.stdin.flush()


def _spent(pid: int) -> Turn:
    """A turn of a process, and of the probe."""
    before, began, probes = cpu_s(pid), time.monotonic(), list[float]()
    while time.monotonic() - began < TURN_S:
        time.sleep(PROBE_S)
        at = time.thread_time()
        _probe()
        probes.append(time.thread_time() - at)
    return Turn((cpu_s(pid) - before) / (time.monotonic() - began), 1e6 * statistics.mean(probes))


def _probe() -> None:
    kept: dict[int, str] = {}
    for number in range(1500):
        kept[number % 997] = str(number)


def table(drawn: list[Curve], numbers: tuple[int, ...], rounds: int, pair_count: int = PAIRS) -> list[str]:
    """More and more parts of one robot."""
    runs: dict[int, list[Found]] = {number: [] for number in numbers}
    for turn in range(rounds):
        for number in numbers[:: -1 if turn % 2 else 1]:
            runs[number].append(measure(number, pair_count))
    probes = [
        turn.probe_us for of in runs.values() for one in of for turns in (one.resting, *one.pairs) for turn in turns
    ]
    usual_us = statistics.quantiles(probes, n=4)[0]
    costs, memory = {}, {}
    lines = [
        "| parts of one robot over UDP | master's CPU µs for one more message | middle half of the pairs "
        "| pairs that count | µs a second for a part at rest | memory of the master for a part | arrived |",
        "|---|---|---|---|---|---|---|",
    ]
    for number, of in runs.items():
        all_pairs = [pair for one in of for pair in one.pairs]
        quiet = [pair for pair in all_pairs if _are_quiet(pair, usual_us)]
        if len(quiet) < 2:
            raise SystemExit(f"{number} parts: the machine was never quiet for two turns: take the table again later")
        more = [1e6 * (often.cpu - seldom.cpu) / (OFTEN_PER_S - SELDOM_PER_S) for seldom, often in quiet]
        low, costs[number], high = statistics.quantiles(more, n=4)
        memory[number] = statistics.median(one.part_kb for one in of)
        at_rest = 1e6 * statistics.median(turn.cpu for one in of for turn in one.resting) / number
        arrived = statistics.median(one.arrived for one in of)
        lines.append(
            f"| {number:,} | {costs[number]:.0f} | {low:.0f} to {high:.0f} | {len(quiet)} of {len(all_pairs)} "
            f"| {at_rest:.0f} | {memory[number]:.0f} kB | {arrived:.1%} |"
        )
    middle = statistics.median(costs.values())
    drawn.append(Curve("parts: the master's CPU of a message, µs", list(costs.items())))
    drawn.append(Curve("parts: the master's memory for each, kB", list(memory.items())))
    return [
        *lines,
        "",
        f"{SELDOM_PER_S} and {OFTEN_PER_S:,} messages a second of all parts together, in pairs of turns of "
        f"{TURN_S:g} s; a pair counts when the core was quiet. Medians. From the message in the middle, "
        f"{middle:.0f} µs, they differ by {100 * (min(costs.values()) / middle - 1):+.0f}% "
        f"to {100 * (max(costs.values()) / middle - 1):+.0f}%.",
    ]


def _are_quiet(turns: tuple[Turn, ...], usual_us: float) -> bool:
    return all(turn.probe_us <= QUIET * usual_us for turn in turns)
