"""A robot on a CAN bus of the kernel: what is lost, and what a frame costs the master.

The master is one process, all parts are another one, in a ring: each publishes, each hears its predecessor. Linux only,
on an interface that is up; where the kernel has no CAN, in a virtual machine:

    tools/run-in-vm.sh .venv/bin/python -m bench.vcan [--parts 10] [--seconds 60] [--hertz 10] [--fd]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from random import Random

from bench.crowd import PART_NUMBER, ROBOT, ring
from bench.machine import describe_machine
from msbot import HelloWorld
from msbot.config import load_library
from msbot.master import Master
from msbot.part import Part
from msbot.pnp import PartEvent, PartState
from msbot.registry import open_registry
from msbot_agent.link import open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_xrce import compress, decompress

CAN = CanSettings(codec=Codec(compress, decompress))
SETTLE_S = 1.0
"""For the samples that are on their way at the end."""
Report = dict[str, int | float | dict[str, int]]


class Speaker:
    """A part that publishes and counts."""

    def __init__(self, number: int, address: str, period_s: float) -> None:
        uid = number.to_bytes(8, "big")
        self.part = Part(PART_NUMBER, local_name=f"P{number:03}", robot=ROBOT, uid=uid, random=Random(number))
        self.link = open_link(address, can=replace(CAN, uid=uid))
        self.speaks = False
        self.heard = 0
        self.part.every(period_s)(self._speak)
        self.part.on("in", HelloWorld)(self._hear)
        self.joined = asyncio.Event()
        self.part.on_join(self.joined.set)
        self._index = 0

    def _speak(self) -> None:
        if self.speaks:
            self._index += 1
            self.part.publish("out", HelloWorld(index=self._index, message="turn-on 3"))

    def _hear(self, message: HelloWorld) -> None:  # noqa: ARG002 - it is only counted
        self.heard += 1


async def run_parts(address: str, size: int, seconds: float, hertz: float) -> Report:
    """Run the parts until so many seconds have passed since all of them were active."""
    speakers = [Speaker(number, address, 1 / hertz) for number in range(1, size + 1)]
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(speaker.part.run_async(speaker.link)) for speaker in speakers]
        for speaker in speakers:
            await speaker.joined.wait()
        await asyncio.sleep(SETTLE_S)
        sys.stdout.write("active\n")
        sys.stdout.flush()
        for speaker in speakers:
            speaker.speaks = True
        await asyncio.sleep(seconds)
        for speaker in speakers:
            speaker.speaks = False
        sys.stdout.write("done\n")
        sys.stdout.flush()
        await asyncio.sleep(SETTLE_S)
        counters = [speaker.part.counters for speaker in speakers]
        dropped: Counter[str] = Counter()
        for speaker in speakers:
            dropped.update(speaker.link.counters.dropped)
        report: Report = {
            "published": sum(one.messages_out for one in counters),
            "heard": sum(speaker.heard for speaker in speakers),
            "not sent": sum(one.not_sent for one in counters),
            "missed beats": sum(one.missed_beats for one in counters),
            "dropped": dict(dropped),
        }
        for task in running:
            task.cancel()
    return report


def sent_on(interface: str) -> int:
    """Frames that were sent on an interface, by all programs."""
    return int(Path(f"/sys/class/net/{interface}/statistics/tx_packets").read_text())


async def run_master(address: str, command: list[str], size: int) -> Report:
    """Run the master beside the parts' process; their report and its own."""
    interface = address.partition(":")[2].partition("?")[0]
    late: list[PartEvent] = []
    with tempfile.TemporaryDirectory() as folder, open_registry(Path(folder) / "robot.db") as registry:
        blueprint = ring(Path(folder), size)
        master = Master(blueprint, registry.runs.begin(registry.robots.apply_blueprint(blueprint, load_library())))
        master.inventory.on_event(lambda event: late.append(event) if event.to_state is PartState.LATE else None)
        link = open_link(address, serve=True, can=replace(CAN, profile_hash=master.profile.profile_hash()))
        master.add_link(link)
        serving = asyncio.create_task(master.run())
        try:
            await master.ready.wait()
            parts = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
            assert parts.stdout is not None
            assert await parts.stdout.readline() == b"active\n"
            frames, cpu, at = sent_on(interface), time.process_time(), time.monotonic()
            assert await parts.stdout.readline() == b"done\n"
            frames, cpu, took = sent_on(interface) - frames, time.process_time() - cpu, time.monotonic() - at
            report: Report = json.loads(await parts.stdout.read())
            await parts.wait()
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
    return report | {
        "seconds": took,
        "frames": frames,
        "master's CPU, s": cpu,
        "late parts": len(late),
        "dropped by the master": dict(link.counters.dropped),
    }


def main() -> None:
    """Run it as the options say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--interface", default="vcan0")
    parser.add_argument("--parts", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--hertz", type=float, default=10.0, help="samples a second from each part")
    parser.add_argument("--fd", action="store_true")
    parser.add_argument("--run-parts", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    address = f"can:{options.interface}?fd={int(options.fd)}"
    if options.run_parts:
        print(json.dumps(asyncio.run(run_parts(address, options.parts, options.seconds, options.hertz))))
        return
    command = [sys.executable, *sys.argv, "--run-parts"]
    report = asyncio.run(run_master(address, command, options.parts))
    print(f"{options.parts} parts on {address}, {options.hertz:g} samples/s each; {describe_machine()}")
    for name, value in report.items():
        print(f"  {name}: {value:.2f}" if isinstance(value, float) else f"  {name}: {value or 0}")
    cpu, frames = report["master's CPU, s"], report["frames"]
    assert isinstance(cpu, float)
    assert isinstance(frames, int)
    if "time-travel" in Path("/proc/cmdline").read_text():
        print("  simulated time: processor time means nothing here")
    else:
        print(f"  master's CPU for a frame: {1e6 * cpu / frames:.1f} µs")


if __name__ == "__main__":
    main()
