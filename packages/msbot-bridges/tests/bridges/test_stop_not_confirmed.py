"""A device of each world that does not stop: STOP names it, in words of `msbot stop`, and the log says why."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from msbot.cli.change.stop_commands import _words
from msbot.pnp import PartState
from tests.bridges.hosts import in_thread
from tests.bridges.test_cyphal import living
from tests.bridges.test_every_world import Plug, Robot, robot_with

pytest.importorskip("canopen")
pytest.importorskip("dronecan")
pytest.importorskip("pycyphal")

from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.dronecan.simulated_servo import SimulatedServo

Mend = Callable[[], Awaitable[object]]


@asynccontextmanager
async def dronecan_servo(plug: Plug) -> AsyncIterator[tuple[Mend, Mend]]:
    servo = SimulatedServo(plug.bridge.link)
    obeys = servo._ordered

    def hear(event: Any) -> None:
        orders.extend(one.command_value for one in event.message.commands)
        if is_mended:
            obeys(event)

    async def stick() -> None:  # it has not obeyed from the beginning on
        while not any(orders):  # noqa: ASYNC110 - it lives in a thread; what was never driven need not stop
            await asyncio.sleep(0.01)

    async def mend() -> None:
        is_mended.append(True)

    is_mended, orders = list[bool](), list[float]()
    servo.position = servo._target = 1.0
    servo._ordered = hear  # type: ignore[method-assign]
    async with in_thread(servo.run_in_thread, servo.end):
        yield stick, mend


@asynccontextmanager
async def canopen_drive(plug: Plug) -> AsyncIterator[tuple[Mend, Mend]]:
    drive = SimulatedDrive(plug.bridge.link)

    async def stick() -> None:
        while abs(drive.rpm - 30) > 1:  # noqa: ASYNC110 - it lives in a thread; what creeps counts as standing
            await asyncio.sleep(0.01)
        drive.is_stuck = True

    async def mend() -> None:
        drive.is_stuck = False

    async with in_thread(drive.run_in_thread, drive.end):
        yield stick, mend


@asynccontextmanager
async def cyphal_servo(plug: Plug) -> AsyncIterator[tuple[Mend, Mend]]:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.aspect import ENGAGED
    from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

    servo: Any = SimulatedCyphalServo(plug.bridge.link, 44)

    async def stick() -> None:
        while servo.readiness != ENGAGED:  # noqa: ASYNC110 - as above
            await asyncio.sleep(0.01)
        servo.is_stuck = True

    async def mend() -> None:
        servo.is_stuck = False

    async with living(servo):
        yield stick, mend


@asynccontextmanager
async def jacdac_servo(plug: Plug) -> AsyncIterator[tuple[Mend, Mend]]:
    await plug.put_in()
    enabled = "bus.serviceProviders()[0].services().find(one => one.specification.shortId == 'servo').enabled"
    handle = "packet => packet.isRegisterSet && packet.registerIdentifier == register.identifier ? true : own(packet)"

    async def stick() -> None:  # it does not take the order
        await plug.until(f"{enabled}.values()[0]", 1.0)
        await plug._page.evaluate(
            f"() => {{ const register = {enabled}, own = register.handlePacket.bind(register); "
            f"register.handlePacket = async {handle}; }}"
        )

    async def mend() -> None:
        await plug._page.evaluate(f"() => {{ delete {enabled}.handlePacket; }}")

    yield stick, mend


async def drive_it(robot: Robot, port: str, value: str) -> None:
    await robot.do("publish", who="ann", port=f"guest.{port}", values=[value], seconds=60.0)


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("world", "number", "plugged", "port", "why"),
    [
        ("dronecan", "org.msbot:simservo", dronecan_servo, "angle", "node 42 has not reported its neutral position"),
        ("canopen", "vendor-0x4d53:SimDrive", canopen_drive, "speed", "node 5 has not reported that its drive stands"),
        ("cyphal", "org.msbot:simcyphalservo", cyphal_servo, "angle", "node 44 has not reported that it is disengaged"),
        ("jacdac", "jacdac:servo", jacdac_servo, "angle", "angle has not reported that its power is off"),
    ],
)
async def test_a_device_that_does_not_stop_is_named_and_the_log_says_why(
    world: str, number: str, plugged: Callable[[Plug], Any], port: str, why: str, tmp_path: Path
) -> None:
    async with AsyncExitStack() as stack:
        plug = Plug(world, "servo", tmp_path, stack)
        async with robot_with(tmp_path, [plug.bridge]) as robot, plugged(plug) as (stick, mend):
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            if world == "cyphal":  # it gets its subjects, and starts anew
                await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
                await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await drive_it(robot, port, "30")
            await stick()
            await robot.do("stop", who="ann", reason="")
            lines: list[str] = []
            while not any(f"STOP is not confirmed: {why}" in line for line in lines):
                outcome = await robot.do("log_lines", who="ann", after=None, last=50, wait=0.0)
                answer: Any = outcome.answer
                lines = [str(line["words"]) for line in answer["lines"]]
                await asyncio.sleep(0.05)
            assert list(robot.master.stop.silent) == [number]
            status: Any = (await robot.do("stop_report", who="ann")).answer
            assert f"NOT confirmed: {number}: it may still move" in _words(status)
            await mend()
            await robot.until(lambda: not robot.master.stop.silent)
            assert {one.part for one in robot.master.stop.confirmed} >= {number}
