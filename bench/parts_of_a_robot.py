"""What a master spends on each message and on each part, with few parts and with many.

The master is a real `msbot master` on one core; its parts are real ones, over UDP, in a process on the other core. They
speak at times of their own, as parts on computers of their own do. First they are at rest, and the master's processor
time is that of beats; then each says something to the next, in turn seldom and often: a message costs what the master
spends more, by the messages that are more.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import statistics
import subprocess
import sys
import tempfile
import time
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
REST_S = 10.0
PAIRS, TURN_S = 5, 3.0
"""Turns of each rate, and how long one lasts."""
SETTLED_S = 4.0
LONGEST_S = 120.0
MASTER_CORE, PARTS_CORE = 0, 1


@dataclass(frozen=True)
class Found:
    """One run."""

    message_us: float
    """The master's processor time for one more message."""
    part_us: float
    """That for a part at rest, in a second."""
    part_kb: float
    """Memory of the master for a part."""
    arrived: float
    """Part of the messages that arrived."""


async def be_parts(size: int, address: str) -> None:
    """The parts; they begin when a line is read, speak as often as the next ones say, and report after 0."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    random, loop, heard, said = Random(1), asyncio.get_running_loop(), 0, 0
    period_s = 0.0

    def hear(_message: HelloWorld) -> None:
        nonlocal heard
        heard += 1

    def speak(part: Part, due: float, period: float) -> None:
        nonlocal said
        if period == period_s:
            said += 1  # also what a part that has lost its robot cannot say
            if part.state is JoinState.ACTIVE:
                part.publish("out", HelloWorld(index=said, message="as a small part says it"))
            due += period
            loop.call_at(due, speak, part, due, period)

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
            period_s, now = size / per_s, loop.time()
            for part in parts:
                due = now + random.random() * period_s
                loop.call_at(due, speak, part, due, period_s)
        period_s = 0.0
        await asyncio.sleep(0.5)
        print(json.dumps({"said": said, "heard": heard}), flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        for task in running:
            task.cancel()


def measure(size: int) -> Found:
    """A master with so many parts."""
    with tempfile.TemporaryDirectory() as name:
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
                rest = _spent(robot.pid, REST_S)
                spent: dict[int, list[float]] = {SELDOM_PER_S: [], OFTEN_PER_S: []}
                for per_s in (SELDOM_PER_S, OFTEN_PER_S) * PAIRS:
                    _tell(parts, per_s)
                    time.sleep(0.3)
                    spent[per_s].append(_spent(robot.pid, TURN_S))
                _tell(parts)
                count = json.loads(parts.stdout.readline())
                _tell(parts)
            finally:
                parts.kill()
                robot.kill()
    more = [often - seldom for seldom, often in zip(spent[SELDOM_PER_S], spent[OFTEN_PER_S], strict=True)]
    return Found(
        message_us=1e6 * statistics.median(more) / (OFTEN_PER_S - SELDOM_PER_S),
        part_us=1e6 * rest / size,
        part_kb=1024 * memory / size,
        arrived=count["heard"] / count["said"],
    )


def _tell(parts: subprocess.Popen[str], number: int = 0) -> None:
    assert parts.stdin is not None
    parts.stdin.write(f"{number}\n")
    parts.stdin.flush()


def _spent(pid: int, seconds: float) -> float:
    """Processor time of a process for each second that passes."""
    before, began = cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(pid) - before) / (time.monotonic() - began)


def table(drawn: list[Curve], numbers: tuple[int, ...], turns: int) -> list[str]:
    """More and more parts of one robot."""
    rounds: list[dict[int, Found]] = []
    for turn in range(turns):
        rounds.append({number: measure(number) for number in numbers[:: -1 if turn % 2 else 1]})
    # Of each turn its ratio to the mean of its round counts: how busy the machine is falls on all rows.
    means = [statistics.mean(one.message_us for one in found.values()) for found in rounds]
    usual = statistics.median(means)
    costs, memory = {}, {}
    lines = [
        "| parts of one robot over UDP | master's CPU µs for one more message "
        "| µs a second for a part at rest | memory of the master for a part | arrived |",
        "|---|---|---|---|---|",
    ]
    for number in numbers:
        of = [found[number] for found in rounds]
        costs[number] = statistics.median(usual * one.message_us / mean for one, mean in zip(of, means, strict=True))
        memory[number] = statistics.median(one.part_kb for one in of)
        at_rest = statistics.median(one.part_us for one in of)
        arrived = statistics.median(one.arrived for one in of)
        lines.append(f"| {number:,} | {costs[number]:.0f} | {at_rest:.0f} | {memory[number]:.0f} kB | {arrived:.1%} |")
    middle = statistics.median(costs.values())
    drawn.append(Curve("parts: the master's CPU of a message, µs", list(costs.items())))
    drawn.append(Curve("parts: the master's memory for each, kB", list(memory.items())))
    return [
        *lines,
        "",
        f"Median of {turns}. From the message in the middle, {middle:.0f} µs, they differ by "
        f"{100 * (min(costs.values()) / middle - 1):+.0f}% to {100 * (max(costs.values()) / middle - 1):+.0f}%.",
    ]
