"""Homes of parts of every kind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import pytest

from tests.firmware.building import need, pipe_program
from tests.firmware.pipe import Firmware
from tests.homes.chromium import CHROMIUM, BrowserHome, Chromium, is_needed
from tests.homes.runners import NODE
from tests.homes.test_conformance import HOMES
from tests.homes.test_conformance import NEEDED as NODE_NEEDED
from tests.homes.world import Home
from tests.stop.kinds import CHome


@pytest.fixture(scope="module")
def firmware() -> Iterator[Firmware]:
    need("gcc")
    running = Firmware(pipe_program())
    yield running
    running.close()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Chromium]:
    if CHROMIUM is None:
        (pytest.fail if is_needed() else pytest.skip)("no Chromium on this machine: apt-get install chromium")
    running = Chromium()
    yield running
    running.close()


@pytest.fixture
def home(request: pytest.FixtureRequest) -> Callable[[str], Home]:
    def make(kind: str) -> Home:
        if kind == "c":
            return CHome(request.getfixturevalue("firmware"))
        if kind == "browser":
            return BrowserHome(request.getfixturevalue("chromium"))
        if kind.startswith("micropython") and NODE is None and not os.environ.get(NODE_NEEDED):
            pytest.skip("no node on this machine: apt-get install nodejs")
        return HOMES[kind]()

    return make
