"""What the data spaces over DDS and Zenoh cost, beside the one in memory and beside Cyclone's own `ddsperf`.

    python -m bench.dds [--quick] [--write]

Runs in a network namespace of its own with nothing in it but the loopback interface (needs root, `unshare`, `ip`);
needs libddsc, gcc for the load generator of `bench/agent.py`, and Debian's cyclonedds-tools for ddsperf. `--write` puts
the tables into bench/results/data_space.md.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from bench.agent import LOADS, build_generator, run
from bench.machine import describe_machine
from bench.result import write_result
from msbot_agent.space import MemorySpace, Qos, Sample, Space, Topic, open_space, parse_space
from msbot_agent.space.dds import DdsSpace
from msbot_agent.space.dds.dds_writer import DdsWriter

INSIDE = "MSBOT_BENCH_DDS_INSIDE"
TOPIC, BACK = Topic("bench", "Bench"), Topic("bench_back", "Bench")
PAYLOAD = bytes(64)
BATCH = 64
GENUINE = {"best effort 1 -> 1, in flight 8": 68_407, "reliable, in flight 16": 42_995}
"""Samples a second of eProsima's agent 2.4.2 with its DDS middleware, same generator, a like machine, once."""
PERF_URI = '<General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>'


def main() -> None:
    """Go into a namespace and print all tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="one run instead of three")
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    options.add_argument("--echo", choices=("dds", "zenoh"), help=argparse.SUPPRESS)
    options.add_argument("--count", action="store_true", help=argparse.SUPPRESS)
    options.add_argument("--best-effort", action="store_true", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.echo:
        asyncio.run(echo(chosen.echo))
        return
    if chosen.count:
        asyncio.run(count(reliable=not chosen.best_effort))
        return
    if INSIDE not in os.environ:
        enter()
    runs = 1 if chosen.quick else 3
    lines = [f"{describe_machine()}; load {os.getloadavg()[0]:.1f}; median of {runs} run(s), in brackets the range", ""]
    lines += costs(runs)
    lines += ["", *between_processes(runs)]
    lines += ["", *over_zenoh(runs)]
    lines += ["", *agents(runs)]
    print("\n".join(lines))
    if chosen.write:
        title = "Memory, DDS and Zenoh as data spaces"
        write_result("data_space", title, lines, made_by="python -m bench.dds --write")


def enter() -> None:
    """Run again where there is no network but lo."""
    command = 'ip link set lo up && exec "$@"'
    os.environ[INSIDE] = "1"
    os.execvp("unshare", ["unshare", "-n", "sh", "-c", command, "sh", sys.executable, *sys.argv])


def said(values: list[float], form: str = ",.1f") -> str:
    """`median (least - most)`."""
    return f"{statistics.median(values):{form}} ({min(values):{form}} - {max(values):{form}})"


# One call.


def costs(runs: int) -> list[str]:
    """Writing and taking, in one process."""
    found = [asyncio.run(one_call(MemorySpace())) for _ in range(runs)], [asyncio.run(in_dds()) for _ in range(runs)]
    memory, dds = found
    names = (
        "write, nobody reads",
        "write, one reader in this process",
        "write, one reader in another process",
        "take and deliver, a batch of 64",
    )
    lines = ["| µs a sample of 64 bytes | in memory | over DDS |", "|---|---|---|"]
    for name in names:
        cells = [said([one[name] for one in many], ".2f") if name in many[0] else "-" for many in (memory, dds)]
        lines.append(f"| {name} | {cells[0]} | {cells[1]} |")
    return lines


async def one_call(space: Space) -> dict[str, float]:
    """What a write costs in any space."""
    writer = space.writer(TOPIC, Qos(depth=BATCH), bytes(16))
    alone = timed(lambda: writer.write(PAYLOAD))
    space.reader(TOPIC, Qos(depth=BATCH), lambda _sample: True)
    return {"write, nobody reads": alone, "write, one reader in this process": timed(lambda: writer.write(PAYLOAD))}


def timed(call: Callable[[], object], times: int = 20_000) -> float:
    """Microseconds a call."""
    started = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - started) / times * 1e6


async def in_dds() -> dict[str, float]:
    """What a write and a take cost over DDS."""
    with DdsSpace(0) as space:
        found = await one_call(space)
    with DdsSpace(0) as space:
        writer: Any = space.writer(TOPIC, Qos(reliable=False, depth=BATCH), bytes(16))
        with Counting(reliable=False):
            await until_read(writer)
            found["write, one reader in another process"] = timed(lambda: writer.write(PAYLOAD))
    with DdsSpace(1) as here, DdsSpace(1) as there:
        reader: Any = there.reader(TOPIC, Qos(depth=BATCH), lambda _sample: True)
        writer = here.writer(TOPIC, Qos(depth=BATCH), bytes(16))
        await until_read(writer)
        inlet, spent = reader.inlets[0], 0.0
        for _ in range(200):
            for _ in range(BATCH):
                writer.write(PAYLOAD)
            started = time.perf_counter()
            inlet.take()
            spent += time.perf_counter() - started
        found["take and deliver, a batch of 64"] = spent / 200 / BATCH * 1e6
    return found


async def until_read(writer: DdsWriter) -> None:
    """Wait for a reader in another process."""
    while not writer.outlets[0].has_readers:  # noqa: ASYNC110 - it is told to nobody
        await asyncio.sleep(0.01)


async def until_room(writer: DdsWriter, most: int) -> None:
    """Wait until no more samples than that wait for a slow peer."""
    while writer.outlets[0].waiting > most:  # noqa: ASYNC110 - it is told to nobody
        await asyncio.sleep(0.001)


# Between processes.


def between_processes(runs: int) -> list[str]:
    """Round trips and throughput to another process, ours and ddsperf's."""
    lines = ["| 64 bytes, two processes | over DDS | ddsperf (C) | in memory, one process |", "|---|---|---|---|"]
    trips = [asyncio.run(round_trips()) for _ in range(runs)]
    memory = asyncio.run(memory_trips())
    perf = perf_trips()
    lines.append(f"| round trip, p50 µs | {said([one[0] for one in trips], '.0f')} | {perf[0]} | {memory:.1f} |")
    lines.append(f"| round trip, p99 µs | {said([one[1] for one in trips], '.0f')} | {perf[1]} | - |")
    for reliable, words in ((True, "reliable"), (False, "best effort")):
        rates = [asyncio.run(throughput(reliable=reliable)) for _ in range(runs)]
        sent, got = [one[0] for one in rates], [one[1] for one in rates]
        lost = sum(one[2] for one in rates)
        lines.append(
            f"| {words}: samples written a second | {said(sent, ',.0f')} | {perf_rate(reliable=reliable)} "
            f"| {1e6 / memory_write():,.0f} |"
        )
        lines.append(f"| ... received a second; lost in all | {said(got, ',.0f')}; {lost} | | |")
    return lines


