"""What a program publishes outside of its port's range: sent as it is, counted, and said once, here and to people."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot import HelloWorld
from msbot.part.messages.standard import Level
from msbot.part.range_watch import RangeWatch
from tests.operations.stage import AA_IS_A_DIAL, DIAL, Stage, play

RANGED = DIAL.replace(
    'name = "out"\ndirection = "publish"\ntype = "HelloWorld"\n',
    'name = "out"\ndirection = "publish"\ntype = "HelloWorld"\nranges = { index = [0, 10] }\n',
)
TOPIC = "HelloWorldTopic_1_to_2"


def test_a_program_learns_of_its_mistake_once_and_so_do_people(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part = stage.parts["AA"]
        assert not [name for name in part.settings if "range" in name], "they are no settings of the program"
        for index in (10, 11, 12, 0):
            part.publish("out", HelloWorld(index=index, message="x"))
        await asyncio.sleep(1)
        assert stage.heard["BB"] == ["x"] * 4, "nothing is clipped, nothing left out"
        assert part.out_of_range == 2
        words = "out: index is published as 11; the robot's library says 0 to 10"
        assert f"its program says: {words}" in stage.master.why("AA")
        told = (await stage.do.log_lines(None, 200, who="ann")).answer["lines"]
        assert isinstance(told, list)
        assert [one["words"] for one in told if "library says" in one["words"]] == [f"AA: {words}"]

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH"), dial=RANGED)


def test_a_message_by_hand_is_refused(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        refused = await stage.refusal(stage.do.publish_topic(TOPIC, ["11", "x"], who="ann"))
        assert refused == "AA.out: index must be from 0 to 10; it is 11"
        await stage.do.publish_topic(TOPIC, ["10", "x"], who="ann")

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH"), dial=RANGED)


def test_ranges_that_nobody_can_read_are_left_out() -> None:
    watch = RangeWatch()
    watch.configure({"out.range.percent": "0 to 100", "in.range.percent": "", "x.range.percent": "0 1"})
    assert watch.look("out", Level(percent=1e6)) == ""
    assert watch.look("x", Level(percent=2)) == "x: percent is published as 2; the robot's library says 0 to 1"
    assert watch.look("x", Level(percent=2)) == ""
    assert watch.count == 2
