"""What `docs/howto/write_an_extension.md` shows, put together as its reader would: it runs."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from random import Random
from types import ModuleType

import pytest

from msbot.config import load_library
from msbot_agent.link import Peer
from msbot_agent.startup.extensions import GROUPS, PREFIX
from msbot_school.faults import PacketFault
from msbot_school.faults.packet_treatments import ErrorTolerantTreatment
from tests.e2e.processes import run
from tests.hardware import robot
from tests.hardware.robot import Bench, machine_at, play

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/howto/write_an_extension.md").read_text()
LED = "sys/class/leds/input0::capslock/brightness"


def section(heading: str) -> str:
    """The text below a heading."""
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def block(heading: str, language: str) -> str:
    """The one block of code in that language below a heading."""
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", section(heading), re.MULTILINE | re.DOTALL)
    assert isinstance(found, str)
    return found


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with the package of the page, as pip installs it."""
    package = tmp_path / "there/msbot_hello"
    (package / "part_types").mkdir(parents=True)
    for name in ("__init__.py", "part_types/__init__.py"):
        (package / name).touch()
    (package / "part_types/DISK-1.toml").write_text(block("A part with a driver", "toml"))
    (package / "disk.py").write_text(block("A part with a driver", "python"))
    (package / "tired.py").write_text(block("A fault", "python"))
    info = tmp_path / "there/msbot_hello-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: msbot-hello\nVersion: 1\n")
    points = {"part_types": "disk = msbot_hello.part_types", "faults": "tired = msbot_hello.tired:TIRED"}
    (info / "entry_points.txt").write_text("".join(f"[{PREFIX}{group}]\n{point}\n" for group, point in points.items()))
    return tmp_path / "there"


@pytest.fixture
def imported(place: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The same, where this process imports it; forgotten afterwards."""
    monkeypatch.syspath_prepend(place)
    importlib.invalidate_caches()
    yield place / "msbot_hello"
    for name in [name for name in sys.modules if name.partition(".")[0] == "msbot_hello"]:
        del sys.modules[name]


def test_it_names_every_group_and_only_classes_that_are_there() -> None:
    listed = re.findall(rf"^\* `{re.escape(PREFIX)}(\w+)`: (.*)$", PAGE, re.MULTILINE)
    assert sorted(group for group, _ in listed) == sorted(GROUPS)
    named = re.findall(
        r"`(msbot\w*(?:\.\w+)+)`", "\n".join(words for _, words in listed) + section("A check of the doctor")
    )
    assert len(named) > 8
    for name in named:
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), name


def test_its_entry_points_are_those_of_the_example() -> None:
    shown = tomllib.loads(block("How MsBOT finds it", "toml"))["project"]["entry-points"]
    there = tomllib.loads((ROOT / "examples/extension/pyproject.toml").read_text())["project"]["entry-points"]
    assert shown
    for group, points in shown.items():
        assert points.items() <= there[group].items()


def test_msbot_finds_nothing_wrong_with_it_and_its_own_test_passes(place: Path, tmp_path: Path) -> None:
    env = {"PYTHONPATH": str(place), "COLUMNS": "100"}
    listed = run("extensions", env=env)
    assert (listed.returncode, listed.stderr) == (0, "")
    assert "  faults          tired" in listed.stdout.splitlines()
    assert "a packet in ten waits" in run("fault", "kinds", env=env).stdout
    checked = run("library", "check", str(place / "msbot_hello/part_types"), env=env)
    assert checked.returncode == 0, checked.stderr
    (tmp_path / "test_disk.py").write_text(block("Test it", "python"))
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_disk.py"]
    done = subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout


def test_its_part_measures_and_switches_in_a_robot_and_is_off_afterwards(
    imported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", load_library(imported / "part_types"))
    led = tmp_path / LED
    led.parent.mkdir(parents=True)

    async def scene(bench: Bench) -> None:
        await bench.until(lambda: bench.heard["used"])
        percent = bench.last("used")["percent"]
        assert isinstance(percent, float)
        assert 0 < percent <= 100
        assert led.read_text() == "0"
        bench.send("light", on=True)
        await bench.until(lambda: led.read_text() == "1")

    play("DISK-1", machine_at(tmp_path), scene)
    assert led.read_text() == "0"


def test_what_its_driver_raises_is_said_by_the_part(
    imported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot, "LIBRARY", load_library(imported / "part_types"))

    async def scene(bench: Bench) -> None:
        await bench.until(lambda: bench.unit.fault)

    fault = play("DISK-1", machine_at(tmp_path), scene, joins=False).unit.fault
    assert fault == f"/{LED}: No such file or directory; is it there, and may this user write it?"


def fault_of(module: ModuleType) -> PacketFault:
    found = module.TIRED
    assert isinstance(found, PacketFault)
    return found


def test_its_fault_delays_what_comes_from_the_part(imported: Path) -> None:
    assert imported.is_dir()
    fault = fault_of(importlib.import_module("msbot_hello.tired"))
    treatment = ErrorTolerantTreatment("tired", fault.treat, 2.0, Random(1))
    peer: Peer = "the part"
    inward = [treatment.delays(peer, float(now), inward=True) for now in range(300)]
    assert {tuple(waits) for waits in inward} == {(0.0,), (2.0,)}
    assert 10 < inward.count([2.0]) < 60
    assert [treatment.delays(peer, 0.0, inward=False) for _ in range(50)] == [[0.0]] * 50
    assert treatment.free_at(peer, 7.0) == 7.0
