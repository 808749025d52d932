"""The page Class with many robots: how long it takes to load, and what it costs while it is open.

    python -m bench.class_page [--robots 100] [--pictures FOLDER]

The robots are entries of one database, each with its blueprint; one of them runs here with the page, two more run here
with databases of their own, two run as if on other computers (with an access), and one access leads nowhere. All is on
127.0.0.1, in processes of their own.
"""

from __future__ import annotations

import argparse
import os
import re
import secrets
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from itertools import product
from pathlib import Path

from click.testing import CliRunner
from playwright.sync_api import Page, sync_playwright

from bench.machine import cpu_s
from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_web.cli.user_commands import user_command as user
from tests.e2e.processes import Process
from tests.web.browser.conftest import ARGUMENTS, chromium, free_port, go

WATCHED_S = 20.0
PASSWORD = "correct horse"
WIDTHS = {"desk": (1280, 860), "phone": (390, 844)}


def blueprint(folder: Path, name: str, serial: str) -> Path:
    line = next(line for line in SAMPLE_ROBOT_TOML.splitlines() if line.startswith("serial_number"))
    path = folder / f"{name}.toml"
    path.write_text(SAMPLE_ROBOT_TOML.replace(line, f'serial_number = "{serial}"'))
    return path


def fill(folder: Path, robots: int) -> float:
    """All robots into one database; returns how long one takes, in seconds."""
    library = load_library()
    began = time.perf_counter()
    with open_registry(str(folder / "robot.db")) as registry:
        for number in range(1, robots + 1):
            text = blueprint(folder, "robot", f"R{number}").read_text()
            if number % 10 == 0:  # every tenth has another blueprint
                text += '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n'
            registry.robots.apply_blueprint(parse_blueprint(text, library), library)
    return (time.perf_counter() - began) / robots


def person(db: Path, name: str, role: str) -> str:
    """Somebody who may sign in there; returns an API token."""
    there = ["--db", str(db)]
    runner = CliRunner()
    added = runner.invoke(user, ["add", name, "--role", role, "--password-stdin", *there], input=f"{PASSWORD}\n")
    assert added.exit_code == 0, added.exception
    return runner.invoke(user, ["token", name, "class", *there]).output.strip()


def watch(page: Page, pid: int, address: str) -> None:
    """Print what the open page costs."""
    received = [0]

    def count(frame: object) -> None:
        received[0] += len(frame) if isinstance(frame, str | bytes) else 0

    page.on("websocket", lambda ws: ws.on("framereceived", count))
    began = time.perf_counter()
    page.goto(f"{address}/class")
    page.locator(".slot").nth(50).wait_for()
    print(f"loaded, tiles there after {time.perf_counter() - began:.2f} s")
    page.wait_for_timeout(3000)
    received[0], used, began = 0, cpu_s(pid), time.perf_counter()
    page.wait_for_timeout(WATCHED_S * 1000)
    seconds = time.perf_counter() - began
    print(
        f"open: {received[0] / seconds:.0f} bytes/s to the browser, "
        f"{(cpu_s(pid) - used) / seconds * 100:.1f} % of a processor for master and page"
    )
    page.get_by_label("Search").fill("R42")
    began = time.perf_counter()
    page.wait_for_function("[...document.querySelectorAll('.slot')].filter(one => one.offsetParent).length == 1")
    print(f"search: {time.perf_counter() - began:.2f} s")
    page.get_by_label("Search").fill("")


def pictures(page: Page, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for (name, (width, height)), look in product(WIDTHS.items(), ("light", "dark")):
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme="dark" if look == "dark" else "light")
        page.wait_for_timeout(1200)
        page.screenshot(path=str(folder / f"class-{name}-{look}.png"))


def main(robots: int, folder_of_pictures: Path | None) -> int:
    path = chromium()
    if path is None:
        print("no Chromium on this machine", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder, word = Path(name), secrets.token_hex(3)
        here = {"XDG_STATE_HOME": f"{folder}/state", "XDG_RUNTIME_DIR": str(folder), "MSBOT_STOP_GROUP": word}
        os.environ.update(here)
        print(f"load of this computer before: {os.getloadavg()[0]:.1f}")
        print(f"{robots} robots stored, {fill(folder, robots) * 1000:.0f} ms each")
        person(folder / "robot.db", "ann", "administrator")
        blueprint(folder, "robot", "R1")

        def run(*words: str, env: dict[str, str] | None = None) -> Process:
            process = Process("master", *words, cwd=folder, env=env)
            stack.callback(process.end, signal.SIGKILL)
            return process

        started = []
        for number in (1, 2):
            made = blueprint(folder, f"near{number}", f"NEAR{number}")
            started.append((run(made.name, "--port", "0", "--link", f"sim:n{word}{number}"), "The page is at"))
            away = folder / f"away{number}"
            away.mkdir()
            made = blueprint(folder, f"far{number}", f"FAR{number}")
            with open_registry(str(made.with_suffix(".db"))) as registry:
                library = load_library()
                registry.robots.apply_blueprint(parse_blueprint(made.read_text(), library), library)
            token, port = person(made.with_suffix(".db"), "lab", "viewer"), free_port()
            elsewhere = {"XDG_RUNTIME_DIR": str(away), "MSBOT_STOP_GROUP": f"{word}{number}"}
            started.append(
                (run(made.name, "--port", str(port), "--link", f"sim:f{word}{number}", env=elsewhere), "The page is at")
            )
            RemoteAccessFile().add(RemoteAccess(f"http://127.0.0.1:{port}", token, "MSBOT_MASTER", f"FAR{number}"))
        RemoteAccessFile().add(RemoteAccess(f"http://127.0.0.1:{free_port()}", "msbot_x", "MSBOT_MASTER", "GONE"))
        main_robot = run("robot.toml", "--port", "0", "--link", f"sim:m{word}")
        for process, words in started:
            process.wait_for(words)
        found = re.search(r"https?://\S+", main_robot.wait_for("The page is at"))
        assert found is not None
        address = found[0].partition("/setup")[0]
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        page = browser.new_context(viewport={"width": 1280, "height": 860}, locale="en-GB").new_page()
        page.set_default_timeout(60_000)
        page.goto(f"{address}/login")
        page.locator("input[name=name]").fill("ann")
        page.locator("input[name=password]").fill(PASSWORD)
        page.locator("button[type=submit]").click()
        page.wait_for_url(f"{address}/")
        watch(page, main_robot.pid, address)
        page.reload()
        go(page, f"{address}/class")
        page.locator(".slot").nth(50).wait_for()
        if folder_of_pictures is not None:
            pictures(page, folder_of_pictures)
        page.set_viewport_size({"width": 1280, "height": 860})
        began = time.perf_counter()
        page.get_by_role("button", name="STOP all robots of the class").click()
        page.get_by_text("NOT stopped: 1 robots on other computers").wait_for()
        print(f"STOP: told to all, and who does not answer named, after {time.perf_counter() - began:.2f} s")
        if folder_of_pictures is not None:
            page.screenshot(path=str(folder_of_pictures / "class-stopped.png"))
        browser.close()
        print(f"load of this computer after: {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--robots", type=int, default=100)
    asked.add_argument("--pictures", type=Path)
    wishes = asked.parse_args()
    sys.exit(main(wishes.robots, wishes.pictures))
