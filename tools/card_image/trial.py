"""Tries the card's image in a virtual computer: the first start, a part over UDP, cuts of the power, an update.

    .venv/bin/python -m tools.card_image.trial build/image/msbot-pi.img [--cuts 20] [--package FILE]
                                                                                            (or: make image-test)

The image itself stays as it is: a copy, larger as a card is, is tried. Each cut comes while changes are being made;
each change whose answer came before it has to be there after the next start. The disk loses by chance what was not
flushed (`forgetful_disk.py`). `--write` stores the figures in bench/results/card_image.md.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import httpx

from bench.machine import describe_machine
from bench.result import write_result
from tools.card_image import base, partitions
from tools.card_image.base import ImageError, run
from tools.card_image.machine import MEMORY_MB, Machine

CARD_SIZE = 4 << 30
"""Of the card that is tried."""
PATIENCE_S = 1800.0
"""How long a start may take: software emulation, maybe on a busy computer."""
STAGES = {
    "Linux": r"Booting Linux|Linux version",
    "the root is there": r"systemd\[1\]: systemd \S+ running|Welcome to",
    "the card's settings": r"Finished .*Settings of the MsBOT card",
    "network": r"Reached target (network\.target - )?Network\.",
    "the master starts": r"Started .*MsBOT robot: master",
}
"""What the console says, in the order of a start."""
NAME, PASSWORD = "ada", "correct horse"
SOURCE = "ABCD"
"""The part number of the slot AA of the sample robot."""


class Robot:
    """The robot on the card, by its page.

    Args:
        machine: where it runs.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{machine.page_port}", timeout=30)

    def wait_for_page(self) -> float:
        """Wait until the page is healthy; returns seconds since the power came."""

        def healthy() -> bool:
            try:
                return self.client.get("/api/health").status_code == 200
            except httpx.HTTPError:
                return False

        wait_for(self.machine, healthy, "the page")
        return self.machine.seconds()

    def set_up(self) -> None:
        """Be the first visitor, and get a token for what follows."""
        form = self.client.get("/login").text
        found = re.search(r'name="token" value="([^"]+)"', form)
        if found is None:
            raise ImageError("the page does not offer the first visitor to set it up:\n" + form[:2000])
        answers = {"token": found[1], "name": NAME, "password": PASSWORD, "again": PASSWORD}
        done = self.client.post("/setup", data=answers, timeout=120)
        if done.status_code != 303:
            raise ImageError(f"the set-up is refused with {done.status_code}: {done.text[:2000]}")
        self.client.headers["x-csrf-token"] = self.ask("GET", "/api/me")["csrf"]
        token = self.ask("POST", f"/api/users/{NAME}/tokens", {"words": "trial"})["token"]
        self.client.cookies.clear()
        del self.client.headers["x-csrf-token"]
        self.client.headers["authorization"] = f"Bearer {token}"

    def ask(self, method: str, path: str, body: object = None, *, content: bytes | None = None) -> dict[str, object]:
        """A call of the API.

        Raises:
            ImageError: it is refused.
            httpx.HTTPError: nobody answers.
        """
        answer = self.client.request(method, path, json=body, content=content, timeout=900 if content else 120)
        if answer.status_code != 200:
            raise ImageError(f"{method} {path}: {answer.status_code} {answer.text[:1000]}")
        return answer.json()


def wait_for(machine: Machine, what: Callable[[], bool], name: str, within_s: float = PATIENCE_S) -> None:
    """Wait for something of a running machine.

    Raises:
        ImageError: it does not come, or the machine goes off.
    """
    until = time.monotonic() + within_s
    while not what():
        machine.need_on()
        if time.monotonic() > until:
            raise ImageError(f"{name} does not come within {within_s:.0f} s:\n{machine.console[-4000:]}")
        time.sleep(0.5)


