"""How long STOP takes to reach a master, in every state of trouble, by `msbot stop`'s socket and by an open page.

    python -m bench.stop [--rounds 10]

A real `msbot master` with its page and three parts (three processes, over UDP), as in `tests/hostile`, which has the
states. Each round says STOP and GO by the socket, then by the page's API over a connection that was open before, and
looks when the last part has confirmed. Times in ms: median and longest. Needs PostgreSQL for its states. Linux.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path

import httpx

from bench.machine import describe_machine
from msbot.registry.records import database_identity
from msbot.stop.stop_request import ask_masters
from msbot_agent.agent.status_files import find_status_files
from tests.e2e.processes import Process
from tests.hostile import test_stop as states
from tests.hostile.robot import PATIENCE_S, Robot, frozen
from tests.registry import postgres

PARTS = ("AA", "BB", "CC")
HALF_OPEN = 300
"""Connections that say half a request and no more."""
LEFT = 40
"""Descriptors that the master still has when they come."""

State = Callable[[Robot, Process], AbstractContextManager[None]]


@contextmanager
def no_fault(_robot: Robot, _master: Process) -> Iterator[None]:
    """no fault"""
    yield


@contextmanager
def half_open_connections(robot: Robot, master: Process) -> Iterator[None]:
    """half-open connections to page and status port take all descriptors"""
    before = resource.prlimit(master.pid, resource.RLIMIT_NOFILE)
    used = len(os.listdir(f"/proc/{master.pid}/fd"))
    resource.prlimit(master.pid, resource.RLIMIT_NOFILE, (used + LEFT, before[1]))
    (file,) = find_status_files(robot.folder / "run" / "msbot")
    page = httpx.URL(robot.page).port or 0
    with ExitStack() as held:
        for number in range(HALF_OPEN):
            one = socket.socket()
            held.callback(one.close)
            one.setblocking(False)
            one.connect_ex(("127.0.0.1", file.port if number % 2 else page))
        yield
    resource.prlimit(master.pid, resource.RLIMIT_NOFILE, before)


@contextmanager
def gone(programs: Path, cluster: Path) -> Iterator[None]:
    """A server that was killed."""
    os.kill(int((cluster / "data/postmaster.pid").read_text().split()[0]), signal.SIGQUIT)
    yield
    with postgres.serving(programs, cluster):
        pass


def by_socket(robot: Robot) -> Callable[[str], None]:
    """STOP as `msbot stop` says it."""
    request = {"who": "bench", "database": database_identity(robot.db or str(robot.folder / "robot.db"))}

    def say(do: str) -> None:
        answers, _ = ask_masters({**request, "do": do}, PATIENCE_S)
        if len(answers) != 1:
            raise SystemExit(f"{do} was not answered")

    return say


def by_page(page: httpx.Client) -> Callable[[str], None]:
    """STOP as a program with a token says it, or a browser that is on the page."""

    def say(do: str) -> None:
        answer = page.post(f"/{do}", json={})
        if answer.status_code != httpx.codes.OK:
            raise SystemExit(f"the page's {do}: {answer.status_code} {answer.text}")

    return say


def times(robot: Robot, say: Callable[[str], None], rounds: int) -> tuple[list[float], list[float]]:
    """For each round: until the master's answer, and (its own figure) until the last part has confirmed, ms."""
    look = by_socket(robot)
    answered, confirmed = [], []
    for _ in range(rounds):
        began = time.perf_counter()
        say("stop")
        answered.append((time.perf_counter() - began) * 1000)
        confirmed.append(last_confirmation_ms(robot))
        look("go")
    return answered, confirmed


def last_confirmation_ms(robot: Robot) -> float:
    """When the last part confirmed the STOP that holds."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        status = robot.tell("status")
        found = status["confirmed"]
        assert isinstance(found, list)
        if not status["silent"] and len(found) == len(PARTS):
            return max(float(one["ms"]) for one in found)
    raise SystemExit("not all parts confirm")


def words(values: list[float]) -> str:
    """Median and longest."""
    return f"{statistics.median(values):.1f}, {max(values):.1f}"


def row(title: str, robot: Robot, page: httpx.Client, rounds: int) -> None:
    """Measure one state and print its row."""
    socket_ms, first = times(robot, by_socket(robot), rounds)
    page_ms, second = times(robot, by_page(page), rounds)
    print(
        f"| {title} | {words(socket_ms)} | {words(page_ms)} | {words(first + second)} | {os.getloadavg()[0]:.1f} |",
        flush=True,
    )


def measure(found: list[tuple[str, State]], rounds: int, db: str | None = None) -> None:
    """A robot of its own, put into one state after the other."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        robot = Robot(Path(folder), stack, db)
        master = robot.master(page=True)
        robot.parts(*PARTS)
        page = robot.open_page()
        for title, state in found:
            page.get("/robot")  # the connection is open before the trouble begins
            with state(robot, master):
                row(title, robot, page, rounds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=10)
    options = parser.parse_args()
    print(f"{describe_machine()}, load {os.getloadavg()[0]:.1f}; {options.rounds} rounds by each way", flush=True)
    print("| state of the master | by socket, ms | by an open page, ms | last confirmation, ms | load |")
    print("|---|---|---|---|---|")
    measure(
        [
            ("no fault", no_fault),
            ("40 silent connections to its status port", states.silent_connections),
            ("the folder of its status files belongs to others, too", states.somebody_elses_folder),
            ("half-open connections take all descriptors", half_open_connections),
            ("no file descriptor is left", states.no_descriptor_left),
            ("no file can be written", states.no_file_can_be_written),
            ("a blueprint is compared without end", states.a_blueprint_is_compared),
        ],
        options.rounds,
    )
    programs = postgres.find_server()
    if programs is None:
        sys.exit(postgres.MISSING)
    with postgres.running_server(programs) as address:
        cluster = Path(address.partition("host=")[2])
        measure(
            [
                ("PostgreSQL, no fault", no_fault),
                ("PostgreSQL does not answer", lambda _robot, _master: frozen(cluster)),
                ("PostgreSQL is gone", lambda _robot, _master: partial(gone, programs, cluster)()),
            ],
            options.rounds,
            address.format("postgres"),
        )


if __name__ == "__main__":
    main()
