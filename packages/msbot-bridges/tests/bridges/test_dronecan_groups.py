"""Several motor controllers on one DroneCAN bus: new ones with one index, what they are told, how it is kept."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Level
from tests.bridges.hosts import Reports, in_thread, running
from tests.bridges.test_dronecan_nodes import GenuineNode

pytest.importorskip("dronecan")

import dronecan

from msbot_bridges.dronecan.dronecan_world import DronecanWorld
from msbot_bridges.dronecan.orders import conflicts, motor_powers, servo_angles

NAME = "uavcan.esc_index"


class Controller(GenuineNode):
    """A motor controller of the library, as it comes: with index 0, which is a parameter."""

    def __init__(self, bus: str, node_id: int) -> None:
        super().__init__(bus, "esc", node_id, bytes([node_id] * 16))
        self.index = self.saved = 0
        self.node.add_handler(self._types.protocol.param.ExecuteOpcode, self._keep)

    def _has_none(self, event: Any) -> Any:
        answer = self._types.protocol.param.GetSet.Response()
        if event.request.index == 0:
            if dronecan.get_active_union_field(event.request.value) == "integer_value":
                self.index = min(19, event.request.value.integer_value)
            answer.name = NAME
            answer.value.integer_value, answer.default_value.integer_value = self.index, 0
            answer.min_value.integer_value, answer.max_value.integer_value = 0, 19
        return answer

    def _keep(self, event: Any) -> Any:
        assert event.request.opcode == event.request.OPCODE_SAVE
        self.saved += 1
        return self._types.protocol.param.ExecuteOpcode.Response(ok=True)


async def until(condition: Any) -> None:
    while not condition():  # noqa: ASYNC110 - nodes are in threads
        await asyncio.sleep(0.02)


@pytest.mark.promise("Two motor controllers of a robot that have one index are not driven")
async def test_new_controllers_are_driven_each_by_its_own_index_and_not_by_a_common_one() -> None:
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(DronecanWorld(bus)) as host:
        one, other = Controller(bus, 17), Controller(bus, 18)
        async with in_thread(one.run, one.ended.set), in_thread(other.run, other.ended.set):
            found = {device.identity.where: device for device in [await host.devices.get() for _ in range(2)]}
            first, second = found["node 17"], found["node 18"]
            assert [(setting.name, setting.default) for setting in first.settings] == [("uavcan_esc_index", 0)]
            first.begin(Reports())
            first.act("power", Level(percent=50))
            words = "node 18 obeys the orders to node 17: both have index 0"
            assert await host.warned.get() == words, "nobody has taken it in"
            await until(lambda: one.power == 4095)
            second.begin(Reports())
            for number, mate in ((17, 18), (18, 17)):
                assert await host.warned.get() == (
                    f"node {number} and node {mate} both have index 0, so neither is driven: give one of them another "
                    "by its setting uavcan_esc_index, then restart it"
                )
            await until(lambda: one.power == 0 and other.power == 0)
            second.act("power", Level(percent=-50))
            second.set("uavcan_esc_index", 1)
            await until(lambda: (one.power, other.power) == (4095, -4095))
            await until(lambda: other.saved)
            second.set("uavcan_esc_index", 1)
            first.set("uavcan_esc_index", 0)
            second.set("uavcan_esc_index", 30)
            await until(lambda: other.index == 19)
            await until(lambda: other.saved == 2)
            assert one.saved == 0, "what it has already is not written into its memory again"
            assert host.warned.empty()


def node(number: int, index: int | None = None, actuator: int | None = None, **more: Any) -> Any:
    values = {"is_driven": True, "power": 100.0, "radians": 1.0, "setting_for": lambda _: ""}
    return SimpleNamespace(node_id=number, esc_index=index, actuator_id=actuator, **{**values, **more})


def test_orders_have_room_for_what_the_protocol_can_say() -> None:
    assert motor_powers([]) == []
    assert motor_powers([node(1, 2), node(2, 0, power=-50.0)]) == [-4095, 0, 8191]
    assert motor_powers([node(1, 1), node(2, 1), node(3, 1)]) == [0, 0]
    assert motor_powers([node(1, 31)]) == []
    assert [len(one) for one in servo_angles(node(number, actuator=number) for number in range(40))] == [15, 15, 10]
    assert servo_angles([node(1, actuator=3), node(2, actuator=3), node(4, actuator=5, radians=None)]) == []


def test_conflicts_are_those_of_devices_in_the_robot() -> None:
    assert conflicts([node(1, 0, is_driven=False), node(2, 0, is_driven=False), node(3, actuator=0)]) == []
    assert [words for _, words in conflicts([node(1, 25)])] == [
        "node 1 has index 25, and RawCommand has places 0 to 19: it cannot be driven"
    ]
    assert [words for _, words in conflicts([node(1, actuator=3), node(2, actuator=3)])] == [
        "node 1 and node 2 both have actuator id 3, so neither is driven: give one of them another, then restart it",
        "node 2 and node 1 both have actuator id 3, so neither is driven: give one of them another, then restart it",
    ]
