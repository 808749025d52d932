"""What stands between a part and its master, measured: nothing, a relay, or an agent that feeds the master.

    python -m bench.ways [--parts 10] [--rate 20] [--seconds 10] [--write]

A real `msbot master`; beside it `msbot relay` or `msbot agent --master`; real parts in a process of their own, in a
ring in which each says so many messages a second to the next one, all over UDP on the loopback. The time on the way is
that from `publish` to the function of the next part; processor time is that of the process, for each message that
arrived. `--write` puts the table into bench/results/ways.md.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from random import randbytes

from bench.machine import cpu_s, describe_machine
from bench.many_parts import PART_NUMBER, blueprint
from bench.result import write_result
from bench.scale import running, wait_for
from msbot import HelloWorld
from msbot.part import Part
from msbot_agent.link import open_link
from msbot_agent.process.user_folders import PACKAGES

MASTER, BETWEEN = "udp:127.0.0.1:9100", "udp:127.0.0.1:9101"
WAYS = {
    "the master itself": (),
    "a relay": ("relay", BETWEEN, MASTER, "--name", "bench"),
    "an agent": ("agent", "udp4", "-p", BETWEEN.rpartition(":")[2], "--master", MASTER, "--name", "bench"),
}


async def be_parts(count: int, rate: float, seconds: float, address: str) -> None:
    """The parts' process: says when all are active, and what came of the messages."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    began = time.monotonic()
    took: list[float] = []
    sent, active = 0, 0
    everybody = asyncio.Event()

    def make(number: int) -> Part:
        part = Part(PART_NUMBER, local_name=f"P{number:04}", robot="CROWD", uid=randbytes(8))

        @part.on_join
        def joined() -> None:
            nonlocal active
            active += 1
            if active == count:
                everybody.set()

        @part.every(1 / rate)
        def speak() -> None:
            nonlocal sent
            sent += 1
            part.publish("out", HelloWorld(index=0, message=str(time.perf_counter())))

        @part.on("in", HelloWorld)
        def hear(message: HelloWorld) -> None:
            took.append(time.perf_counter() - float(message.message))

        return part

    async with asyncio.TaskGroup() as tasks:
        parts = [make(number) for number in range(count)]
        for part in parts:
            tasks.create_task(part.run_async(open_link(address)))
        await everybody.wait()
        print(json.dumps({"active_s": time.monotonic() - began}), flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        took.clear()
        sent = 0
        await asyncio.sleep(seconds)
        print(json.dumps({"took": took, "sent": sent}), flush=True)
        for part in parts:
            part.end()


def measure(words: Sequence[str], count: int, rate: float, seconds: float) -> list[str]:
    """The cells of one way."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ |= {"XDG_STATE_HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
        (folder / "robot.toml").write_text(blueprint(count))
        wish = ("master", "--no-page", "--rec", "off", "--link", MASTER)
        master = stack.enter_context(running("-m", "msbot", *wish, folder=folder))
        wait_for(master, "is up on")
        processes: list[subprocess.Popen[str]] = [master]
        if words:
            processes.append(stack.enter_context(running("-m", "msbot", *words, folder=folder)))
            wait_for(processes[-1], "takes the parts of")
        me = str(Path(__file__).resolve())
        play = ("--be", f"{count},{rate},{seconds},{BETWEEN if words else MASTER}")
        parts = stack.enter_context(running(me, *play))
        active_s = json.loads(wait_for(parts, "active_s"))["active_s"]
        assert parts.stdin is not None
        parts.stdin.write("\n")
        parts.stdin.flush()
        before = [cpu_s(process.pid) for process in processes]
        told = json.loads(wait_for(parts, "took"))
        spent = [cpu_s(process.pid) - was for process, was in zip(processes, before, strict=True)]
    took = sorted(1e3 * one for one in told["took"])
    missing = max(0, told["sent"] - len(took))
    costs = [f"{one / len(took) * 1e6:.0f}" for one in spent]
    return [
        f"{active_s * 1e3:.0f}",
        f"{len(took) / seconds:.0f}",
        f"{took[len(took) // 2]:.2f}",
        f"{took[int(len(took) * 0.99)]:.2f}",
        str(missing),
        costs[1] if words else "-",
        costs[0],
    ]


def main() -> None:
    """Measure all ways, or be the parts."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--parts", type=int, default=10)
    options.add_argument("--rate", type=float, default=20.0)
    options.add_argument("--seconds", type=float, default=10.0)
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    options.add_argument("--be", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.be:
        count, rate, seconds, address = chosen.be.split(",")
        asyncio.run(be_parts(int(count), float(rate), float(seconds), address))
        return
    lines = [
        f"{describe_machine()}; load {os.getloadavg()[0]:.1f}; {chosen.parts} parts, {chosen.rate:g} messages a second "
        "each",
        "",
        "| between part and master | all active, ms | messages/s | on the way, p50 ms | p99 ms | on their way at the "
        "end | its CPU, µs a message | the master's |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, words in WAYS.items():
        cells = measure(words, chosen.parts, chosen.rate, chosen.seconds)
        lines.append(f"| {name.replace('the master itself', 'nothing')} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    if chosen.write:
        write_result("ways", "Ways between part and master", lines, made_by="python -m bench.ways --write")


if __name__ == "__main__":
    main()
