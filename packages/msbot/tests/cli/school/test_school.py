"""`msbot class`: a robot that runs here, one elsewhere, one that is stored, one that is away; list, STOP, roll-out."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot.stop.socket_folders import IS_THERE
from msbot.stop.socket_names import GROUP_VARIABLE
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_school.cli.classroom.class_commands import command, stop_line
from msbot_web.cli.user_commands import user_command as user
from tests.e2e.processes import PATIENCE_S, run, running
from tests.web.refusing import refusing_port

pytestmark = pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")


def ask(*words: str) -> tuple[int, str, str]:
    """Exit status, what is printed, and the error."""
    done = CliRunner().invoke(command, words)
    return done.exit_code, done.stdout, str(done.exception or "")


class School:
    """X1 runs here, X2 as if on another computer, X3 is in robot.db and does not run; X4 has gone."""

    def __init__(self, folder: Path, away: str) -> None:
        self.folder = folder
        self.page = ""
        """The page of X2, once it runs."""
        self.away = away
        serial = next(line for line in SAMPLE_ROBOT_TOML.splitlines() if line.startswith("serial_number"))
        library = load_library()
        for number, name in ((1, "robot1"), (2, "robot2"), (3, "robot")):
            text = SAMPLE_ROBOT_TOML.replace(serial, f'serial_number = "X{number}"')
            (folder / f"{name}.toml").write_text(text)
            with open_registry(str(folder / f"{name}.db")) as registry:
                registry.robots.apply_blueprint(parse_blueprint(text, library), library)
        self.token = self.new_token("lab", "teacher")

    def new_token(self, name: str, role: str) -> str:
        there = ("--db", "robot2.db")
        assert CliRunner().invoke(user, ["add", name, "--role", role, "--generate", *there]).exit_code == 0
        made = CliRunner().invoke(user, ["token", name, "class", *there])
        assert made.exit_code == 0, made.exception
        return made.output.strip()

    def slots(self, name: str) -> list[str]:
        with open_registry(str(self.folder / f"{name}.db"), read_only=True) as registry:
            (record,) = registry.robots.all()
            return registry.robots.slot_names(record)


@pytest.fixture(scope="module")
def school(tmp_path_factory: pytest.TempPathFactory) -> Iterator[School]:
    folder = tmp_path_factory.mktemp("school")
    far = folder / "far"
    far.mkdir()
    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        here = {"XDG_STATE_HOME": folder / "state", "XDG_RUNTIME_DIR": folder, GROUP_VARIABLE: f"{os.getpid()}near"}
        for name, value in here.items():
            patch.setenv(name, str(value))
        patch.chdir(folder)
        made = School(folder, f"http://127.0.0.1:{stack.enter_context(refusing_port())}")
        elsewhere = {"XDG_RUNTIME_DIR": str(far), GROUP_VARIABLE: f"{os.getpid()}far"}
        masters = [
            stack.enter_context(running("master", "robot1.toml", "--no-page", "--link", "sim:school1", cwd=folder)),
            stack.enter_context(
                running("master", "robot2.toml", "--port", "0", "--link", "sim:school2", cwd=folder, env=elsewhere)
            ),
        ]
        masters[0].wait_for("is up on")
        line = masters[1].wait_for("The page is at")
        found = re.search(r"https?://[^/\s]+", line)
        assert found is not None, line
        made.page = found[0]
        patch.setenv("MSBOT_TOKEN", made.token)
        deadline = time.monotonic() + PATIENCE_S
        status, said, error = ask("join", made.page)
        while status != 0 and time.monotonic() < deadline:  # a page's first answer takes long on a busy computer
            assert "no answer in time" in error
            status, said, error = ask("join", made.page)
        assert status == 0, error
        assert said.startswith(f"MSBOT_MASTER X2 at {made.page} is in the class as lab (teacher)\n")
        RemoteAccessFile().add(RemoteAccess(made.away, "msbot_x", "MSBOT_MASTER", "X4"))
        yield made


def test_robots_are_listed_searched_and_told_apart(school: School) -> None:
    listed = json.loads(ask("list", "--json")[1])
    told = [(one["serial_number"], one["runs_here"], one["runs_elsewhere"], one["answers"]) for one in listed]
    assert told == [
        ("X1", True, False, True),
        ("X2", False, True, True),
        ("X3", False, False, False),
        ("X4", False, False, False),
    ]
    marks = {one["serial_number"]: one["blueprint"] for one in listed}
    assert len(marks["X1"]) == 8
    assert marks["X1"] == marks["X2"] == marks["X3"], "one from its master, one over the network, one from its database"
    assert marks["X4"] == ""
    versions = {one["msbot"] for one in listed if one["answers"]}
    assert len(versions) == 1
    assert "" not in versions
    lines = ask("list", "runs", "x2")[1].splitlines()
    assert lines[0].split() == ["robot", "version", "blueprint", "state", "page"]
    assert "X2" in lines[1]
    assert f"runs at {school.page}, 0 of 3 slots active" in lines[1]
    assert lines[-1] == "1 robot, 0 of them run here, 1 on other computers."
    assert f"does not answer: {school.away}: Connection refused" in ask("list", "X4")[1]
    assert ask("list", "nobody")[1] == "No robot fits.\n"


def test_one_blueprint_for_all_keeps_their_names_and_is_taken_back(school: School) -> None:
    wanted = school.folder / "wanted.toml"
    wanted.write_text((school.folder / "robot.toml").read_text() + '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n')
    status, rolled, error = ask("apply", "wanted.toml", "--yes")
    assert status != 0
    assert "1 of 4 robots was not changed" in error, rolled
    assert f"MSBOT_MASTER X4: {school.away}: Connection refused" in rolled
    assert "[3/3]" in rolled
    assert [school.slots(name)[-1] for name in ("robot1", "robot2", "robot")] == ["extra"] * 3
    again = ask("apply", "wanted.toml", "--yes", "--only", "X2", "--only", "slots")
    assert (again[0], again[1]) == (0, "MSBOT_MASTER X2: nothing to change\n")
    (school.folder / "own").mkdir()
    (school.folder / "own" / "ODD-1.toml").write_text('number = "ODD-1"\nname = "odd"\nmanufacturer = "us"\n')
    odd = school.folder / "odd.toml"
    odd.write_text(wanted.read_text().replace("RELAY-1", "ODD-1"))
    _, refused, error = ask("apply", "odd.toml", "--yes", "--library", "own", "--only", "X2")
    assert "ODD-1" in refused, "its own library decides"
    assert "1 of 1 robot was not changed" in error
    assert len({one["blueprint"] for one in json.loads(ask("list", "--json")[1])} - {""}) == 1
    assert not list(school.folder.glob(".wanted-*"))

    run("undo", "--db", "robot1.db", cwd=school.folder)  # by hand, at the robot itself: nothing is left to do there
    status, back, error = ask("undo")
    assert status == 0, back + error
    assert "[1/3] MSBOT_MASTER X1: somebody has taken it back already: change 1 (" in back
    assert ["extra" in school.slots(name) for name in ("robot1", "robot2", "robot")] == [False] * 3
    assert "there is no roll-out that could be taken back" in ask("undo")[2]


def test_one_stop_names_who_was_told_and_who_was_not(school: School) -> None:
    for serial, group in (("X1", "near"), ("X2", "far")):  # by its socket, and by its page
        place = f"{os.getpid()}{group}"
        status, said, error = ask("stop", "--reason", "a test", "--stop-group", place)
        assert status != 0
        lines = said.splitlines()
        assert f"MSBOT_MASTER {serial}: STOP holds; no part is in the robot" in lines
        assert f"MSBOT_MASTER X4: NOT told: {school.away}: Connection refused" in lines
        assert error == "NOT stopped: MSBOT_MASTER X4: cut their power"
        answers = json.loads(ask("stop", "--json", "--stop-group", place)[1])
        stopped = {one["serial_number"]: one["stopped"] for one in answers}
        assert stopped | {serial: True, "X4": False} == stopped
        status_of = json.loads(
            run(
                *("stop", "--status", "--json", "--robot", serial),
                cwd=school.folder / "far",
                env={GROUP_VARIABLE: place},
            ).stdout
        )
        assert status_of["stopped"]


def test_a_stop_group_says_which_robots_here_and_elsewhere_are_meant(school: School) -> None:
    near, far = f"{os.getpid()}near", f"{os.getpid()}far"
    status, said, error = ask("stop", "--stop-group", far)
    assert said.splitlines()[0] == "MSBOT_MASTER X2: STOP holds; no part is in the robot"
    assert "X1" not in said
    assert (status != 0, error) == (True, "NOT stopped: MSBOT_MASTER X4: cut their power"), "nobody knows its group"
    left_alone = f"MSBOT_MASTER X2: left alone, it is not in the STOP group {near}"
    for words in (("stop", "--stop-group", near), ("stop",)):  # as an option, and as the variable says
        assert ask(*words)[1].splitlines()[-1] == left_alone
    assert ask("stop", "--stop-group", "bench 1")[0] == 2
    groups = {one["serial_number"]: one["stop_group"] for one in json.loads(ask("list", "--json")[1])}
    assert groups == {"X1": near, "X2": far, "X3": "", "X4": ""}
    assert f"STOP group {near}" in ask("list", near)[1]


def test_a_viewer_may_stop_and_not_change_and_a_stranger_nothing(
    school: School, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.MonkeyPatch.context() as other:
        other.setenv("XDG_STATE_HOME", str(school.folder / "guest"))
        other.setenv("MSBOT_TOKEN", school.new_token("eve", "viewer"))
        status, said, error = ask("join", school.page)
        deadline = time.monotonic() + PATIENCE_S
        while status != 0 and time.monotonic() < deadline:  # the master follows its database within a second
            assert "it does not know the API token" in error
            status, said, error = ask("join", school.page)
        assert "as viewer, the class may say STOP there" in said
        wanted = school.folder / "more.toml"
        wanted.write_text((school.folder / "robot.toml").read_text() + '\n[[slot]]\nname = "m"\npart = "RELAY-1"\n')
        assert "may not" in ask("apply", "more.toml", "--yes", "--only", "X2")[1]
        assert ask("leave", "X2")[0] == 0
        assert "there is no access to X2" in ask("leave", "X2")[2]
        monkeypatch.setenv("MSBOT_TOKEN", "msbot_wrong")
        assert "it does not know the API token" in ask("join", school.page)[2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("apply", "robot.toml", "--yes"), "no robot fits"),
        (("stop",), "NOT delivered: no master of yours runs on this computer"),
        (("list", "--db", "nowhere.db"), "there is no database nowhere.db"),
        (("join", "ftp://x"), "is no address of a page"),
        (("join", "http://127.0.0.1:1"), "http://127.0.0.1:1: Connection refused"),
        (("join", "http://127.0.0.1:1", "--fingerprint", "AB"), "--fingerprint is for pages with a certificate"),
        (("leave", "ROVER"), "there is no access to ROVER"),
    ],
)
def test_mistakes_are_one_sentence(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv(GROUP_VARIABLE, f"{os.getpid()}none")
    (tmp_path / "robot.toml").write_text(SAMPLE_ROBOT_TOML)
    status, _, error = ask(*words)
    assert status != 0
    assert said in error
    assert "\n" not in error


@pytest.mark.parametrize(
    ("answer", "line"),
    [
        ({"told": 3, "not_confirmed": 0, "silent": []}, "R 7: STOP, confirmed by all 3 parts"),
        ({"told": 3, "not_confirmed": 1, "silent": ["arm"]}, "R 7: STOP, confirmed by 2 of 3 parts; NOT by arm"),
        ({"told": 0, "not_confirmed": 0, "silent": []}, "R 7: STOP holds; no part is in the robot"),
        (
            {"told": None, "not_confirmed": 0, "silent": []},
            "R 7: STOP was taken; which parts have confirmed it is NOT known",
        ),
        ({"stopped": False}, "R 7: STOP has been ended meanwhile"),
        ({"error": "away"}, "R 7: away"),
    ],
)
def test_stop_is_told_robot_by_robot(answer: dict[str, object], line: str) -> None:
    assert stop_line({"robot": "R", "serial_number": "7", "stopped": True} | answer) == line
