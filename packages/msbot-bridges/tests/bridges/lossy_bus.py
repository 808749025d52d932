"""A simulated CANopen module in a robot that drives it, while a CAN bus has no room for the orders."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from uuid import uuid4

import pytest

import can
from msbot.config import BridgeTable
from msbot.pnp import PartState
from msbot_bridges.canbus import FrameSender
from tests.bridges.hosts import in_thread
from tests.bridges.test_every_world import Robot, robot_with
from tests.bridges.test_safe_values_on_can import ADOPTED

pytest.importorskip("canopen")

from msbot_bridges.canopen.simulated.io_module import OUTPUTS, SimulatedIo

MODULE = "vendor-0x4d53:SimIO"
NODE = 6
TO_MODULE, SDO, NMT = 0x200 + NODE, 0x600 + NODE, 0x000


class Loss:
    """The controllers of this process have no room for some frames."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.left = 0
        """So many more frames get lost."""
        self.is_off = False
        """The controllers are bus-off instead, as far as they send such frames."""
        self._matches: Callable[[can.Message], bool] = lambda _: False
        own = FrameSender.send

        def send(sender: FrameSender, message: can.Message) -> bool:
            if self.left and self._matches(message):
                self.left -= 1
                if self.is_off:
                    raise can.CanOperationError("bus-off")
                return False
            return own(sender, message)

        monkeypatch.setattr(FrameSender, "send", send)

    def lose(self, frames: int, matches: Callable[[can.Message], bool]) -> None:
        self._matches, self.left = matches, frames


def is_to_module(*identifiers: int) -> Callable[[can.Message], bool]:
    return lambda message: not message.is_extended_id and message.arbitration_id in identifiers


def adopted(folder: Path, number: str, safe: str) -> str:
    """The blueprint's slot `arm` with a part that the robot knows."""
    (folder / "adopted").mkdir()
    file = f"{number.partition(':')[2]}.toml"
    lines = (ADOPTED / file).read_text().splitlines()
    known = [line for line in lines if not line.startswith(("compatible_with", "lacks"))]
    (folder / "adopted" / file).write_text("\n".join(known) + "\n")
    return f'\n[[slot]]\nname = "arm"\npart = "{number}"\n[slot.safe]\n{safe}\n'


async def drive(robot: Robot, number: str, port: str, value: str, is_driven: Callable[[], object]) -> None:
    await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
    await robot.do("publish", who="ann", port=f"arm.{port}", values=[value], seconds=60.0)
    await robot.until(is_driven)


@asynccontextmanager
async def io_module() -> AsyncIterator[tuple[SimulatedIo, BridgeTable]]:
    """A module on a bus of its own, and that bus."""
    bus = f"msbot:{uuid4().hex[:12]}"
    module = SimulatedIo(bus, NODE)
    async with in_thread(module.run_in_thread, module.end):
        yield module, BridgeTable("canopen", bus)


@asynccontextmanager
async def robot_of_module(folder: Path, bus: BridgeTable) -> AsyncIterator[Robot]:
    """A robot whose slot `arm` is the module; its output 1 is safe when it is on."""
    async with robot_with(folder, [bus], adopted(folder, MODULE, "out_1 = { on = true }")) as robot:
        await robot.until(lambda: robot.is_in(MODULE, PartState.ACTIVE))
        yield robot


async def drive_module(robot: Robot, module: SimulatedIo) -> None:
    """Its output 2 is switched on."""
    await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
