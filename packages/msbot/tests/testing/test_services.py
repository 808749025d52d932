"""`robot_for` and services: a test calls what a part serves, and stands in for what it calls."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from msbot import Angle, CallError, Message, Number, Part, Text
from msbot.part.calls import MOST_SERVED
from msbot.testing import robot_for
from msbot_xrce.errors import ConfigError
from tests import ROOT

PAGE = (ROOT / "docs/howto/test_your_part.md").read_text().partition("## Services")[2]


def camera() -> Part:
    part = Part("CAMERA-OF-A-TEST")

    @part.serves("photo", Angle, Text)
    def photo(request: Angle) -> Text:
        if request.degrees > 90:
            raise CallError("it turns to 90 degrees only")
        return Text(text=f"a tree at {request.degrees:g}")

    return part


def brain(told: list[str]) -> Part:
    part = Part("BRAIN-OF-A-TEST")
    part.calls("look", Angle, Text)
    part.publishes("seen", Number)

    @part.every(2.0)
    def look() -> None:
        try:
            told.append(part.call("look", Angle(degrees=len(told)), timeout=1.0).text)
        except CallError as error:
            told.append(str(error))

    return part


def test_the_examples_of_the_page_run_as_they_are_written(tmp_path: Path) -> None:
    program, tests = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "relay.py").write_text(program)
    (tmp_path / "test_relay.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path)]
    done = subprocess.run([*command, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "3 passed" in done.stdout, done.stdout + done.stderr


def test_a_test_calls_what_a_part_serves() -> None:
    with robot_for(camera()) as robot:
        assert robot.call("photo", Angle(degrees=45)) == Text(text="a tree at 45")
        with pytest.raises(CallError, match="refused: it turns to 90 degrees only"):
            robot.call("photo", Angle(degrees=100))
        robot.stop()
        with pytest.raises(CallError, match="STOP is in force"):
            robot.call("photo", Angle(degrees=1))
        robot.go()
        robot.unplug()
        with pytest.raises(CallError, match=r"slot part is empty|no reply within"):
            robot.call("photo", Angle(degrees=1))
        robot.plug()
        assert robot.call("photo", Angle(degrees=2)) == Text(text="a tree at 2")
        robot.unplug_partner()
        with pytest.raises(ConfigError, match="nobody can call 'photo'"):
            robot.call("photo", Angle(degrees=1))
        assert robot.errors == []


def test_a_test_stands_in_for_what_a_part_calls() -> None:
    told: list[str] = []
    with robot_for(brain(told)) as robot:
        robot.advance(1.5)
        assert told[0].startswith("call of look: no reply within 1 s"), "at first nobody ever answers"
        robot.answer("look", Text(text="a wall"))
        robot.advance(2)
        robot.answer("look", lambda request: Text(text=f"a door at {request.degrees:g}"))
        robot.advance(2)
        robot.answer("look", CallError("it is dark"))
        robot.advance(2)
        robot.answer("look", None)
        robot.advance(2)
        assert [one.partition(": is the part")[0] for one in told[1:]] == [
            "a wall",
            "a door at 2",
            "call of look: refused: it is dark",
            "call of look: no reply within 1 s",
        ]
        assert robot.asked("look") == [Angle(degrees=number) for number in range(5)]
        robot.clear()
        assert robot.asked("look") == []
        robot.unplug_partner()
        robot.advance(2)
        assert told[-1] == "call of look: the robot does not pass it on: slot partner is empty"
        robot.plug_partner()
        robot.answer("look", Text(text="a wall"))
        robot.advance(2)
        assert told[-1] == "a wall"
        assert robot.errors == []


def test_a_service_may_stay_silent_as_often_as_a_test_likes() -> None:
    told: list[str] = []
    with robot_for(brain(told)) as robot:
        robot.advance(2 * MOST_SERVED - 1)
        assert {one[:33] for one in told} == {"call of look: no reply within 1 s"}


@pytest.mark.parametrize(
    ("port", "answer", "words"),
    [
        ("loook", None, "the part calls at no port 'loook'; it calls at look"),
        ("look", Number(value=1.0), "port 'look' gets Text, not Number"),
    ],
)
def test_mistakes_of_a_test_are_told(port: str, answer: Message | None, words: str) -> None:
    with robot_for(brain([])) as robot:
        with pytest.raises(ConfigError) as raised:
            robot.answer(port, answer)
        assert words in str(raised.value)
        with pytest.raises(ConfigError, match="the part serves at no port 'look'; it serves at none"):
            robot.call("look", Angle(degrees=1))