class Stages:
    """Notes when the console says that a stage is reached."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.seconds: dict[str, float] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while not self._over.wait(0.2):
            console = self._machine.console
            for name, pattern in STAGES.items():
                if name not in self.seconds and re.search(pattern, console):
                    self.seconds[name] = self._machine.seconds()

    def end(self) -> dict[str, float]:
        """What was reached, and when."""
        self._over.set()
        self._thread.join()
        return self.seconds


class Changes:
    """Makes one change after the other, and knows which were acknowledged.

    Args:
        robot: whose.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._number = 0
        self.acknowledged = 0
        self._tokens: set[str] = set()
        self._programs: dict[str, set[str | None]] = {}
        """By name: the texts that it may have; None: there may be none."""
        self._bitrates: set[object] = set()
        self.refused = ""
        """Why a change was refused: then the trial itself is wrong."""

    def make_until(self, over: threading.Event) -> None:
        """Make changes until nobody answers any more; the last of them may have been made, or not."""
        self._bitrates = {self._bitrate()}
        while not over.is_set():
            self._number += 1
            number = self._number
            try:
                match number % 3:
                    case 0:
                        name = f"cut {number}"
                        self._robot.ask("POST", f"/api/users/{NAME}/tokens", {"words": name})
                        self._tokens.add(name)
                    case 1:
                        name, text = f"program-{number % 5}.py", f"# {number}\n"
                        self._programs[name] = self._programs.get(name, {None}) | {text}
                        self._robot.ask("PUT", f"/api/programs/{name}", {"text": text})
                        self._programs[name] = {text}
                    case _:
                        rate = 100_000 + number
                        self._bitrates.add(rate)
                        self._robot.ask("PATCH", "/api/card", {"hardware": {"can_bitrate": rate}})
                        self._bitrates = {rate}
            except httpx.HTTPError:
                return
            except ImageError as error:
                self.refused = str(error)
                return
            self.acknowledged += 1

    def missing(self) -> list[str]:
        """What was acknowledged and is not there."""
        lost = []
        people = self._robot.ask("GET", "/api/users")
        tokens = {token for person in people for token in person["tokens"]}  # type: ignore[index,attr-defined]
        lost += [f"the token {name!r}" for name in sorted(self._tokens - tokens)]
        for name, texts in self._programs.items():
            found = self._program(name)
            if found not in texts:
                lost.append(f"{name!r}: {found!r} in place of {texts}")
            self._programs[name] = {found}
        if (rate := self._bitrate()) not in self._bitrates:
            lost.append(f"the bit rate: {rate} in place of {self._bitrates}")
        for name in sorted(tokens):
            if str(name).startswith("cut "):  # a person has 50 at most
                self._robot.ask("DELETE", f"/api/users/{NAME}/tokens/{name}")
        self._tokens.clear()
        return lost

    def _bitrate(self) -> object:
        return self._robot.ask("GET", "/api/card")["settings"]["can_bitrate"]  # type: ignore[index]

    def _program(self, name: str) -> str | None:
        answer = self._robot.client.get(f"/api/programs/{name}")
        if answer.status_code == 404:
            return None
        return str(answer.raise_for_status().json()["text"])


def copied(image: Path, folder: Path) -> Path:
    """A card with the image: larger than it, as cards are."""
    card = folder / "card.img"
    run("cp", "--sparse=always", image, card)
    with card.open("r+b") as file:
        file.truncate(max(CARD_SIZE, image.stat().st_size))
    return card


def part_joins(robot: Robot, folder: Path) -> None:
    """A part on this computer joins the robot in the machine, over UDP."""
    link = f"udp:127.0.0.1:{robot.machine.parts_port}"
    words = [sys.executable, "-m", "msbot", "part", SOURCE, "--link", link]
    with (folder / "part.log").open("wb") as log:
        environment = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
        part = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=log, stderr=log, cwd=folder, env=environment)
        try:
            wait_for(
                robot.machine,
                lambda: robot.ask("GET", "/api/slots/AA").get("part") is not None,
                f"the part (its log: {folder / 'part.log'})",
                300,
            )
        finally:
            part.kill()
            part.wait()


