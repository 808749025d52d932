"""The log of a running robot, as people follow it: bounded, for everybody who may see the robot, without secrets."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from msbot.operations.robot_log import MOST_KEPT, MOST_TOLD
from msbot_school.faults.fault_lab import FaultLab
from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


async def lines(stage: Stage, after: int | None = None, **more: object) -> Mapping[str, Any]:
    return (await stage.operations.do("log_lines", who="ann", after=after, **more)).answer


def test_parts_people_and_stop_come_in_the_order_in_which_it_happened(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await lines(stage, last=200)
        assert {"AA: checking -> active in slot AA" in one["words"] for one in begun["lines"]} == {True, False}
        waiting = asyncio.create_task(lines(stage, begun["next"], wait=3.0))
        await asyncio.sleep(1.0)
        await stage.do.release("BB", who="novak")
        first = await waiting
        assert first["lines"][0]["words"].startswith("BB: ")
        await stage.do.stop("hand in the gear", who="ann")
        await stage.do.go(who="ann")
        FaultLab(stage.operations)
        await stage.do.plant_fault("loss", "AA", who="novak")
        stage.pull("CC")
        await asyncio.sleep(20)
        rest = await lines(stage, first["next"])
        told = [(one["kind"], one["who"], one["slot"]) for one in (*first["lines"], *rest["lines"])]
        assert ("person", "novak", "BB") in told
        words = [one["words"] for one in rest["lines"]]
        stop = next(number for number, one in enumerate(words) if "hand in the gear" in one)
        lost = next(number for number, one in enumerate(words) if one.startswith("CC: ") and "lost" in one)
        assert stop < lost
        assert not any("loss" in one for one in words)  # a class is to find it
        before = stage.now()
        nothing = await lines(stage, rest["next"], wait=2.0)
        assert (nothing["lines"], stage.now() - before) == ([], 2.0)
        assert len((await lines(stage, last=3))["lines"]) == 3

    play(tmp_path, scene, parts=RING)


def test_who_reads_slowly_is_told_how_many_are_gone_and_nothing_grows(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await lines(stage)
        for number in range(MOST_KEPT + 5):
            stage.operations.log.operation_done("ann", "set", {"slot": "AA"}, f"{number} " + "x" * 1000)
        told = await lines(stage, begun["next"])
        assert (told["missed"], len(told["lines"])) == (5, MOST_TOLD)
        assert told["lines"][0]["words"].startswith("ann: 5 xx")
        assert len(told["lines"][0]["words"]) == 500
        for topic in ("a", "a", "b", "a"):
            stage.operations.log.operation_done("ann", "publish_topic", {"topic": topic}, f"{topic}: 1")
        assert [one["words"] for one in (await lines(stage, last=3))["lines"]][1:] == ["ann: a: 1", "ann: b: 1"]
        ahead = await lines(stage, 2**53)  # the master has begun anew
        assert (ahead["lines"], ahead["missed"]) == ([], 0)

    play(tmp_path, scene, parts=RING)


def test_an_error_in_a_function_of_a_part_is_in_the_log_and_in_why_which_knows_of_stop(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await lines(stage)

        def broken(message: object) -> None:
            raise NameError("name 'persent' is not defined")

        stage.parts["BB"].program.listeners["in"] = replace(stage.parts["BB"].program.listeners["in"], function=broken)
        await stage.do.publish("BB.in", ["1", "x"], who="ann")
        await asyncio.sleep(3.0)
        words = "NameError: name 'persent' is not defined"
        told = [one["words"] for one in (await lines(stage, begun["next"]))["lines"] if words in one["words"]]
        assert len(told) == 1  # and not once for each message
        await stage.do.stop("", who="ann")
        await asyncio.sleep(1.0)
        why = stage.master.why("BB")
        assert any(words in line for line in why)
        assert "STOP is in force: no message reaches its functions until GO" in why

    play(tmp_path, scene, parts=RING)
