"""How long somebody's STOP takes while another person's browser says as much as it can over its pages' WebSockets.

    python -m bench.page_flood [--rounds 20]

A real `msbot master` with its page and three parts over UDP. Eve, a student, signs in, opens pages and sends messages
of NiceGUI over their WebSockets without a pause, from a process of her own: right ones, each of which changes something
on her page; long ones; and right ones over many pages at the same time. Meanwhile a program with an API token says
STOP, and Ben, who is signed in, presses it on the page: the call that the button makes. Times in ms from the request to
the answer, and until the last part has confirmed: median and longest. What Eve has said waits mostly in her
connections: the page reads some of it. Linux; where other masters run, in a network of
its own (`unshare -n`, `ip link set lo up`).
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import multiprocessing
import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from bench.machine import cpu_s, describe_machine
from bench.stop import PARTS, by_page, by_socket, last_confirmation_ms, words
from msbot.registry import open_registry
from msbot.registry.edits import users
from msbot_web.access.passwords import Argon2Hasher
from tests.e2e.processes import Process
from tests.hostile.robot import PATIENCE_S, Robot

PASSWORD = "correct horse"
EVE, BEN = "eve", "ben"
LONG = 900_000
"""Octets of a long message; the page takes up to a megabyte."""
WARM_S = 3.0
"""The flood's own time before the first STOP: what may come at once has come by then."""


def sign_in(site: str, name: str) -> httpx.Client:
    """Somebody's browser."""
    browser = httpx.Client(base_url=site, timeout=PATIENCE_S)
    answer = browser.post("/login", data={"name": name, "password": PASSWORD})
    if answer.status_code != httpx.codes.SEE_OTHER:
        raise SystemExit(f"{name} cannot sign in: {answer.status_code} {answer.text[:200]}")
    return browser


def on_the_page(site: str, name: str) -> httpx.Client:
    """A browser as the STOP button of its page uses it."""
    browser = sign_in(site, name)
    browser.headers["x-csrf-token"] = browser.get("/api/me").json()["csrf"]
    browser.base_url = httpx.URL(f"{site}/api")
    return browser


def flood(site: str, pages: int, octets: int, over: Event, said: Any) -> None:  # noqa: ANN401 - a shared number
    """Open so many pages and talk over all of them until it is over; fewer than 0 octets: say nothing."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # connections that are closed are part of it
    os.nice(10)  # as her computer is another one, she shall not take the master's processor
    browser = sign_in(site, EVE)
    threads = [threading.Thread(target=_talk, args=(browser, site, octets, over, said)) for _ in range(pages)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()


def _talk(browser: httpx.Client, site: str, octets: int, over: Event, said: Any) -> None:  # noqa: ANN401
    while not over.is_set():
        page = browser.get("/")
        found = re.search(r"client_id': '([^']+)'", page.text)
        switch = re.search(r'"(\d+)":\{"tag":"nicegui-dark_mode".*?"listener_id":"([^"]+)"', page.text)
        if page.status_code != httpx.codes.OK or found is None or switch is None:
            over.wait(1.0)
            continue
        query = (
            f"EIO=4&transport=websocket&client_id={found[1]}&implicit_handshake=true&next_message_id=0"
            f"&tab_id={found[1]}&document_id={found[1]}&old_tab_id="
        )
        address = f"{site.replace('http', 'ws', 1)}/_nicegui_ws/socket.io/?{query}"
        cookies = "; ".join(f"{name}={value}" for name, value in browser.cookies.items())
        value = json.dumps("x" * octets) if octets > 0 else "true"
        event = {"client_id": found[1], "id": int(switch[1]), "listener_id": switch[2], "args": [value]}
        try:
            with connect(
                address, origin=Origin(site), additional_headers={"Cookie": cookies}, compression=None, max_size=None
            ) as line:
                line.recv()
                line.send("40")
                reading = threading.Thread(target=_read, args=(line,), daemon=True)
                reading.start()
                if octets < 0:
                    over.wait()
                _say(line.send, event, over, said)
        except (ConnectionClosed, OSError, TimeoutError):
            over.wait(0.1)


def _say(send: Callable[[str], None], event: dict[str, Any], over: Event, said: Any) -> None:  # noqa: ANN401
    count, last = 0, event["args"][0]
    while not over.is_set():
        event["args"] = [("false", last)[count % 2]]
        send(f'42["event",{json.dumps(event)}]')
        count += 1
        if count % 50 == 0 or len(last) > LONG // 2:
            with said.get_lock():
                said.value += 50 if len(last) < LONG // 2 else 1


def _read(line: Any) -> None:  # noqa: ANN401 - a connection
    try:
        for message in line:
            if message == "2":
                line.send("3")
    except (ConnectionClosed, OSError):
        return


@contextmanager
def flooding(site: str, pages: int, octets: int) -> Iterator[Any]:
    """While Eve floods; tells how many messages she has said."""
    over, said = multiprocessing.Event(), multiprocessing.Value("q", 0)
    eve = multiprocessing.Process(target=flood, args=(site, pages, octets, over, said), daemon=True)
    if pages:
        eve.start()
        time.sleep(WARM_S)
    try:
        yield said
    finally:
        over.set()
        if pages:
            eve.join(10.0)
            eve.kill()


def row(title: str, robot: Robot, master: Process, ways: list[httpx.Client], said: Any, rounds: int) -> None:  # noqa: ANN401
    """Measure one kind of flood and print its row."""
    began, used = time.monotonic(), cpu_s(master.pid)
    answered: list[list[float]] = [[] for _ in ways]
    confirmed: list[float] = []
    go = by_socket(robot)
    for _ in range(rounds):
        for way, times in zip(ways, answered, strict=True):
            at = time.perf_counter()
            by_page(way)("stop")
            times.append((time.perf_counter() - at) * 1000)
            confirmed.append(last_confirmation_ms(robot))
            go("go")
    seconds = time.monotonic() - began
    print(
        f"| {title} | {said.value:,} | {' | '.join(map(words, answered))} | {words(confirmed)} "
        f"| {(cpu_s(master.pid) - used) / seconds:.0%} | {os.getloadavg()[0]:.1f} |",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        robot = Robot(Path(folder), stack)
        master = robot.master(page=True)
        people = [
            users.Person(name, "student", asyncio.run(Argon2Hasher().hash(PASSWORD, asker=""))) for name in (EVE, BEN)
        ]
        with open_registry(robot.folder / "robot.db") as registry:
            registry.edits.make(None, "bench", partial(users.keep, people=people))
        robot.parts(*PARTS)
        site = robot.page.removesuffix("/api")
        time.sleep(2.0)  # the master looks once a second who may sign in
        ways = [robot.open_page(), on_the_page(site, BEN)]
        print(f"{describe_machine()}; {options.rounds} rounds by each way\n")
        print(
            "| Eve's browser | messages said | STOP by the API, ms | by the page, ms "
            "| last confirmation, ms | master's CPU | load |\n|---|---|---|---|---|---|---|"
        )
        for title, pages, octets in (
            ("says nothing", 0, 0),
            ("30 pages, says nothing", 30, -1),
            ("right messages over one page", 1, 0),
            (f"messages of {LONG // 1000} kB over one page", 1, LONG),
            ("right messages over 30 pages", 30, 0),
            (f"messages of {LONG // 1000} kB over 30 pages", 30, LONG),
        ):
            with flooding(site, pages, octets) as said:
                row(title, robot, master, ways, said, options.rounds)


if __name__ == "__main__":
    main()
