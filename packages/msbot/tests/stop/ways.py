"""STOP while the ways to parts change: an agent's cable is cut, another master takes over. In virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from random import Random

from tests.firmware.c_part import CPart, Described
from tests.firmware.msbot_side import Part, Switch
from tests.firmware.pipe import Firmware
from tests.firmware.robot import Robot
from tests.firmware.robot import play as play_robot
from tests.homes.world import UID
from tests.master.fed_stage import Stage
from tests.master.fed_stage import play as play_agents
from tests.stop.oracle import Verdict, until_all_confirm

EVERY_S = 0.1
SOME_S = 2.0
SWITCH_ON = b"\x01"


async def _cut_before(stage: Stage, say_stop: Callable[[], object]) -> None:
    stage.right.cut()
    await asyncio.sleep(1.0)
    say_stop()
    await asyncio.sleep(SOME_S)
    assert stage.master.stop.silent, "a part that nobody can reach has not confirmed"
    stage.right.heal()


async def _cut_after(stage: Stage, say_stop: Callable[[], object]) -> None:
    say_stop()
    await until_all_confirm(stage.master, 3)
    stage.right.cut()
    await asyncio.sleep(1.0)
    stage.right.heal()


async def _both_cut(stage: Stage, say_stop: Callable[[], object]) -> None:
    stage.left.cut()
    stage.right.cut()
    say_stop()
    await asyncio.sleep(1.0)
    stage.left.heal()
    stage.right.heal()


CUTS: Mapping[str, Callable[[Stage, Callable[[], object]], Awaitable[None]]] = {
    "an agent's cable is cut, STOP, it is mended": _cut_before,
    "STOP, an agent's cable is cut and mended": _cut_after,
    "both agents' cables are cut, STOP, they are mended": _both_cut,
}


def agents_story(name: str) -> Verdict:
    """A part at one agent speaks to one beside it and to one at another agent."""
    verdict = Verdict()

    async def scene(stage: Stage) -> None:
        number = 0

        async def speak() -> None:
            nonlocal number
            while True:
                number += 1
                stage.speak(number)
                await asyncio.sleep(EVERY_S)

        def counts() -> dict[str, int]:
            return {one: len(stage.heard[one]) for one in ("NEAR", "FAR")}

        def since(at: dict[str, int]) -> dict[str, int]:
            return {one: count - at[one] for one, count in counts().items()}

        speaking = asyncio.create_task(speak())
        await asyncio.sleep(SOME_S)
        verdict.before = counts()
        await CUTS[name](stage, lambda: stage.master.say_stop("ann"))
        verdict.confirmed_ms = await until_all_confirm(stage.master, 3, 60.0)
        at, said = counts(), number
        await asyncio.sleep(2 * SOME_S)
        verdict.after, verdict.on_the_way = since(at), number - said
        await asyncio.sleep(4 * SOME_S)  # parts that were lost are back by then
        at = counts()
        stage.master.say_go("ann")
        await asyncio.sleep(2 * SOME_S)
        verdict.again = since(at)
        speaking.cancel()

    play_agents(scene)
    return verdict


def takeover_story(folder: Path, firmware: Firmware) -> Verdict:
    """STOP; the master is killed and another one takes over; a part in Python speaks to one of the firmware."""
    verdict = Verdict()

    async def scene(robot: Robot) -> None:
        hand = robot.plug_python(Part("TOGGLE", local_name="lever", random=Random(1)), "lever")
        board = robot.plug(CPart(firmware, Described(uid=UID)))
        said = 0

        async def speak() -> None:
            nonlocal said
            while True:
                if hand.state.value == "active":
                    hand.publish("on", Switch(on=True))
                    said += 1
                await asyncio.sleep(EVERY_S)

        speaking = asyncio.create_task(speak())
        await asyncio.sleep(2 * SOME_S)
        verdict.before = {"the board": len(board.heard)}
        robot.master.say_stop("ann")
        verdict.confirmed_ms = await until_all_confirm(robot.master, 2)
        await robot.master.until_stop_is_stored()
        at, began = len(board.heard), said
        await robot.kill_master()
        await asyncio.sleep(1.0)
        await robot.new_master()
        await until_all_confirm(robot.master, 2, 60.0)
        await asyncio.sleep(2 * SOME_S)
        verdict.after, verdict.on_the_way = {"the board": len(board.heard) - at}, said - began
        at = len(board.heard)
        robot.master.say_go("ann")
        await asyncio.sleep(SOME_S)
        verdict.again = {"the board": len(board.heard) - at}
        speaking.cancel()

    play_robot(folder, scene)
    return verdict
