"""What a thousand robots with ten parts each cost: a few robots for real, then one database and one router for all.

    python -m bench.scale [--robots 1000] [--write]

Some samples, in a network namespace of its own with nothing in it but the loopback interface (needs root, `unshare`,
`ip`), within five minutes:

* robots: a few real masters (`msbot master --space zenoh`) with ten real parts each; time and memory of a master at
  rest, with the spread between them.
* database: so many robots in one SQLite file, and in one PostgreSQL server if there is one (Debian's postgresql), and
  the changes of state of all their parts when all are switched on.
* DDS: more and more programs in one domain, each with the topics of a robot, until each knows all others.
* router: a real `msbot router`; a few processes have the writers of so many robots, and one program reads them all.

`--write` puts the tables into bench/results/scale.md.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import LiteralString

import psycopg

from bench.dds import enter
from bench.machine import cpu_s, describe_machine
from bench.many_parts import PART_NUMBER, be_parts, blueprint
from bench.result import write_result
from msbot.config import load_library, parse_blueprint
from msbot.pnp import PartEvent, PartState
from msbot.registry import open_registry
from msbot_agent.space import Qos, Topic
from msbot_agent.space.dds import DdsSpace
from msbot_agent.space.zenoh import ZenohSpace
from tests.registry.postgres import find_server, running_server

INSIDE = "MSBOT_BENCH_DDS_INSIDE"
HERE = "tcp/127.0.0.1:7447"
PARTS = 10
SAMPLED = 3
REST_S = 10.0
PATIENCE_S = 60.0
SETTLED_S = 120.0
IDLE = 0.1
"""A router that uses less of a core has dealt with all that was made; it is waited for so long."""
SIZE = "SELECT pg_database_size(current_database())"
PARTICIPANTS = (5, 10, 20, 40)
HOSTS = 4
"""Processes that stand for the sites."""
PAYLOAD = bytes(64)


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--robots", type=int, default=1000)
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    options.add_argument("--parts", help=argparse.SUPPRESS)
    options.add_argument("--site", help=argparse.SUPPRESS)
    options.add_argument("--participant", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.parts:
        asyncio.run(be_parts(0, PARTS, chosen.parts, 0))
    elif chosen.site:
        asyncio.run(be_site(*map(int, chosen.site.split(":"))))
    elif chosen.participant:
        asyncio.run(be_participant(*map(int, chosen.participant.split(":"))))
    else:
        if INSIDE not in os.environ:
            enter()
        with tempfile.TemporaryDirectory() as folder:
            os.environ |= {"XDG_STATE_HOME": folder, "XDG_RUNTIME_DIR": folder}
            lines = [f"{describe_machine()}; load {os.getloadavg()[0]:.1f}"]
            for table in (
                partial(robots, Path(folder)),
                partial(database, Path(folder), chosen.robots),
                neighbours,
                partial(router, chosen.robots),
            ):
                made = ["", *table()]
                print("\n".join(made), flush=True)
                lines += made
        if chosen.write:
            write_result("scale", "From one robot to a thousand", lines, made_by="python -m bench.scale --write")


def memory_mb(pid: int, what: str = "Pss") -> float:
    """Memory of a process in MB: what it shares counted by its share (Pss), or in full (Rss)."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return next(int(line.split()[1]) for line in text.splitlines() if line.startswith(f"{what}:")) / 1024


