"""`robot_for` and message classes of the program: by `robot.messages`, and by an import."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from msbot import Message, Number, float32
from msbot.testing import robot_for
from msbot_xrce.errors import ConfigError

STATS = """\
from msbot import Message, Number, Part, float32


class Point(Message):
    x: float32


class Samples(Message):
    values: list[float32]


class Way(Message):
    points: list[Point]


part = Part("MY-STATS")
part.publishes("seen", Samples)
part.calls("ask", Samples, Number)


@part.serves("mean", Samples, Number)
def mean(request):
    return Number(value=sum(request.values) / len(request.values))


@part.on("in", Samples)
def hear(message):
    part.publish("seen", message)


@part.on("way", Way)
def follow(message):
    print(message)


part.setting("gain", float, 1.0)
part.run()
"""
TESTS = """\
from stats import Samples


def test_import(robot_for):
    robot = robot_for("stats.py")
    assert robot.call("mean", Samples(values=[1, 2, 6])).value == 3
    robot.send("in", Samples(values=[1.0, 3.0]))
    assert robot.last("seen") == Samples(values=[1, 3]) == robot.messages.Samples(values=[1.0, 3])
"""


@pytest.fixture
def stats(tmp_path: Path) -> Path:
    (tmp_path / "stats.py").write_text(STATS)
    return tmp_path / "stats.py"


def test_a_test_imports_the_program_and_no_part_joins_a_robot(stats: Path) -> None:
    folder = stats.parent
    (folder / "test_stats.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(folder)]
    done = subprocess.run([*command, str(folder)], cwd=folder, capture_output=True, text=True, check=False, timeout=60)
    assert "1 passed" in done.stdout, done.stdout + done.stderr


def test_the_classes_of_a_program_are_there_by_name(stats: Path) -> None:
    with robot_for(stats) as robot:
        samples = robot.messages.Samples
        assert robot.call("mean", samples(values=[1, 2, 6])) == Number(value=3)
        assert robot.messages.Way(points=[robot.messages.Point(x=1)]).points[0].x == 1
        assert {"Number", "Point", "Samples", "Way"} <= set(dir(robot.messages))
        with pytest.raises(AttributeError, match="no message class 'Sample'; did you mean Samples"):
            _ = robot.messages.Sample


def test_a_class_of_the_same_name_and_fields_is_the_same_type_and_another_is_not(stats: Path) -> None:
    def twin_class() -> type[Message]:
        class Samples(Message):
            values: list[float32]

        return Samples

    class Samples(Message):
        numbers: list[float32]

    twin: Any = twin_class()

    with robot_for(stats) as robot:
        assert twin(values=[1]) == robot.messages.Samples(values=[1]) != twin(values=[2])
        assert robot.call("mean", twin(values=[1, 2])) == Number(value=1.5)
        robot.answer("ask", Number(value=1))
        for act in (lambda m: robot.call("mean", m), lambda m: robot.send("in", m)):
            with pytest.raises(ConfigError, match=r"other fields: use robot\.messages\.Samples"):
                act(Samples(numbers=[1]))
            with pytest.raises(ConfigError, match=r"Samples, as robot\.messages\.Samples\(\.\.\.\), not "):
                act({"values": [1]})
        assert Samples(numbers=[1]) != twin(values=[1])


def test_a_setting_that_nobody_has_and_a_file_that_is_none_are_said(stats: Path) -> None:
    with robot_for(stats) as robot:
        robot.set("gain", 2.0)
        assert robot.part.setting("gain", float) == 2
        with pytest.raises(ConfigError, match="no setting 'period_s'; it has gain"):
            robot.set("period_s", 1)
    with pytest.raises(ConfigError, match=r"there is no file .*stat\.py .*did you mean stats\.py"):
        robot_for(stats.parent / "stat.py")
