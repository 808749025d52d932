"""The fault lab in a running robot: who ends faults, what is told of them, and what cannot be planted."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot_agent.link import DisturbedLink
from msbot_school.faults.fault_lab import FaultLab
from tests.lab.fault_stage import FaultStage, fault_scene
from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


def is_disturbed(stage: FaultStage) -> bool:
    return any(isinstance(link, DisturbedLink) for link in stage.robot.master.agent.links)


def test_a_life_in_the_lab(tmp_path: Path) -> None:
    """Everything that needs a robot and leaves it well, in one robot."""

    async def scene(stage: FaultStage) -> None:
        await ends_by_itself(stage)
        await waits_for_its_condition(stage)
        await is_mended_by_a_person(stage)
        await is_hidden(stage)
        await what_makes_no_sense_is_refused(stage)
        await stop_ends_all(stage)
        assert stage.registry.storage.flush(60.0)
        robot = stage.operations.faults.running.robot
        edits = [one for one in stage.registry.edits.latest(robot) if one.kind == "fault"]
        lines = [edit.words for edit in edits]
        assert "fault 1 begins: loss at fan: packets are lost (30 %)" in lines
        assert "fault 1 is over (its time is over): loss at fan: packets are lost (30 %)" in lines
        assert {edit.who for edit in edits} == {"Ada"}

    fault_scene(tmp_path, scene)


async def ends_by_itself(stage: FaultStage) -> None:
    assert not is_disturbed(stage)
    words = await stage.plant("loss", "fan", **{"for": 5})
    assert words == "fault 1: loss at fan: packets are lost (30 %), for 5 s"
    await asyncio.sleep(4.5)
    assert is_disturbed(stage)
    assert [fault["kind"] for fault in await stage.listed()] == ["loss"]
    await asyncio.sleep(1.0)
    assert not is_disturbed(stage)  # not one instruction more for a sample than without a lab
    assert await stage.listed() == []
    assert stage.card("fan").faults == []


async def waits_for_its_condition(stage: FaultStage) -> None:
    stage.page.bench.operate("knob", "knob", 10.0)
    await stage.plant("unplug", "fan", when="knob.level > 60")
    await asyncio.sleep(2.0)
    assert stage.robot.is_plugged("fan")
    stage.page.bench.operate("knob", "knob", 90.0)
    await asyncio.sleep(1.0)
    assert not stage.robot.is_plugged("fan")
    await stage.quiet()
    assert stage.robot.is_plugged("fan")


async def is_mended_by_a_person(stage: FaultStage) -> None:
    await stage.plant("unplug", "fan")
    await asyncio.sleep(1.0)
    stage.robot.plug("fan")
    await asyncio.sleep(1.0)
    assert stage.changes[-1]["begins"] is False
    assert stage.changes[-1]["reason"] == "somebody has plugged it in again"


async def is_hidden(stage: FaultStage) -> None:
    await stage.plant("late", "fan", hidden=True)
    await asyncio.sleep(1.0)
    assert stage.card("fan").faults == []
    assert "planted" not in stage.why("fan")
    (listed,) = await stage.listed()
    assert listed["hidden"] is True
    await stage.quiet()


async def what_makes_no_sense_is_refused(stage: FaultStage) -> None:
    for wish, words in (
        ({"kind": "lost"}, "there is no fault 'lost'; did you mean loss?"),
        ({"kind": "loss"}, "loss is planted at a part: name its slot"),
        ({"kind": "loss", "at": "nowhere"}, "nowhere"),
        ({"kind": "babbling", "at": "fan"}, "planted at the robot as a whole: leave fan out"),
        ({"kind": "loss", "at": "fan", "amount": 200.0}, "loss: 200 % is not possible; it is 0.1 to 100 %"),
        ({"kind": "unplug", "at": "fan", "amount": 2.0}, "unplug takes no --amount"),
        ({"kind": "loss", "at": "fan", "jitter": 5.0}, "loss takes no --jitter"),
        ({"kind": "stuck", "at": "fan"}, "fan has no sensor"),
        ({"kind": "stuck", "at": "knob", "port": "smell"}, "it publishes: level"),
        ({"kind": "wrong-number", "at": "fan", "number": "NOTHING"}, "NOTHING"),
        ({"kind": "wrong-key", "at": "fan"}, "asks no part for a key"),
        ({"kind": "duplicate-identity", "at": "hand"}, "no part with an identity now"),
        ({"kind": "loss", "at": "fan", "when": "nobody is late"}, "there is no slot nobody"),
        ({"kind": "loss", "at": "fan", "when": "knob.smell > 4"}, "no part has a wired port knob.smell"),
        ({"kind": "loss", "at": "fan", "when": "knob.level.smell > 4"}, "its numbers: percent"),
    ):
        assert words in await stage.refused(**wish), wish
    assert await stage.listed() == []


async def stop_ends_all(stage: FaultStage) -> None:
    await stage.plant("master-frozen")
    await stage.plant("babbling", amount=20.0)
    await stage.plant("drift", "knob", after=30)
    await asyncio.sleep(1.0)
    report = await stage.operations.do("stop", who="a viewer")
    assert "told to go" in report.words
    assert await stage.listed() == []
    assert not is_disturbed(stage)
    assert {change["reason"] for change in stage.changes[-3:]} == {"STOP"}
    await asyncio.sleep(2.0)
    confirmed = stage.robot.master.stop.confirmed
    assert {one.part for one in confirmed} == {"knob", "fan"}
    assert "STOP is in force" in await stage.refused("loss", "fan")
    await stage.operations.do("go", who="Ada")


def test_a_wrong_key_is_refused_in_the_arrivals(tmp_path: Path) -> None:
    async def scene(stage: FaultStage) -> None:
        await stage.plant("wrong-key", "fan", **{"for": 8})
        await asyncio.sleep(7)
        assert stage.card("fan").state == "lost"
        (arrived,) = [part for part in stage.page.arrivals() if part.part == "fan"]
        assert "key" in arrived.reason
        assert "wrong-key at fan: a part with a wrong key is in its place" in stage.why("fan")
        await asyncio.sleep(4)
        assert stage.card("fan").state == "active"

    fault_scene(tmp_path, scene, keyed=True)


def test_without_a_bus_and_for_real_parts_it_says_what_is_possible(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        lab = FaultLab(stage.operations)
        running = asyncio.create_task(lab.run())

        async def refusal(kind: str, at: str = "") -> str:
            return await stage.refusal(stage.do.plant_fault(kind, at, who="Ada"))

        for kind, at in (("bit-errors", ""), ("babbling", ""), ("bus-off", "AA")):
            assert "needs a CAN bus that is simulated in the master's process" in await refusal(kind, at)
        for kind in ("stuck", "drift"):
            assert "What a real part sends can be lost, late, doubled or overtaken" in await refusal(kind, "BB")
        before = stage.master.agent.links
        await stage.operations.do("plant_fault", who="Ada", kind="unplug", at="BB", **{"for": 8.0})
        await asyncio.sleep(7.0)
        assert stage.state("BB") == "lost"
        assert stage.state("AA") == "active"
        assert "Ada has planted fault 1 here: unplug at BB" in "\n".join(stage.master.why("BB"))
        await asyncio.sleep(6.0)
        assert stage.state("BB") == "active"
        assert stage.master.agent.links == before
        await stage.operations.do("plant_fault", who="Ada", kind="unplug", at="BB")
        running.cancel()
        await asyncio.wait([running])
        assert stage.master.agent.links == before  # the end of the robot ends all

    play(tmp_path, scene, parts=RING)


def test_without_a_lab_it_says_so(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        refused = await stage.refusal(stage.do.plant_fault("loss", "AA", who="Ada"))
        assert refused == "this robot runs without a fault lab"

    play(tmp_path, scene)
