"""A simulated bus in a thread: begun by its first user here, ended with the last."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from msbot_agent.link.can.sim import sim_bus_thread as sim_thread
from msbot_agent.link.can.sim.bus_names import NamedBus, existing_bus, find_bus, publish
from msbot_agent.link.can.sim.sim_bus_client import SimBusRequest
from msbot_agent.link.can.sim.sim_bus_server import SimBusServer
from msbot_agent.link.can.sim.sim_bus_thread import BusThread, hold, release
from msbot_xrce.errors import ConfigError, LinkDown

WISH = SimBusRequest("classroom", 125_000)


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "msbot"


def test_a_bus_ends_with_its_last_user() -> None:
    assert hold(WISH)
    assert hold(SimBusRequest("classroom"))
    release("classroom")
    assert existing_bus("classroom").bitrate == 125_000
    release("classroom")
    assert find_bus("classroom") is None


def test_each_user_counts_once() -> None:
    for _ in range(3):
        assert hold(WISH)
    for _ in range(2):
        release("classroom")
        assert existing_bus("classroom").bitrate == 125_000
    release("classroom")
    assert find_bus("classroom") is None


def test_a_bus_of_another_process_is_left_to_it() -> None:
    publish(NamedBus("classroom", 1, "ab" * 16, os.getppid(), 500_000, None, False))
    assert not hold(WISH)
    thread = BusThread(WISH)
    assert not thread.begin(), "the other was quicker"
    thread.end()
    with pytest.raises(KeyError):
        release("classroom")


def test_what_is_wrong_is_raised_here(runtime_folder: Path) -> None:
    runtime_folder.write_text("no folder")
    thread = BusThread(WISH)
    with pytest.raises(ConfigError, match="cannot write"):
        thread.begin()
    thread.end()


def test_a_thread_that_does_not_begin_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim_thread, "START_S", 0.0)
    monkeypatch.setattr(BusThread, "run", lambda _self: None)
    with pytest.raises(LinkDown, match="did not begin"):
        hold(WISH)


def test_who_begins_to_serve_while_this_one_looks_has_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BusThread, "begin", lambda _self: False)
    assert not hold(WISH)
    with pytest.raises(KeyError):
        release("classroom")


@pytest.mark.parametrize("is_another_there", [False, True])
@pytest.mark.parametrize("error", [LinkDown("no port"), ConfigError("no folder")])
def test_only_that_another_serves_the_bus_is_no_error(
    error: Exception, is_another_there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(_self: SimBusServer) -> None:
        raise error

    monkeypatch.setattr(SimBusServer, "run", fail)
    if is_another_there:
        publish(NamedBus("classroom", 1, "ab" * 16, os.getppid(), 500_000, None, False))
    thread = BusThread(WISH)
    assert thread.daemon, "who forgets it can still end"
    if is_another_there and isinstance(error, LinkDown):
        assert not thread.begin()
    else:
        with pytest.raises(type(error), match=str(error)):
            thread.begin()
    thread.end()


def test_who_forgets_to_let_go_leaves_no_name_behind() -> None:
    assert hold(WISH)
    sim_thread._end_all()
    assert find_bus("classroom") is None
