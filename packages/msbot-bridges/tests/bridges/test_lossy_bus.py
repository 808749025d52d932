"""A bridge leaves, and its robot stops, while a CAN bus has no room for the orders; devices of genuine libraries."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from uuid import uuid4

import pytest

import can
from msbot.config import BridgeTable
from tests.bridges.hosts import in_thread
from tests.bridges.lossy_bus import (
    MODULE,
    NMT,
    SDO,
    TO_MODULE,
    Loss,
    adopted,
    drive,
    drive_module,
    io_module,
    is_to_module,
    robot_of_module,
)
from tests.bridges.test_every_world import robot_with

pytest.importorskip("canopen")
pytest.importorskip("dronecan")

from msbot_bridges.canopen.simulated.io_module import OUTPUTS
from msbot_bridges.dronecan.simulated_servo import SimulatedServo

SERVO = "org.msbot:simservo"
LATE_S = 0.4
"""The library asks again before that."""
ARRAY_COMMAND = 1010
"""The number of DroneCAN's message to servos."""


@pytest.fixture
def loss(monkeypatch: pytest.MonkeyPatch) -> Loss:
    return Loss(monkeypatch)


def is_to_servo(message: can.Message) -> bool:
    return message.is_extended_id and message.arbitration_id >> 8 & 0xFFFF == ARRAY_COMMAND


@pytest.mark.promise("A slot's safe value is what leaving leaves a device on CAN with, though frames get lost")
@pytest.mark.parametrize("lost", [(TO_MODULE,), (TO_MODULE, NMT), (TO_MODULE, SDO, NMT)])
async def test_a_module_has_its_safe_values_when_its_bridge_has_left(
    lost: tuple[int, ...], loss: Loss, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with io_module() as (module, bus):
        async with robot_of_module(tmp_path, bus) as robot:
            await drive_module(robot, module)
            loss.lose(5, is_to_module(*lost))
        assert loss.left == 0
        assert module.get(OUTPUTS) == 1
        assert module.node.nmt.state == "PRE-OPERATIONAL"
    assert "not known to be safe" not in caplog.text


async def test_a_module_that_answers_late_is_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async with io_module() as (module, bus):
        answer, timers = module.node.sdo.send_response, list[threading.Timer]()

        def answer_late(response: bytes) -> None:
            timers.append(threading.Timer(LATE_S, answer, [response]))
            timers[-1].start()

        async with robot_of_module(tmp_path, bus) as robot:
            await drive_module(robot, module)
            module.node.sdo.send_response = answer_late
        for timer in timers:
            timer.join()
        assert timers
        assert module.get(OUTPUTS) == 1
        assert module.node.nmt.state == "PRE-OPERATIONAL"
    assert "not known to be safe" not in caplog.text


async def test_a_module_that_cannot_be_asked_is_named(
    loss: Loss, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with io_module() as (module, bus):
        async with robot_of_module(tmp_path, bus) as robot:
            await drive_module(robot, module)
            loss.lose(10_000, is_to_module(SDO))
        assert module.get(OUTPUTS) == 1, "the order itself has come"
    words = "not known to be safe: node 6 has not reported that its outputs have their safe values"
    assert words in caplog.text


async def test_stop_reaches_a_module_through_a_bus_that_loses_frames(loss: Loss, tmp_path: Path) -> None:
    async with io_module() as (module, bus), robot_of_module(tmp_path, bus) as robot:
        await drive_module(robot, module)
        loss.lose(5, is_to_module(TO_MODULE, SDO, NMT))
        await robot.do("stop", who="ann", reason="")
        await robot.until(lambda: MODULE in {one.part for one in robot.master.stop.confirmed})
        assert loss.left == 0
        assert module.get(OUTPUTS) == 1
        loss.lose(3, is_to_module(NMT))  # the order to start gets lost, too
        await robot.do("go", who="ann", stop=None)
        await drive_module(robot, module)


async def test_an_order_for_which_there_was_no_room_is_not_lost(loss: Loss, tmp_path: Path) -> None:
    async with io_module() as (module, bus), robot_of_module(tmp_path, bus) as robot:
        await robot.until(lambda: module.is_operational)
        loss.lose(4, is_to_module(TO_MODULE))
        await drive_module(robot, module)
        assert loss.left == 0


async def test_a_servo_has_its_safe_value_when_its_bridge_has_left(
    loss: Loss, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, SERVO, "angle = { degrees = 30 }")
    servo = SimulatedServo(bus, 42)
    servo.speed = 300
    async with in_thread(servo.run_in_thread, servo.end):
        async with robot_with(tmp_path, [BridgeTable("dronecan", bus)], more) as robot:
            await drive(robot, SERVO, "angle", "60", lambda: abs(math.degrees(servo.position) - 60) < 1)
            loss.lose(8, is_to_servo)
        assert loss.left == 0
        assert abs(math.degrees(servo.position) - 30) < 4, "it has reported that it is there, or nearly"
    assert "not known to be safe" not in caplog.text
