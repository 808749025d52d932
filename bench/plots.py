"""What the page Plots costs: the rover, and a browser that looks at 20 curves of it.

    python -m bench.plots [--seconds 10]

Master, browser and recorder are processes of their own. The page's share is what the master's process needs more than
with no page open. Needs Chromium and Linux.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from bench.machine import cpu_s, describe_machine

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
CURVES = "knob.level,ear.level,eye.colour,fan.power,hand.grip,beacon.colour,@beat,@bus,@late,@frames"
SPANS = (10, 60, 300)
SETTLE_S = 8.0
FRAMES = "msbotPlotsFrames()"


def load(pid: int, seconds: float) -> float:
    """Percent of a processor that a process takes."""
    before, began = cpu_s(pid), time.perf_counter()
    time.sleep(seconds)
    return 100 * (cpu_s(pid) - before) / (time.perf_counter() - began)


def browser_cpu_s(browser: Browser) -> float:
    """Processor time of all processes of a browser, what draws included."""
    session = browser.new_browser_cdp_session()
    found = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return sum(float(one["cpuTime"]) for one in found)


def drawing(browser: Browser, page: Page, pid: int, seconds: float) -> tuple[float, float, float, float]:
    """(percent of a processor for the master, pictures a second, percent of the page's main thread, percent of a
    processor for the browser)."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")

    def busy_s() -> float:
        found = session.send("Performance.getMetrics")["metrics"]
        return next(float(one["value"]) for one in found if one["name"] == "TaskDuration")

    frames, busy, cpu, began = page.evaluate(FRAMES), busy_s(), browser_cpu_s(browser), time.perf_counter()
    share = load(pid, seconds)
    took = time.perf_counter() - began
    rate = (page.evaluate(FRAMES) - frames) / took
    return share, rate, 100 * (busy_s() - busy) / took, 100 * (browser_cpu_s(browser) - cpu) / took


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    print(describe_machine())
    command = [sys.executable, "-m", "msbot", "demo", "--robot", "rover", "--port", "0"]
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "said").open("w") as said:
        process = subprocess.Popen(command, stdout=said, cwd=folder)
        try:
            while not (found := re.search(r"https?://\S+", Path(said.name).read_text())):
                time.sleep(0.2)
            time.sleep(SETTLE_S)
            print(f"no page open: the master takes {load(process.pid, seconds):.1f} % of a processor")
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
                page = browser.new_page(viewport={"width": 1280, "height": 900})
                page.goto(found[0])
                base = re.sub(r"/enter\?.*", "", found[0])
                for span in SPANS:
                    page.goto(f"{base}/plots?show={CURVES}&span={span}")
                    page.wait_for_function(f"window.msbotPlotsFrames && {FRAMES} > 5")
                    time.sleep(SETTLE_S)
                    curves = page.locator("#ms-plot-figures tr[data-place]").count()
                    share, rate, busy, whole = drawing(browser, page, process.pid, seconds)
                    print(
                        f"{curves} curves, {span} s: the master {share:.1f} %, {rate:.1f} pictures/s, "
                        f"the page's main thread {busy:.0f} %, the browser {whole:.0f} % of a processor"
                    )
                browser.close()
        finally:
            process.terminate()
            process.wait()


if __name__ == "__main__":
    main()