def check_file_systems(card: Path, folder: Path) -> int:
    """Both file systems that are written to are whole; returns the size of the data partition.

    Raises:
        ImageError: one is damaged.
    """
    with card.open("rb") as file:
        _, (boot, _, data) = partitions.read(file.read(512))
    for name, place, command in (
        ("boot.check", boot, ("fsck.vfat", "-n")),
        # A journal that has to be replayed is no damage: -p does that, and fails at anything else.
        ("data.check", data, ("e2fsck", "-p")),
    ):
        system = folder / name
        words = (f"if={card}", f"of={system}", "bs=4M", f"skip={place.start >> 22}", f"count={place.size >> 22}")
        run("dd", *words, "conv=sparse", "status=none")
        done = subprocess.run([*command, str(system)], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise ImageError(f"{name}: {done.stdout}{done.stderr}")
        system.unlink()
    return data.size


def try_cuts(robot: Robot, count: int, seed: int) -> list[str]:
    """Cut the power again and again; returns the lines of the table."""
    chance, changes, rows, machine = random.Random(seed), Changes(robot), [], robot.machine
    for number in range(1, count + 1):
        before, lost_before = changes.acknowledged, machine.disk.lost
        over = threading.Event()
        maker = threading.Thread(target=changes.make_until, args=(over,), daemon=True)
        maker.start()
        wait_for(machine, lambda before=before: changes.acknowledged > before or changes.refused, "a change")  # type: ignore[misc]
        time.sleep(chance.uniform(0.5, 8.0))
        if changes.refused:
            raise ImageError(changes.refused)
        machine.cut_power()
        over.set()
        maker.join()
        made, dropped = changes.acknowledged - before, machine.disk.lost - lost_before
        machine.switch_on()
        seconds = robot.wait_for_page()
        lost = changes.missing()
        rows.append(f"| {number} | {made} | {dropped} | {seconds:.0f} | {len(lost)} |")
        say(rows[-1])
        if lost:
            raise ImageError(f"cut {number} of {count}: acknowledged and lost: {'; '.join(lost)}")
    return rows


def later_version(package: Path, folder: Path, version: str, *, broken: bool) -> Path:
    """The same package as a later version; a broken one has a master that ends at once."""
    tree = folder / version
    run("dpkg-deb", "--raw-extract", package, tree)
    control = tree / "DEBIAN/control"
    control.write_text(re.sub(r"(?m)^Version: .*$", f"Version: {version}", control.read_text("utf-8")), "utf-8")
    if broken:
        (tree / "usr/lib/msbot/bin/msbot").write_text("#!/bin/sh\nexit 1\n", "utf-8")
    made = folder / f"msbot_{version}_arm64.deb"
    run("dpkg-deb", "--root-owner-group", "-Zzstd", "-z3", "--build", tree, made)
    base.remove_folder(tree)
    return made


def try_updates(robot: Robot, package: Path, folder: Path) -> list[str]:
    """A good update stays; one whose master ends at once falls back by itself."""
    lines = []
    for version, broken, told in (("9.0.0", False, "updated"), ("9.9.9", True, "fell back")):
        made = later_version(package, folder, version, broken=broken)
        done = robot.ask("POST", "/api/card/update", content=made.read_bytes())
        say(str(done["words"]))
        robot.ask("POST", "/api/card/restart")

        def has_told(told: str = told) -> bool:
            try:
                return bool(robot.ask("GET", "/api/card")["versions"]["told"] == told)  # type: ignore[index]
            except (httpx.HTTPError, ImageError):
                return False

        wait_for(robot.machine, has_told, f"{version}: {told}")
        versions = robot.ask("GET", "/api/card")["versions"]
        made.unlink()
        kind = "whose master ends at once" if broken else "that is well"
        lines.append(f"| {version}, {kind} | {told} | {versions['current'] or 'that of the image'} |")  # type: ignore[index]
        say(lines[-1])
    return lines


def main() -> int:
    """Try it; returns 1 with the reason if something is not as it should be."""
    parser = argparse.ArgumentParser(prog="make image-test")
    parser.add_argument("image", type=Path)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--package", type=Path, help="the package in the image: updates are made of it, and tried")
    parser.add_argument("--folder", type=Path, help="where the card and the console's text stay")
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the machine ends with its trial
    with tempfile.TemporaryDirectory(prefix="msbot-card-") as scratch:
        folder = asked.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        machine = Machine(copied(asked.image, folder), folder, asked.seed)
        try:
            lines = tried(machine, folder, asked)
        except (ImageError, httpx.HTTPError, TimeoutError) as error:
            sys.stderr.write(f"image-test: {error}\n")
            return 1
        finally:
            machine.close()
        size = check_file_systems(folder / "card.img", folder)
    if size < CARD_SIZE // 2:
        sys.stderr.write(f"image-test: the data partition has not grown: {size} octets\n")
        return 1
    lines += [
        "",
        f"Afterwards both file systems are whole, and the data partition has {size / 1e9:.1f} GB of the card.",
    ]
    if asked.write:
        write_result(
            "card_image", "The card's image in a virtual computer", lines, made_by="make image-test ARGS=--write"
        )
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def tried(machine: Machine, folder: Path, asked: argparse.Namespace) -> list[str]:
    """All trials; returns the text of the result."""
    robot = Robot(machine)
    load = os.getloadavg()[0]
    stages = Stages(machine)
    machine.switch_on()
    page = robot.wait_for_page()
    seconds = {**stages.end(), "the page": page}
    say(f"the first start: {seconds}")
    robot.set_up()
    joined = time.monotonic()
    part_joins(robot, folder)
    part = time.monotonic() - joined
    say(f"a part has joined after {part:.0f} s")
    lines = [
        f"{describe_machine()}; load {load:.0f}. qemu `virt`, cortex-a72, 2 cores, {MEMORY_MB} MB, all in software: a "
        "Raspberry Pi is faster. Kernel and initramfs are the image's, started by qemu in place of the firmware.",
        "",
        "| the first start | s since the power came |",
        "|---|---|",
        *(f"| {name} | {seconds[name]:.0f} |" for name in (*STAGES, "the page") if name in seconds),
        "",
        f"A part on another computer joined over UDP, {part:.0f} s after its program was started.",
    ]
    if asked.cuts:
        rows = try_cuts(robot, asked.cuts, asked.seed)
        lines += [
            "",
            f"The power was cut {asked.cuts} times while changes were made by the API: API tokens, programs, settings "
            "of the card. The machine is killed, and of each sector that was written since the last flush chance says "
            "whether it is kept.",
            "",
            "| cut | changes acknowledged | sectors lost | s to the page | acknowledged changes lost |",
            "|---|---|---|---|---|",
            *rows,
        ]
    if asked.package:
        lines += ["", "| update | came of it | runs then |", "|---|---|---|"]
        lines += try_updates(robot, asked.package, folder)
    return lines


def say(words: str) -> None:
    """A line for whom waits."""
    sys.stderr.write(words + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    raise SystemExit(main())
