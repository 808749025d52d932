"""What parts that come in by the page cost: a ring of them over WebSockets, each saying ten messages a second.

    python -m bench.page_parts [--parts 30] [--seconds 20]

Master, guard and part socket are one process, all parts another one, joined by WebSockets on the loopback, in real
time. Each part hears the one before it; the time on the way is that from `publish` to the function of the next part.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import time
from random import Random

from bench.machine import describe_machine
from msbot import Text
from msbot.config import PartType, Slot
from msbot.part import Part
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot_agent.link.net import WebSocketClientLink
from tests.web.part_site import part_site

PERIOD_S = 0.1


def ring(parts: int) -> MemoryStore:
    """Slots whose part says something to the next one's."""
    return MemoryStore(
        types=tuple(PartType(f"T{n}", "a part of the ring") for n in range(parts)),
        slots=tuple(Slot(f"S{n}", f"T{n}") for n in range(parts)),
        configurations=tuple(
            Configuration(
                1,
                f"S{n}",
                (
                    SlotBinding("out", f"topic{n}", "Text", publishes=True, reliable=False),
                    SlotBinding("in", f"topic{(n - 1) % parts}", "Text", publishes=False, reliable=False),
                ),
                (),
            )
            for n in range(parts)
        ),
    )


async def play_parts(address: str, tokens: list[str], count: int, seconds: float) -> None:
    """The parts' process: prints the times on the way, in ms."""
    took: list[float] = []
    parts, active = [], 0

    def make(number: int) -> Part:
        part = Part(f"T{number}", uid=number.to_bytes(8, "big"), random=Random(number))

        @part.on_join
        def joined() -> None:
            nonlocal active
            active += 1

        @part.every(PERIOD_S)
        def speak() -> None:
            part.publish("out", Text(text=str(time.perf_counter())))

        @part.on("in", Text)
        def hear(message: Text) -> None:
            took.append(1000 * (time.perf_counter() - float(message.text)))

        return part

    async with asyncio.TaskGroup() as tasks:
        for number in range(count):
            parts.append(make(number))
            link = WebSocketClientLink(address, tokens[number % len(tokens)])
            tasks.create_task(parts[-1].run_async(link))
        while active < count:  # noqa: ASYNC110 - a loop of call-backs, nothing to wait on
            await asyncio.sleep(0.05)
        await asyncio.sleep(1.0)
        print("active", flush=True)
        took.clear()
        await asyncio.sleep(seconds)
        print(json.dumps(took), flush=True)
        for part in parts:
            part.end()


async def measure(parts: int, seconds: float) -> None:
    """The master's process."""
    async with part_site(stored=ring(parts)) as site:
        tokens = [await site.token(name) for name in ("bob", "eve", "ada")]
        command = [sys.executable, "-m", "bench.page_parts", "--address", site.address, "--tokens", ",".join(tokens)]
        process = await asyncio.create_subprocess_exec(
            *command,
            "--parts",
            str(parts),
            "--seconds",
            str(seconds),
            stdout=subprocess.PIPE,
            limit=2**24,
            env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
        )
        assert process.stdout is not None
        await process.stdout.readline()
        began, used, packets = time.perf_counter(), time.process_time(), site.link.counters.packets_in
        took = sorted(json.loads(await process.stdout.readline()))
        wall, used = time.perf_counter() - began, time.process_time() - used
        packets = site.link.counters.packets_in - packets
        await process.wait()
    share = [took[int(len(took) * part)] for part in (0.5, 0.99)]
    print(
        f"{parts} parts by the page, {len(took) / wall:.0f} messages/s arrived, {packets / wall:.0f} packets/s in: "
        f"master {100 * used / wall:.1f} % of a core; on the way {share[0]:.1f} ms (median), {share[1]:.1f} ms (p99), "
        f"{took[-1]:.1f} ms (worst)"
    )


def main() -> None:
    """Measure, or be the parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--address", help=argparse.SUPPRESS)
    parser.add_argument("--tokens", help=argparse.SUPPRESS)
    wishes = parser.parse_args()
    if wishes.address:
        asyncio.run(play_parts(wishes.address, wishes.tokens.split(","), wishes.parts, wishes.seconds))
        return
    print(describe_machine())
    print(f"load {os.getloadavg()[0]:.1f}")
    asyncio.run(measure(wishes.parts, wishes.seconds))


if __name__ == "__main__":
    main()
