"""Thirty pupils at one master: programs over the page's WebSockets, robots of five parts each, a few real browsers.

    python -m bench.classroom [--pupils 30] [--tabs 2] [--seconds 20] [--write]

A real `msbot master` with the robot that `msbot pupils robot` writes. Of each group's five parts four are simulated
in the master; the fifth is a pupil's program: in this process, over a WebSocket of its own and the protocol of the
browser's home, or (`--tabs`) in a tab of a real headless Chromium. Each program gets distances ten times a second and
answers each with two powers. Measured: processor time and memory of the master, the way of a message from program to
program, a page, freeze, and STOP. The load of the machine is in the first line. `--write` puts the table into
bench/results/classroom.md. Linux.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Coroutine, Iterator
from pathlib import Path
from random import Random

import httpx

from bench.machine import cpu_s, describe_machine
from bench.result import write_result
from msbot import Distance, Level, Part
from msbot.config import GROUP_ROBOT_TOML, blueprint_toml, for_groups, load_library, parse_blueprint
from msbot_agent.link.net import WebSocketClientLink

PASSWORD = "thirty at once"
LONGEST_S = 180.0
PERIOD_S = 1.0
PROGRAM = """from msbot import Distance, Level, Part
part = Part("PILOT")
@part.on("distance", Distance)
def look(distance):
    power = 40 if distance.metres > 0.3 else 0
    part.publish("left", Level(percent=power))
    part.publish("right", Level(percent=power))
part.run()
"""


class Pupil:
    """One pupil's program, with what it measures."""

    def __init__(self, number: int) -> None:
        self.part = Part(
            "PILOT", local_name=f"P{number}", uid=(0x17_0000 + number).to_bytes(8, "big"), random=Random(number)
        )
        self.heard = 0
        self.sent_at: dict[int, float] = {}
        self.ways_ms: list[float] = []
        self.lost_at = 0.0
        self.asked = 0
        self.part.on("distance", Distance)(self._look)
        self.part.on_partner_lost(self._lost)

    def _look(self, distance: Distance) -> None:
        self.heard += 1
        power = 40.0 if distance.metres > 0.3 else 0.0
        self.part.publish("left", Level(percent=power))
        self.part.publish("right", Level(percent=power))

    def _lost(self, port: str) -> None:
        if port == "distance":
            self.lost_at = time.monotonic()

    def ask(self) -> None:
        """Send a number to the neighbour."""
        self.asked += 1
        self.sent_at[self.asked] = time.monotonic()
        self.part.publish("grip", Level(percent=float(self.asked)))


