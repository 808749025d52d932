"""This version opens what each earlier one has stored: database, blueprint, recording, keys, files, API."""

from __future__ import annotations

import gzip
import json
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import pytest

from msbot.config import load_library, open_blueprint
from msbot.part.join.part_keys import KEY_OCTETS, parse_key
from msbot.part.join.uid import kept_file, stored_uid
from msbot.recording.recordings.mcap_reader import RecordingReader
from msbot.registry import open_registry
from msbot.registry.maintenance import database_maintenance
from msbot.sim.arena.world_reader import open_world
from msbot_school.lessons.lesson_reader import read_lesson
from msbot_school.missions.mission_file import load_mission
from tests.e2e.processes import running
from tools.sources import ROOT
from tools.stored_by import STORED, asking

VERSIONS = sorted(path.name for path in STORED.iterdir())
BOARD = """
import json, sys
sys.path.insert(0, {folder!r})
from msbot.keys import parse_key
settings = json.load(open("msbot.json"))
print(len(parse_key(settings["key"])), len(bytes.fromhex(settings["uid"])))
"""


@pytest.fixture(params=VERSIONS)
def stored(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """What a version has stored, in a folder that may be written to."""
    shutil.copytree(STORED / request.param, tmp_path / "stored")
    for path in (tmp_path / "stored").glob("*.gz"):
        path.with_suffix("").write_bytes(gzip.decompress(path.read_bytes()))
    return tmp_path / "stored"


def test_there_is_something_of_the_first_version() -> None:
    assert "0.1.0" in VERSIONS


@pytest.mark.promise("A database of any earlier version is opened, and nothing in it is lost")
def test_the_database_is_opened_with_all_that_it_knows(stored: Path) -> None:
    path = stored / "robot.db"
    database_maintenance.migrate(str(path))
    assert database_maintenance.check(str(path)) == []
    with open_registry(path) as registry:
        (robot,) = registry.robots.all()
        assert robot.name == "ROVER"
        assert len(registry.robots.slot_names(robot)) == 10
        values = {one.name: one.value for one in registry.robots.values(robot, "beacon")}
        assert values["brightness"] == 0.5  # set by hand
        assert [user.name for user in registry.users.all()] == ["ann"]
        assert len(registry.keys.all()) == 1


def test_the_blueprint_is_read(stored: Path) -> None:
    blueprint, _ = open_blueprint(stored / "robot.toml")
    assert blueprint.robot.name == "ROVER"
    assert len(blueprint.slots) == 10


def test_the_recording_is_read_to_its_end(stored: Path) -> None:
    messages = list(RecordingReader(stored / "recording.mcap").messages())
    assert len(messages) > 100
    assert {"knob", "ear"} <= {message.slot for message in messages}


def test_a_part_keeps_its_identity_and_its_key(stored: Path) -> None:
    folder = stored / "state"
    before = kept_file("uid", "SG90", "arm", folder).read_text()
    assert stored_uid("SG90", "arm", folder).hex() == before.strip()
    assert len(parse_key(kept_file("key", "SG90", "arm", folder).read_text())) == KEY_OCTETS


def test_a_board_reads_its_file(stored: Path) -> None:
    program = BOARD.format(folder=str(ROOT / "micropython"))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=stored / "board", capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["16", "8"]


@pytest.fixture
def written(stored: Path) -> Path:
    """What people have written for a version: a folder for each kind of file."""
    with tarfile.open(stored / "files.tar.gz") as archive:
        archive.extractall(stored, filter="data")
    return stored / "files"


def test_part_types_and_messages_are_read(written: Path) -> None:
    kept = [part_type.number for part_type in load_library(written / "library") if part_type.number.endswith("-KEPT")]
    assert len(kept) > 50


def test_worlds_are_read(written: Path) -> None:
    worlds = sorted((written / "worlds").iterdir())
    assert len(worlds) >= 6
    for path in worlds:
        open_world(str(path))


def test_lessons_are_read(written: Path) -> None:
    assert len([read_lesson(path).title for path in (written / "lessons").iterdir()]) >= 6


def test_missions_are_read(written: Path) -> None:
    assert len([load_mission(path).title for path in (written / "missions").iterdir()]) >= 6


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the API answers to the same questions."""
    wanted = {path for version in VERSIONS for path in json.loads((STORED / version / "api.json").read_text("utf-8"))}
    folder = tmp_path_factory.mktemp("robot")
    with running("demo", "--port", "0", "--db", "robot.db", cwd=folder) as process:
        link = process.wait_for("The page is at").split()[-1]
        ask = asking(link)
        while (status := ask("status"))["active"] != status["slots"]:
            process.wait_for("bus")
        return {path: ask(path) for path in wanted}


@pytest.mark.parametrize("version", VERSIONS)
def test_the_api_still_answers_what_it_answered(version: str, answers: dict[str, Any]) -> None:
    before = json.loads((STORED / version / "api.json").read_text("utf-8"))
    missing = [words for path, answer in before.items() for words in gone(path, answer, answers[path])]
    assert missing == []


def gone(place: str, before: Any, after: Any) -> list[str]:
    """What an answer had and has no more: a key, or the kind of a value. Lists are compared by what their rows have."""
    if before is None or after is None:
        return []
    if isinstance(before, dict) and isinstance(after, dict):
        return [
            words
            for key, value in before.items()
            for words in (gone(f"{place}.{key}", value, after[key]) if key in after else [f"{place}.{key}"])
        ]
    if isinstance(before, list) and isinstance(after, list):
        return min((gone(f"{place}[]", before[0], row) for row in after), key=len) if before and after else []
    return [] if kind(before) is kind(after) else [f"{place}: {kind(before).__name__}"]


def kind(value: Any) -> type:
    """JSON has one kind of number."""
    return float if isinstance(value, int) and not isinstance(value, bool) else type(value)


def test_a_key_that_is_gone_is_seen() -> None:
    assert gone("x", {"a": 1, "b": [{"c": "d"}]}, {"a": 1.5, "b": [{"e": 1}]}) == ["x.b[].c"]
    assert gone("x", {"a": 1}, {"a": "1"}) == ["x.a: float"]
