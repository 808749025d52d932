"""A CAN bus at one computer, its master at another, and a cable between them that is cut and mended."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from msbot.registry import open_registry
from tests.e2e.prepared import NETWORK
from tests.e2e.processes import Process, run, wait_for_states
from tests.networks import DESK, Network, two_computers
from tests.skewed_clock import skewed


@pytest.fixture
def network() -> Iterator[Network]:
    with two_computers() as made:
        yield made


def test_a_relay_carries_a_bus_of_parts_to_a_master_elsewhere_through_cut_and_heal(
    network: Network, tmp_path: Path
) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    state = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path)}
    master_link = f"udp:{DESK}:8888"
    with ExitStack() as stack:

        def started(computer: str, *arguments: str) -> Process:
            process = network.run(computer, *arguments, cwd=tmp_path, env=state)
            stack.callback(process.end, signal.SIGKILL)
            return process

        relay = started(network.body, "relay", "sim:body", master_link, "--name", "pi")  # before its master
        master = started(network.desk, "master", "--no-page", "--link", master_link)
        relay.wait_for("takes the parts of sim:body")
        parts = {name: started(network.body, "part", name, "--link", "sim:body") for name in ("AA", "BB", "CC")}
        for part in parts.values():
            part.wait_for("active")
        parts["BB"].wait_for("output", "on")

        network.cut()
        for _ in parts:
            master.wait_for("lost", "the relay pi is silent")
        relay.wait_for("silent")
        for part in parts.values():
            part.wait_for("lost")

        network.heal()
        relay.wait_for("heard again after")
        for part in parts.values():
            part.wait_for("active")
        parts["BB"].wait_for("output", "on")

        assert relay.end(signal.SIGTERM) == 0
        for _ in parts:
            master.wait_for("lost", "behind relay pi has ended")


def test_agents_on_two_computers_feed_one_master_through_cut_and_heal(network: Network, tmp_path: Path) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    state = {"XDG_STATE_HOME": str(tmp_path / "state"), "XDG_RUNTIME_DIR": str(tmp_path)}
    way = f"udp:{DESK}:8888"
    began = time.time()
    with ExitStack() as stack:

        def started(computer: str, *arguments: str, clock_off_s: int = 0) -> Process:
            clock = skewed(tmp_path, clock_off_s) if clock_off_s else {}
            process = network.run(computer, *arguments, cwd=tmp_path, env=state | clock)
            stack.callback(process.end, signal.SIGKILL)
            return process

        # Before its master, on a computer whose clock is three days ahead.
        pi = started(network.body, "agent", "udp4", "-p", "9999", "--master", way, "--name", "pi", clock_off_s=259_200)
        master = started(network.desk, "master", "--no-page", "--link", way)
        pi.wait_for("takes the parts of this agent, pi")
        desk = started(network.desk, "agent", "can", "-D", "sim:desk", "--master", way, "--name", "desk")
        desk.wait_for("takes the parts of this agent, desk")
        parts = {
            name: started(network.body, "part", name, "--link", "udp:127.0.0.1:9999", clock_off_s=off)
            for name, off in (("AA", 0), ("BB", -7200))
        }
        parts["CC"] = started(network.desk, "part", "CC", "--link", "sim:desk")
        for part in parts.values():
            part.wait_for("active")
        parts["BB"].wait_for("output", "on")

        network.cut()
        for _ in ("AA", "BB"):
            master.wait_for("lost", "the agent pi is silent")
        pi.wait_for("the master is silent: 2 parts that are in stay as they are")
        for name in ("AA", "BB"):
            parts[name].wait_for("lost")
        at_desk = state | {NETWORK: network.desk}
        wait_for_states({"AA": "lost", "BB": "lost", "CC": "active"}, cwd=tmp_path, env=at_desk)

        network.heal()
        pi.wait_for("the master is heard again after")
        for name in ("AA", "BB"):
            parts[name].wait_for("active")
        parts["BB"].wait_for("output", "on")

        assert pi.end(signal.SIGTERM) == 0
        for _ in ("AA", "BB"):
            master.wait_for("lost", "gone: the agent pi has ended")
    with open_registry(tmp_path / "robot.db") as registry:
        lines = registry.robots.journal(1000)
    assert {line.event.slot for line in lines} >= {"AA", "BB", "CC"}
    assert all(began - 1 <= line.at_ns / 1e9 <= time.time() for line in lines)  # the master's clock dates them


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--name", "pi"), "say with --master ADDRESS where that is"),
        (("--master", "udp:nowhere"), "it needs a host and a port"),
        (("--master", "udp:127.0.0.1:8888", "--space", "dds"), "leave --space out here"),
    ],
)
def test_mistakes_of_an_agent_with_a_master_are_one_sentence(
    options: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    ended = run("agent", "udp4", "-p", "0", *options, cwd=tmp_path)
    assert ended.returncode == 2
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sim:body", "udp:nowhere"), "it needs a host and a port"),
        (("smoke:body", "udp:127.0.0.1:8888"), "unknown kind of link 'smoke'"),
        (("udp:127.0.0.1:0", "canfd:can0"), "a relay needs 256"),
    ],
)
def test_mistakes_are_one_sentence(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    ended = run("relay", *arguments, cwd=tmp_path)
    assert ended.returncode == 2
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--part-of", "udp:127.0.0.1:8888"), "needs both the way to it and a part number"),
        (("--part-of", "udp:127.0.0.1:8888", "--as", "ARM-1"), "has nothing to offer a bigger robot"),
    ],
)
def test_mistakes_of_a_robot_that_is_a_part_are_one_sentence(
    options: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    ended = run("master", "--no-page", *options, cwd=tmp_path)
    assert ended.returncode == 2
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "robot.db").exists()
