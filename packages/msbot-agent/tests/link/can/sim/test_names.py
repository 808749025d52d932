"""Names of simulated buses: one bus for a name, private, never stale for long."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from msbot_agent.link.can.sim.bus_names import (
    NamedBus,
    check_name,
    existing_bus,
    find_bus,
    list_buses,
    publish,
    rates_words,
    withdraw,
)
from msbot_xrce.errors import ConfigError, LinkDown

BUS = NamedBus("classroom", 4711, "ab" * 16, os.getpid(), 500_000, None, False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "msbot"


def test_a_bus_is_found_by_its_name_while_it_is_served(folder: Path) -> None:
    assert find_bus("classroom", folder) is None
    path = publish(BUS, folder)
    assert find_bus("classroom", folder) == BUS
    assert existing_bus("classroom", folder) == BUS
    assert folder.stat().st_mode & 0o777 == 0o700
    assert path.stat().st_mode & 0o777 == 0o600
    assert [entry.name for entry in folder.iterdir()] == ["bus-classroom.json"], "no draft is left"
    withdraw(BUS, folder)
    assert find_bus("classroom", folder) is None


def test_buses_are_listed_by_name(folder: Path) -> None:
    assert list_buses(folder) == []
    fast = replace(BUS, name="bench2", fd=True, data_bitrate=2_000_000)
    publish(BUS, folder)
    publish(fast, folder)
    (folder / "bus-what is this.json").write_text("{}")
    assert list_buses(folder) == [fast, BUS]
    assert (BUS.rates(), fast.rates()) == ("CAN, 500 kbit/s", "CAN FD, 500 and 2000 kbit/s")


def test_a_name_stands_for_one_bus(folder: Path) -> None:
    publish(BUS, folder)
    with pytest.raises(LinkDown, match=rf"process {os.getpid()} serves a simulated bus 'classroom' already"):
        publish(replace(BUS, port=1), folder)
    assert find_bus("classroom", folder) == BUS


def test_whoever_comes_at_the_same_instant_is_told(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    (folder / "bus-classroom.json").write_text("being written")
    with pytest.raises(LinkDown, match="has just begun to serve"):
        publish(BUS, folder)


def test_what_a_killed_process_left_behind_is_removed(folder: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    path = publish(replace(BUS, pid=ended.pid), folder)
    assert find_bus("classroom", folder) is None
    assert not path.exists()
    publish(replace(BUS, pid=ended.pid), folder)
    publish(BUS, folder)
    assert find_bus("classroom", folder) == BUS


def test_of_two_that_see_a_dead_bus_the_slower_leaves_the_name_of_the_new_one_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dead = replace(BUS, pid=4711, key="cd" * 16)
    path = publish(dead, folder)

    def look(pid: int) -> bool:
        """Between the slower one's look and what it does about it, another program begins to serve the bus."""
        if pid == dead.pid:
            path.unlink(missing_ok=True)
            publish(BUS, folder)
        return pid != dead.pid

    monkeypatch.setattr("msbot_agent.link.can.sim.bus_names.is_running", look)
    assert find_bus("classroom", folder) is None, "the one it has seen is dead"
    assert find_bus("classroom", folder) == BUS, "and the new one has kept its name"


def test_a_bus_that_was_started_anew_is_not_withdrawn_by_the_old_one(folder: Path) -> None:
    publish(BUS, folder)
    withdraw(replace(BUS, key="cd" * 16), folder)
    assert find_bus("classroom", folder) == BUS


def test_a_missing_bus_is_explained(folder: Path) -> None:
    with pytest.raises(LinkDown, match="no simulated bus 'classroom': start one with `msbot bus serve classroom`"):
        existing_bus("classroom", folder)
    publish(BUS, folder)
    with pytest.raises(LinkDown, match=r"'bench1' \(there is classroom\)"):
        existing_bus("bench1", folder)


@pytest.mark.parametrize("name", ["", "a" * 33, "a/b", "../x", "a.b", "ä", "a b"])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="1 to 32 letters"):
        check_name(name)


def test_a_folder_of_others_is_refused(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    folder.chmod(0o755)
    with pytest.raises(ConfigError, match="belongs to you alone"):
        find_bus("classroom", folder)
    with pytest.raises(ConfigError, match="belongs to you alone"):
        publish(BUS, folder)


def test_a_folder_that_cannot_be_made_is_explained(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write"):
        publish(BUS, tmp_path / "missing" / "msbot")


@pytest.mark.parametrize(
    "change", [{"port": "x"}, {"key": "no hex"}, {"key": 7}, {"bitrate": None}, {"data_bitrate": "x"}, {"pid": []}]
)
def test_a_file_that_is_none_is_no_bus(folder: Path, change: dict[str, object]) -> None:
    path = publish(BUS, folder)
    path.write_text(json.dumps(asdict(BUS) | change))
    assert find_bus("classroom", folder) is None
    path.write_text("[]")
    assert find_bus("classroom", folder) is None


def test_rates_in_words() -> None:
    assert rates_words(125_000, None, fd=False) == "CAN, 125 kbit/s"
    assert rates_words(1_000_000, 5_000_000, fd=True) == "CAN FD, 1000 and 5000 kbit/s"
