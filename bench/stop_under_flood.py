"""How long STOP takes while strangers flood the master by all ways at the same time, and what the floods cost.

    python -m bench.stop_under_flood [--rounds 20] [--scale 1.0] [--write]

A real `msbot master` with links over UDP and TCP and its page, and three parts (three processes, over UDP). Floods
without any rights come from processes that are pinned to another processor than the master: datagrams from ever new
addresses, connections to the TCP link, requests for the page, and negotiations of TLS. Each round says STOP and GO by
the socket of `msbot stop`, then by the page's API over a connection that was open before, and looks when the last part
has confirmed. While the floods go on, a new part joins: how long that takes. Times in ms: median and longest. Memory
is the master's own, in MB: before, at the end of the flood, and ten seconds after it. Linux; two processors.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx

from bench.floods import Flood, flooding, http, tcp, tls, udp
from bench.machine import cpu_s, describe_machine
from bench.result import write_result
from bench.stop import by_page, by_socket
from tests.certificate import Certificate
from tests.e2e.processes import Process
from tests.e2e.test_processes import free_port
from tests.hostile.robot import Robot

TITLE = "STOP while strangers flood the master"
COMMAND = "python -m bench.stop_under_flood --write"
PARTS = ("AA", "BB")
NEWCOMER = "CC"
UDP_S, TCP_S, HTTP_S, TLS_S = 8700.0, 430.0, 236.0, 100.0
"""What each flood sends a second."""
WARM_S = 3.0
CALM_S = 10.0
CONFIRM_S = 5.0
"""A part that has not confirmed by then counts as unconfirmed."""
TITLES = (
    "flood", "sent a second", "by socket, ms", "by an open page, ms", "last confirmation, ms", "not confirmed",
    "new part joins, s", "master's CPU", "memory, MB", "lines of log", "load",
)  # fmt: skip


def words(values: list[float]) -> str:
    """Median and longest."""
    return f"{statistics.median(values):.1f}, {max(values):.1f}" if values else "none"


def memory_mb(pid: int) -> int:
    """What a process has in memory."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1_000_000


def last_confirmation_ms(robot: Robot) -> float | None:
    """When the last part confirmed the STOP that holds; None: not all of them have."""
    end = time.monotonic() + CONFIRM_S
    while time.monotonic() < end:
        status = robot.tell("status")
        found = status["confirmed"]
        assert isinstance(found, list)
        if len(found) >= len(PARTS):  # the part that joined under an earlier flood was killed, and cannot
            return max(float(one["ms"]) for one in found)
    return None


def row(title: str, robot: Robot, master: Process, page: httpx.Client, floods: list[Flood], rounds: int) -> str:
    """Measure one mixture of floods; its row."""
    before = memory_mb(master.pid)
    lines = len(master.lines) + master.waiting()
    with flooding(floods, (os.cpu_count() or 1) - 1) as counts:
        time.sleep(WARM_S if floods else 0.0)
        began, used, sent = time.monotonic(), cpu_s(master.pid), total(counts)
        socket_ms: list[float] = []
        page_ms: list[float] = []
        confirmed: list[float] = []
        missing = 0
        ways = ((by_socket(robot), socket_ms), (by_page(page), page_ms))
        for _ in range(rounds):
            for say, times in ways:
                at = time.perf_counter()
                say("stop")
                times.append((time.perf_counter() - at) * 1000)
                last = last_confirmation_ms(robot)
                missing += last is None
                confirmed += [] if last is None else [last]
                by_socket(robot)("go")
        seconds = time.monotonic() - began
        share = (cpu_s(master.pid) - used) / seconds
        rates = {name: (count - sent[name]) / seconds for name, count in total(counts).items()}
        joins_s = joining_s(robot)
        during, load = memory_mb(master.pid), os.getloadavg()[0]
    time.sleep(CALM_S if floods else 0.0)
    said = ", ".join(f"{name} {rate:,.0f}" for name, rate in rates.items()) or "nothing"
    cells = (
        title,
        said,
        words(socket_ms),
        words(page_ms),
        words(confirmed),
        f"{missing} of {2 * rounds}",
        f"{joins_s:.1f}",
        f"{share:.0%}",
        f"{before}, {during}, {memory_mb(master.pid)}",
        str(len(master.lines) + master.waiting() - lines),
        f"{load:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def joining_s(robot: Robot) -> float:
    """How long a part that is switched on now takes until it is active (its program's start included)."""
    began = time.monotonic()
    with ExitStack() as stack:
        newcomer = robot.part(NEWCOMER, stack)
        newcomer.wait_for("is active")
        return time.monotonic() - began


def total(counts: dict[str, Any]) -> dict[str, int]:
    """How many each flood has sent."""
    return {name: int(count.value) for name, count in counts.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--scale", type=float, default=1.0, help="times the rates of the floods")
    parser.add_argument("--only", help="only the rows with this word")
    parser.add_argument("--write", action="store_true", help="keep it in bench/results")
    options = parser.parse_args()
    lines = [
        f"{describe_machine()}, load {os.getloadavg()[0]:.1f}; {options.rounds} rounds by each way; "
        f"the master on processor 0, the floods on {(os.cpu_count() or 1) - 1}",
        "",
        f"| {' | '.join(TITLES)} |",
        "|" + "---|" * len(TITLES),
    ]
    print("\n".join(lines), flush=True)
    for has_tls in (False, True):
        for line in measure(options, has_tls=has_tls):
            print(line, flush=True)
            lines.append(line)
    if options.write:
        write_result("stop_under_flood", TITLE, lines, made_by=COMMAND)


def measure(options: argparse.Namespace, *, has_tls: bool) -> list[str]:
    """The rows of one robot, whose page is served with or without TLS."""
    rows = []
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        robot = Robot(folder, stack)
        links = [free_port(), int(robot.link.rpartition(":")[2])]
        more = ["--link", f"tcp:127.0.0.1:{links[0]}"]
        if has_tls:
            own = Certificate(folder)
            more += ["--certificate", str(own.certificate), "--certificate-key", str(own.key)]
        master = robot.master(*more, page=True)
        print(f"master is process {master.pid}", file=sys.stderr, flush=True)
        os.sched_setaffinity(master.pid, {0})
        for task in os.listdir(f"/proc/{master.pid}/task"):
            os.sched_setaffinity(int(task), {0})
        robot.parts(*PARTS)
        page = robot.open_page()
        port = httpx.URL(robot.page).port or 0
        scale = options.scale
        one = [udp(links[1], UDP_S * scale), tcp(links[0], TCP_S * scale)]
        if has_tls:
            mixtures = [
                ("TLS, no flood", []),
                ("TLS", [tls(port, TLS_S * scale)]),
                ("TLS, all together", [*one, tls(port, TLS_S * scale)]),
            ]
        else:
            mixtures = [
                ("no flood", []),
                ("UDP", one[:1]),
                ("TCP", one[1:]),
                ("HTTP", [http(port, HTTP_S * scale)]),
                ("all together", [*one, http(port, HTTP_S * scale)]),
            ]
        for title, floods in mixtures:
            if options.only is None or options.only in title:
                page.get("/robot")  # the connection is open before the trouble begins
                rows.append(row(title, robot, master, page, floods, options.rounds))
    return rows


if __name__ == "__main__":
    main()
