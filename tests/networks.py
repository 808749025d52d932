"""Two computers for a test: network namespaces of their own, joined by a cable that can be cut."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.e2e.prepared import NETWORK
from tests.e2e.processes import Process

DESK, BODY = "10.79.0.1", "10.79.0.2"
"""Their addresses."""


class Network:
    """The two computers, `desk` and `body`."""

    def __init__(self, number: int) -> None:
        self.desk, self.body = f"msbot{number}d", f"msbot{number}b"
        self._cables = {self.desk: f"mv{number}d", self.body: f"mv{number}b"}

    def open(self) -> None:
        """Make both, and the cable.

        Raises:
            subprocess.CalledProcessError: that is not permitted here.
        """
        for name in (self.desk, self.body):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        ours, theirs = self._cables.values()
        _ip("link", "add", ours, "netns", self.desk, "type", "veth", "peer", "name", theirs, "netns", self.body)
        for name, address in ((self.desk, DESK), (self.body, BODY)):
            _ip("-n", name, "addr", "add", f"{address}/24", "dev", self._cables[name])
            _ip("-n", name, "link", "set", self._cables[name], "up")

    def close(self) -> None:
        """Remove both, with all that is left."""
        for name in (self.desk, self.body):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)

    def cut(self) -> None:
        """Pull the cable."""
        _ip("-n", self.desk, "link", "set", self._cables[self.desk], "down")

    def heal(self) -> None:
        """Plug it in again."""
        _ip("-n", self.desk, "link", "set", self._cables[self.desk], "up")

    def run(self, computer: str, *arguments: str, cwd: Path, env: dict[str, str] | None = None) -> Process:
        """Start `msbot` on one of them."""
        return Process(*arguments, cwd=cwd, env={**(env or {}), NETWORK: computer})


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


@contextmanager
def two_computers() -> Iterator[Network]:
    """Two computers with a cable; the test is skipped where that is not permitted."""
    if shutil.which("ip") is None:
        pytest.skip("no command `ip`: apt install iproute2")
    network = Network(os.getpid() % 100_000)
    try:
        network.open()
    except subprocess.CalledProcessError as error:
        network.close()
        pytest.skip(f"two networks need root: {error.stderr.strip()}")
    try:
        yield network
    finally:
        network.close()


@contextmanager
def lonely_computer() -> Iterator[str]:
    """The name of a computer that is in no network; the test is skipped where that is not permitted."""
    if shutil.which("ip") is None:
        pytest.skip("no command `ip`: apt install iproute2")
    name = f"msbot{os.getpid() % 100_000}l"
    try:
        _ip("netns", "add", name)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"a network of its own needs root: {error.stderr.strip()}")
    try:
        _ip("-n", name, "link", "set", "lo", "up")
        yield name
    finally:
        subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


ROUTER = "10.79.3.1"
"""Where the router of two sites is, seen from either."""


class TwoSites:
    """Two sites, `north` and `south`, and a router that each reaches by a cable of its own."""

    def __init__(self, number: int) -> None:
        self.north, self.south, self.middle = (f"msbot{number}{letter}" for letter in "nsm")
        self._cables = {self.north: f"mn{number}", self.south: f"ms{number}"}

    def open(self) -> None:
        """Make all three, and the cables.

        Raises:
            subprocess.CalledProcessError: that is not permitted here.
        """
        for name in (self.north, self.south, self.middle):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        _ip("-n", self.middle, "addr", "add", f"{ROUTER}/32", "dev", "lo")
        for number, (site, cable) in enumerate(self._cables.items()):
            there = f"10.79.{4 + number}"
            _ip("link", "add", "out", "netns", site, "type", "veth", "peer", "name", cable, "netns", self.middle)
            _ip("-n", site, "addr", "add", f"{there}.2/24", "dev", "out")
            _ip("-n", site, "link", "set", "out", "up")
            _ip("-n", self.middle, "addr", "add", f"{there}.1/24", "dev", cable)
            _ip("-n", self.middle, "link", "set", cable, "up")
            _ip("-n", site, "route", "add", ROUTER, "via", f"{there}.1")

    def close(self) -> None:
        """Remove all, with what is left."""
        for name in (self.north, self.south, self.middle):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)

    def cut(self, site: str) -> None:
        """Pull a site's cable, at the router's end: the site sees nothing but silence."""
        _ip("-n", self.middle, "link", "set", self._cables[site], "down")

    def heal(self, site: str) -> None:
        """Plug it in again."""
        _ip("-n", self.middle, "link", "set", self._cables[site], "up")


@contextmanager
def two_sites() -> Iterator[TwoSites]:
    """Two sites with a router; the test is skipped where that is not permitted."""
    if shutil.which("ip") is None:
        pytest.skip("no command `ip`: apt install iproute2")
    sites = TwoSites(os.getpid() % 100_000)
    try:
        sites.open()
    except subprocess.CalledProcessError as error:
        sites.close()
        pytest.skip(f"networks of their own need root: {error.stderr.strip()}")
    try:
        yield sites
    finally:
        sites.close()
