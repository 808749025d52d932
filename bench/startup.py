"""How long a student waits for `import msbot`, `msbot --help`, and the page of `msbot demo` and `msbot master`.

    python -m bench.startup [--runs N] [--write]

Each row is a fresh process with its files in memory and its byte-code compiled, as it is after the first start: on a
busy machine go by the least processor time. The page is there when a visitor who follows the printed link has got the
home page with every slot of the robot in it; STOP works when the robot has answered on the socket that `msbot stop`
uses. What its imports take is measured in the same way, in the process that makes them (`bench/import_share.py`).
`--write` puts the table into bench/results/startup.md. Linux.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from http.cookiejar import CookieJar
from pathlib import Path
from urllib.request import HTTPCookieProcessor, build_opener

from bench.agent import free_port
from bench.machine import cpu_s, describe_machine
from bench.result import write_result
from msbot.config import open_blueprint, write_sample
from msbot.registry.records import database_identity
from msbot.stop.stop_request import ask_masters
from msbot_agent.process.user_folders import cache_folder, make_own_folder

IMPORT_SHARE = Path(__file__).with_name("import_share.py")
COMMAND = [sys.executable, "-m", "msbot"]
CACHE = str(cache_folder() / "bench-byte-code")
"""Where the byte-code of these starts is kept: in a folder in which nobody else can put any."""
MASTER = ("master", "--link", f"udp:127.0.0.1:{free_port()}")


@dataclass(frozen=True)
class Taken:
    """What one start took, in milliseconds."""

    real_ms: float
    processor_ms: float


@dataclass(frozen=True)
class Started:
    """A robot that is starting."""

    process: subprocess.Popen[str]
    database: str
    slots: tuple[str, ...]


def compiled() -> dict[str, str]:
    """The environment of a start whose byte-code is kept."""
    make_own_folder(Path(CACHE))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**environment, "PYTHONPYCACHEPREFIX": CACHE, "PYTHONUNBUFFERED": "1"}


def process(*arguments: str) -> Taken:
    """A process from its start to its end."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*arguments], stdout=subprocess.DEVNULL, check=True, env=compiled())
    real_s = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Taken(real_s * 1e3, (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) * 1e3)


def robot(until: Callable[[Started], None], *command: str, program: Sequence[str] = COMMAND) -> Taken:
    """A robot with its page, from its start until something of it is there."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sample(folder / "robot.toml", "rover")
        database = str(folder / "robot.db")
        slots = tuple(slot.name for slot in open_blueprint(folder / "robot.toml")[0].slots)
        start = time.perf_counter()
        with subprocess.Popen(
            [*program, *command, "--db", database, "--port", "0"],
            cwd=folder,
            stdout=subprocess.PIPE,
            text=True,
            env={**compiled(), "XDG_STATE_HOME": name},
        ) as running:
            try:
                until(Started(running, database, slots))
                real_s, used_s = time.perf_counter() - start, cpu_s(running.pid)
            finally:
                running.terminate()
                running.communicate()
    return Taken(real_s * 1e3, used_s * 1e3)


def imports_alone() -> Taken:
    """What the imports of a demo take of the time until a visitor has its first page."""
    with tempfile.TemporaryDirectory() as name:
        result = Path(name) / "imports.json"
        robot(page_is_there, "demo", program=(sys.executable, "-P", str(IMPORT_SHARE), str(result)))
        return Taken(**json.loads(result.read_text()))


def first_page(started: Started) -> str:
    """What a visitor gets who follows the link."""
    assert started.process.stdout is not None
    for line in started.process.stdout:
        if "The page is at " in line:
            link = line.split()[-1]
            break
    else:
        raise SystemExit("the robot has ended without a page")
    with build_opener(HTTPCookieProcessor(CookieJar())).open(link) as answer:
        return str(answer.read().decode())


def page_is_there(started: Started) -> None:
    """A visitor gets the home page, and every slot is in it."""
    text = first_page(started)
    missing = [name for name in started.slots if f"Open slot {name}" not in text]
    if missing:
        raise SystemExit(f"the first page does not have the slots {', '.join(missing)}")


def form_is_there(started: Started) -> None:
    """The first visitor of a new master gets the form that makes him its administrator."""
    if 'type="password"' not in first_page(started):
        raise SystemExit("the first page of a new master is not its form")


def stop_works(started: Started) -> None:
    """The robot answers where `msbot stop` asks."""
    meant = {"do": "status", "database": database_identity(started.database)}
    while not ask_masters(meant)[0]:
        if started.process.poll() is not None:
            raise SystemExit("the robot has ended without STOP")


ROWS: tuple[tuple[str, str, Callable[[], Taken]], ...] = (
    ("Python itself", "-", lambda: process(sys.executable, "-c", "pass")),
    ("`import msbot`", "40 ms", lambda: process(sys.executable, "-c", "import msbot")),
    ("`msbot --help`", "60 ms", lambda: process(*COMMAND, "--help")),
    ("`msbot parts --help`", "-", lambda: process(*COMMAND, "parts", "--help")),
    ("`msbot demo`: STOP works", "-", partial(robot, stop_works, "demo")),
    ("`msbot demo`: the page is there", "1,500 ms, 1.5 x imports", partial(robot, page_is_there, "demo")),
    ("`msbot demo`: its imports alone", "-", imports_alone),
    ("`msbot master`: STOP works", "-", partial(robot, stop_works, *MASTER)),
    ("`msbot master`: its page is there", "1,500 ms", partial(robot, form_is_there, *MASTER)),
)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--runs", type=int, default=7)
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    chosen = options.parse_args()
    lines = [
        f"{describe_machine()}; {chosen.runs} starts each, files in memory; load {os.getloadavg()[0]:.0f}.",
        "",
        "| start | goal | median ms | least ms | processor, least ms |",
        "|---|---|---|---|---|",
    ]
    for name, goal, start in ROWS:
        start()
        took = [start() for _ in range(chosen.runs)]
        real = [one.real_ms for one in took]
        lines.append(
            f"| {name} | {goal} | {statistics.median(real):,.0f} | {min(real):,.0f} "
            f"| {min(one.processor_ms for one in took):,.0f} |"
        )
    print("\n".join(lines))
    if chosen.write:
        write_result("startup", "How long starts take", lines, made_by="python -m bench.startup --write")


if __name__ == "__main__":
    main()
