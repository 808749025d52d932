"""Tries the card's image in a virtual computer: the first start, a part over UDP, cuts of the power, set-up, updates.

    .venv/bin/python -m tools.card_image.trial build/image/msbot-pi.img --package FILE [--only cuts] [--cuts 20]
                                                                                            (or: make image-test)

The image itself stays as it is: a copy, larger as a card is, is tried. Each cut comes while changes are being made;
each change whose answer came before it has to be there after the next start. The disk loses by chance what was not
flushed (`forgetful_disk.py`). `--write` stores the figures in bench/results/card_image*.md.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import httpx

from bench.machine import describe_machine
from bench.result import write_result
from tools.card_image import partitions
from tools.card_image.base import ImageError, run
from tools.card_image.cuts import try_cuts
from tools.card_image.machine import MEMORY_MB, Machine
from tools.card_image.robot import STAGES, Robot, Stages, say, wait_for
from tools.card_image.set_up_trial import SetUpTrial
from tools.card_image.updates_trial import try_updates

CARD_SIZE = 4 << 30
"""Of the card that is tried."""
SOURCE = "ABCD"
"""The part number of the slot AA of the sample robot."""


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


def started(robot: Robot) -> list[str]:
    """The first start; returns the lines of the result."""
    load = os.getloadavg()[0]
    stages = Stages(robot.machine)
    robot.machine.switch_on()
    page = robot.wait_for_page()
    seconds = {**stages.end(), "the page": page}
    say(f"the first start: {seconds}")
    robot.set_up()
    return [
        computer(load),
        "",
        "| the first start | s since the power came |",
        "|---|---|",
        *(f"| {name} | {seconds[name]:.0f} |" for name in (*STAGES, "the page") if name in seconds),
    ]


def computer(load: float) -> str:
    """What was tried where."""
    return (
        f"{describe_machine()}; load {load:.0f}. qemu `virt`, cortex-a72, 2 cores, {MEMORY_MB} MB, all in software: a "
        "Raspberry Pi is faster. Kernel and initramfs are the image's, started by qemu in place of the firmware."
    )


def cuts(card: Path, folder: Path, asked: argparse.Namespace) -> list[str]:
    """First start, a part over UDP, cuts of the power; returns the text of the result."""
    machine = Machine(card, folder, asked.seed)
    try:
        robot = Robot(machine)
        lines = started(robot)
        joined = time.monotonic()
        part_joins(robot, folder)
        seconds = time.monotonic() - joined
        say(f"a part has joined after {seconds:.0f} s")
        rows = try_cuts(robot, asked.cuts, asked.seed) if asked.cuts else []
    finally:
        machine.close()
    size = check_file_systems(card, folder)
    if size < CARD_SIZE // 2:
        raise ImageError(f"the data partition has not grown: {size} octets")
    return [
        *lines,
        "",
        f"A part on another computer joined over UDP, {seconds:.0f} s after its program was started.",
        "",
        f"The power was cut {len(rows)} times while changes were made by the API, three at a time: API tokens, "
        "programs, settings of the card. The machine is killed at any moment, in the middle of a write, or before a "
        "flush, which is never answered then; chance says of each sector that was written since the last flush whether "
        "it is kept. What the machine starts from again is only what the disk has kept.",
        "",
        "| cut | moment | changes acknowledged | sectors not flushed | of these lost | s to the page | changes lost |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "",
        f"Afterwards both file systems are whole, and the data partition has {size / 1e9:.1f} GB of the card.",
    ]


def set_up(card: Path, folder: Path, asked: argparse.Namespace) -> list[str]:
    """A first start with a set-up file, adapters, Wi-Fi; returns the text of the result."""
    load, one = os.getloadavg()[0], SetUpTrial(card, folder, asked.seed)
    try:
        return [computer(load), "", *one.run()]
    finally:
        one.close()


def updates(card: Path, folder: Path, asked: argparse.Namespace) -> list[str]:
    """Updates by the page; returns the text of the result."""
    machine = Machine(card, folder, asked.seed)
    try:
        robot = Robot(machine)
        lines = started(robot)
        rows = try_updates(robot, asked.package, folder)
    finally:
        machine.close()
    return [*lines, "", "| update | came of it | runs then |", "|---|---|---|", *rows]


RESULTS = {
    "cuts": ("card_image", "The card's image in a virtual computer: cuts of the power", cuts),
    "set-up": ("card_image_set_up", "The card's image in a virtual computer: set-up and adapters", set_up),
    "updates": ("card_image_updates", "The card's image in a virtual computer: updates", updates),
}


def main() -> int:
    """Try it; returns 1 with the reason if something is not as it should be."""
    parser = argparse.ArgumentParser(prog="make image-test")
    parser.add_argument("image", type=Path)
    parser.add_argument("--only", choices=sorted(RESULTS), help="one of the trials")
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--package", type=Path, required=True, help="the package in the image: updates are made of it")
    parser.add_argument("--folder", type=Path, help="where the card and the console's text stay")
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the machine ends with its trial
    for name, (file, title, trial) in RESULTS.items():
        if asked.only not in (None, name):
            continue
        with tempfile.TemporaryDirectory(prefix="msbot-card-") as scratch:
            folder = (asked.folder or Path(scratch)) / name
            folder.mkdir(parents=True, exist_ok=True)
            try:
                lines = trial(copied(asked.image, folder), folder, asked)
            except (ImageError, httpx.HTTPError, TimeoutError) as error:
                sys.stderr.write(f"image-test: {name}: {error}\n")
                return 1
        if asked.write:
            write_result(file, title, lines, made_by=f'make image-test ARGS="--only {name} --write"')
        sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
