"""kill -9 of a process that writes: the database opens, nothing committed is lost, nothing is half there."""

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from random import Random

import pytest

from msbot.config import Blueprint, Library
from msbot.registry import open_registry
from tests.effort import tries

WRITER = """
import sys
from pathlib import Path
from dataclasses import replace

from msbot.config import Slot, load_blueprint, load_library
from msbot.pnp import Claim, PartState
from msbot.registry import open_registry
from tests.registry.events import changed

library = load_library()
blueprint = load_blueprint(Path(sys.argv[1]), library)
registry = open_registry(sys.argv[2])
store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
number = len(registry.robots.journal(1_000_000))
while True:
    for _ in range(5):
        number += 1
        uid = number.to_bytes(8, "big")
        store.remember(uid, "AA", Claim("ABCD", f"n{number}", uid))
        store.journal(changed(PartState.LOST, uid=uid, local_name=f"n{number}", reason=str(number)))
    registry.storage.flush()
    print(number, flush=True)
    if number % 20 == 0:
        slots = blueprint.slots if number % 40 else (*blueprint.slots, Slot("DD", "ABCD"))
        registry.robots.apply_blueprint(replace(blueprint, slots=slots), library)
"""


def _run_and_kill(robot_toml: Path, path: Path, lines: int) -> int:
    """Let a process write until it has told so many lines, kill it; gives the last number it had stored."""
    command = [sys.executable, "-W", "error", "-c", WRITER, str(robot_toml), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = [int(process.stdout.readline()) for _ in range(lines)]
        process.kill()
        told.extend(int(line) for line in process.stdout if line.endswith("\n"))
    return told[-1]


@pytest.mark.promise("Nothing acknowledged is lost after kill -9")
def test_nothing_committed_is_lost_when_the_process_is_killed(
    path: Path, blueprint: Blueprint, library: Library
) -> None:
    assert blueprint.source is not None
    dice = Random(9)
    for _ in range(tries(2, 10)):
        stored = _run_and_kill(blueprint.source, path, dice.randint(1, 12))
        with closing(sqlite3.connect(path)) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
            assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        with open_registry(path) as registry:
            numbers = [int(entry.event.reason) for entry in registry.robots.journal(1_000_000)]
            assert numbers == list(range(1, len(numbers) + 1))
            assert len(numbers) >= stored
            parts = {part.uid: part.slot for part in registry.robots.parts()}
            assert all(parts[number.to_bytes(8, "big")] == "AA" for number in numbers)
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            assert [len(store.configuration(slot.name).bindings) for slot in store.slots()] == [2, 2, 2]


@pytest.mark.parametrize("seed", range(tries(1, 4)))
@pytest.mark.promise("Nothing acknowledged is lost after kill -9")
def test_masters_are_killed_during_swaps_and_edits(tmp_path: Path, seed: int) -> None:
    """See `killing.py`."""
    kills = tries(24, 50)
    command = [sys.executable, "-W", "error", "-m", "tests.registry.killing", str(tmp_path), str(seed), str(kills)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    found = json.loads(done.stdout)
    assert (found["kills"], found["faults"]) == (kills, [])
    assert found["edits"] >= kills
