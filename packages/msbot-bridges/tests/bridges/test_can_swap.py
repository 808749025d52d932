"""A device on CAN is replaced by a like one, which gets the slot and its settings; a setting is undone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from tests.bridges.hosts import in_thread
from tests.bridges.test_every_world import robot_with

pytest.importorskip("canopen")
pytest.importorskip("dronecan")

from msbot_bridges.canopen.objects import DRIVE_SETTINGS
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.dronecan.simulated_servo import SimulatedServo

Speed = Callable[[], int]


def drive(bus: str, number: int) -> tuple[SimulatedDrive, Speed]:
    made = SimulatedDrive(bus, 5, serial=number)  # at the same place as the one before
    return made, lambda: made.get(DRIVE_SETTINGS[0].entry)


def servo(bus: str, number: int) -> tuple[SimulatedServo, Speed]:
    made = SimulatedServo(bus, 40 + number)
    return made, lambda: made.speed


@pytest.mark.parametrize(
    ("world", "number", "plug", "own"),
    [("canopen", "vendor-0x4d53:SimDrive", drive, 60), ("dronecan", "org.msbot:simservo", servo, 30)],
)
async def test_a_like_device_gets_the_slot_with_its_settings(
    world: str,
    number: str,
    plug: Callable[[str, int], tuple[SimulatedDrive | SimulatedServo, Speed]],
    own: int,
    tmp_path: Path,
) -> None:
    bus = f"msbot:{uuid4().hex[:12]}"
    async with robot_with(tmp_path, [BridgeTable(world, bus)]) as robot:

        def holds_slot() -> bool:
            """Whether a device of this kind is in the slot: the one that is gone is listed, too."""
            view = robot.master.inventory.view(asyncio.get_running_loop().time())
            return any((one.part_number, one.state, one.slot) == (number, PartState.ACTIVE, "guest") for one in view)

        first, first_speed = plug(bus, 1)
        async with in_thread(first.run_in_thread, first.end):
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(holds_slot)
            await robot.do("set", who="ann", slot="guest", name="profile_velocity", value="75")
            await robot.until(lambda: first_speed() == 75)
        await robot.until(lambda: not holds_slot())
        second, second_speed = plug(bus, 2)
        assert second_speed() == own
        async with in_thread(second.run_in_thread, second.end):
            await robot.until(lambda: holds_slot() and second_speed() == 75)
            await robot.do("undo", who="ann", edit=None)
            await robot.until(lambda: second_speed() == own)
