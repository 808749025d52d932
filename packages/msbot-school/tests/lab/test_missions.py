"""Missions in a running robot: every ready one is played, and whatever ends one leaves the robot well."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from msbot_agent.link import DisturbedLink
from msbot_school.faults.fault_kinds import KINDS
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.missions.mission import REPAIRS, MissionEventKind, drawn
from msbot_school.missions.mission_file import parse_mission, ready_missions
from msbot_school.missions.mission_lab import MissionLab
from msbot_school.missions.recorded_missions import played_from_json
from msbot_xrce.errors import MsbotError
from tests.lab.fault_stage import FaultStage, fault_scene

ROVER = ("knob", "fan", "button", "headlight", "eye", "beacon", "ear", "hand", "bumper", "horn")
OWN = """
[mission]
title = "Mine"
story = "What is it?"
time_s = 30
hints = ["look"]

[[fault]]
kind = "unplug"
at = "fan"
after_s = 2
"""


class Played:
    """A robot in which missions are played."""

    def __init__(self, stage: FaultStage) -> None:
        self.stage = stage
        self.lab = MissionLab(stage.operations, stage.lab)
        self.notes: list[Mapping[str, object]] = []
        stage.operations.missions.on_note(self.notes.append)

    async def do(self, operation: str, *, who: str = "Bo", **arguments: Any) -> str:
        return (await self.stage.operations.do(operation, who=who, **arguments)).words

    async def refused(self, operation: str, **arguments: Any) -> str:
        try:
            words = await self.do(operation, **arguments)
        except MsbotError as error:
            return str(error)
        raise AssertionError(words)

    async def state(self) -> Mapping[str, object]:
        return (await self.stage.operations.do("mission", who="Bo")).answer

    async def runs(self) -> bool:
        return "mission" in await self.state()

    async def start(self, toml: str = OWN) -> str:
        return await self.do("start_mission", who="Ada", mission="mine.toml", toml=toml, seed=1)

    async def report(self) -> Mapping[str, object]:
        return (await self.stage.operations.do("mission_report", who="Bo")).answer

    def is_clean(self) -> bool:
        """Whether nothing of a mission is left."""
        links = self.stage.robot.master.agent.links
        return not self.stage.lab._engine.faults and not any(isinstance(link, DisturbedLink) for link in links)


REPAIR_OF = {kind: repair.name for repair in REPAIRS.values() for kind in repair.mends}


@pytest.fixture(scope="module")
def graded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[float, str]]:
    """Percent and end of each ready mission, played right in one rover."""
    found: dict[str, tuple[float, str]] = {}

    async def scene(stage: FaultStage) -> None:
        played = Played(stage)
        for name, mission in ready_missions().items():
            if name == "wrong-hands":  # needs a robot with keys
                continue
            await played.do("start_mission", who="Ada", mission=name, seed=7)
            if mission.tasks:
                await played.do("identify", part="fan")
            await asyncio.sleep(11)
            for fault in drawn(mission, 7):
                words = await played.do("answer_mission", kind=fault.kind, at=fault.at)
                assert words.endswith("right"), (name, words)
                words = await played.do("repair", repair=REPAIR_OF[fault.kind], at=fault.at)
                assert words.endswith("that has mended it"), (name, words)
            for _ in range(60):
                if not await played.runs():
                    break
                await asyncio.sleep(0.5)
            report = played_from_json(await played.report())
            assert report.mission.name == name
            assert played.is_clean(), name
            found[name] = report.grade().percent, report.grade().reason
            for _ in range(200):
                if all(stage.card(slot).state == "active" for slot in ROVER):
                    break
                await asyncio.sleep(0.1)

    fault_scene(tmp_path_factory.mktemp("ready"), scene, names=ROVER)
    return found


@pytest.mark.parametrize("name", sorted(set(ready_missions()) - {"wrong-hands"}))
def test_a_ready_mission_played_right_brings_all_marks(graded: dict[str, tuple[float, str]], name: str) -> None:
    assert graded[name] == (100.0, "everything is found and done")


def test_the_mission_about_keys(tmp_path: Path) -> None:
    async def scene(stage: FaultStage) -> None:
        played = Played(stage)
        mission = ready_missions()["wrong-hands"]
        (fault,) = drawn(mission, 7)
        await played.do("start_mission", who="Ada", mission="wrong-hands", seed=7)
        await asyncio.sleep(14)
        (arrived,) = [part for part in stage.page.arrivals() if part.part == fault.at]
        assert "key" in arrived.reason
        await played.do("answer_mission", kind="wrong-key", at=fault.at)
        await played.do("repair", repair="right-part", at=fault.at)
        assert played_from_json(await played.report()).grade().percent == 100

    fault_scene(tmp_path, scene, names=("knob", "fan", "headlight"), keyed=True)


def test_a_life_with_missions(tmp_path: Path) -> None:
    """Everything else, in one robot."""

    async def scene(stage: FaultStage) -> None:
        played = Played(stage)
        await what_cannot_begin_changes_nothing(played)
        await answers_are_not_told(played)
        await who_plugs_in_has_mended(played)
        await its_time_ends_it(played)
        await a_teacher_ends_it(played)
        await stop_ends_it(played)
        await the_end_of_the_robot_ends_it(played)
        assert stage.registry.storage.flush(60.0)
        robot = stage.operations.missions.running.robot
        lines = [edit.words for edit in stage.registry.edits.latest(robot) if edit.kind == "mission"]
        assert "mission mine begins" in lines
        assert "mission mine is over (its time is over)" in lines
        assert "mission mine is over (Cy said STOP)" in lines

    fault_scene(tmp_path, scene)


async def what_cannot_begin_changes_nothing(played: Played) -> None:
    stage = played.stage
    assert set(played.lab.obstacles()) == {"wrong-hands"}
    without_bus = FaultLab(stage.operations, parts=stage.robot)
    others = MissionLab(stage.operations, without_bus).obstacles()
    assert set(others) == {"wrong-hands", "chatterbox", "crackle", "outcast"}
    assert "as `msbot demo` has" in others["crackle"]
    stage.operations.faults.attach(stage.lab)
    stage.operations.missions.attach(played.lab)
    for arguments, words in (
        ({"mission": "one-silent"}, "in a robot that is well: ear, headlight, bumper must be active first"),
        (
            {"mission": "x.toml", "toml": OWN.replace("fan", "nose") + '[robot]\nsample = "rover"'},
            "needs a robot with the slots nose: `msbot demo --robot rover` has them",
        ),
        ({"mission": "x.toml", "toml": OWN + '[[do]]\nwords = "w"\nuntil = "nose is active"'}, "no slot nose"),
        (
            {"mission": "nothing"},
            "one of your own is a file, such as nothing.toml; there are a-bad-day",
        ),
        ({"mission": "x.toml", "toml": "[mission]"}, "x.toml"),
        ({"mission": "x.toml", "toml": OWN.replace("unplug", "wrong-key")}, "asks no part for a key"),
        ({"mission": "x.toml", "toml": OWN.replace("unplug", "stuck")}, "fan has no sensor"),
    ):
        assert words in await played.refused("start_mission", **arguments)
        assert played.is_clean()
    for operation, arguments in (
        ("answer_mission", {"kind": "loss"}),
        ("repair", {"repair": "plug-in"}),
        ("mission_hint", {}),
        ("stop_mission", {}),
    ):
        assert "no mission runs" in await played.refused(operation, **arguments)
    assert "no report of a mission" in await played.refused("mission_report")
    await stage.plant("loss", "fan")
    assert "`msbot fault clear` ends them; a mission begins without" in await played.refused(
        "start_mission", mission="x.toml", toml=OWN
    )
    await stage.quiet()
    assert not await played.runs()


async def answers_are_not_told(played: Played) -> None:
    stage = played.stage
    assert await played.start() == "mission mine begins: Mine"
    assert "the mission mine runs" in await played.refused("start_mission", mission="no-memory")
    assert "no other fault may come in between" in await stage.refused("loss", "knob")
    await asyncio.sleep(8)
    assert stage.card("fan").state == "lost"
    told = json.dumps([await played.state(), await stage.listed(), stage.card("fan").faults, stage.why("fan")])
    assert "unplug" not in told
    assert "pulled out" not in told
    assert stage.operations.faults.listed() == await stage.listed()
    edits = stage.registry.edits.latest(stage.operations.missions.running.robot)
    assert not any("unplug" in edit.words for edit in edits)
    shown = (await stage.operations.do("faults", who="Ada", answers=True)).answer["faults"]
    assert isinstance(shown, list)
    assert [fault["kind"] for fault in shown] == ["unplug"]
    assert await played.do("answer_mission", kind="unplug", at="fan") == "the part is pulled out (at fan): right"
    assert "there is no slot nose" in await played.refused("answer_mission", kind="unplug", at="nose")
    assert "name its slot" in await played.refused("answer_mission", kind="unplug")
    assert "there is no repair" in await played.refused("repair", repair="prayer")
    assert await played.do("mission_hint") == "look"


async def who_plugs_in_has_mended(played: Played) -> None:
    played.stage.robot.plug("fan")
    played.stage.operations.acts.note("Cleo", ["fan"])  # as the page does it for whoever plugs in
    await asyncio.sleep(1.5)
    assert not await played.runs()
    report = played_from_json(await played.report())
    found = report.grade()
    assert found.reason == "everything is found and done"
    assert found.looked_by == "Ada"
    assert (found.faults[0].mended_how, found.faults[0].mended_by) == ("", "Cleo")
    assert (found.faults[0].marks, found.of) == (3.0, 10.0), "what was looked up brings nothing, mending does"
    states = [fact.word for fact in report.facts if fact.what is MissionEventKind.STATE and fact.slot == "fan"]
    assert states[:3] == ["active", "late", "lost"]
    await played.stage.quiet()


async def its_time_ends_it(played: Played) -> None:
    await played.start()
    await asyncio.sleep(29.5)
    assert await played.runs()
    await asyncio.sleep(1)
    assert not await played.runs()
    assert played_from_json(await played.report()).grade().reason == "its time is over"
    assert played.is_clean()
    assert played.stage.robot.is_plugged("fan"), "what it set it takes back"
    await played.stage.quiet()


async def a_teacher_ends_it(played: Played) -> None:
    await played.start()
    await asyncio.sleep(3)
    assert not played.stage.robot.is_plugged("fan")
    assert await played.do("stop_mission", who="Ada") == "mission mine is over"
    assert played.stage.robot.is_plugged("fan")
    assert played.is_clean()
    await played.stage.quiet()


async def stop_ends_it(played: Played) -> None:
    await played.start(OWN.replace("hints", 'avoid = ["stop"]\nhints'))
    await asyncio.sleep(3)
    await played.do("stop", who="Cy")
    assert not await played.runs()
    assert played.is_clean()
    found = played_from_json(await played.report()).grade()
    assert [one.words for one in found.wrong] == ["stop was to be avoided"]
    assert "STOP is in force" in await played.refused("start_mission", mission="x.toml", toml=OWN)
    await asyncio.sleep(2)
    await played.do("go", who="Ada")
    await played.stage.quiet()


async def the_end_of_the_robot_ends_it(played: Played) -> None:
    running = asyncio.create_task(played.lab.run())
    await asyncio.sleep(0)
    await played.start()
    await asyncio.sleep(3)
    running.cancel()
    await asyncio.wait([running])
    assert played.is_clean()
    whole = played.notes[-1]
    report = played_from_json({**whole["head"], "facts": whole["facts"]})  # type: ignore[dict-item]
    assert report.grade().reason == "the robot ends"
    live = [note for note in played.notes if note["began_ms"] == whole["began_ms"]][:-1]
    assert [{**note, "began_ms": 0} for note in live if "head" not in note] == [
        {"began_ms": 0, **fact}
        for fact in whole["facts"][1:]  # type: ignore[index]
    ]
    await played.stage.quiet()


def test_a_robot_without_missions_says_so(tmp_path: Path) -> None:
    async def scene(stage: FaultStage) -> None:
        assert (await stage.operations.do("mission", who="Bo")).answer == {"reports": []}
        with pytest.raises(MsbotError, match="this robot runs without missions"):
            await stage.operations.do("stop_mission", who="Ada")

    fault_scene(tmp_path, scene)


def test_kinds_and_repairs_are_where_the_robot_looks() -> None:
    mission = parse_mission(OWN, "mine.toml")
    assert mission.name == "mine"
    assert set(REPAIR_OF) == set(KINDS)
