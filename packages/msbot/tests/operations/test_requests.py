"""Requests of other processes: every operation can be asked for, every mistake is answered with a sentence."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from msbot.config import PartType
from msbot.operations.dispatch import perform
from msbot.operations.operation import EditLog
from msbot.operations.table import OPERATIONS
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_reader import open_world
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson_controller import LessonController
from msbot_school.missions.mission_lab import MissionLab
from tests import ROOT
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

MISSION = '[mission]\ntitle = "T"\nstory = "S"\nhints = ["H"]\n[[fault]]\nkind = "loss"\nat = "AA"\nafter_s = 9\n'
RING = ("AA=DIAL", "BB=EFGH", "CC=WXYZ", "DD=EFGH")


async def ask(stage: Stage, do: str, **args: object) -> dict[str, object]:
    named = {name.rstrip("_"): value for name, value in args.items()}
    return await perform(stage.operations, {"do": do, "args": named, "who": "ann"})


async def forgotten(stage: Stage) -> dict[str, object]:
    """A part type that was adopted is forgotten."""
    library = stage.operations.applying._running.library
    assert library is not None
    library.become(library.with_type(PartType("OLD", "old", origin="said by the part")))
    return await ask(stage, "forget_type", number="OLD")


async def stands_by(stage: Stage) -> dict[str, object]:
    """A part type that was adopted fits other slots, too."""
    library = stage.operations.applying._running.library
    assert library is not None
    dial = library.require("EFGH")
    library.become(library.with_type(replace(dial, number="LIKE", origin="said by the part", compatible_with=())))
    stage.plug("LK", "LIKE")
    await asyncio.sleep(1)
    return await ask(stage, "spare", slot="CC", part="LK", agreed=True)


class Tape:
    """A recorder that only remembers what it was asked for."""

    def __init__(self) -> None:
        self.file = ""

    def record(self, path: Path, *, as_bag: bool) -> None:
        self.file, self.is_bag = str(path), as_bag

    def end_record(self) -> str:
        file, self.file = self.file, ""
        return file

    async def wait_until_complete(self, file: str) -> Sequence[str] | None:
        return {"lost.mcap": None, "bag.mcap": ["/strange"] * 31}.get(Path(file).name, [])

    def as_json(self) -> Mapping[str, object]:
        return {"file": self.file}


async def called(stage: Stage) -> dict[str, object]:
    """A port that serves must be wired before it can be called."""
    await ask(stage, "bind", topic="echo", type="HelloWorld -> HelloWorld", from_="AA.echo", to=[])
    await asyncio.sleep(2.0)
    return await ask(stage, "call", port="AA.echo", values=["1", "hello"])


async def part_forgotten(stage: Stage) -> dict[str, object]:
    """A part must be gone before it can be forgotten."""
    stage.plug("EE", "ABCD")
    await asyncio.sleep(2.0)
    stage.pull("EE")
    await asyncio.sleep(1.0)
    return await ask(stage, "forget_part", part="EE")


def test_every_operation_can_be_asked_for(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.operations.recording.attach(Tape())
        MissionLab(stage.operations, FaultLab(stage.operations))
        LessonController(stage.operations, LessonCatalog())
        stage.operations.worlds.attach(RunningArena(Arena(open_world("line"))))
        done = {
            "swap": await ask(stage, "swap", slot="BB", to="DD"),
            "release": await ask(stage, "release", slot="CC"),
            "adopt": await ask(stage, "adopt", part="CC", slot="CC"),
            "forget_part": await part_forgotten(stage),
            "block": await ask(stage, "block", part="CC", reason="loud"),
            "unblock": await ask(stage, "unblock", part="CC"),
            "set": await ask(stage, "set", slot="AA", name="period_s", value="2"),
            "values": await ask(stage, "values", slot="AA"),
            "reset": await ask(stage, "reset", slot="AA", name="period_s"),
            "unbind": await ask(stage, "unbind", topic="HelloWorldTopic_1_to_2", port="BB.in"),
            "bind": await ask(
                stage, "bind", topic="HelloWorldTopic_1_to_2", type="HelloWorld", from_="AA.out", to=["BB.in"]
            ),
            "undo": await ask(stage, "undo"),
            "edits": await ask(stage, "edits", limit=3),
            "publish": await ask(stage, "publish", port="BB.in", values=["1", "turn-on 3"], seconds=60),
            "let_go": await ask(stage, "let_go", port="BB.in"),
            "topics": await ask(stage, "topics"),
            "log_lines": await ask(stage, "log_lines"),
            "topic_samples": await ask(stage, "topic_samples", topic="HelloWorldTopic_1_to_2"),
            "publish_topic": await ask(stage, "publish_topic", topic="HelloWorldTopic_1_to_2", values=["1", "hi"]),
            "call": await called(stage),
            "window": await ask(stage, "window", seconds=5),
            "close_window": await ask(stage, "close_window"),
            "stop": await ask(stage, "stop", reason="hand in the gear"),
            "stop_report": await ask(stage, "stop_report"),
            "record": await ask(stage, "record", file=str(tmp_path / "a.mcap")),
            "recording": await ask(stage, "recording"),
            "end_record": await ask(stage, "end_record"),
            "objects": await ask(stage, "objects"),
            "stored": await ask(stage, "stored"),
            "versions": await ask(stage, "versions"),
            "go": await ask(stage, "go"),
            "plant_fault": await ask(stage, "plant_fault", kind="loss", at="AA"),
            "faults": await ask(stage, "faults"),
            "clear_fault": await ask(stage, "clear_fault", fault=1),
            "start_mission": await ask(stage, "start_mission", mission="m.toml", toml=MISSION),
            "mission": await ask(stage, "mission"),
            "answer_mission": await ask(stage, "answer_mission", kind="loss", at="AA"),
            "repair": await ask(stage, "repair", repair="new-cable", at="AA"),
            "mission_hint": await ask(stage, "mission_hint"),
            "stop_mission": await ask(stage, "stop_mission"),
            "mission_report": await ask(stage, "mission_report"),
            "who_stops": await ask(stage, "who_stops", lesson="first_part"),
            "start_lesson": await ask(stage, "start_lesson", lesson="ring"),
            "join_lesson": await ask(stage, "join_lesson"),
            "answer_lesson": await ask(stage, "answer_lesson", check="1.3", answer="HelloWorldTopic_1_to_2"),
            "hand": await ask(stage, "hand", down=True),
            "lesson": await ask(stage, "lesson"),
            "stop_lesson": await ask(stage, "stop_lesson"),
            "pause_world": await ask(stage, "pause_world"),
            "step_world": await ask(stage, "step_world", steps=25),
            "put_robot": await ask(stage, "put_robot", robot="robot", x=0.5, y=0.75, heading=90),
            "world": await ask(stage, "world"),
            "world_speed": await ask(stage, "world_speed", speed=2),
            "reset_world": await ask(stage, "reset_world"),
            "group": await ask(stage, "group", group="Red", pupils=["ben"], slots=["AA"]),
            "freeze": await ask(stage, "freeze", reason="look"),
            "thaw": await ask(stage, "thaw"),
            "take_over": await ask(stage, "take_over", pupil="ben"),
            "classroom": await ask(stage, "classroom"),
            "hand_back": await ask(stage, "hand_back", pupil="ben"),
            "remove_group": await ask(stage, "remove_group", group="Red"),
            "ignore": await ask(stage, "ignore", part="DD"),
            "simulate": await ask(stage, "simulate", slot="CC"),
            "identify": await ask(stage, "identify", part="AA"),
            "why": await ask(stage, "why", part="AA"),
            "apply": await ask(stage, "apply", path=str(tmp_path / "robot.toml"), folders=[str(tmp_path / "library")]),
            "add_slot": await ask(stage, "add_slot", slot="EE", part="EFGH"),
            "remove_slot": await ask(stage, "remove_slot", slot="EE"),
            "spare": await stands_by(stage),
            "forget_type": await forgotten(stage),
        }
        assert done.keys() == set(OPERATIONS)
        assert {name: answer["error"] for name, answer in done.items() if "error" in answer} == {}
        assert done["set"] == {"words": "period_s of AA: 1 s -> 2 s", "edit": done["set"]["edit"]}
        assert done["recording"] == {"file": str(tmp_path / "a.mcap")}
        assert done["step_world"]["words"] == "0.5 s have passed in the world"
        assert done["world"]["robots"] == {"robot": {"x": 0.5, "y": 0.75, "heading": 90.0, "parts": []}}
        assert (done["world"]["paused"], done["world"]["seconds"]) == (True, 0.5)
        assert done["stored"] == {"trouble": "", "waiting": 0}
        assert done["stop_report"]["reason"] == "hand in the gear"
        edits = done["edits"]["edits"]
        assert isinstance(edits, list)
        assert [edit["kind"] for edit in edits] == ["undo", "bind", "bind"]

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({}, "there is no operation None; there are adopt, swap"),
        ({"do": "explode", "who": "ann"}, "there is no operation 'explode'"),
        ({"do": "release", "args": {"slot": "BB"}}, "release: it is not said who asks for it"),
        ({"do": "release", "who": "ann"}, "release: slot is missing"),
        ({"do": "release", "who": "ann", "args": {"slot": 1}}, "release: slot must be a text"),
        ({"do": "release", "who": "ann", "args": []}, "release: the arguments must be an object"),
        ({"do": "release", "who": "ann", "args": {"slto": "BB"}}, "release knows no slto; it takes slot"),
        ({"do": "go", "who": "ann", "args": {"x": 1}}, "go knows no x; it takes stop"),
        ({"do": "go", "who": "ann", "args": {"who": "eve"}}, "go knows no who; it takes stop"),
        ({"do": "undo", "who": "ann", "args": {"edit": 10**400}}, "undo: edit must be a whole number"),
        ({"do": "undo", "who": "ann", "args": {"edit": 0}}, "undo: edit is 0; it must be 1 to 9007199254740992"),
        ({"do": "window", "who": "ann", "args": {"seconds": 0.5}}, "window: seconds is 0.5; it must be 1 to 3600"),
        ({"do": "window", "who": "ann", "args": {"seconds": 10**400}}, "window: seconds must be a number"),
        ({"do": "go", "who": "ann"}, "nobody said STOP: there is nothing to end"),
        ({"do": "undo", "who": "ann", "args": {"edit": True}}, "undo: edit must be a whole number"),
        ({"do": "window", "who": "ann", "args": {"seconds": "x"}}, "window: seconds must be a number"),
        (
            {"do": "bind", "who": "ann", "args": {"topic": "t", "type": "x", "to": "BB.in"}},
            "bind: to must be a list of texts",
        ),
        (
            {"do": "bind", "who": "ann", "args": {"topic": "t", "type": "x", "reliable": 1}},
            "bind: reliable must be true or false",
        ),
        (
            {"do": "bind", "who": "ann", "args": {"topic": "t", "type": "HelloWorld", "to": ["in"]}},
            "'in' is not a port: write SLOT.port, for example AA.out",
        ),
        ({"do": "apply", "who": "ann", "args": {"path": "/nowhere.toml"}}, "/nowhere.toml"),
    ],
)
def test_a_mistake_is_answered_with_a_sentence(request_: dict[str, object], words: str, tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        answer = await perform(stage.operations, request_)
        assert words in str(answer["error"])
        await asyncio.sleep(0)

    play(tmp_path, scene)


STORED = {
    EditLog.UNDOABLE: "undoable",
    EditLog.CHANGE: "change",
    EditLog.LINE: "line",
    EditLog.NOTHING: "",
}


def test_the_reference_lists_the_operations() -> None:
    page = (ROOT / "docs" / "reference" / "operations.md").read_text()
    rows = {}
    for line in re.findall(r"^\* `.*$", page, re.MULTILINE):
        named, _, rest = line.partition(": ")
        call, role, stored = re.findall(r"\((?:`([A-Z]+ /api/\S+)`, )?(\w+)(?:, (\w+))?\)$", rest)[0]
        name, *arguments = re.findall(r"`(\w+)`", named)
        rows[name] = (tuple(arguments), call.replace(" /api/", " /"), role, stored)
    assert rows == {
        name: (
            tuple(argument.name for argument in row.arguments),
            row.call,
            row.right.least.word,
            STORED[row.kept],
        )
        for name, row in OPERATIONS.items()
    }


def test_the_end_of_a_recording_tells_what_is_not_in_it(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        tape = Tape()
        stage.operations.recording.attach(tape)
        bag, lost, last = (str(tmp_path / f"{name}.mcap") for name in ("bag", "lost", "last"))
        begun = await ask(stage, "record", file=bag, ros2=True)
        assert (begun["words"], tape.is_bag) == (f"what ROS 2 can read is recorded in {bag} from now on", True)
        left_out = f"{bag} is complete; left out, for they are no ROS 2 messages: " + "/strange, " * 30 + "..."
        instead = await ask(stage, "record", file=lost)
        assert instead["words"] == f"{left_out}; everything is recorded in {lost} from now on"
        assert not tape.is_bag
        not_ended = f"{lost} is not complete yet, or could not be written: see `msbot rec list`"
        assert (await ask(stage, "end_record"))["words"] == not_ended
        await ask(stage, "record", file=last)
        assert (await ask(stage, "end_record"))["words"] == f"{last} is complete"

    play(tmp_path, scene)


@pytest.mark.parametrize(
    ("do", "args", "error"),
    [
        ("record", {"file": "a.mcap"}, "a.mcap: the file is named with its whole path"),
        ("record", {"file": "/nowhere/a.mcap"}, "/nowhere/a.mcap: there is no folder /nowhere"),
        ("record", {"file": __file__}, f"{__file__} is there already: give the recording another name"),
        ("end_record", {}, "this robot runs with `--rec off`: it has no recorder"),
    ],
)
def test_a_recording_that_cannot_be_is_refused(do: str, args: dict[str, str], error: str, tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert await ask(stage, do, **args) == {"error": error}

    play(tmp_path, scene)