@contextlib.contextmanager
def running(*command: str, folder: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """A process of this bench, ended with the block."""
    with subprocess.Popen(
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()
            process.communicate()


def wait_for(process: subprocess.Popen[str], words: str) -> str:
    """The next line with these words."""
    assert process.stdout is not None
    for line in process.stdout:
        if words in line:
            return line
    raise RuntimeError(f"it ended without {words!r}")


# Robots.


def robots(folder: Path) -> list[str]:
    """A few masters with their parts, at rest."""
    with contextlib.ExitStack() as stack:
        masters = []
        for number in range(SAMPLED):
            (folder / str(number)).mkdir()
            file = folder / str(number) / "robot.toml"
            file.write_text(blueprint(PARTS).replace("C-0001", f"C-{number}"))
            address = f"udp:127.0.0.1:{9000 + number}"
            wish = ("--no-page", "--rec", "off", "--space", "zenoh", "--link", address)
            master = stack.enter_context(running("-m", "msbot", "master", *wish, folder=file.parent))
            wait_for(master, "is up on")
            parts = stack.enter_context(running(str(Path(__file__).resolve()), "--parts", address))
            assert parts.stdin is not None
            parts.stdin.write("\n")
            parts.stdin.flush()
            wait_for(parts, f'"active": {PARTS}')
            masters.append(master)
        before = [cpu_s(master.pid) for master in masters]
        started = time.monotonic()
        time.sleep(REST_S)
        spent = time.monotonic() - started
        load = [(cpu_s(master.pid) - was) / spent * 100 for master, was in zip(masters, before, strict=True)]
        memory = [memory_mb(master.pid) for master in masters]
    return [
        f"| one robot of {PARTS} parts at rest ({SAMPLED} of them, least to most) | |",
        "|---|---|",
        f"| its master, of a core | {min(load):.2f} to {max(load):.2f} % |",
        f"| its master, memory (shared pages by their share) | {min(memory):.0f} to {max(memory):.0f} MB |",
    ]


# The database.


def database(folder: Path, number: int) -> list[str]:
    """So many robots in one database, all switched on."""
    file = folder / "school.db"
    columns = [("one SQLite file", *fill(str(file), number), file.stat().st_size)]
    programs = find_server()
    if programs is not None:
        with running_server(programs, durable=True) as address:
            ask(address.format("postgres"), "CREATE DATABASE school")
            where = address.format("school")
            open_registry(where).close()
            empty = ask(where, SIZE)
            found = fill(where, number)
            columns.append(("one PostgreSQL", *found, ask(where, SIZE) - empty))
    changes = 3 * PARTS * number
    rows = [
        [f"{number:,} robots of {PARTS} parts"],
        ["a blueprint put into force, the first 20 / the last 20"],
        ["for each robot"],
        ["a change of state, kept (one writer)"],
        [f"all robots switched on at once: {changes:,} changes by one writer"],
    ]
    for name, applied, journal, size in columns:
        edges = statistics.median(applied[:20]) * 1e3, statistics.median(applied[-20:]) * 1e3
        cells = (
            name,
            f"{edges[0]:.1f} / {edges[1]:.1f} ms",
            f"{size / number / 1024:.1f} kB",
            f"{journal * 1e6:.0f} µs, {1 / journal:,.0f} a second",
            f"{changes * journal:.1f} s",
        )
        for row, cell in zip(rows, cells, strict=True):
            row.append(cell)
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def ask(where: str, question: LiteralString) -> int:
    """One question to the server; its answer is a number, or there is none."""
    with psycopg.connect(where, autocommit=True) as connection:
        cursor = connection.execute(question)
        row = cursor.fetchone() if cursor.description else None
        return 0 if row is None else int(row[0])


def fill(where: str, number: int) -> tuple[list[float], float]:
    """How long each robot took to be put into force, and a change of state to be kept."""
    library = load_library()
    sample = parse_blueprint(blueprint(PARTS), library)
    applied = []
    count = 2000
    with open_registry(where) as registry:
        for index in range(number):
            robot = replace(sample.robot, name=f"R{index}", serial_number=f"S-{index}")
            started = time.perf_counter()
            registry.robots.apply_blueprint(replace(sample, robot=robot), library)
            applied.append(time.perf_counter() - started)
        first = registry.robots.find(replace(sample, robot=replace(sample.robot, name="R0", serial_number="S-0")))
        assert first is not None
        store = registry.runs.begin(first)
        started = time.perf_counter()
        for index in range(count):
            part = index % PARTS
            state = PartState.ACTIVE if index // PARTS % 2 else PartState.LATE
            store.journal(
                PartEvent(
                    float(index),
                    f"P{part:04}",
                    f"P{part:04}",
                    None,
                    state,
                    "its beats",
                    part_number=PART_NUMBER,
                    local_name=f"P{part:04}",
                    uid=part.to_bytes(8),
                    client_key=part + 1,
                )
            )
            if index % PARTS == PARTS - 1:  # what one robot writes together
                registry.storage.flush()
        journal = (time.perf_counter() - started) / count
        kept = len(list(registry.robots.journal(count, robot=first)))
    assert kept >= count, f"{kept} changes were kept"
    return applied, journal


# Programs in one DDS domain.


async def be_participant(number: int, others: int) -> None:
    """A robot's topics, once it is told to; says when it knows those of all others."""
    print("loaded", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    with DdsSpace(42, partition=f"robots/R{number}") as space:
        for part in range(PARTS):
            space.writer(Topic(f"part_{part}", "Level"), Qos(depth=16), (number * PARTS + part).to_bytes(16))
        while space.neighbours < others * PARTS:  # noqa: ASYNC110 - discovery calls nobody
            await asyncio.sleep(0.05)
        print("knows all", flush=True)
        await asyncio.to_thread(sys.stdin.readline)


def neighbours() -> list[str]:
    """More and more programs in one domain."""
    lines = [
        f"| programs in one DDS domain, {PARTS} topics each | all know all after | memory of one | at rest, of a core, "
        "all together |",
        "|---|---|---|---|",
    ]
    me = str(Path(__file__).resolve())
    for number in PARTICIPANTS:
        with contextlib.ExitStack() as stack:
            programs = [
                stack.enter_context(running(me, "--participant", f"{index}:{number - 1}")) for index in range(number)
            ]
            for program in programs:
                wait_for(program, "loaded")
            started = time.perf_counter()
            for program in programs:
                assert program.stdin is not None
                program.stdin.write("\n")
                program.stdin.flush()
            for program in programs:
                wait_for(program, "knows all")
            took = time.perf_counter() - started
            before, began = sum(cpu_s(program.pid) for program in programs), time.perf_counter()
            time.sleep(REST_S)
            load = (sum(cpu_s(program.pid) for program in programs) - before) / (time.perf_counter() - began)
            memory = statistics.median(memory_mb(program.pid) for program in programs)
        lines.append(f"| {number} | {took:.1f} s | {memory:.0f} MB | {load * 100:.1f} % |")
    return lines


# The router.


async def be_site(first: int, count: int) -> None:
    """The writers of some robots; writes one sample of each a second when told to."""
    with ZenohSpace([HERE]) as space:
        writers = [
            space.writer(Topic(f"part_{part}", "Level"), Qos(depth=16, partitions=(f"R{robot}",)), os.urandom(16))
            for robot in range(first, first + count)
            for part in range(PARTS)
        ]
        while not writers[-1].outlets[0]._declared:  # type: ignore[attr-defined]  # noqa: ASYNC110
            await asyncio.sleep(0.05)
        for writer in writers:
            writer.outlets[0].is_wanted = True  # type: ignore[attr-defined]
        print("ready", flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        loop = asyncio.get_running_loop()
        due = loop.time()
        for index in range(10 * len(writers)):
            writers[index % len(writers)].write(PAYLOAD)
            due += 1 / len(writers)
            if index % 20 == 19:
                await asyncio.sleep(max(0.0, due - loop.time()))
        print("done", flush=True)
        await asyncio.to_thread(sys.stdin.readline)


def router(number: int) -> list[str]:
    """One router and the topics of so many robots."""
    from msbot_agent.space.zenoh.zenoh_library import load, session_config

    with contextlib.ExitStack() as stack:
        process = stack.enter_context(running("-m", "msbot", "router"))
        wait_for(process, "router at")
        empty = memory_mb(process.pid)
        got = 0

        def count(_sample: object) -> None:
            nonlocal got
            got += 1

        reader = stack.enter_context(load().open(session_config("client", connect=[HERE])))
        everything = reader.declare_subscriber("msbot/**", load().handlers.Callback(count, indirect=False))
        started = time.perf_counter()
        each = number // HOSTS
        sites = [
            stack.enter_context(running(str(Path(__file__).resolve()), "--site", f"{host * each}:{each}"))
            for host in range(HOSTS)
        ]
        for site in sites:
            wait_for(site, "ready")
        known = time.perf_counter() - started
        while time.perf_counter() - started < SETTLED_S:
            busy = cpu_s(process.pid)
            time.sleep(1)
            if cpu_s(process.pid) - busy < IDLE:
                break
        settled = time.perf_counter() - started
        full, before, began = memory_mb(process.pid), cpu_s(process.pid), time.perf_counter()
        for site in sites:
            assert site.stdin is not None
            site.stdin.write("\n")
            site.stdin.flush()
        for site in sites:
            wait_for(site, "done")
        took, spent = time.perf_counter() - began, cpu_s(process.pid) - before
        deadline = time.perf_counter() + 2
        sent = 10 * HOSTS * each * PARTS
        while got < sent and time.perf_counter() < deadline:
            time.sleep(0.05)
        everything.undeclare()
    topics = HOSTS * each * PARTS
    return [
        f"| one router, {topics:,} topics of {HOSTS * each:,} robots at {HOSTS} sites | |",
        "|---|---|",
        f"| all writers made; the router at rest again | after {known:.0f} s; {settled:.0f} s |",
        f"| memory, empty / with them | {empty:.0f} / {full:.0f} MB, {(full - empty) * 1024 / topics:.1f} kB each |",
        f"| samples carried to one reader, of {sent:,} and repeats | {got:,}, {sent / took:,.0f} a second |",
        f"| its processor time | {spent / took * 100:.0f} % of a core, {spent / sent * 1e6:.1f} µs a sample |",
    ]


if __name__ == "__main__":
    main()
