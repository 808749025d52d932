"""A Cyphal servo that got out of reach while it was driven reports that it is safe before its robot gets it back."""

from __future__ import annotations

import logging
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from msbot.pnp import PartState
from tests.bridges.lossy_bus import Loss
from tests.bridges.test_every_world import Plug, robot_with
from tests.bridges.test_stop_not_confirmed import cyphal_servo


async def test_a_servo_on_cyphal_that_was_out_of_reach_reports_that_it_is_safe(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("pycyphal")
    caplog.set_level(logging.INFO, "msbot.part")
    loss, number = Loss(monkeypatch), "org.msbot:simcyphalservo"
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
