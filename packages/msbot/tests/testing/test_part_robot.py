"""`robot_for`: a part's program in a robot of its own, in virtual time; the examples of the page run as written."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from msbot import Count, HelloWorld, Level, Message, Part, float32
from msbot.testing import robot_for
from msbot_xrce.errors import ConfigError, MsbotError
from tests import ROOT

PAGE = (ROOT / "docs/howto/test_your_part.md").read_text()
EXAMPLES = ROOT / "examples"


class Wind(Message):
    speed: float32


class Seen:
    """What happened to the part of `fan`."""

    def __init__(self) -> None:
        self.told: list[str] = []


def fan(seen: Seen) -> Part:
    part = Part("FAN-OF-A-TEST", robot="ROVER", describes=True)
    part.publishes("speed", Level)
    part.publishes("wind", Wind)

    @part.on("power", Level, safe=Level(percent=0))
    def power(message: Level) -> None:
        seen.told.append(f"power {message.percent:g}")
        if part.state.value == "active":
            part.publish("speed", Level(percent=message.percent))

    @part.on_setting("gain", int, default=1)
    def gain(value: int) -> None:
        seen.told.append(f"gain {value}")
        part.publish("wind", Wind(speed=100 / value))

    for name in ("on_join", "on_lost", "on_stop", "on_go", "on_identify", "on_end"):
        getattr(part, name)(lambda name=name: seen.told.append(name))
    part.on_partner_lost(lambda port: seen.told.append(f"nobody at {port}"))
    return part


def test_the_examples_of_the_page_run_as_they_are_written(tmp_path: Path) -> None:
    program, tests, plain, *_ = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "fan.py").write_text(program)
    (tmp_path / "test_fan.py").write_text(tests)
    (tmp_path / "plain.py").write_text(plain)
    python = [sys.executable, "-m"]
    done = subprocess.run(
        [*python, "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "3 passed" in done.stdout, done.stdout + done.stderr
    done = subprocess.run([sys.executable, "plain.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("Level(percent=40.0)\n", "")


def test_messages_stop_settings_partner_and_cable() -> None:
    seen = Seen()
    with robot_for(fan(seen), settings={"gain": 2}) as robot:
        assert seen.told == ["gain 2", "on_join"]
        robot.send("power", Level(percent=40))
        assert robot.published("speed") == [Level(percent=40)]
        robot.set("gain", 5)
        assert robot.last("wind") == Wind(speed=20)
        robot.identify()
        robot.stop("hand in the gear")
        robot.send("power", Level(percent=90))
        robot.go()
        assert seen.told[2:] == ["power 40", "gain 5", "on_identify", "power 0", "on_stop", "on_go"]
        seen.told.clear()
        robot.unplug_partner()
        with pytest.raises(ConfigError, match="the partner is unplugged"):
            robot.send("power", Level(percent=1))
        robot.plug_partner()
        robot.send("power", Level(percent=7))
        assert seen.told == ["power 0", "nobody at power", "power 7"]
        seen.told.clear()
        robot.unplug()
        assert (robot.state, robot.part.state.value) == ("lost", "lost")
        robot.plug()
        assert seen.told == ["power 0", "on_lost", "on_join"]
        assert any("is active" in line for line in robot.log)
        assert not any("partner" in line for line in robot.log)


def test_errors_are_what_students_read() -> None:
    with robot_for(fan(Seen())) as robot:
        robot.set("gain", 0)
        (error,) = robot.errors
        assert re.match(r"test_part_robot\.py:\d+.*: ZeroDivisionError", error)
        robot.clear()
        assert (robot.errors, robot.log, robot.published("wind")) == ([], [], [])


def test_time_is_virtual_and_the_same_each_time() -> None:
    def counted() -> tuple[float, int]:
        part = Part("COUNT-OF-A-TEST")
        part.publishes("out", Count)

        @part.every(0.5)
        def tick() -> None:
            part.publish("out", Count(value=1))

        with robot_for(part) as robot:
            robot.advance(10)
            return robot.now, len(robot.published("out"))

    assert counted() == counted()
    assert counted()[1] in (20, 21)


def test_a_program_is_run_up_to_its_run_and_has_the_ports_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    with robot_for(EXAMPLES / "01_hello.py") as robot:
        robot.advance(1)
        assert isinstance(robot.last("out"), HelloWorld)
    with robot_for(str(EXAMPLES / "02_listen.py")) as robot:
        robot.send("in", HelloWorld(index=1, message="as in a robot"))
    assert "as in a robot" in capsys.readouterr().out


def test_what_cannot_be_is_said_where_it_was_asked_for(tmp_path: Path) -> None:
    with robot_for(fan(Seen())) as robot:
        for call, words in (
            (lambda: robot.send("speed", Level(percent=0)), "the part listens to no port 'speed'; it listens to power"),
            (lambda: robot.published("power"), "the part publishes at no port 'power'; it publishes at speed, wind"),
            (lambda: robot.send("power", Wind(speed=0)), "port 'power' carries Level, not Wind"),
            (lambda: robot.advance(-1), "time does not run backwards"),
        ):
            with pytest.raises(ConfigError, match=re.escape(words)):
                call()
        with pytest.raises(AssertionError, match="nothing was published at 'speed'"):
            robot.last("speed")
    empty = tmp_path / "empty.py"
    empty.write_text("")
    with pytest.raises(ConfigError, match="the program runs 0 parts"):
        robot_for(empty)
    wrong = Part("ABCD")
    wrong.publishes("out", Level)
    with pytest.raises(ConfigError, match="the library says that ABCD publishes HelloWorld there"):
        robot_for(wrong)


def test_a_mistake_that_ends_a_part_ends_the_test() -> None:
    part = Part("MISTAKE-OF-A-TEST")

    @part.every(1.0)
    def tick() -> None:
        part.publish("nowhere", Level(percent=0))

    with pytest.raises(MsbotError, match="nowhere"), robot_for(part) as robot:
        robot.advance(1)


def test_a_robot_that_nobody_closes_ends_without_a_word(tmp_path: Path) -> None:
    (tmp_path / "fan.py").write_text('from msbot import Part\n\npart = Part("FAN", describes="Fan")\npart.run()\n')
    program = "from msbot.testing import robot_for\nrobot = robot_for('fan.py')\nprint(robot.state)\n"
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("active\n", "")


def test_the_part_of_the_tutorial_passes_its_tests(tmp_path: Path) -> None:
    page = (ROOT / "docs/tutorial/own_part.md").read_text()
    program, tests = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "stats.py").write_text(program)
    (tmp_path / "test_stats.py").write_text(tests)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "2 passed" in done.stdout, done.stdout + done.stderr
