"""A CAN bus at one computer, its master at another, and a cable between them that is cut and mended."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.e2e.processes import Process, run
from tests.networks import DESK, Network, two_computers


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
