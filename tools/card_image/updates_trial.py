"""Updates by the page: one that is well stays, one that is not falls back by itself, and a person can go back."""

from __future__ import annotations

import re
from pathlib import Path

import httpx

from tools.card_image import base
from tools.card_image.base import ImageError, run
from tools.card_image.robot import Robot, say, wait_for

OF_THE_IMAGE = "that of the image"


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


def try_updates(robot: Robot, package: Path, folder: Path) -> list[str]:
    """Update, update to what does not work, go back; returns the lines of the table.

    Raises:
        ImageError: something else comes of it, or what was stored is not as it should be.
    """
    lines = []
    robot.ask("PUT", "/api/programs/first.py", {"text": "# of the image\n"})
    good = later_version(package, folder, "9.0.0", broken=False)
    lines.append(_update(robot, good, "9.0.0, which is well", "updated", "9.0.0"))
    _need_programs(robot, {"first.py": True})
    robot.ask("PUT", "/api/programs/second.py", {"text": "# of 9.0.0\n"})
    broken = later_version(package, folder, "9.9.9", broken=True)
    lines.append(_update(robot, broken, "9.9.9, whose master ends at once", "fell back", "9.0.0"))
    _need_programs(robot, {"first.py": True, "second.py": True})
    robot.ask("POST", "/api/card/back")
    lines.append(_restart(robot, "*Back*", "went back", OF_THE_IMAGE))
    _need_programs(robot, {"first.py": True})
    return lines


def _update(robot: Robot, package: Path, name: str, told: str, runs: str) -> str:
    say(str(robot.ask("POST", "/api/card/update", content=package.read_bytes())["words"]))
    package.unlink()
    return _restart(robot, name, told, runs)


def _restart(robot: Robot, name: str, told: str, runs: str) -> str:
    """Start again; returns a line of the table."""
    robot.ask("POST", "/api/card/restart")
    said: list[object] = []

    def has_told() -> bool:
        try:
            versions = robot.ask("GET", "/api/card")["versions"]
        except (httpx.HTTPError, ImageError):
            return False  # it starts
        said[:] = [versions["told"], versions["current"] or OF_THE_IMAGE]  # type: ignore[index]
        return said[0] == told

    wait_for(robot.machine, has_told, f"{name}: {told}")
    if said[1] != runs:
        raise ImageError(f"{name}: {said[1]} runs in place of {runs}")
    line = f"| {name} | {told} | {said[1]} |"
    say(line)
    return line


def _need_programs(robot: Robot, wanted: dict[str, bool]) -> None:
    for name in wanted:
        if robot.client.get(f"/api/programs/{name}").status_code != 200:
            raise ImageError(f"the program {name} is gone")
