"""What the page costs: a robot of 120 simulated parts, and no, one, or three browsers that look at it.

    python -m bench.page [--parts 120] [--seconds 10]

Master, parts and browsers are processes of their own, joined by UDP and HTTP, in real time. The page's share is what
the master needs more than the same master without a page. Needs Chromium.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from random import randbytes

from playwright.sync_api import Browser, Page, sync_playwright

from bench.machine import describe_machine
from msbot.config import load_blueprint, load_library
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.registry import open_registry
from msbot.sim import make_simulator
from msbot_agent.link import open_link
from msbot_agent.process.user_folders import PACKAGES

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
BROWSERS = (0, 1, 3)
REPEATS = 3
LINK = "udp:127.0.0.1:18888"
SETTLE_S = 4.0
PATIENCE_MS = 60_000

_ROBOT = """\
[robot]
name = "CROWD"
version = "CROWD_V1"
serial_number = "C-0001"
released = "2026"
manufacturer = "MsBOT"
"""
_PAIR = """
[[slot]]
name = "knob{0:02}"
part = "POT-10K"
settings = {{ period_s = 1.0 }}

[[slot]]
name = "fan{0:02}"
part = "FAN-5V"

[[binding]]
topic = "power{0:02}"
type = "Level"
from = "knob{0:02}.level"
to = ["fan{0:02}.power"]
"""


async def serve(parts: int, *, with_page: bool) -> None:
    """Run the master; each line that comes in is answered by the CPU seconds so far and how many slots are active."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_text(_ROBOT + "".join(_PAIR.format(pair) for pair in range(parts // 2)))
        library = load_library()
        blueprint = load_blueprint(path, library)
        address = str(Path(folder) / "robot.db")
        with open_registry(address) as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            master = Master(blueprint, registry.runs.begin(record))
            link = open_link(LINK, serve=True)
            master.add_link(link)
            async with asyncio.TaskGroup() as tasks:
                if with_page:
                    from msbot_school.demo.gallery import ROVER
                    from msbot_web.assembly import Database, PageSources, RobotPages
                    from msbot_web.frame_ring import FrameRing
                    from msbot_web.gallery import RunningDemo
                    from msbot_web.server import WebSettings

                    room = RobotPages(
                        master,
                        InProcessOperations(master, registry, record, library=library),
                        library,
                        database=Database(registry, record, address),
                        seen=PageSources(FrameRing()),
                        settings=WebSettings(port=0),
                        demo=RunningDemo(ROVER, print),
                    )
                    tasks.create_task(room.run())
                    await room.server.ready.wait()
                    print(room.server.link, flush=True)
                else:
                    print("no page", flush=True)
                tasks.create_task(master.run())
                while await asyncio.to_thread(sys.stdin.readline):
                    now = asyncio.get_running_loop().time()
                    active = sum(info.state.value == "active" for info in master.inventory.view(now))
                    print(json.dumps({"cpu_s": time.process_time(), "active": active}), flush=True)


async def be_parts(parts: int) -> None:
    """Run all parts until the process is killed."""
    library = load_library()
    for package in PACKAGES:  # each says when STOP comes
        logging.getLogger(package).setLevel(logging.ERROR)
    async with asyncio.TaskGroup() as tasks:
        for number in range(parts):
            kind, name = (("FAN-5V", "fan"), ("POT-10K", "knob"))[number % 2]
            simulated = make_simulator(kind, local_name=f"{name}{number // 2:02}", library=library, uid=randbytes(8))
            tasks.create_task(simulated.part.run_async(open_link(LINK)))


