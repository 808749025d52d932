"""Tries the card's image in a virtual computer: the first start, a part over UDP, cuts of the power, set-up, updates.

    .venv/bin/python -m tools.card_image.trial build/image/msbot-pi.img --package FILE [--only cuts] [--cuts 20]
                                                                                            (or: make image-test)

The image itself stays as it is: a copy, larger as a card is, is tried. Each cut comes while changes are being made;
each change whose answer came before it has to be there after the next start. The disk loses by chance what was not
flushed (`forgetful_disk.py`). `--write` stores the figures in bench/results/card_image*.md.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import httpx

from bench.machine import describe_machine
from bench.result import write_result
from tools.card_image import partitions
from tools.card_image.base import ImageError, need_programs, run
from tools.card_image.cuts import MOMENTS, Cut, Numbers, try_cuts
from tools.card_image.machine import MEMORY_MB, Machine
from tools.card_image.moments import try_moments
from tools.card_image.robot import STAGES, Robot, Stages, say, wait_for
from tools.card_image.set_up_trial import SetUpTrial
from tools.card_image.shell import Shell, line
from tools.card_image.updates_trial import LONGER, UpdatesTrial

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


def cuts(folder: Path, asked: argparse.Namespace) -> list[str]:
    """First start, a part over UDP, cuts of the power; returns the text of the result."""
    numbers = Numbers(asked.cuts, asked.minutes * 60)
    machines: list[Machine] = []
    with ThreadPoolExecutor(asked.machines) as pool:
        places = [folder / str(one) for one in range(asked.machines)]
        running = [pool.submit(cuts_of_one, place, one, numbers, asked, machines) for one, place in enumerate(places)]
        try:
            for one in as_completed(running):
                one.result()
        except BaseException:
            numbers.end()
            for machine in machines:
                machine.kill()
            raise
    ended = [one.result() for one in running]
    (lines, _, size), *_ = ended
    made = sorted((cut for _, some, _ in ended for cut in some), key=lambda cut: cut.number)
    if asked.cuts >= len(MOMENTS) and not any(cut.waiting for cut in made):
        raise ImageError("no cut found anything that was not flushed: the trial shows nothing")
    return [
        *lines,
        "",
        f"The power was cut {len(made)} times while changes were made by the API, three at a time: API tokens, "
        "programs, settings of the card. The machine is killed at any moment, in the middle of a write, or before a "
        "flush, which is never answered then; chance says of each sector that was written since the last flush whether "
        "it is kept. What the machine starts from again is only what the disk has kept. "
        f"{asked.machines} such machines ran at a time.",
        "",
        "| cut | moment | changes acknowledged | sectors not flushed | of these lost | s to the page | changes lost |",
        "|---|---|---|---|---|---|---|",
        *(cut.row for cut in made),
        "",
        f"Afterwards the file systems are whole, and the data partition has {size / 1e9:.1f} GB of the card.",
    ]


def cuts_of_one(
    folder: Path, number: int, numbers: Numbers, asked: argparse.Namespace, machines: list[Machine]
) -> tuple[list[str], list[Cut], int]:
    """One machine, which is added to those that run: its first start, its cuts, the size of its data partition."""
    folder.mkdir(exist_ok=True)
    card = copied(asked.image, folder)
    machine = Machine(card, folder, asked.seed + number)
    machines.append(machine)
    try:
        robot = Robot(machine)
        lines = started(robot)
        if not number:
            joined = time.monotonic()
            part_joins(robot, folder)
            words = f"A part on another computer joined over UDP, {time.monotonic() - joined:.0f} s after its start."
            say(words)
            lines += ["", words]
        made = try_cuts(robot, numbers, asked.seed + number)
    finally:
        machine.close()
    size = check_file_systems(card, folder)
    if size < CARD_SIZE // 2:
        raise ImageError(f"the data partition has not grown: {size} octets")
    return lines, made, size


def moments(folder: Path, asked: argparse.Namespace) -> list[str]:
    """What cuts of the power would leave; returns the text of the result."""
    card = copied(asked.image, folder)
    machine = Machine(card, folder, asked.seed)
    try:
        robot = Robot(machine)
        lines = started(robot)
        rows = try_moments(robot, card, asked.moments, asked.seed, folder)
    finally:
        machine.close()
    return [
        *lines,
        "",
        f"At {len(rows)} moments, while changes were made by the API, what a cut of the power would have left was kept "
        "in a file: what was flushed, and of what was not, sectors by chance. The file system was repaired, and a "
        "master on this computer started from it.",
        "",
        "| moment | where | changes acknowledged | sectors not flushed | of these lost | changes lost |",
        "|---|---|---|---|---|---|",
        *rows,
    ]


def set_up(folder: Path, asked: argparse.Namespace) -> list[str]:
    """A first start with a set-up file, adapters, Wi-Fi; returns the text of the result."""
    load, one = os.getloadavg()[0], SetUpTrial(copied(asked.image, folder), folder, asked.seed)
    try:
        return [computer(load), "", *one.run()]
    finally:
        one.close()


def updates(folder: Path, asked: argparse.Namespace) -> list[str]:
    """Updates by the page; returns the text of the result."""
    place = folder / "shell.socket"
    words, told = line(place)
    machine, shell = Machine(copied(asked.image, folder), folder, asked.seed, words, f"{told} {LONGER}"), Shell(place)
    try:
        robot = Robot(machine)
        lines = started(robot)
        rows = UpdatesTrial(robot, shell, asked.package, folder, asked.minutes * 60).run()
    finally:
        shell.close()
        machine.close()
    check_file_systems(folder / "card.img", folder)
    return [
        *lines,
        "",
        "The packages are the one of the image with other numbers, and one of them with a master that ends at once. A "
        "cut in a start comes before the first flush since the card's settings are applied.",
        "",
        "| update | came of it | runs then | s |",
        "|---|---|---|---|",
        *rows,
        "",
        "Afterwards the file systems are whole.",
    ]


PROGRAMS = {
    "qemu-system-aarch64": "qemu-system-arm",
    "mcopy": "mtools",
    "fsck.vfat": "dosfstools",
    "e2fsck": "e2fsprogs",
    "debugfs": "e2fsprogs",
    "dpkg-deb": "dpkg",
}
"""What it takes, and the packages of Debian that have it."""
RESULTS = {
    "cuts": ("card_image", "The card's image in a virtual computer: cuts of the power", cuts),
    "moments": ("card_image_moments", "The card's image in a virtual computer: what cuts would leave", moments),
    "set-up": ("card_image_set_up", "The card's image in a virtual computer: set-up and adapters", set_up),
    "updates": ("card_image_updates", "The card's image in a virtual computer: updates", updates),
}


def main() -> int:
    """Try it; returns 1 with the reason if something is not as it should be."""
    parser = argparse.ArgumentParser(prog="make image-test")
    parser.add_argument("image", type=Path)
    parser.add_argument("--only", choices=sorted(RESULTS), help="one of the trials")
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--moments", type=int, default=100, help="so many without a start after each")
    parser.add_argument("--machines", type=int, default=1, help="so many share the cuts at a time")
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which no cut is begun any more")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--package", type=Path, required=True, help="the package in the image: updates are made of it")
    parser.add_argument("--folder", type=Path, help="where the card and the console's text stay")
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the machine ends with its trial
    try:
        need_programs(PROGRAMS)
    except ImageError as error:
        sys.stderr.write(f"image-test: {error}\n")
        return 1
    for name, (file, title, trial) in RESULTS.items():
        if asked.only not in (None, name):
            continue
        with tempfile.TemporaryDirectory(prefix="msbot-card-") as scratch:
            folder = (asked.folder or Path(scratch)) / name
            folder.mkdir(parents=True, exist_ok=True)
            try:
                lines = trial(folder, asked)
            except (ImageError, httpx.HTTPError, TimeoutError) as error:
                sys.stderr.write(f"image-test: {name}: {error}\n")
                return 1
        if asked.write:
            write_result(file, title, lines, made_by=f'make image-test ARGS="--only {name} --write"')
        sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
