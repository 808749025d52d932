"""What the card has at many moments of one run: in the middle of a write, or before a flush, while changes are made.

Each is the data partition as a cut of the power would leave it then: what was flushed, and of what was not, sectors by
chance. The machine goes on meanwhile, so that this takes seconds where a start takes minutes. The file system is
repaired, and the robot's own master, on this computer, has to find in it what was acknowledged before the moment.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

from tools.card_image.base import ImageError, remove_folder, run
from tools.card_image.cuts import HOLDING, MOMENT_S, Acknowledged, Changes
from tools.card_image.forgetful_disk import Moment
from tools.card_image.machine import free_port
from tools.card_image.partitions import read
from tools.card_image.robot import NAME, Page, Robot, say, wait_for

MASTER_S = 300.0
"""How long the master on this computer may take to start."""
UNSET_BITRATE = 500_000
"""While nobody has set anything."""
MOMENTS = (Moment.FLUSH, Moment.WRITE)


def try_moments(robot: Robot, card: Path, count: int, seed: int, folder: Path) -> list[str]:
    """Look at the data partition at many moments; returns the lines of the table.

    Raises:
        ImageError: an acknowledged change is lost, or nothing was ever left to be flushed.
    """
    with card.open("rb") as file:
        _, (*_, data) = read(file.read(512))
    chance, changes, disk, rows = random.Random(seed), Changes(robot), robot.machine.disk, []
    for number in range(1, count + 1):
        moment, holding, before = MOMENTS[number % len(MOMENTS)], chance.randint(*HOLDING), changes.acknowledged
        left, over = folder / "left.data", threading.Event()
        makers = changes.begin(over)

        def has_begun(before: int = before) -> bool:
            return changes.acknowledged > before + 2 or bool(changes.refused)

        wait_for(robot.machine, has_begun, "three changes")
        time.sleep(chance.uniform(0.0, 3.0))
        was = disk.kept, disk.lost
        disk.leave_at(moment, holding, left, data.start)
        try:
            if not disk.wait_until_stopped(MOMENT_S):
                raise ImageError(f"no moment {moment.value} with {holding} sectors comes within {MOMENT_S:.0f} s")
            acknowledged, made = changes.now(), changes.acknowledged - before
        finally:
            over.set()
            disk.go_on()
        for maker in makers:
            maker.join()
        if changes.refused:
            raise ImageError(changes.refused)
        dropped, waiting = disk.lost - was[1], disk.kept - was[0] + disk.lost - was[1]
        if lost := missing(left, robot, acknowledged, folder / "left"):
            raise ImageError(f"moment {number}: acknowledged and lost: {'; '.join(lost)}")
        left.unlink()
        rows.append(f"| {number} | {moment.value} | {made} | {waiting} | {dropped} | 0 |")
        say(rows[-1])
        if lost := changes.missing():  # in the machine itself
            raise ImageError(f"moment {number}: the machine has lost: {'; '.join(lost)}")
    return rows


def missing(left: Path, robot: Page, acknowledged: Acknowledged, folder: Path) -> list[str]:
    """What a data partition has not, of what has to be there.

    Args:
        left: the partition; it is repaired.
        robot: whose token is shown.
        acknowledged: what has to be there.
        folder: for its files.

    Raises:
        ImageError: it cannot be repaired, or the master does not start from it.
    """
    done = subprocess.run(["e2fsck", "-p", str(left)], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise ImageError(f"the file system is damaged: {done.stdout}{done.stderr}")
    remove_folder(folder)
    folder.mkdir()
    for name in ("msbot", "card"):
        run("debugfs", "-R", f"rdump /{name} {folder}", left)
    kept = folder / "card/settings.json"
    bitrate = json.loads(kept.read_text("utf-8"))["can_bitrate"] if kept.exists() else UNSET_BITRATE
    port, log = free_port(socket.SOCK_STREAM), folder / "log"
    words = [sys.executable, "-m", "msbot"]
    subprocess.run([*words, "init", "robot.toml"], cwd=folder, check=True, capture_output=True)
    words += ["master", "robot.toml", "--db", "msbot/robot.db", "--port", str(port), "--link", "udp:127.0.0.1:0"]
    environment = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder), "MSBOT_STOP_GROUP": folder.name}
    with log.open("wb") as output:
        master = subprocess.Popen(words, cwd=folder, env=environment, stdout=output, stderr=output)
    try:
        page, until = Page(port), time.monotonic() + MASTER_S
        page.client.headers["authorization"] = robot.client.headers["authorization"]
        while not page.healthy:
            if time.monotonic() > until or master.poll() is not None:
                raise ImageError(f"no master starts from what is left: {log.read_text('utf-8', 'replace')[-2000:]}")
            time.sleep(0.2)
        return acknowledged.missing(page.tokens(NAME), page.program, bitrate)
    finally:
        master.terminate()
        master.wait()
        shutil.rmtree(folder / "msbot", ignore_errors=True)
