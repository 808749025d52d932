"""`examples/extension`, installed by pip as somebody else's package, and one in which everything is broken."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

import httpx
import pytest

from msbot.config import write_sample
from msbot_agent.cli import BUILT_IN
from msbot_agent.startup.extensions import GROUPS, OWN_PACKAGES, PREFIX
from tests.e2e.processes import Process, run, running

EXAMPLE = Path(__file__).parents[2] / "examples/extension"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where it is installed: the environment that runs the tests stays as it is."""
    folder = tmp_path_factory.mktemp("extension")
    words = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder / "dist")]
    subprocess.run(words, cwd=EXAMPLE, check=True, capture_output=True)
    (wheel,) = (folder / "dist").glob("*.whl")
    subprocess.run(
        ["python3", "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--target", str(folder / "there"), wheel],
        check=True,
        capture_output=True,
    )
    return folder / "there"


@pytest.fixture
def env(place: Path) -> dict[str, str]:
    return {"PYTHONPATH": str(place), "COLUMNS": "100"}


def told(*words: str, env: dict[str, str], cwd: Path | None = None) -> str:
    done = run(*words, env=env, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_brings_one_of_each_in_under_150_lines(env: dict[str, str]) -> None:
    found = json.loads(told("extensions", "--json", env=env))["extensions"]
    assert sorted(row["group"] for row in found) == sorted(GROUPS)
    assert {row["left_out"] for row in found} == {""}
    assert [row["problems"] for row in found if row["problems"]] == []
    lines = told("extensions", env=env).splitlines()
    assert lines[0] == "msbot-hello 1.0"
    assert "  commands        hello" in lines
    # A bridge is a device with all that it can do: it has a file of its own, and is no part of the shortest example.
    written = [path for path in EXAMPLE.rglob("*") if path.suffix in (".py", ".toml") and path.name != "bridge.py"]
    assert sum(bool(line.strip()) for path in written for line in path.read_text().splitlines()) < 150


def test_its_command_and_files_are_there_like_those_of_msbot(env: dict[str, str], tmp_path: Path) -> None:
    assert told("hello", "rover", env=env) == "Hello, rover!\n"
    assert re.search(r"hello +Greets a robot: an example of an extension \(msbot-hello 1\.0\)", told("--help", env=env))
    assert "HELLO-LOAD" in told("library", "list", env=env)
    assert "Load meter" in told("library", "show", "HELLO-LOAD", env=env)
    assert "hiccups" in told("mission", "list", env=env)
    assert ["hello", "5", "1", "Say", "hello"] in [
        line.split() for line in told("lesson", "list", env=env).splitlines()
    ]
    assert "hiccup" in told("fault", "kinds", env=env)
    assert "two-lamps  Two lamps" in told("arena", "list", env=env)
    assert "load" in told("doctor", "--only", "load", "-v", env=env, cwd=tmp_path)


def test_a_wrong_address_is_told_as_it_is_of_msbots_own(env: dict[str, str]) -> None:
    done = run("part", "ABCD", "--link", "slow:x:udp:127.0.0.1:1", env=env)
    assert done.returncode == 2
    assert "'x' are no milliseconds; write it like `slow:50:udp:127.0.0.1:8888`" in done.stderr
    done = run("agent", "udp4", "--space", "scratch:x", env=env)
    assert done.returncode == 2
    assert "scratch has no options; write it like `scratch`" in done.stderr
    done = run("part", "ABCD", "--link", "nothing:x", env=env)
    assert "slow:50:udp:127.0.0.1:8888" in done.stderr, "it is among the kinds that there are"


def test_its_own_folder_is_checked_while_it_is_installed(env: dict[str, str], place: Path, tmp_path: Path) -> None:
    folder = place / "msbot_hello/part_types"
    assert told("library", "check", str(folder), env=env).startswith("No mistake: ")
    (tmp_path / "COPY.toml").write_text((folder / "HELLO-LOAD.toml").read_text())
    done = run("library", "check", str(tmp_path), env=env)
    assert done.returncode == 2
    assert f'part number "HELLO-LOAD" is taken by {folder / "HELLO-LOAD.toml"}' in done.stderr


def test_a_driver_that_is_not_there_is_named(tmp_path: Path) -> None:
    types = tmp_path / "msbot_disk"
    types.mkdir()
    (types / "__init__.py").touch()
    load = (EXAMPLE / "src/msbot_hello/part_types/HELLO-LOAD.toml").read_text()
    (types / "DISK-1.toml").write_text(
        load.replace("HELLO-LOAD", "DISK-1").replace("msbot_hello.classroom:Load", "msbot_disk:")
    )
    info = tmp_path / "msbot_disk-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: msbot-disk\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(f"[{PREFIX}part_types]\ndisk = msbot_disk\n")
    env = {"PYTHONPATH": str(tmp_path), "COLUMNS": "100"}
    done = run("extensions", env=env)
    assert done.returncode == 1
    words = "the driver msbot_disk:Meter of part DISK-1 cannot be found: module 'msbot_disk' has no attribute 'Meter'"
    assert f"  part_types      disk  {words}" in done.stdout.splitlines()
    (row,) = json.loads(run("extensions", "--json", env=env).stdout)["extensions"]
    assert (row["left_out"], row["problems"]) == ("", [words])
    assert "DISK-1" in told("library", "list", env=env), "it can be simulated"


def test_a_fault_that_was_installed_after_the_master_began(env: dict[str, str], tmp_path: Path) -> None:
    with running("demo", "--port", "0", "--robot", "rover", "--db", "demo.db", cwd=tmp_path) as process:
        process.wait_for("http://")
        done = run("fault", "add", "hiccup", "fan", "--db", "demo.db", env=env, cwd=tmp_path)
        assert done.returncode == 2
        assert "the running master does not know the fault 'hiccup', which an extension here adds: restart" in " ".join(
            done.stderr.split()
        )
        done = run("fault", "add", "hicup", "fan", "--db", "demo.db", env=env, cwd=tmp_path)
        assert "there is no fault 'hicup'" in done.stderr
        assert "restart" not in done.stderr


@pytest.fixture
def robot(env: dict[str, str], tmp_path: Path) -> Iterator[Process]:
    with running("demo", "--port", "0", "--robot", "rover", "--db", "demo.db", cwd=tmp_path, env=env) as process:
        yield process


def test_its_page_call_fault_and_world_work_at_a_running_robot(
    robot: Process, env: dict[str, str], tmp_path: Path
) -> None:
    link = re.search(r"http://\S+", robot.wait_for("http://"))
    assert link is not None
    base = link[0].partition("/enter")[0]
    with httpx.Client(base_url=base, timeout=60) as visitor:
        assert visitor.get("/api/x/hello/greeting").status_code == 401
        assert visitor.get("/x/hello").status_code != 200
        visitor.get(link[0].removeprefix(base))
        assert visitor.get("/api/x/hello/greeting").json() == "Hello, ROVER!"
        page = visitor.get("/x/hello").text
        assert "Hello, ROVER: " in page
        assert "/x/hello" in visitor.get("/").text, "in the menu"
        assert "hiccup" in told("fault", "add", "hiccup", "fan", "--db", "demo.db", env=env, cwd=tmp_path)
        assert "Two lamps" in visitor.get("/gallery").text
        wish = {"robot": "buggy", "world": "two-lamps", "agreed": True}
        me = visitor.get("/api/me").json()
        assert visitor.post("/api/gallery", json=wish, headers={"x-csrf-token": me["csrf"]}).status_code == 200
        robot.wait_for("wheels active")  # another robot, in that world
    assert robot.end() == 0
    assert not any("Traceback" in line for line in robot.lines)


def test_its_service_runs_beside_a_master_and_an_agent(env: dict[str, str], tmp_path: Path) -> None:
    write_sample(tmp_path / "robot.toml")
    for words in (("master", "--link", "udp:127.0.0.1:0", "--no-page"), ("agent", "udp4", "-p", "0")):
        with running(*words, "--greet", "rover", cwd=tmp_path, env=env) as process:
            process.wait_for("Hello, rover!")
            assert process.end() == 0
        with running(*words, cwd=tmp_path, env=env) as process:
            process.wait_for("Ctrl-C ends it")
            assert process.end() == 0
        assert not any("Hello" in line for line in process.lines), "nobody asked for it"


def without(place: Path, *groups: str) -> dict[str, str]:
    """MsBOT as if the distributions were not installed that bring these groups."""
    for name in OWN_PACKAGES:
        info = place / f"{name.replace('-', '_')}-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        points = distribution(name).entry_points
        (info / "entry_points.txt").write_text(
            f"[{PREFIX}checks]\n"  # something of MsBOT's, so that it hides the one that is installed
            + "".join(f"[{one.group}]\n{one.name} = {one.value}\n" for one in points if one.group not in groups)
        )
    return {"PYTHONPATH": str(place), "COLUMNS": "100"}


def test_a_master_runs_without_page_and_lessons(tmp_path: Path) -> None:
    env = without(tmp_path, "msbot.services")
    write_sample(tmp_path / "robot.toml")
    for option in ("--port", "--lessons", "--announce", "--no-page"):
        done = run("master", option, "0", env=env, cwd=tmp_path)
        assert done.returncode == 2
        assert "No such option" in done.stderr
        assert option in done.stderr
    with running("master", "--link", "udp:127.0.0.1:0", cwd=tmp_path, env=env) as process:
        process.wait_for("Ctrl-C ends it")
        assert told("parts", env=env, cwd=tmp_path) == "No part has been seen yet.\n"
        assert process.end() == 0
    assert not any("http" in line or "left out" in line for line in process.lines)


def test_an_agent_runs_alone(tmp_path: Path) -> None:
    env = without(tmp_path, "msbot.agent_services", "msbot.services", "msbot.commands", "msbot.loaders")
    listed = re.findall(r"^  ([a-z]+)  ", told("--help", env=env).partition("Options:")[2], re.MULTILINE)
    assert sorted(listed) == sorted(BUILT_IN)
    for command, package in (("part", "msbot"), ("lesson", "msbot-school"), ("demo", "msbot-web")):
        done = run(command, env=env)
        assert done.returncode == 2
        assert f"`msbot {command}` is in the package {package}, which is not installed here." in done.stderr
    done = run("master", env=env)
    assert done.returncode == 2
    assert "`msbot master` is in the package msbot" in done.stderr
    usage = told("agent", "udp4", "--help", env=env)
    assert "--refs" in usage
    assert not any(f"{option} " in usage for option in ("--rec", "--metrics", "--master", "--name"))
    with running("agent", "udp4", "-p", "0", cwd=tmp_path, env=env) as process:
        process.wait_for("Ctrl-C ends it")
        assert process.end() == 0
    assert told("extensions", env=env).startswith("No extension is installed")


def broken(place: Path) -> dict[str, str]:
    """A package in which nothing works."""
    package = place / "broken"
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError('no way')\n")
    info = place / "msbot_broken-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: msbot-broken\nVersion: 0.1\n")
    points = "".join(f"[{PREFIX}{group}]\nbad = broken.{group}:x\n" for group in GROUPS)
    (info / "entry_points.txt").write_text(points)
    return {"PYTHONPATH": str(place), "COLUMNS": "100"}


def test_a_broken_one_is_named_and_left_out(tmp_path: Path) -> None:
    env = broken(tmp_path)
    done = run("extensions", "--json", env=env)
    assert done.returncode == 1
    found = {row["group"]: row["left_out"] for row in json.loads(done.stdout)["extensions"]}
    assert found == dict.fromkeys(GROUPS, "RuntimeError: no way")
    assert done.stderr == ""
    done = run("bad", env=env)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "msbot-broken 0.1" in done.stderr
    assert "HC-SR04" in told("library", "list", env=env)
    with running("demo", "--port", "0", cwd=tmp_path, env=env) as process:
        process.wait_for("http://")
        assert process.end() == 0
    assert not any("Traceback" in line for line in process.lines)
    assert any("msbot-broken 0.1 is left out" in line for line in process.lines)
