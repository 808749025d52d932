"""Two sites with DDS inside, a gateway in each, a router with certificates and rules between them; cut and healed."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests import ROOT
from tests.e2e.prepared import NETWORK
from tests.e2e.processes import Process, run
from tests.networks import ROUTER, TwoSites, two_sites
from tests.space.dds.peers import Program, program
from tests.space.zenoh.conftest import commands_of_the_guide

pytest.importorskip("zenoh")
pytest.importorskip("cyclonedds")
RULES = f"""
listen = ["tls/{ROUTER}:7447"]

[tls]
ca = "ca.pem"
certificate = "router.pem"
key = "router.key"

[[allow]]
who = ["north", "south"]
keys = ["ROVER/**"]
"""
GATEWAY = f"""
inside = "dds:7?interface=lo"
outside = "zenoh:tls/{ROUTER}:7447?ca=ca.pem&cert=SITE.pem&key=SITE.key"

[[cross]]
robot = "ROVER"
topic = "light"
type = "Number"
direction = "both"
depth = 256

[[cross]]
robot = "ROVER"
topic = "back"
type = "Number"
direction = "WAY"
depth = 256
"""


@pytest.fixture
def sites() -> Iterator[TwoSites]:
    with two_sites() as made:
        yield made


def make_files(folder: Path) -> None:
    """What the guide makes, for this router."""
    for line in commands_of_the_guide():
        here = line.replace("IP:127.0.0.1", f"IP:{ROUTER}")
        for command in {here, here.replace("north", "south")}:
            subprocess.run(command, shell=True, check=True, capture_output=True, cwd=folder)
    (folder / "router.toml").write_text(RULES)
    for site, way in (("north", "in"), ("south", "out")):
        (folder / f"{site}.toml").write_text(GATEWAY.replace("SITE", site).replace("WAY", way))


def peer(network: str, own: str) -> contextlib.AbstractAsyncContextManager[Program]:
    """A program of a site."""
    enter = ("ip", "netns", "exec", network)
    return program(
        *enter,
        sys.executable,
        "-m",
        "tests.wide.site_peer",
        own,
        environment={"PYTHONPATH": str(ROOT), "CYCLONEDDS_URI": ""},
    )


async def write(site: Program, topic: str, first: int, last: int) -> None:
    """Have it write these numbers."""
    assert site.process.stdin is not None
    site.process.stdin.write(f"{topic} {first} {last}\n".encode())
    await site.process.stdin.drain()


def heard(site: Program, topic: str) -> list[int]:
    """The numbers that it has read, without those of the beginning."""
    numbers = [int(line.split()[1]) for line in site.lines if line.startswith(f"{topic} ")]
    return [number for number in numbers if number]


async def until_they_hear(here: Program, there: Program, topic: str) -> None:
    """Nothing is promised to a reader before it is found: write zeros until one arrives."""
    while f"{topic} 0" not in there.lines:
        await write(here, topic, 0, 0)
        await asyncio.sleep(0.1)


async def test_only_what_is_listed_crosses_and_nothing_that_reliable_promises_is_lost(
    sites: TwoSites, tmp_path: Path
) -> None:
    make_files(tmp_path)
    with ExitStack() as stack:

        def started(network: str, *arguments: str) -> Process:
            process = Process(*arguments, cwd=tmp_path, env={NETWORK: network, "CYCLONEDDS_URI": ""})
            stack.callback(process.end, signal.SIGKILL)
            return process

        networks = {"north": sites.north, "south": sites.south}
        gateways = {site: started(network, "gateway", f"{site}.toml") for site, network in networks.items()}
        gateways["north"].wait_for(f"no Zenoh router at tls/{ROUTER}:7447 (Connection refused)")
        router = started(sites.middle, "router", "router.toml")
        router.wait_for("router at", "1 rule(s) say what passes")
        async with peer(sites.north, "light") as north, peer(sites.south, "back") as south:
            await until_they_hear(north, south, "light")
            await until_they_hear(south, north, "back")
            await write(north, "light", 1, 50)
            await write(north, "secret", 1, 5)
            await south.says("light 50")

            sites.cut(sites.north)
            await write(north, "light", 51, 150)
            await write(south, "back", 1, 100)
            await asyncio.to_thread(gateways["north"].wait_for, "is lost; it is tried again until it answers")
            await write(north, "light", 151, 200)
            sites.heal(sites.north)
            await asyncio.to_thread(gateways["north"].wait_for, "is heard again")
            await south.says("light 200")
            await north.says("back 100")
            await write(north, "light", 201, 210)
            await south.says("light 210")
            assert heard(south, "light") == list(range(1, 211))
            assert heard(north, "back") == list(range(1, 101))
            assert heard(south, "secret") == []
        assert gateways["north"].end() == 0
        assert any("samples crossed out" in line for line in gateways["north"].lines)


def test_a_router_that_cannot_serve_and_a_gateway_that_is_wrong_end_with_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "gateway.toml").write_text('inside = "dds"\noutside = "zenoh:x"\n[[cross]]\ntopic = "a"\n')
    ended = run("gateway", cwd=tmp_path)
    assert ended.returncode == 2
    assert "gateway.toml, line 2, outside" in ended.stderr
    assert "Traceback" not in ended.stderr
    ended = run("gateway", "none.toml", cwd=tmp_path)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    (tmp_path / "router.toml").write_text('listen = ["tcp/203.0.113.5:7447"]\n')
    ended = run("router", "router.toml", cwd=tmp_path)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "this computer does not have that address" in ended.stderr