class Site:
    """The master, and the administrator who prepares it."""

    def __init__(self, folder: Path, pupils: int) -> None:
        self.folder = folder
        self.names = [f"g{number:02}" for number in range(pupils)]
        one = parse_blueprint(GROUP_ROBOT_TOML, load_library())
        text = blueprint_toml(for_groups(one, self.names))
        for here, there in zip(self.names, [*self.names[1:], self.names[0]], strict=True):
            text += (
                f'\n[[binding]]\ntopic = "ring_{here}"\ntype = "Level"\nfrom = "program_{here}.grip"\n'
                f'to = ["program_{there}.sound"]\n'
            )
        (folder / "class.toml").write_text(text)
        self.log = folder / "log"
        home = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
        folder.chmod(0o700)
        command = [sys.executable, "-m", "msbot", "master", "class.toml", "--port", "0", "--link", "udp:127.0.0.1:0"]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(command, cwd=folder, env=home, stdout=log, stderr=subprocess.STDOUT)
        found = self._until(r"(http://\S+)/setup\?token=(\S+)")
        self.base, token = found[1], found[2]
        self.client = httpx.Client(base_url=self.base, timeout=120)
        answer = self.client.post(
            "/setup",
            data={"token": token, "name": "novak", "password": PASSWORD, "again": PASSWORD},
            headers={"origin": self.base},
        )
        assert answer.status_code == 303, answer.text
        self.client.headers["x-csrf-token"] = self.client.get("/api/me").json()["csrf"]

    def _until(self, pattern: str) -> re.Match[str]:
        end = time.monotonic() + LONGEST_S
        while time.monotonic() < end:
            if found := re.search(pattern, self.log.read_text()):
                return found
            time.sleep(0.1)
        raise SystemExit(f"the master does not come up:\n{self.log.read_text()}")

    def do(self, method: str, path: str, **body: object) -> dict[str, object]:
        """Call the API."""
        answer = self.client.request(method, f"/api{path}", json=body)
        assert answer.status_code == 200, (path, answer.text)
        return dict(answer.json())

    def prepare(self) -> dict[str, str]:
        """Accounts with tokens, groups, simulated parts; pupil -> token."""
        tokens = {}
        for name in self.names:
            self.do("POST", "/users", name=f"pupil {name}", role="student", password=PASSWORD)
            made = self.do("POST", f"/users/pupil {name}/tokens", words="bench")
            tokens[name] = str(made["token"])
            slots = [f"{stem}_{name}" for stem in ("program", "eyes", "bumper", "wheels", "lamp")]
            self.do("PUT", f"/class/groups/{name}", pupils=[f"pupil {name}"], slots=slots)
            for slot in slots[1:]:
                self.do("POST", f"/slots/{slot}/simulate", end=False)
        return tokens

    def active(self) -> int:
        """Active parts."""
        slots = self.do("GET", "/robot")["slots"]
        assert isinstance(slots, list)
        return sum(slot["state"] == "active" for slot in slots)

    def used_s(self) -> float:
        """Processor time of the master, seconds."""
        return cpu_s(self.process.pid)

    def memory_mb(self) -> float:
        """Memory of the master, shared pages by their share."""
        rollup = Path(f"/proc/{self.process.pid}/smaps_rollup").read_text()
        found = re.search(r"^Pss:\s+(\d+)", rollup, re.M)
        assert found
        return int(found[1]) / 1024

    def close(self) -> None:
        """End the master."""
        self.client.close()
        self.process.terminate()
        self.process.wait(30)


@contextlib.contextmanager
def browsers(site: Site, names: list[str]) -> Iterator[list[float]]:
    """Tabs of a real browser in which pupils run the program; yields how long the page Program took in each, s."""
    if not names:
        yield []
        return
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if path is None:
        raise SystemExit("there is no Chromium: --tabs 0")
    loads = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        for name in names:
            page = browser.new_context().new_page()
            page.set_default_timeout(LONGEST_S * 1000)
            page.goto(f"{site.base}/login?next=/program")
            page.fill("[name=name]", f"pupil {name}")
            page.fill("[name=password]", PASSWORD)
            began = time.monotonic()
            page.click("button[type=submit]")
            page.wait_for_selector(".cm-content")
            loads.append(time.monotonic() - began)
            page.wait_for_function("document.querySelector('.cm-content').innerText.includes('import')")
            page.locator(".cm-content").click()
            page.keyboard.press("Control+a")
            page.keyboard.insert_text(PROGRAM)
            page.get_by_role("button", name="Run", exact=True).click()
            page.wait_for_selector("#ms-prog-state[data-state=active]")
        yield loads
        browser.close()


