"""Updates by the page: one that is well stays, one that is not falls back by itself, and a person can go back.

The power goes three times meanwhile: in the first start of an update, in the start that goes back, and while a package
is being unpacked. A root shell at a serial port says how far that is.
"""

from __future__ import annotations

import contextlib
import re
import threading
import time
from pathlib import Path

import httpx

from tools.card_image import base
from tools.card_image.base import ImageError, run
from tools.card_image.forgetful_disk import Moment
from tools.card_image.robot import HELPER_IS_SLOW, Robot, say, wait_for
from tools.card_image.shell import Shell

OF_THE_IMAGE = "that of the image"
GOOD, BROKEN = "9.0.0", "9.9.9"
LONGER = "systemd.setenv=MSBOT_CARD_TRIAL_S=1500"
"""For the kernel's command line: an emulated computer, beside others, may take longer than a card has."""
SETTINGS = "Starting .*Settings of the MsBOT card"
"""What the console says when a start comes to the versions."""
CUT_S = 60.0
"""How long a flush may take to come; then the cut comes at any moment."""
UNPACKED = 40
"""Folders of libraries that are there when the power goes."""


def later_version(package: Path, folder: Path, version: str, *, broken: bool) -> Path:
    """The same package as a later version, which says so; a broken one has a master that ends at once."""
    tree = folder / version
    run("dpkg-deb", "--raw-extract", package, tree)
    control = tree / "DEBIAN/control"
    text = re.sub(r"(?m)^Version: .*$", f"Version: {version}", control.read_text("utf-8"))
    control.write_text(re.sub(r"(?m)^Architecture: .*$", f"Architecture: {base.ARCHITECTURE}", text), "utf-8")
    if broken:
        (tree / "usr/lib/msbot/bin/msbot").write_text("#!/bin/sh\nexit 1\n", "utf-8")
    made = folder / f"msbot_{version}_arm64.deb"
    run("dpkg-deb", "--root-owner-group", "-Zzstd", "-z3", "--build", tree, made)
    base.remove_folder(tree)
    return made


