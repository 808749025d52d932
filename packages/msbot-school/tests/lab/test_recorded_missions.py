"""A mission in a recording brings the marks that it brought in the robot; its report needs nothing but itself."""

from __future__ import annotations

import asyncio
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.operations.dispatch import InProcessOperations
from msbot.recording.recorder.batch import Unpacker
from msbot.recording.recorder.recorder import Recorder
from msbot.recording.recordings.mcap_reader import RecordingReader
from msbot_school.cli.mission import command
from msbot_school.demo import DemoRobot
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.missions.mission import MissionEventKind
from msbot_school.missions.mission_lab import MissionLab
from msbot_school.missions.recorded_missions import TOPIC, PlayedMission, grade_json, played_in
from msbot_web.language import languages
from msbot_web.mission_report import report_page
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, messages, record_demo, store

MINE = """
[mission]
title = "<b>Mine</b>"
story = "What is it?"
time_s = 60
hints = ["look"]
explanation = "It was pulled out."

[[fault]]
kind = "unplug"
at = "BB"
after_s = 2

[[do]]
words = "Have AA show itself."
operation = "identify"
with = { part = "AA" }
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PlayedMission]:
    """A recording, and what the robot itself has of the mission in it."""
    folder = tmp_path_factory.mktemp("recorded")
    live: list[PlayedMission] = []

    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(3)
        lab = MissionLab(operations, FaultLab(operations, parts=robot), epoch_ns=lambda: BEGAN_NS)
        await operations.do("start_mission", who="Ada", mission="mine.toml", toml=MINE, seed=4)
        await asyncio.sleep(9)
        for kind, at in (("loss", "BB"), ("unplug", "CC"), ("unplug", "BB")):
            await operations.do("answer_mission", who="Bo", kind=kind, at=at)
        await operations.do("mission_hint", who="Cy")
        await operations.do("identify", who="Cy", part="AA")
        await operations.do("faults", who="Cy", answers=True)
        await operations.do("repair", who="Bo", repair="plug-in", at="BB")
        live.append(lab.played(None))

    record_demo(folder, folder / "a.mcap", scene)
    return folder / "a.mcap", live[0]


def test_it_brings_the_same_marks(recorded: tuple[Path, PlayedMission]) -> None:
    path, live = recorded
    (found,) = played_in(RecordingReader(path))
    assert grade_json(found) == grade_json(live)
    grade = found.grade()
    assert grade.reason == "everything is found and done"
    assert (grade.marks, grade.of) == (12 - 3, 12), "two wrong answers and a hint; the answers were looked up too late"
    assert [fact.word for fact in found.facts if fact.what is MissionEventKind.STATE and fact.slot == "BB"][:3] == [
        "active",
        "late",
        "lost",
    ]


def test_a_mission_that_was_broken_off_is_graded_as_far_as_it_goes(
    recorded: tuple[Path, PlayedMission], tmp_path: Path
) -> None:
    path, _ = recorded
    recorder = Recorder(lambda: 0.0, lambda: BEGAN_NS)
    for message in messages(path):
        if message.topic == TOPIC and b'"facts"' not in message.data and b'"ended"' not in message.data:
            recorder._mission_noted(json.loads(message.data))

    store(Unpacker().feed(recorder.drain()), tmp_path / "b.mcap")
    (found,) = played_in(RecordingReader(tmp_path / "b.mcap"))
    assert found.grade().reason == ""
    assert found.grade().marks == 9


def test_a_recording_without_mission_says_so(tmp_path: Path) -> None:
    store([], tmp_path / "empty.mcap")
    with pytest.raises(ConfigError, match="there is no mission in"):
        played_in(RecordingReader(tmp_path / "empty.mcap"))


class Tags(HTMLParser):
    """What a page loads, and its open elements."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loads += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "line", "rect", "circle"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("rect", "circle", "line"):
            assert self.open.pop() == tag


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("en", "9 of 12 marks 75 % over after 9 s: everything is found and done"),
        ("de", "9 von 12 Punkten 75 % zu Ende nach 9 s: alles ist gefunden und erledigt"),
    ],
)
def test_the_report_is_a_page_of_its_own(recorded: tuple[Path, PlayedMission], code: str, words: str) -> None:
    page = report_page(recorded[1], languages()[code])
    tags = Tags()
    tags.feed(page)
    assert tags.loads == []
    assert tags.open == []
    text = re.sub(r"\s+", " ", re.sub(r"<(style|title)>.*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL))
    assert words in text
    assert "&lt;b&gt;Mine&lt;/b&gt;" in page, "what a file says is text"
    for one in ("Bo", "Cy", "−1", "It was pulled out."):
        assert one in text


def test_the_command_grades_a_recording_and_writes_the_page(
    recorded: tuple[Path, PlayedMission], tmp_path: Path
) -> None:
    path = str(recorded[0])
    told = CliRunner().invoke(command, ["report", "--recording", path])
    assert told.output.startswith("<b>Mine</b> (mine, seed 4): 9 of 12 marks, 75 %\nover after 9 s")
    assert "unplug at BB: named by Bo after 7 s, mended by Bo after 7 s (plug-in): 10 of 10" in told.output
    target = tmp_path / "r.html"
    done = CliRunner().invoke(command, ["report", "--recording", path, "--html", str(target), "--language", "de"])
    assert done.exit_code == 0
    assert "Punkten" in target.read_text()
    for arguments, words in (
        (["--number", "7"], "there is no mission 7 in"),
        (["--html", str(tmp_path)], "cannot write"),
        (["--html", str(target), "--language", "xx"], "there is no language 'xx'; there are en, de"),
    ):
        failed = CliRunner().invoke(command, ["report", "--recording", path, *arguments])
        assert words in str(failed.exception)


def test_a_damaged_recording_is_graded_as_far_as_it_goes_and_told(
    recorded: tuple[Path, PlayedMission], tmp_path: Path
) -> None:
    short = tmp_path / "short.mcap"
    short.write_bytes(recorded[0].read_bytes()[:-40])
    told = CliRunner().invoke(command, ["report", "--recording", str(short)])
    assert told.exit_code == 1
    assert told.stdout.startswith("<b>Mine</b> (mine, seed 4): 9 of 12 marks")
    assert told.stderr.startswith(f"msbot: {short} is damaged: ")


def test_the_list_and_the_check_tell_what_there_is(tmp_path: Path) -> None:
    listed = CliRunner().invoke(command, ["list"]).output
    assert "one-silent             5  rover  One of us does not answer" in listed
    (tmp_path / "mine.toml").write_text(MINE)
    checked = CliRunner().invoke(command, ["check", str(tmp_path / "mine.toml")]).output
    assert checked.endswith("mine.toml is right: faults: 1, things to do: 1, 60 s; slots: BB\n")
    (tmp_path / "mine.toml").write_text(MINE.replace("unplug", "unplugged"))
    failed = CliRunner().invoke(command, ["check", str(tmp_path / "mine.toml")])
    assert "mine.toml, line 10, fault[0].kind: there is no fault 'unplugged'" in str(failed.exception)
