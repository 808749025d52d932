"""`msbot lesson start` asks before people's programs stop."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click.testing
import pytest
from click.testing import CliRunner, Result

from msbot.operations.teaching_operations import people_stop
from msbot_school.cli import lesson as lesson_command
from tests.lessons.lesson_stage import LessonStage, lesson_scene


class Robot:
    """Answers operations as a robot with these people does."""

    def __init__(self, *people: str) -> None:
        self.words = people_stop(people)
        self.begun: list[object] = []

    def perform(self, db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> dict[str, object]:
        assert (db, robot, do, args) == (None, None, "who_stops", {"lesson": "ring"})
        return {"words": self.words}

    def say(self, db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> None:
        assert (db, robot, do) == (None, None, "start_lesson")
        self.begun.append(args["lesson"])


def start(monkeypatch: pytest.MonkeyPatch, robot: Robot, *options: str, answer: str | None = None) -> Result:
    """What the command prints, in a terminal if there is an answer."""
    monkeypatch.setattr(lesson_command, "perform", robot.perform)
    monkeypatch.setattr(lesson_command, "say", robot.say)
    monkeypatch.setattr(click.testing._NamedTextIOWrapper, "isatty", lambda _: answer is not None)
    return CliRunner().invoke(lesson_command.command, ["start", "ring", *options], input=answer)


@pytest.mark.parametrize(("answer", "begins"), [("y\n", True), ("n\n", False)])
def test_in_a_terminal_it_names_who_stops_and_asks(answer: str, begins: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot("Ada (fan)", "WEATHER-1")
    done = start(monkeypatch, robot, answer=answer)
    assert "Programs and parts of people stop: Ada (fan), WEATHER-1; their texts are kept." in done.output
    assert "Begin the lesson? [y/N]" in done.output
    assert robot.begun == (["ring"] if begins else [])


def test_without_a_terminal_it_begins_only_with_yes_if_somebody_s_program_stops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = Robot("Ada (fan)")
    done = start(monkeypatch, robot)
    assert "Ada (fan)" in str(done.exception)
    assert "add --yes to begin without asking" in str(done.exception)
    assert robot.begun == []
    told = start(monkeypatch, robot, "--json", answer="y\n")
    assert "add --yes to begin without asking" in str(told.exception)
    assert told.stdout == ""
    assert robot.begun == []
    assert start(monkeypatch, robot, "--yes").exit_code == 0
    assert robot.begun == ["ring"]
    nobody = Robot()
    assert start(monkeypatch, nobody).exit_code == 0
    assert nobody.begun == ["ring"]


@pytest.mark.parametrize("has_parts", [True, False])
def test_simulated_parts_of_the_robot_are_nobody_s(has_parts: bool, tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        if not has_parts:
            await stage.do("simulate", slot="fan")
        assert await stage.do("who_stops", lesson="ring") == ""
        assert "no lesson" in await stage.refused("who_stops", lesson="rings")

    lesson_scene(tmp_path, scene, has_parts=has_parts)
