"""Nothing is heard after all have confirmed STOP: every kind of part, whatever happens meanwhile."""

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
from tests.stop.kinds import HAPPENINGS, CHome, stories

KINDS = ("cpython", "micropython-can", "micropython-serial", "c", "browser")


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


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_heard_after_all_have_confirmed(
    kind: str, home: Callable[[str], Home], record_property: Callable[[str, object], None]
) -> None:
    verdicts = stories(home(kind))
    record_property("tried", len(verdicts))
    record_property("held", sum(verdict.is_right for verdict in verdicts.values()))
    assert len(verdicts) == len(HAPPENINGS)
    assert {words: verdict for words, verdict in verdicts.items() if not verdict.is_right} == {}
