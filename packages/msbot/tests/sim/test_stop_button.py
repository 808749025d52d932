"""A STOP button says STOP to its whole robot; releasing it is no GO, and while it is pressed nobody can say GO."""

from __future__ import annotations

import asyncio

import pytest

from msbot.part import JoinState
from msbot_agent.link import InprocHub
from msbot_xrce.errors import ConfigError
from tests.sim.robot import Bench, play


def test_a_pressed_button_stops_the_robot_until_it_is_released_and_somebody_says_go() -> None:
    async def scene(bench: Bench) -> None:
        master = bench.master
        bench.unit.set("button", True)
        await asyncio.sleep(0.2)
        assert master.stop.stopped
        assert master.stop.by == "ESTOP"
        assert bench.desk.stopped
        await asyncio.sleep(3.0)
        assert master.stop.silent == (), "the part with the button confirms as well"
        for _ in range(30):
            with pytest.raises(ConfigError, match="STOP is still said by ESTOP: release the STOP button there"):
                master.say_go("ann")
            await asyncio.sleep(0.1)
        assert bench.desk.stopped
        bench.unit.set("button", False)
        await asyncio.sleep(0.2)
        assert bench.desk.stopped, "to release it is no GO"
        master.say_go("ann")
        await asyncio.sleep(3.0)
        assert not bench.desk.stopped
        assert not bench.unit.part.stopped
        assert master.stop.number == 1

    play("ESTOP", scene)


def test_a_button_that_is_pressed_while_stop_holds_has_to_be_released_before_go() -> None:
    async def scene(bench: Bench) -> None:
        bench.master.say_stop("ann")
        await asyncio.sleep(0.2)
        bench.unit.set("button", True)
        await asyncio.sleep(0.2)
        with pytest.raises(ConfigError, match="ESTOP"):
            bench.master.say_go("ann")
        bench.unit.set("button", False)
        await asyncio.sleep(0.2)
        bench.master.say_go("ann")
        await asyncio.sleep(1.2)
        assert not bench.desk.stopped

    play("ESTOP", scene)


def test_a_button_that_falls_silent_while_it_is_pressed_lets_go_be_said_and_stops_the_robot_when_it_is_back() -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("button", True)
        await asyncio.sleep(0.2)
        bench.unit.part.end()
        await asyncio.sleep(0.2)
        bench.master.say_go("ann")
        hub = InprocHub()
        bench.master.add_link(hub.server)
        again = asyncio.create_task(bench.unit.part.run_async(hub.connect(), epoch_ns=lambda: 0))
        await asyncio.sleep(1.0)
        assert bench.unit.part.state is JoinState.ACTIVE
        assert bench.master.stop.number == 2
        assert bench.desk.stopped
        again.cancel()

    play("ESTOP", scene)


def test_a_program_says_stop_by_itself() -> None:
    async def scene(bench: Bench) -> None:
        bench.desk.say_stop()
        await asyncio.sleep(0.2)
        assert bench.master.stop.by == "DESK"
        assert bench.unit.part.stopped
        assert bench.master.stop.silent == ()
        bench.master.say_go("ann")
        await asyncio.sleep(1.2)
        assert not bench.unit.part.stopped
        assert not bench.desk.stopped

    play("BUTTON", scene)
