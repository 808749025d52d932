"""`msbot class`: two robots that run, one that does not; list and search, one STOP, one blueprint for all, and back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from msbot.cli.school.rollout import MOST_ROLLOUTS, RolledOut, RollOutBook
from msbot.cli.school.school import stop_line
from msbot.errors import ConfigError
from msbot.runtime.stop_datagram import IS_THERE
from tests.e2e.processes import run, running


@pytest.fixture(scope="module")
def school(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, str]]]:
    """Robots X1 and X2 run, each with a database of its own; X3 is in robot.db and does not run."""
    folder = tmp_path_factory.mktemp("school")
    place = {
        "XDG_STATE_HOME": str(folder / "state"),
        "XDG_RUNTIME_DIR": str(folder),
        "MSBOT_STOP_GROUP": f"{os.getpid()}school",
    }
    assert run("init", cwd=folder).returncode == 0
    text = (folder / "robot.toml").read_text()
    serial = next(line for line in text.splitlines() if line.startswith("serial_number"))
    with ExitStack() as stack:
        for number in (1, 2, 3):
            own = folder / f"robot{number}.toml"
            own.write_text(text.replace(serial, f'serial_number = "X{number}"'))
            if number == 3:
                assert run("apply", own.name, "--db", "robot.db", "--yes", cwd=folder, env=place).returncode == 0
            else:
                master = stack.enter_context(
                    running("master", own.name, "--no-page", "--link", f"sim:school{number}", cwd=folder, env=place)
                )
                master.wait_for("is up on")
        yield folder, place


def test_robots_are_listed_searched_and_told_apart(school: tuple[Path, dict[str, str]]) -> None:
    folder, place = school
    listed = json.loads(run("class", "list", "--json", cwd=folder, env=place).stdout)
    assert [(one["serial_number"], one["runs_here"]) for one in listed] == [("X1", True), ("X2", True), ("X3", False)]
    lines = run("class", "list", "runs", "x2", cwd=folder, env=place).stdout.splitlines()
    assert "X2" in lines[0]
    assert "runs here, 0 of 3 slots active" in lines[0]
    assert lines[-1] == "1 robots, 1 of them run here."
    assert run("class", "list", "nobody", cwd=folder, env=place).stdout == "No robot fits.\n"


def test_one_blueprint_for_all_keeps_their_names_and_is_taken_back(school: tuple[Path, dict[str, str]]) -> None:
    folder, place = school
    wanted = folder / "robot.toml"
    wanted.write_text(wanted.read_text() + '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n')
    rolled = run("class", "apply", "robot.toml", "--yes", cwd=folder, env=place)
    assert rolled.returncode == 0, rolled.stderr
    assert "[3/3]" in rolled.stdout
    assert "3 robots are as robot.toml says" in rolled.stdout
    for database, serial in (("robot1.db", "X1"), ("robot.db", "X3")):
        exported = run("export", "--db", database, cwd=folder, env=place).stdout
        assert serial in exported
        assert '"extra"' in exported
    again = run("class", "apply", "robot.toml", "--yes", cwd=folder, env=place)
    assert again.stdout.count("nothing to change") == 3
    assert not list(folder.glob(".robot-*"))

    back = run("class", "undo", cwd=folder, env=place)
    assert back.returncode == 0, back.stdout + back.stderr
    for database in ("robot1.db", "robot.db"):
        assert '"extra"' not in run("export", "--db", database, cwd=folder, env=place).stdout
    nothing = run("class", "undo", cwd=folder, env=place)
    assert nothing.returncode == 2
    assert "there is no roll-out that could be taken back" in nothing.stderr


@pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")
def test_one_stop_names_who_was_told_and_who_was_not(school: tuple[Path, dict[str, str]]) -> None:
    folder, place = school
    stopped = run("class", "stop", "--reason", "a test", cwd=folder, env=place)
    assert stopped.returncode == 0, stopped.stderr
    assert [line.split(":")[0][-2:] for line in stopped.stdout.splitlines()] == ["X1", "X2"]
    for serial in ("X1", "X2"):
        meant = ("--robot", serial, "--db", f"robot{serial[1]}.db")
        status = json.loads(run("stop", "--status", "--json", *meant, cwd=folder, env=place).stdout)
        assert status["stopped"]
        assert run("go", *meant, cwd=folder, env=place).returncode == 0


def test_mistakes_are_one_sentence(tmp_path: Path) -> None:
    place = {
        "XDG_RUNTIME_DIR": str(tmp_path),
        "MSBOT_STOP_GROUP": f"{os.getpid()}none",
        "XDG_STATE_HOME": str(tmp_path),
    }
    assert run("init", cwd=tmp_path).returncode == 0
    for words, said in (
        (("apply", "robot.toml", "--yes"), "no robot fits"),
        (("stop",), "NOT delivered: no master of yours runs on this computer"),
        (("list", "--db", "nowhere.db"), "there is no database nowhere.db"),
    ):
        ended = run("class", *words, cwd=tmp_path, env=place)
        assert ended.returncode == 2
        assert said in ended.stderr
        assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        ({"told": 3, "not_confirmed": 0, "silent": []}, "R 7: STOP, confirmed by all 3 parts"),
        ({"told": 3, "not_confirmed": 1, "silent": ["arm"]}, "R 7: STOP, confirmed by 2 of 3 parts; NOT by arm"),
        ({"told": 0, "not_confirmed": 0, "silent": []}, "R 7: STOP holds; no part is in the robot"),
        ({"stopped": False}, "R 7: STOP has been ended meanwhile"),
        ({"error": "away"}, "R 7: away"),
    ],
)
def test_stop_is_told_robot_by_robot(answer: dict[str, object], line: str) -> None:
    assert stop_line({"robot": "R", "serial_number": "7", "stopped": True} | answer) == line


def test_roll_outs_are_remembered_as_they_are_made_and_not_for_ever(tmp_path: Path) -> None:
    book = RollOutBook(tmp_path)
    assert book.last() is None
    for number in range(MOST_ROLLOUTS + 5):
        written = book.begin(f"{number}.toml")
        written(RolledOut("R", "1", "robot.db", number))
    one, two = RolledOut("R", "1", "robot.db", number), RolledOut("R", "2", "robot.db", 9)
    written(two)
    assert len(json.loads((tmp_path / "rollouts.json").read_text())) == MOST_ROLLOUTS
    assert (book.last() or ("", 0, []))[2] == [one, two]
    book.taken_back([one])
    assert (book.last() or ("", 0, []))[2] == [two]
    book.taken_back([two])
    assert (book.last() or ("", 0, []))[0] == f"{number - 1}.toml"
    (tmp_path / "rollouts.json").write_text('[{"at": 1}]')
    with pytest.raises(ConfigError, match="move it away"):
        book.last()
