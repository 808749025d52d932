"""The firmware on an emulated STM32F405, in a robot of MsBOT, in real time.

The bus is MsBOT's simulated one, bit by bit; the board is a node of it through its serial line (`emulator.py`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from random import Random

from tests.firmware.building import EMULATED, link_example, need
from tests.firmware.emulator import PATIENCE_S, Emulator
from tests.firmware.msbot_side import Part, Switch
from tests.firmware.robot import Robot, play

LOOK_S = 0.01
AGAIN_S = 0.3
FAST = (('[[slot]]\nname = "lever"', '[timing]\npreset = "fast"\n\n[[slot]]\nname = "lever"'),)


async def until(holds: Callable[[], bool], what: str, *, meanwhile: Callable[[], object] = bool) -> None:
    """Wait until something holds, and do something again and again meanwhile."""
    loop = asyncio.get_running_loop()
    began_at = again_at = loop.time()
    while not holds():
        assert loop.time() - began_at < PATIENCE_S, f"not within {PATIENCE_S} s: {what}"
        if loop.time() >= again_at:
            meanwhile()
            again_at = loop.time() + AGAIN_S
        await asyncio.sleep(LOOK_S)


def putting(hand: Part, level: bool) -> Callable[[], object]:
    """Somebody who puts the lever until that has an effect: on a busy computer any part may be out for a moment."""
    return lambda: hand.bound("on") and hand.state.value == "active" and hand.publish("on", Switch(on=level))


def test_an_emulated_stm32_lives_in_a_robot(tmp_path: Path) -> None:
    need("arm-none-eabi-gcc", "qemu-system-arm")
    board = Emulator(link_example(EMULATED))
    heard: list[bool] = []

    async def scene(robot: Robot) -> None:
        hand = robot.plug_python(Part("TOGGLE", local_name="lever", random=Random(1)), "lever")
        relay = Part("RELAY-1", local_name="relay", random=Random(2))
        relay.on("on", Switch)(lambda message: heard.append(message.on))
        robot.plug_python(relay, "relay")
        await board.start(robot.attach("board"))
        try:
            await plugs_itself_in(robot, board)
            await drives_and_reads_its_pins(robot, board, hand)
            await obeys_a_setting(robot, board, hand)
            await is_lost_when_it_stops_and_comes_back(robot, board, hand)
            await goes_to_its_safe_value_without_a_master(robot, board)
        finally:
            await board.end()

    async def plugs_itself_in(robot: Robot, board: Emulator) -> None:
        assert board.pin in (None, False)
        await until(lambda: robot.state() == "active", "the board is active")
        await until(lambda: robot.beats() >= 3, "it beats")
        assert board.pin is False

    async def drives_and_reads_its_pins(robot: Robot, board: Emulator, hand: Part) -> None:
        for level in (True, False, True):
            await drives(board, hand, level)
            board.apply(level)
            await until(lambda level=level: heard[-1:] == [level], f"the relay has heard {level}")  # type: ignore[misc]

    async def drives(board: Emulator, hand: Part, level: bool) -> None:
        await until(lambda: board.pin is level, f"the board's pin is {level}", meanwhile=putting(hand, level))

    async def obeys_a_setting(robot: Robot, board: Emulator, hand: Part) -> None:
        await drives(board, hand, level=True)
        robot.set("board", "invert", True)
        await until(lambda: board.pin is False, "the pin is turned round")
        await until(lambda: heard[-1:] == [False], "what it reads, too")
        heard.clear()
        robot.set("board", "repeat_s", 0.2)
        await until(lambda: heard[:3] == [False] * 3, "it says so each 0.2 s")
        robot.set("board", "invert", False)
        await until(lambda: board.pin is True, "and back")

    async def is_lost_when_it_stops_and_comes_back(robot: Robot, board: Emulator, hand: Part) -> None:
        board.freeze()
        await until(lambda: robot.state() == "lost", "the board is lost")
        heard.clear()
        board.thaw()
        await until(lambda: robot.state() == "active", "the board is back")
        await until(lambda: bool(heard), "it says how its pin stands: it has its configuration")
        assert board.pin is False, "its safe value, when it heard that it was out"
        await drives(board, hand, level=True)

    async def goes_to_its_safe_value_without_a_master(robot: Robot, board: Emulator) -> None:
        await robot.kill_master()
        await until(lambda: board.pin is False, "the pin has its safe value")
        await robot.new_master()
        await until(lambda: robot.state() == "active", "the next master has the board")

    play(tmp_path, scene, changes=FAST, run=asyncio.run)
