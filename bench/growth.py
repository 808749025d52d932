"""What grows with what: sessions of an agent, parts on a bus, robots on a computer, and a restart under all of them.

    python -m bench.growth [--quick] [--write]

Processor time is compared, not rates. The loads of the first table take turns of a second, so that a busy machine blurs
but does not tilt them; the rate of all sessions together is the same in each of its rows, only their number changes.
`--write` puts the tables into bench/results/growth.md and the curves into docs/explain/growth.svg. Needs gcc
(`xrce_load.c`); some 5 minutes; Linux.
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
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from random import randbytes

from bench.agent import Result, agent, build_generator, pinned, start_agent, wait_for
from bench.buses import Rates
from bench.crowd import switch_on
from bench.growth_curves import Curve, curves
from bench.machine import cpu_s, describe_machine
from bench.many_parts import PART_NUMBER, blueprint
from bench.result import write_result
from bench.scale import memory_mb, running
from bench.scale import wait_for as wait_for_words
from msbot import HelloWorld
from msbot.part import JoinState, Part
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import open_link
from msbot_agent.process.user_folders import PACKAGES

PICTURE = Path(__file__).parent.parent / "docs/explain/growth.svg"
SESSIONS = (10, 30, 100, 300, 1000, 3000, 5000)
TOGETHER = 500.0
"""Requests a second of all sessions together."""
TURN_S, TURNS = 1.0, 14
STORMS = (1000, 5000)
STORM_PORT = 18888
"""Not one that the system gives to the thousands of clients while the agent is away."""
BUS = Rates(500_000)
ON_BUS = (10, 30, 60, 120)
BUS_REST_S = 2400.0
"""For one part; for more of them the shorter, so that there are as many frames in each row."""
ROBOTS = (1, 5, 20)
PARTS = 10
ROBOTS_IN_A_PROCESS = 5
PERIOD_S = 1.0
"""Of what each part of a robot says to the next."""
FIRST_PORT = 19000
READY_S = 60.0


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="fewer loads, and three turns of each")
    options.add_argument("--write", action="store_true", help="keep tables in bench/results, curves in docs/explain")
    options.add_argument("--be-robots", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.be_robots:
        asyncio.run(be_rings(chosen.be_robots.split(",")))
        return
    drawn: list[Curve] = []
    lines = [f"{describe_machine()}; load {os.getloadavg()[0]:.1f}"]
    print(lines[0], flush=True)
    tables: tuple[Callable[[], list[str]], ...] = (
        partial(sessions, drawn, SESSIONS[::3] if chosen.quick else SESSIONS, 3 if chosen.quick else TURNS),
        partial(storms, STORMS[:1] if chosen.quick else STORMS),
        partial(one_bus, ON_BUS[::3] if chosen.quick else ON_BUS),
        partial(robots, ROBOTS[:2] if chosen.quick else ROBOTS, 5.0 if chosen.quick else 20.0),
    )
    for table in tables:
        made = ["", *table()]
        print("\n".join(made), flush=True)
        lines += made
    if chosen.write:
        PICTURE.write_text(curves(drawn))
        write_result("growth", "What grows with what", lines, made_by="python -m bench.growth --write")


# Sessions of one agent.


def sessions(drawn: list[Curve], numbers: tuple[int, ...], turns: int) -> list[str]:
    """More and more clients, of which each asks the more seldom; an agent of its own for each number of them.

    All agents and their sessions are there at once, and one after the other has its turn of a second: so what the
    machine does meanwhile falls on all of them, and none is measured but when its sessions are long open. Requests
    come at the same instants in each turn, one client asking after the other.
    """
    generator = build_generator()
    rounds: list[list[Result]] = []
    with contextlib.ExitStack() as stack:
        crowds: list[subprocess.Popen[str]] = []
        for number in numbers:
            crowds.append(stack.enter_context(_crowd(generator, number, turns + 1)))
            _turn(crowds[-1])  # it comes when all sessions are open and have been answered once
        for turn in range(turns):
            found = {place: _turn(crowds[place]) for place in range(len(crowds))[:: -1 if turn % 2 else 1]}
            rounds.append([found[place] for place in range(len(crowds))])
    return _table_of_sessions(drawn, numbers, rounds)


@contextlib.contextmanager
def _crowd(generator: Path, number: int, turns: int) -> Iterator[subprocess.Popen[str]]:
    """So many sessions with an agent, which ask when told to."""
    with agent() as (port, pid):
        words = [
            "idle_heartbeat",
            "--even",
            "--clients",
            str(number),
            "--rate",
            str(TOGETHER / number),
            "--duration",
            str(TURN_S),
            "--turns",
            str(turns),
            "--agent",
            f"127.0.0.1:{port}",
            "--agent-pid",
            str(pid),
        ]
        with subprocess.Popen(
            [*pinned(1), str(generator), *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as crowd:
            yield crowd
            assert crowd.stdin is not None
            crowd.stdin.close()


def _turn(crowd: subprocess.Popen[str]) -> Result:
    _tell([crowd])
    assert crowd.stdout is not None
    line = crowd.stdout.readline()
    if not line:
        raise SystemExit(f"the generator has ended: {crowd.args!r}")
    found: Result = json.loads(line)
    return found


def _table_of_sessions(drawn: list[Curve], numbers: tuple[int, ...], rounds: list[list[Result]]) -> list[str]:
    """Of each turn its ratio to the mean of its round counts: how the machine is in that round falls on all of them."""
    costs = [[result["agent_cpu_us_per_msg"] for result in one] for one in rounds]
    usual = statistics.median(statistics.mean(one) for one in costs)
    lines = [
        f"| sessions, {TOGETHER:.0f} requests a second together | agent CPU µs a request | middle half of the turns "
        "| p50 / p99 µs | memory of the agent; a session | opened, CPU of the agent for each | lost or doubled |",
        "|---|---|---|---|---|---|---|",
    ]
    cost, memory, waiting = [], [], []
    for place, number in enumerate(numbers):
        results = [one[place] for one in rounds]
        shares = sorted(usual * one[place] / statistics.mean(one) for one in costs)
        middle = {name: statistics.median(result[name] for result in results) for name in _FIGURES}
        grown_kb = middle["agent_rss_kb"] - middle["agent_rss_before_kb"]
        wrong = sum(int(result["missing"] + result["dup_or_late"]) for result in results)
        opening_ms = middle["agent_bringup_cpu_s"] / number * 1e3
        lines.append(
            f"| {number:,} | {statistics.median(shares):.0f} | {shares[len(shares) // 4]:.0f} to "
            f"{shares[-1 - len(shares) // 4]:.0f} | {middle['rtt_p50_us']:,.0f} / {middle['rtt_p99_us']:,.0f} "
            f"| {middle['agent_rss_kb'] / 1024:.0f} MB; {grown_kb / number:.0f} kB "
            f"| {'-' if number < 300 else f'{opening_ms:.2f} ms'} | {wrong or 'nothing'} |"
        )
        cost.append((number, statistics.median(shares)))
        memory.append((number, middle["agent_rss_kb"] / 1024))
        waiting.append((number, middle["rtt_p50_us"]))
    drawn += [
        Curve("processor time for a request, µs", cost),
        Curve("from request to reply, median, µs", waiting),
        Curve("memory of the agent, MB", memory),
    ]
    least, most = min(value for _, value in cost), max(value for _, value in cost)
    middle_cost, together = statistics.median(value for _, value in cost), [statistics.mean(one) for one in costs]
    return [
        *lines,
        "",
        f"Median of {len(rounds)} turns of {TURN_S:g} s each. The dearest request costs {most / least - 1:.0%} more "
        f"than the cheapest; from the one in the middle, {middle_cost:.0f} µs, they differ by "
        f"{least / middle_cost - 1:+.0%} to {most / middle_cost - 1:+.0%}. The mean of a round, in which each has a "
        f"turn, was {min(together):.0f} to {max(together):.0f} µs: that much the machine changed.",
    ]


_FIGURES = (
    "agent_cpu_us_per_msg", "rtt_p50_us", "rtt_p99_us", "agent_rss_kb", "agent_rss_before_kb", "agent_bringup_cpu_s",
)  # fmt: skip


# The agent ends without a word, and all of its clients come back at once.


def storms(numbers: tuple[int, ...]) -> list[str]:
    """Sessions open, the agent killed and started again, all clients at its door in the same instant."""
    generator = build_generator()
    lines = [
        "| clients that come back at once after `kill -9` | all are in again after | then each had an answer "
        "| the agent's CPU | messages sent again | lost or doubled |",
        "|---|---|---|---|---|---|",
    ]
    for number in numbers:
        common = [
            *pinned(1),
            str(generator),
            "idle_heartbeat",
            "--agent",
            f"127.0.0.1:{STORM_PORT}",
            "--clients",
            str(number),
            "--count",
            "1",
            "--timeout",
            "60",
        ]
        with start_agent(STORM_PORT) as first:
            try:
                wait_for(STORM_PORT)
                subprocess.run([*common, "--even", "--no-close"], check=True, stdout=subprocess.DEVNULL)
            finally:
                first.kill()
        with start_agent(STORM_PORT) as second:
            try:
                words = ["--parallel", str(number), "--agent-pid", str(second.pid)]
                done = subprocess.run([*common, *words], capture_output=True, text=True, check=False)
                found = json.loads(done.stdout)
            finally:
                second.terminate()
        back_s = found["bringup_s"] + found["match_s"] + found["seconds"]
        wrong = int(found["missing"] + found["dup_or_late"] + found["alien"])
        cpu = found["agent_bringup_cpu_s"] + found["agent_cpu_s"]
        lines.append(
            f"| {number:,} | {found['bringup_s']:.1f} s | {back_s:.1f} s | {cpu:.1f} s | {found['resent']:,.0f} "
            f"| {wrong or 'nothing'} |"
        )
    return lines


# Parts on one bus.


def one_bus(numbers: tuple[int, ...]) -> list[str]:
    """Parts switched on together on one simulated bus, then at rest: real master, real parts, virtual time."""
    lines = [
        f"| parts on one CAN bus ({BUS.name}), switched on at once | all active after | bus load at rest "
        "| CPU µs a frame at rest, bus, master and parts together | lost |",
        "|---|---|---|---|---|",
    ]
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder:
            found = run_virtual(switch_on(BUS, number, Path(folder), rest_s=BUS_REST_S / number))
        lines.append(
            f"| {number} | {found.last_s:.2f} s | {100 * found.load:.1f} % "
            f"| {found.rest_cpu_s / found.rest_frames * 1e6:.0f} | {found.lost + found.late or 'nothing'} |"
        )
    return lines


# Robots on one computer.


async def be_rings(addresses: list[str]) -> None:
    """The parts of some robots: each says something to the next once a second. Prints what it hears, when told to."""
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.CRITICAL)
    took: list[float] = []

    def make(number: int) -> Part:
        part = Part(PART_NUMBER, local_name=f"P{number:04}", robot="CROWD", uid=randbytes(8))

        @part.every(PERIOD_S)
        def speak() -> None:
            part.publish("out", HelloWorld(index=number, message=str(time.perf_counter())))

        @part.on("in", HelloWorld)
        def hear(message: HelloWorld) -> None:
            took.append(1e3 * (time.perf_counter() - float(message.message)))

        return part

    parts = [(make(number), address) for address in addresses for number in range(PARTS)]
    print("loaded", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    async with asyncio.TaskGroup() as tasks:
        running_parts = [tasks.create_task(part.run_async(open_link(address))) for part, address in parts]
        while any(part.state is not JoinState.ACTIVE for part, _ in parts):  # noqa: ASYNC110 - nothing says "all"
            await asyncio.sleep(0.01)
        print("all active", flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        took.clear()
        await asyncio.to_thread(sys.stdin.readline)
        print(json.dumps(took), flush=True)
        await asyncio.to_thread(sys.stdin.readline)
        for task in running_parts:
            task.cancel()


def robots(numbers: tuple[int, ...], seconds: float) -> list[str]:
    """Masters in a process each, all parts switched on in the same moment, each sending once a second."""
    lines = [
        f"| robots of {PARTS} parts over UDP, {PARTS} messages a second each | all active after "
        "| all masters, of a core | CPU µs a message, beats included | memory of a master "
        "| latency p50 / p99 / most ms | arrived |",
        "|---|---|---|---|---|---|---|",
    ]
    for number in numbers:
        with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
            folder = Path(name)
            os.environ |= {"XDG_STATE_HOME": name, "XDG_RUNTIME_DIR": name}
            addresses = [f"udp:127.0.0.1:{FIRST_PORT + index}" for index in range(number)]
            masters = []
            for index, address in enumerate(addresses):
                (folder / str(index)).mkdir()
                text = blueprint(PARTS).replace("C-0001", f"C-{index}")
                (folder / str(index) / "robot.toml").write_text(text)
                words = ("-m", "msbot", "master", "--no-page", "--rec", "off", "--link", address)
                masters.append(stack.enter_context(running(*words, folder=folder / str(index))))
            for master in masters:
                wait_for_words(master, "is up on")
            groups = [addresses[at : at + ROBOTS_IN_A_PROCESS] for at in range(0, number, ROBOTS_IN_A_PROCESS)]
            me = str(Path(__file__).resolve())
            crowds = [stack.enter_context(running(me, "--be-robots", ",".join(group))) for group in groups]
            for crowd in crowds:
                wait_for_words(crowd, "loaded")
            began = time.perf_counter()
            _tell(crowds)
            for crowd in crowds:
                wait_for_words(crowd, "all active")
            active_s = time.perf_counter() - began
            time.sleep(3.0)  # until their beats have settled
            before, began = [cpu_s(master.pid) for master in masters], time.perf_counter()
            _tell(crowds)
            time.sleep(seconds)
            _tell(crowds)
            spent_s = time.perf_counter() - began
            used_s = sum(cpu_s(master.pid) - was for master, was in zip(masters, before, strict=True))
            took = sorted(one for crowd in crowds for one in json.loads(wait_for_words(crowd, "[")))
            memory = statistics.median(memory_mb(master.pid) for master in masters)
            _tell(crowds)
        expected = number * PARTS * spent_s / PERIOD_S
        shares = " / ".join(f"{took[min(len(took) - 1, int(len(took) * share))]:.1f}" for share in (0.5, 0.99, 1.0))
        lines.append(
            f"| {number} | {active_s:.2f} s | {100 * used_s / spent_s:.1f} % | {used_s / len(took) * 1e6:,.0f} "
            f"| {memory:.0f} MB | {shares} | {len(took) / expected:.0%} |"
        )
    return lines


def _tell(processes: list[subprocess.Popen[str]]) -> None:
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()


if __name__ == "__main__":
    main()
