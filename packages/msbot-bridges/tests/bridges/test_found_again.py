"""A device that was driven when it got out of reach is made safe when it is found again, though it has no slot now."""

from __future__ import annotations

import logging
from contextlib import AsyncExitStack
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.pnp import PartState
from tests.bridges.hosts import in_thread
from tests.bridges.test_every_world import Plug, robot_with
from tests.bridges.test_lossy_bus import MODULE, NODE, Loss, adopted, drive
from tests.bridges.test_stop_not_confirmed import cyphal_servo

pytest.importorskip("canopen")

from msbot_bridges.canopen.simulated.io_module import OUTPUTS, SimulatedIo


@pytest.fixture
def loss(monkeypatch: pytest.MonkeyPatch) -> Loss:
    return Loss(monkeypatch)


@pytest.mark.promise("A device that was driven when it got out of reach is made safe when it is found again")
async def test_a_module_that_was_out_of_reach_while_it_was_driven_is_made_safe(loss: Loss, tmp_path: Path) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    async with (
        in_thread(module.run_in_thread, module.end),
        robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot,
    ):
        await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
        module.node.nmt.stop_heartbeat()
        loss.lose(1_000_000, lambda message: message.arbitration_id & 0x7F in (0, NODE))
        await robot.until(lambda: robot.is_in(MODULE, PartState.LOST, PartState.LEFT))
        assert module.get(OUTPUTS) & 2, "nobody has reached it, and it watches nobody"
        await robot.do("remove_slot", who="ann", slot="arm")
        loss.left = 0
        module.node.nmt.start_heartbeat(200)
        await robot.until(lambda: module.get(OUTPUTS) == 1)
        await robot.until(lambda: module.node.nmt.state == "PRE-OPERATIONAL")


async def test_a_servo_on_cyphal_that_was_out_of_reach_reports_that_it_is_safe(
    loss: Loss, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("pycyphal")
    caplog.set_level(logging.INFO, "msbot.part")
    number = "org.msbot:simcyphalservo"
    async with AsyncExitStack() as stack:
        plug = Plug("cyphal", "servo", tmp_path, stack)
        async with robot_with(tmp_path, [plug.bridge]) as robot, cyphal_servo(plug) as (stick, mend):
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))  # it gets its subjects
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await robot.do("publish", who="ann", port="guest.angle", values=["30"], seconds=60.0)
            await stick()  # it is engaged
            await mend()
            loss.lose(1_000_000, lambda message: message.arbitration_id & 0x7F in (44, 125))
            await robot.until(lambda: robot.is_in(number, PartState.LOST, PartState.LEFT))
            await robot.do("remove_slot", who="ann", slot="guest")
            loss.left = 0
            await robot.until(lambda: not robot.is_in(number, PartState.LOST, PartState.LEFT))
    assert "is made safe first" in caplog.text
    assert "not known to be safe" not in caplog.text