class Counting:
    """Another process that counts what it receives."""

    def __init__(self, *, reliable: bool) -> None:
        wish = [] if reliable else ["--best-effort"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bench.dds", "--count", *wish],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Counting:
        assert self._process.stdout is not None
        self._process.stdout.readline()
        return self

    def __exit__(self, *_: object) -> None:
        self.result()

    def result(self) -> dict[str, float]:
        """End it: how many came, in which time."""
        if self._process.poll() is None:
            output, _ = self._process.communicate()
            self._said = json.loads(output or "{}")
        return self._said  # type: ignore[no-any-return]


async def count(*, reliable: bool) -> None:
    """The counting process."""
    state = {"count": 0, "first": 0.0, "last": 0.0}

    def deliver(_sample: Sample) -> bool:
        state["last"] = time.perf_counter()
        state["first"] = state["first"] or state["last"]
        state["count"] += 1
        return True

    with DdsSpace() as space:
        space.reader(TOPIC, Qos(reliable=reliable, keep_all=reliable, depth=4096), deliver)
        print("ready", flush=True)
        await asyncio.to_thread(sys.stdin.read)
        await asyncio.sleep(0.3)
        print(json.dumps(state), flush=True)


async def throughput(*, reliable: bool, seconds: float = 2.0) -> tuple[float, float, int]:
    """Samples written and received a second, and how many were lost."""
    with DdsSpace() as space:
        writer: Any = space.writer(TOPIC, Qos(reliable=reliable, keep_all=reliable, depth=4096), bytes(16))
        with Counting(reliable=reliable) as other:
            await until_read(writer)
            sent, started = 0, time.perf_counter()
            while time.perf_counter() - started < seconds:
                for _ in range(BATCH):
                    writer.write(PAYLOAD)
                sent += BATCH
                await until_room(writer, 1024)
            took = time.perf_counter() - started
            await until_room(writer, 0)
            state = await asyncio.to_thread(other.result)
    span = max(state["last"] - state["first"], 1e-9)
    return sent / took, state["count"] / span, int(sent - state["count"])


async def echo(kind: str) -> None:
    """The echoing process."""
    with open_space(parse_space(kind)) as space:
        writer = space.writer(BACK, Qos(depth=1), bytes(15) + b"\1")
        space.reader(TOPIC, Qos(depth=1), lambda sample: writer.write(sample.payload) > 0)
        print("ready", flush=True)
        await asyncio.to_thread(sys.stdin.read)


async def round_trips(kind: str = "dds", times: int = 3000) -> tuple[float, float]:
    """p50 and p99 of a round trip to another process, in µs."""
    process = subprocess.Popen(  # noqa: ASYNC220 - before anything is measured
        [sys.executable, "-m", "bench.dds", "--echo", kind], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        with open_space(parse_space(kind)) as space:
            taken: list[float] = []
            done = asyncio.Event()
            started = 0.0

            def deliver(_sample: Sample) -> bool:
                nonlocal started
                now = time.perf_counter()
                taken.append(now - started)
                if len(taken) < times:
                    started = time.perf_counter()
                    writer.write(PAYLOAD)
                else:
                    done.set()
                return True

            writer = space.writer(TOPIC, Qos(depth=1), bytes(16))
            space.reader(BACK, Qos(depth=1), deliver)
            while not taken:
                started = time.perf_counter()
                writer.write(PAYLOAD)
                await asyncio.sleep(0.1)
            await done.wait()
    finally:
        process.communicate()
    taken = sorted(taken[100:])
    return taken[len(taken) // 2] * 1e6, taken[len(taken) * 99 // 100] * 1e6


async def memory_trips() -> float:
    """The same within a space in memory."""
    space = MemorySpace()
    back = space.writer(BACK, Qos(depth=1), bytes(15) + b"\1")
    space.reader(TOPIC, Qos(depth=1), lambda sample: back.write(sample.payload) > 0)
    space.reader(BACK, Qos(depth=1), lambda _sample: True)
    writer = space.writer(TOPIC, Qos(depth=1), bytes(16))
    return timed(lambda: writer.write(PAYLOAD))


def memory_write() -> float:
    """A write to one reader in memory, in µs."""
    return asyncio.run(one_call(MemorySpace()))["write, one reader in this process"]


def perf(*arguments: str) -> str:
    """What ddsperf says; its output is empty where it is not installed."""
    if shutil.which("ddsperf") is None:
        return ""
    environment = {**os.environ, "CYCLONEDDS_URI": PERF_URI}
    done = subprocess.run(["ddsperf", *arguments], env=environment, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def perf_with(other: list[str], *arguments: str) -> str:
    """What a second ddsperf beside it says."""
    if shutil.which("ddsperf") is None:
        return ""
    environment = {**os.environ, "CYCLONEDDS_URI": PERF_URI}
    with subprocess.Popen(["ddsperf", "-D", "6", *other], env=environment, stdout=subprocess.DEVNULL) as beside:
        output = perf("-D", "4", *arguments)
        beside.terminate()
    return output


def perf_trips() -> tuple[str, str]:
    """p50 and p99 of ddsperf's round trips in µs; it tells half of them."""
    found = re.findall(r"50% ([\d.]+)us.*?99% ([\d.]+)us", perf_with(["pong"], "ping", "size", "64"))
    if not found:
        return "-", "-"
    p50, p99 = found[-1]
    return f"{2 * float(p50):.0f}", f"{2 * float(p99):.0f}"


def perf_rate(*, reliable: bool) -> str:
    """Samples a second that ddsperf receives; it puts many into a packet."""
    wish = [] if reliable else ["-u"]
    found = re.findall(r"rate ([\d.]+) kS/s", perf_with([*wish, "pub", "size", "64"], *wish, "sub"))
    return f"{float(found[-1]) * 1000:,.0f}" if found else "-"


# Zenoh.


def over_zenoh(runs: int) -> list[str]:
    """Round trips and a write by way of a router in a process of its own, in turns with DDS."""
    with subprocess.Popen(
        [sys.executable, "-m", "msbot", "router"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as router:
        try:
            assert router.stdout is not None
            router.stdout.readline()
            trips: dict[str, list[tuple[float, float]]] = {"dds": [], "zenoh": []}
            for _ in range(runs):
                for kind, found in trips.items():
                    found.append(asyncio.run(round_trips(kind)))
            writes = [asyncio.run(zenoh_write()) for _ in range(runs)]
        finally:
            router.terminate()
    lines = ["| 64 bytes, in turns | over DDS | over Zenoh, by a router | ratio |", "|---|---|---|---|"]
    for index, name in enumerate(("p50", "p99")):
        dds, zenoh = ([one[index] for one in trips[kind]] for kind in ("dds", "zenoh"))
        ratio = statistics.median(zenoh) / statistics.median(dds)
        lines.append(f"| round trip, {name} µs | {said(dds, '.0f')} | {said(zenoh, '.0f')} | {ratio:.1f} |")
    lines.append(f"| write, one reader elsewhere, µs | see above | {said(writes, '.2f')} | |")
    return lines


async def zenoh_write() -> float:
    """What a write to a reader behind the router costs."""
    with open_space(parse_space("zenoh")) as here, open_space(parse_space("zenoh")) as there:
        there.reader(TOPIC, Qos(reliable=False, depth=BATCH), lambda _sample: True)
        writer: Any = here.writer(TOPIC, Qos(reliable=False, depth=BATCH), bytes(16))
        while not writer.outlets[0].is_wanted:  # noqa: ASYNC110 - it is told to nobody
            await asyncio.sleep(0.01)
        return timed(lambda: writer.write(PAYLOAD))


# The agent.


def agents(runs: int) -> list[str]:
    """XRCE clients at an agent in memory and at one on DDS, in turns."""
    generator = build_generator()
    lines = [
        "| XRCE clients at one agent, samples a second | in memory | over DDS | eProsima's agent with DDS | ratio |",
        "|---|---|---|---|---|",
    ]
    for load in LOADS:
        if load.name not in GENUINE:
            continue
        memory, dds = [], []
        for _ in range(runs):
            memory.append(run(generator, load, 2)[load.rate_key])
            dds.append(run(generator, load, 2, "--space", "dds")[load.rate_key])
        peer = GENUINE[load.name]
        lines.append(
            f"| {load.name} | {said(memory, ',.0f')} | {said(dds, ',.0f')} | {peer:,} "
            f"| {statistics.median(dds) / peer:.2f} |"
        )
    return lines


if __name__ == "__main__":
    main()