class Robot:
    """The robot in its own process."""

    def __init__(self, parts: int, *, with_page: bool) -> None:
        words = [sys.executable, "-m", "bench.page", "--parts", str(parts)]
        serve = [*words, "--serve"] if with_page else [*words, "--serve", "--no-page"]
        self._process = subprocess.Popen(serve, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.link = self._process.stdout.readline().strip()
        self._parts = subprocess.Popen([*words, "--be-parts"], stdout=subprocess.DEVNULL)

    def look(self) -> dict[str, float]:
        """CPU seconds so far, and active slots."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        found: dict[str, float] = json.loads(self._process.stdout.readline())
        return found

    def wait_for_active(self, parts: int) -> None:
        """Wait until all parts are in."""
        until = time.monotonic() + PATIENCE_MS / 1000
        while self.look()["active"] < parts:
            if time.monotonic() > until:
                raise SystemExit("the robot is not complete: the machine has no time for it")
            time.sleep(0.5)

    def load_percent(self, seconds: float) -> float:
        """CPU of the process, in percent of one core, over some time."""
        loads = []
        for _ in range(REPEATS):
            before, at = self.look()["cpu_s"], time.monotonic()
            time.sleep(seconds)
            loads.append(100 * (self.look()["cpu_s"] - before) / (time.monotonic() - at))
        return statistics.median(loads)

    def end(self) -> None:
        """End it."""
        for process in (self._parts, self._process):
            process.kill()
            process.communicate()


def open_home(browser: Browser, link: str) -> tuple[Page, float]:
    """A visitor on the home page, and seconds until its cards were there."""
    page = browser.new_context(viewport={"width": 1280, "height": 860}).new_page()
    page.set_default_timeout(PATIENCE_MS)
    began = time.monotonic()
    page.goto(link)
    page.get_by_role("button", name="Open slot knob00").wait_for()
    return page, time.monotonic() - began


def change_s(page: Page) -> float:
    """Seconds from a change that somebody else makes until the page shows it."""
    base = page.url.rpartition("/")[0]
    ask = page.context.request
    headers = {"x-csrf-token": ask.get(f"{base}/api/me").json()["csrf"]}
    began = time.monotonic()
    ask.post(f"{base}/api/stop", headers=headers, data={"words": "bench"})
    page.get_by_text("STOP by").wait_for()
    took = time.monotonic() - began
    ask.post(f"{base}/api/go", headers=headers)
    page.get_by_text("STOP by").wait_for(state="detached")
    return took


def measure(parts: int, seconds: float) -> None:
    """Print the table."""
    plain = Robot(parts, with_page=False)
    plain.wait_for_active(parts)
    time.sleep(SETTLE_S)
    without = plain.load_percent(seconds)
    plain.end()
    print(f"{describe_machine()}; {parts} parts, median of {REPEATS} times {seconds:g} s\n")
    print("| browsers | CPU of the master | for the page | home page there | a change is shown |")
    print("|---|---|---|---|---|")
    print(f"| no page | {without:.1f} % | - | - | - |")
    robot = Robot(parts, with_page=True)
    robot.wait_for_active(parts)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium") or shutil.which("google-chrome"), args=ARGUMENTS
        )
        pages: list[Page] = []
        opened: list[float] = []
        for count in BROWSERS:
            while len(pages) < count:
                page, took = open_home(browser, robot.link)
                pages.append(page)
                opened.append(took)
            time.sleep(SETTLE_S)
            load = robot.load_percent(seconds)
            shown = statistics.median(change_s(pages[0]) for _ in range(3)) if pages else None
            print(
                f"| {count} | {load:.1f} % | {load - without:.1f} % | "
                f"{f'{max(opened):.1f} s' if opened else '-'} | {'-' if shown is None else f'{shown:.2f} s'} |",
                flush=True,
            )
        browser.close()
    robot.end()


def main() -> None:
    """Measure, or be the robot."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--parts", type=int, default=120)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--no-page", action="store_true")
    parser.add_argument("--be-parts", action="store_true")
    options = parser.parse_args()
    if options.serve:
        asyncio.run(serve(options.parts, with_page=not options.no_page))
    elif options.be_parts:
        asyncio.run(be_parts(options.parts))
    else:
        measure(options.parts, options.seconds)


if __name__ == "__main__":
    main()
