"""The safe value of a slot at devices on CAN, with their genuine libraries: STOP, a partner that is gone, leaving."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import pytest

import msbot_bridges.makers
from msbot.config import BridgeTable
from msbot.part.messages.standard import Angle, Level, Speed
from msbot.pnp import PartState
from tests.bridges.hosts import Reports, in_thread
from tests.bridges.test_every_world import robot_with

pytest.importorskip("canopen")
pytest.importorskip("dronecan")

from msbot_bridges.canopen.drive_states import DriveState
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.canopen.simulated.io_module import OUTPUTS, SimulatedIo
from msbot_bridges.dronecan.simulated_servo import SimulatedServo
from tests.bridges.test_canopen import world
from tests.bridges.test_dronecan_nodes import plugged

ADOPTED = Path(msbot_bridges.makers.__file__).parent / "adopted"
Simulated = SimulatedServo | SimulatedIo


async def test_a_motor_controller_turns_at_stop_where_its_slot_says_so_and_reports_its_power() -> None:
    async with plugged("esc", 17) as (node, device, host):
        device.begin(Reports())
        device.act("power", Level(percent=80))
        device.safe_is("power", Level(percent=20))
        node.is_stuck = True
        device.stop()
        assert device.not_stopped == "node 17 has not reported a power of 20 %"
        node.is_stuck = False
        await host.until(lambda: not device.not_stopped)
        assert node.power == int(8191 * 0.2)
        device.go()
        device.stop()
        assert device.not_stopped == "node 17 has not reported that it stands still", "the robot says it no longer"
        await host.until(lambda: not device.not_stopped)
        assert node.power == 0


async def test_stop_waits_for_a_new_report_after_a_partner_was_lost() -> None:
    async with plugged("esc", 17) as (node, device, host):
        reports = Reports()
        device.begin(reports)
        device.act("power", Level(percent=50))
        device.rests_at("power", Level(percent=20))
        device.rest()
        await reports.until(lambda last: last.get("turns") == Speed(rpm=int(8191 * 0.2)))
        device.act("power", Level(percent=50))
        await reports.until(lambda last: last.get("turns") == Speed(rpm=4095))
        node.is_stuck = True
        device.stop()
        assert device.not_stopped == "node 17 has not reported that it stands still"
        node.is_stuck = False
        await host.until(lambda: not device.not_stopped)


async def test_a_servo_stays_where_it_is_until_somebody_says_where_it_is_to_be() -> None:
    async with plugged("servo", 17) as (node, device, _):
        commands = list[float]()
        types = node._types
        node.node.add_handler(
            types.equipment.actuator.ArrayCommand,
            lambda event: commands.extend(one.command_value for one in event.message.commands),
        )
        reports = Reports()
        device.begin(reports)
        await reports.until(lambda last: last)
        reports.last.clear()
        await reports.until(lambda last: last)
        assert commands == []
        device.safe_is("angle", Angle(degrees=30))
        device.stop()
        assert device.not_stopped == "node 17 has not reported an angle of 30 degrees"
        while not commands:  # noqa: ASYNC110 - it is in a thread
            await asyncio.sleep(0.02)
        assert commands[-1] == pytest.approx(math.radians(30), abs=0.001)


async def test_a_drive_keeps_quick_stop_and_turns_without_a_partner_where_its_slot_says_so() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus, 5)
        async with in_thread(drive.run_in_thread, drive.end):
            device = await host.devices.get()
            assert {one.stops_by for one in device.inputs} == {"quick stop"}
            reports = Reports()
            device.begin(reports)
            device.act("speed", Speed(rpm=60))
            await reports.until(lambda last: last.get("turns") == Speed(rpm=60))
            device.rests_at("speed", Speed(rpm=30))
            device.rest()
            await reports.until(lambda last: last["turns"] == Speed(rpm=30))
            device.act("speed", Speed(rpm=60))
            device.rests_at("speed", Speed(rpm=0))  # the library's own
            device.rest()
            await reports.until(lambda _: drive.state is DriveState.SWITCH_ON_DISABLED)
            device.act("speed", Speed(rpm=60))
            await reports.until(lambda last: last["turns"] == Speed(rpm=60))
            device.safe_is("speed", Speed(rpm=30))
            device.stop()
            await host.until(lambda: not device.not_stopped)
            assert (drive.rpm, drive.node.nmt.state) == (0, "PRE-OPERATIONAL")
            device.go()
            device.act("speed", Speed(rpm=60))
            reports.last.clear()
            await reports.until(lambda last: last.get("turns") == Speed(rpm=60))
            device.rests_at("speed", Speed(rpm=30))
            device.rest()
            device.end()
            while drive.rpm:  # noqa: ASYNC110 - it is in a thread
                await asyncio.sleep(0.02)
            assert drive.state is DriveState.SWITCH_ON_DISABLED, "nobody would stop it later"


def servo(bus: str) -> tuple[SimulatedServo, Callable[[], bool], Callable[[], bool]]:
    made = SimulatedServo(bus, 42)
    made.speed = 300
    return (
        made,
        lambda: abs(math.degrees(made.position) - 60) < 1,
        lambda: abs(math.degrees(made.position) - 30) < 1,
    )


def module(bus: str) -> tuple[SimulatedIo, Callable[[], bool], Callable[[], bool]]:
    made = SimulatedIo(bus, 6)
    return made, lambda: made.get(OUTPUTS) & 2 == 2, lambda: made.get(OUTPUTS) == 1


@pytest.mark.parametrize(
    ("name", "number", "safe", "port", "value", "make"),
    [
        ("dronecan", "org.msbot:simservo", "angle = { degrees = 30 }", "angle", "60", servo),
        ("canopen", "vendor-0x4d53:SimIO", "out_1 = { on = true }", "out_2", "true", module),
    ],
)
@pytest.mark.promise("A slot's safe value is what STOP and leaving leave a device on CAN with")
async def test_a_slot_says_what_stop_and_leaving_leave_a_device_with(
    name: str,
    number: str,
    safe: str,
    port: str,
    value: str,
    make: Callable[[str], tuple[Simulated, Callable[[], bool], Callable[[], bool]]],
    tmp_path: Path,
) -> None:
    (tmp_path / "adopted").mkdir()
    file = f"{number.partition(':')[2]}.toml"
    text = (ADOPTED / file).read_text()  # without its stand-in for a type that this robot has not
    lines = [line for line in text.splitlines() if not line.startswith(("compatible_with", "lacks"))]
    (tmp_path / "adopted" / file).write_text("\n".join(lines) + "\n")
    bus = f"msbot:{uuid4().hex[:12]}"
    more = f'\n[[slot]]\nname = "arm"\npart = "{number}"\n[slot.safe]\n{safe}\n'
    simulated, is_driven, is_safe = make(bus)
    async with in_thread(simulated.run_in_thread, simulated.end):
        async with robot_with(tmp_path, [BridgeTable(name, bus)], more) as robot:
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await robot.do("publish", who="ann", port=f"arm.{port}", values=[value], seconds=60.0)
            await robot.until(is_driven)
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: number in {one.part for one in robot.master.stop.confirmed})
            assert is_safe()
            await robot.do("go", who="ann", stop=None)
            await robot.do("publish", who="ann", port=f"arm.{port}", values=[value], seconds=60.0)
            await robot.until(is_driven)
        async with asyncio.timeout(60):
            while not is_safe():  # noqa: ASYNC110 - it is in a thread
                await asyncio.sleep(0.02)
