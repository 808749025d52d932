"""A device that was driven when it got out of reach is made safe when it is found again, though it has no slot now."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.pnp import PartState
from tests.bridges.lossy_bus import (
    MODULE,
    NMT,
    NODE,
    SDO,
    TO_MODULE,
    Loss,
    drive_module,
    io_module,
    is_to_module,
    robot_of_module,
)

pytest.importorskip("canopen")

from msbot_bridges.canopen.canopen_bus import HEARTBEAT
from msbot_bridges.canopen.canopen_device import OWN_ID
from msbot_bridges.canopen.simulated.io_module import OUTPUTS


@pytest.fixture
def loss(monkeypatch: pytest.MonkeyPatch) -> Loss:
    return Loss(monkeypatch)


@pytest.mark.promise("A device that was driven when it got out of reach is made safe when it is found again")
async def test_a_module_that_was_out_of_reach_while_it_was_driven_is_made_safe(loss: Loss, tmp_path: Path) -> None:
    async with io_module() as (module, bus), robot_of_module(tmp_path, bus) as robot:
        await drive_module(robot, module)
        module.node.nmt.stop_heartbeat()
        loss.lose(1_000_000, lambda message: message.arbitration_id & 0x7F in (0, NODE))
        await robot.until(lambda: robot.is_in(MODULE, PartState.LOST, PartState.LEFT))
        assert module.get(OUTPUTS) & 2, "nobody has reached it, and it watches nobody"
        await robot.do("remove_slot", who="ann", slot="arm")
        loss.left = 0
        module.node.nmt.start_heartbeat(200)
        await robot.until(lambda: module.get(OUTPUTS) == 1)
        await robot.until(lambda: module.node.nmt.state == "PRE-OPERATIONAL")


async def test_a_module_that_was_driven_when_the_bus_went_off_is_made_safe_by_the_next_bridge(
    loss: Loss, tmp_path: Path
) -> None:
    async with io_module() as (module, bus), robot_of_module(tmp_path, bus) as robot:
        await drive_module(robot, module)
        loss.is_off = True
        loss.lose(1_000_000, is_to_module(TO_MODULE, SDO, NMT, HEARTBEAT + OWN_ID))
        await robot.until(lambda: robot.is_in(MODULE, PartState.LOST, PartState.LEFT))
        assert any("the bridge to it has ended" in line and "bus-off" in line for line in robot.master.why(MODULE))
        assert module.get(OUTPUTS) & 2
        await robot.do("remove_slot", who="ann", slot="arm")
        loss.left = 0
        await robot.until(lambda: module.get(OUTPUTS) == 1)
        await robot.until(lambda: module.node.nmt.state == "PRE-OPERATIONAL")