class UpdatesTrial:
    """The trial.

    Args:
        robot: on a card as it was flashed, with an administrator.
        shell: a root shell in its machine.
        package: the one in the image.
        folder: for its files.
        within_s: from then on there is no cut while unpacking any more.
    """

    def __init__(self, robot: Robot, shell: Shell, package: Path, folder: Path, within_s: float) -> None:
        self._robot, self._shell, self._folder = robot, shell, folder
        self._until = time.monotonic() + within_s
        self._good = later_version(package, folder, GOOD, broken=False)
        self._broken = later_version(package, folder, BROKEN, broken=True)
        self._rows: list[str] = []

    def run(self) -> list[str]:
        """Update, update to what does not work, go back, be cut off; returns the lines of the table.

        Raises:
            ImageError: something else comes of it, or what was stored is not as it should be.
        """
        robot = self._robot
        robot.ask("PUT", "/api/programs/first.py", {"text": "# of the image\n"})
        self._send(self._good, GOOD)
        self._restart(f"{GOOD}, which is well; the power goes in its first start", "updated", GOOD, cut=True)
        self._need_programs("first.py")
        robot.ask("PUT", "/api/programs/second.py", {"text": f"# of {GOOD}\n"})
        self._send(self._broken, BROKEN)
        self._restart(f"{BROKEN}, whose master ends at once", "fell back", GOOD)
        self._need_programs("first.py", "second.py")
        robot.ask("POST", "/api/card/back")
        self._restart("*Back*; the power goes in the start that goes back", "went back", OF_THE_IMAGE, cut=True)
        self._need_programs("first.py")
        if robot.program("second.py") is not None:
            raise ImageError("the image's version has the database of the later one")
        if time.monotonic() < self._until:
            self._cut_off()
        return self._rows

    def _send(self, package: Path, version: str) -> None:
        """Have a package taken in; the page may lose patience before the helper of an emulated computer is done."""
        begun = time.monotonic()
        try:
            self._robot.ask("POST", "/api/card/update", content=package.read_bytes())
        except httpx.TimeoutException:
            pass  # the whole package is there, and is being unpacked
        except ImageError as error:
            if HELPER_IS_SLOW not in str(error):
                raise
        wait_for(self._robot.machine, lambda: self._state() == ("", version), f"{version}, taken in")
        say(f"{version} is taken in after {time.monotonic() - begun:.0f} s")

    def _state(self) -> tuple[str, str]:
        """What the card tells about its last update, and what runs from the next start on, or now; empty: not known."""
        try:
            versions = self._robot.ask("GET", "/api/card")["versions"]
        except (httpx.HTTPError, ImageError):
            return "", ""  # it starts, or is busy
        assert isinstance(versions, dict)
        return str(versions["told"]), str(versions["current"]) or OF_THE_IMAGE

    def _restart(self, name: str, told: str, runs: str, *, cut: bool = False) -> None:
        """Start again, maybe twice, until the card tells what came of it."""
        robot, machine = self._robot, self._robot.machine
        starts, begun = self._starts(), time.monotonic()
        with contextlib.suppress(httpx.TransportError):  # it may be gone before it has answered
            robot.ask("POST", "/api/card/restart")
        if cut:
            wait_for(machine, lambda: self._starts() > starts, "the next start")
            moment = self._cut(Moment.FLUSH, 1)
            say(f"{name}: the power is gone, {moment}")
        found = "", ""

        def has_told() -> bool:
            nonlocal found
            found = self._state() if robot.healthy else found
            return found[0] == told

        wait_for(machine, has_told, f"{name}: {told}")
        if found[1] != runs:
            raise ImageError(f"{name}: {found[1]} runs in place of {runs}")
        self._saw(name, told, runs, time.monotonic() - begun)

    def _starts(self) -> int:
        """How many starts the console has told of, as far as to the versions."""
        return len(re.findall(SETTINGS, self._robot.machine.console))

    def _cut(self, moment: Moment, holding: int) -> str:
        """Cut the power, and let it come again; returns the moment."""
        machine = self._robot.machine
        machine.disk.stop_at(moment, holding)
        if not machine.disk.wait_until_stopped(CUT_S):
            moment = Moment.ANY
        machine.cut_power()
        machine.switch_on()
        return moment.value

    def _cut_off(self) -> None:
        """The power goes while a package is being unpacked: nothing is left of that, and nothing is lost."""
        begun = time.monotonic()
        self._shell.open()
        sending = threading.Thread(target=self._send_into_the_dark, daemon=True)
        sending.start()
        libraries = "/data/card/unfinished-version/lib/python3.*/site-packages"
        self._shell.wait_for(f"test $(ls {libraries} 2>/dev/null | wc -l) -gt {UNPACKED}", 900)
        moment = self._cut(Moment.WRITE, 64)
        sending.join()
        self._robot.wait_for_page()
        self._shell.open()
        left = self._shell.run("ls -d /data/card/unfinished-* /data/card/update.deb /var/lib/msbot/update.deb || true")
        there = [line for line in left.splitlines() if not line.startswith("ls: ")]
        if there:
            raise ImageError(f"the card still has {' and '.join(there)}")
        machine = self._robot.machine
        wait_for(machine, lambda: self._state()[1] == OF_THE_IMAGE, "the image's version after the cut", 600)
        self._need_programs("first.py")
        name = f"{GOOD} again; the power goes while it is unpacked, {moment}"
        self._saw(name, "nothing: what was unpacked is removed", OF_THE_IMAGE, time.monotonic() - begun)

    def _send_into_the_dark(self) -> None:
        try:
            self._robot.ask("POST", "/api/card/update", content=self._good.read_bytes())
        except httpx.HTTPError as error:
            say(f"the package was under way: {error!r}")

    def _need_programs(self, *names: str) -> None:
        for name in names:
            if self._robot.program(name) is None:
                raise ImageError(f"the program {name} is gone")

    def _saw(self, name: str, told: str, runs: str, seconds: float) -> None:
        self._rows.append(f"| {name} | {told} | {runs} | {seconds:.0f} |")
        say(self._rows[-1])
