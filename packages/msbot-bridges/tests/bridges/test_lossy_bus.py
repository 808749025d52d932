"""A bridge leaves, and its robot stops, while a CAN bus has no room for the orders; devices of genuine libraries."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
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
pytest.importorskip("dronecan")

from msbot_bridges.canopen.simulated.io_module import OUTPUTS, SimulatedIo
from msbot_bridges.dronecan.simulated_servo import SimulatedServo

MODULE, SERVO = "vendor-0x4d53:SimIO", "org.msbot:simservo"
NODE = 6
TO_MODULE, SDO, NMT = 0x200 + NODE, 0x600 + NODE, 0x000
LATE_S = 0.4
"""The library asks again before that."""
ARRAY_COMMAND = 1010
"""The number of DroneCAN's message to servos."""


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


@pytest.fixture
def loss(monkeypatch: pytest.MonkeyPatch) -> Loss:
    return Loss(monkeypatch)


def is_to_module(*identifiers: int) -> Callable[[can.Message], bool]:
    return lambda message: not message.is_extended_id and message.arbitration_id in identifiers


def is_to_servo(message: can.Message) -> bool:
    return message.is_extended_id and message.arbitration_id >> 8 & 0xFFFF == ARRAY_COMMAND


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


@pytest.mark.promise("A slot's safe value is what leaving leaves a device on CAN with, though frames get lost")
@pytest.mark.parametrize("lost", [(TO_MODULE,), (TO_MODULE, NMT), (TO_MODULE, SDO, NMT)])
async def test_a_module_has_its_safe_values_when_its_bridge_has_left(
    lost: tuple[int, ...], loss: Loss, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    async with in_thread(module.run_in_thread, module.end):
        async with robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot:
            await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
            loss.lose(5, is_to_module(*lost))
        assert loss.left == 0
        assert module.get(OUTPUTS) == 1
        assert module.node.nmt.state == "PRE-OPERATIONAL"
    assert "not known to be safe" not in caplog.text


async def test_a_module_that_answers_late_is_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    answer, timers = module.node.sdo.send_response, list[threading.Timer]()

    def answer_late(response: bytes) -> None:
        timers.append(threading.Timer(LATE_S, answer, [response]))
        timers[-1].start()

    async with in_thread(module.run_in_thread, module.end):
        async with robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot:
            await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
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
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    async with in_thread(module.run_in_thread, module.end):
        async with robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot:
            await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
            loss.lose(10_000, is_to_module(SDO))
        assert module.get(OUTPUTS) == 1, "the order itself has come"
    words = "not known to be safe: node 6 has not reported that its outputs have their safe values"
    assert words in caplog.text


async def test_stop_reaches_a_module_through_a_bus_that_loses_frames(loss: Loss, tmp_path: Path) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    async with (
        in_thread(module.run_in_thread, module.end),
        robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot,
    ):
        await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
        loss.lose(5, is_to_module(TO_MODULE, SDO, NMT))
        await robot.do("stop", who="ann", reason="")
        await robot.until(lambda: MODULE in {one.part for one in robot.master.stop.confirmed})
        assert loss.left == 0
        assert module.get(OUTPUTS) == 1
        loss.lose(3, is_to_module(NMT))  # the order to start gets lost, too
        await robot.do("go", who="ann", stop=None)
        await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)


async def test_an_order_for_which_there_was_no_room_is_not_lost(loss: Loss, tmp_path: Path) -> None:
    bus, more = f"msbot:{uuid4().hex[:12]}", adopted(tmp_path, MODULE, "out_1 = { on = true }")
    module = SimulatedIo(bus, NODE)
    async with (
        in_thread(module.run_in_thread, module.end),
        robot_with(tmp_path, [BridgeTable("canopen", bus)], more) as robot,
    ):
        await robot.until(lambda: robot.is_in(MODULE, PartState.ACTIVE))
        await robot.until(lambda: module.is_operational)
        loss.lose(4, is_to_module(TO_MODULE))
        await drive(robot, MODULE, "out_2", "true", lambda: module.get(OUTPUTS) & 2)
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