async def play(site: Site, tokens: dict[str, str], seconds: float, in_browser: int) -> dict[str, str]:
    """Let the programs run, and measure."""
    names = site.names[in_browser:]
    pupils = {name: Pupil(number) for number, name in enumerate(names)}
    followers = dict(zip(names, [*names[1:], None], strict=True))
    for name, follower in followers.items():
        if follower is not None:
            sender, taker = pupils[name], pupils[follower]

            @taker.part.on("sound", Level)
            def heard(level: Level, sender: Pupil = sender, taker: Pupil = taker) -> None:
                sent = sender.sent_at.pop(round(level.percent), None)
                if sent is not None:
                    taker.ways_ms.append(1000 * (time.monotonic() - sent))

    address = site.base.replace("http", "ws")
    figures: dict[str, str] = {}
    async with asyncio.TaskGroup() as group:
        began = time.monotonic()
        tasks = [
            group.create_task(pupil.part.run_async(WebSocketClientLink(address, tokens[name])))
            for name, pupil in pupils.items()
        ]
        all_parts = 5 * len(site.names)
        while (here := await asyncio.to_thread(site.active)) < all_parts:
            if time.monotonic() - began > LONGEST_S:
                raise SystemExit(f"only {here} of {all_parts} parts became active")
            await asyncio.sleep(0.2)
        figures["all programs active, from connecting on"] = f"{time.monotonic() - began:.1f} s"
        for pupil in pupils.values():
            pupil.heard = 0
        used, start = site.used_s(), time.monotonic()
        while (now := time.monotonic()) - start < seconds:
            for name, pupil in pupils.items():
                if followers[name] is not None:
                    pupil.ask()
            await asyncio.sleep(max(0.0, PERIOD_S - (time.monotonic() - now)))
        span = time.monotonic() - start
        figures["the master, of one core"] = f"{100 * (site.used_s() - used) / span:.0f} %"
        figures["the master, memory"] = f"{site.memory_mb():.0f} MB"
        rate = sum(pupil.heard for pupil in pupils.values()) / span / len(pupils)
        figures["distances that a program gets, of 10 a second"] = f"{rate:.1f}"
        ways = sorted(way for pupil in pupils.values() for way in pupil.ways_ms)
        figures["a message from program to program, median / 99 of 100"] = (
            f"{ways[len(ways) // 2]:.0f} / {ways[int(len(ways) * 0.99)]:.0f} ms" if ways else "none came"
        )
        loads = []
        for _ in range(5):
            at = time.monotonic()
            await asyncio.to_thread(site.client.get, "/program")
            loads.append(time.monotonic() - at)
        figures["the page Program from the server, median"] = f"{1000 * sorted(loads)[2]:.0f} ms"
        at = time.monotonic()
        await asyncio.to_thread(site.do, "POST", "/class/freeze", reason="")
        answered = time.monotonic() - at
        end = at + 30
        while any(pupil.lost_at < at for pupil in pupils.values()) and time.monotonic() < end:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        last = max(pupil.lost_at for pupil in pupils.values()) - at
        figures["freeze: nothing passes any more / the last program knows"] = (
            f"{1000 * answered:.0f} / {1000 * last:.0f} ms"
        )
        await asyncio.to_thread(site.do, "POST", "/class/thaw")
        await asyncio.sleep(1.0)
        await asyncio.to_thread(site.do, "POST", "/stop", reason="bench")
        state: dict[str, list[object]] = {"silent": [1], "confirmed": []}
        end = time.monotonic() + 30
        while state["silent"] and time.monotonic() < end:
            await asyncio.sleep(0.3)
            found = (await asyncio.to_thread(site.do, "GET", "/robot"))["stop"]
            assert isinstance(found, dict)
            state = found
        times = sorted(float(one["ms"]) for one in state["confirmed"] if isinstance(one, dict))
        figures["STOP: confirmed by half / by all parts"] = (
            f"{times[len(times) // 2]:.0f} / {times[-1]:.0f} ms ({len(times)} of {all_parts})" if times else "by none"
        )
        for task in tasks:
            task.cancel()
    return figures


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pupils", type=int, default=30)
    parser.add_argument("--tabs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--write", action="store_true")
    wishes = parser.parse_args()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        site = Site(Path(folder), wishes.pupils)
        try:
            tokens = site.prepare()
            with browsers(site, site.names[: wishes.tabs]) as loads:
                figures = _in_thread(play(site, tokens, wishes.seconds, wishes.tabs))
        finally:
            site.close()
    lines = [
        f"{describe_machine()}; load {load:.1f} before",
        "",
        f"| {wishes.pupils} pupils, {5 * wishes.pupils} parts, {wishes.tabs} of the programs in real browsers | |",
        "|---|---|",
    ]
    if loads:
        figures["sign in until the page Program can be used, real browser"] = f"{max(loads):.1f} s at most"
    lines += [f"| {what} | {value} |" for what, value in figures.items()]
    table = "\n".join(lines)
    print(table)
    if wishes.write:
        write_result("classroom", "A class at one robot", lines, made_by="python -m bench.classroom --write")


def _in_thread(work: Coroutine[None, None, dict[str, str]]) -> dict[str, str]:
    """Playwright has a loop of its own in this thread, in which no other can begin or end."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


if __name__ == "__main__":
    main()
