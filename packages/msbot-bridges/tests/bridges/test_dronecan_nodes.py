"""Nodes of the genuine library: motor controller, range finder, battery, and one that asks for its node id."""

from __future__ import annotations

import math
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any
from uuid import uuid4

import pytest

from msbot.part import Message
from msbot.part.messages.standard import Angle, Battery, Distance, Level, Place, Speed, Temperature
from msbot_bridges.bridge import ForeignDevice
from tests.bridges.hosts import Host, Reports, in_thread, running

dronecan = pytest.importorskip("dronecan")
UNIQUE = bytes(range(100, 116))
INDEX = 2
"""The motor controller's place in RawCommand."""


class GenuineNode:
    """A node of the library, in a thread.

    Args:
        bus: where it is.
        kind: what it is, a method of this class.
        node_id: None: it asks for one, by the three messages of the protocol.
        unique: tells it from others.
    """

    def __init__(self, bus: str, kind: str, node_id: int | None, unique: bytes = UNIQUE) -> None:
        from msbot_bridges.canbus import open_bus
        from msbot_bridges.dronecan.can_driver import PythonCanDriver

        self.power = 0
        """As RawCommand has it."""
        self.is_stuck = False
        self.index = INDEX
        self.reading = 1
        self.ended = threading.Event()
        self.raw_commands = 0
        self._types = dronecan.uavcan
        self._report: Callable[[], Any] = getattr(self, f"_{kind}")
        info = self._types.protocol.GetNodeInfo.Response()
        info.name = f"com.acme.{kind}"
        info.hardware_version.unique_id = unique
        self._driver = PythonCanDriver(open_bus(bus))
        self.node = dronecan.node.Node(self._driver, node_id, node_info=info, mode=0)
        self.node.add_handler(self._types.equipment.esc.RawCommand, self._ordered)
        self.node.add_handler(self._types.protocol.param.GetSet, self._has_none)
        self.node.periodic(0.05, self._live)
        if node_id is None:
            self.node.add_handler(self._types.protocol.dynamic_node_id.Allocation, self._answered)
            self.node.periodic(0.7, self._ask)

    def run(self) -> None:
        while not self.ended.is_set():
            self.node.spin(0.02)
        self.node.close()

    def critical(self) -> None:
        self.node.health = self._types.protocol.NodeStatus().HEALTH_CRITICAL

    # How it gets its id

    def _ask(self) -> None:
        if self.node.is_anonymous:
            self._send(UNIQUE[:6], is_first=True)

    def _answered(self, event: Any) -> None:
        known = event.message.unique_id.to_bytes()
        if not self.node.is_anonymous or event.transfer.source_node_id == 0 or not UNIQUE.startswith(known):
            return
        if len(known) == len(UNIQUE):
            self.node.node_id = event.message.node_id
        else:
            self._send(UNIQUE[len(known) :][:6], is_first=False)

    def _send(self, octets: bytes, *, is_first: bool) -> None:
        question = self._types.protocol.dynamic_node_id.Allocation(first_part_of_unique_id=is_first)
        question.unique_id.from_bytes(octets)
        transfer = dronecan.transport.Transfer(payload=question, source_node_id=0, discriminator=0x1234)
        for frame in transfer.to_frames():
            self._driver.send(frame.message_id, frame.bytes, extended=True)

    # What it is

    def _live(self) -> None:
        if not self.node.is_anonymous:
            self.node.broadcast(self._report())

    def _ordered(self, event: Any) -> None:
        if len(event.message.cmd) > self.index and not self.is_stuck:
            self.power = event.message.cmd[self.index]
            self.raw_commands += 1

    def _has_none(self, _event: Any) -> Any:
        return self._types.protocol.param.GetSet.Response()

    def _esc(self) -> Any:
        return self._types.equipment.esc.Status(
            esc_index=self.index,
            rpm=self.power,
            power_rating_pct=round(100 * abs(self.power) / 8191),
            voltage=12.0,
            current=1.5,
            temperature=300.0,
        )

    def _range(self) -> Any:
        return self._types.equipment.range_sensor.Measurement(range=1.25, reading_type=self.reading)

    def _battery(self) -> Any:
        return self._types.equipment.power.BatteryInfo(voltage=11.0, current=2.0, state_of_charge_pct=80)

    def _gnss(self) -> Any:
        fix = self._types.equipment.gnss.Fix2(status=self.reading, sats_used=9)
        fix.latitude_deg_1e8, fix.longitude_deg_1e8 = -3_673_000_000, 17_470_000_000
        fix.height_msl_mm = 20_500
        return fix

    def _servo(self) -> Any:
        return self._types.equipment.actuator.Status(actuator_id=4, position=0.0)


@asynccontextmanager
async def plugged(kind: str, node_id: int | None) -> AsyncIterator[tuple[GenuineNode, ForeignDevice, Host]]:
    from msbot_bridges.dronecan.dronecan_world import DronecanWorld

    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(DronecanWorld(bus)) as host:
        node = GenuineNode(bus, kind, node_id)
        async with in_thread(node.run, node.ended.set):
            yield node, await host.devices.get(), host


PORTS = {
    "esc": ({"turns": Speed, "supply": Battery, "temperature": Temperature}, {"power": Level}),
    "range": ({"distance": Distance}, {}),
    "battery": ({"battery": Battery}, {}),
    "gnss": ({"place": Place}, {}),
    "servo": ({"position": Angle}, {"angle": Angle}),
}


@pytest.mark.parametrize("kind", PORTS)
async def test_a_genuine_node_is_found_with_the_ports_of_what_it_sends_and_is_missed(kind: str) -> None:
    outputs, inputs = PORTS[kind]
    async with plugged(kind, 17) as (node, device, host):
        assert (device.identity.part_number, device.identity.unique) == (f"com.acme:{kind}", UNIQUE)
        assert {one.name: one.message for one in device.outputs} == outputs
        assert {one.name: one.message for one in device.inputs} == inputs
        assert device.settings == ()
        node.critical()
        await host.until(lambda: device.fault)
        assert device.fault == "node 17 says that its health is CRITICAL"
        node.ended.set()
        assert await host.lost_why.get() == "node 17 has sent no NodeStatus for 3 s"


async def test_a_motor_controller_turns_and_confirms_stop_by_its_speed() -> None:
    async with plugged("esc", 17) as (node, device, host):
        assert node.raw_commands == 0, "nothing was told to a device that is in no robot"
        reports = Reports()
        device.begin(reports)
        device.act("power", Level(percent=50))
        await reports.until(lambda last: last.get("turns") == Speed(rpm=4095))
        supply, temperature = reports.last["supply"], reports.last["temperature"]
        assert (supply.volts, supply.amperes, math.isnan(supply.percent)) == (12.0, 1.5, True)  # type: ignore[attr-defined]
        assert temperature.celsius == pytest.approx(26.85, abs=0.2)  # type: ignore[attr-defined]
        device.act("power", Level(percent=-50))
        await reports.until(lambda last: last["turns"] == Speed(rpm=-4095))
        node.is_stuck = True
        device.stop()
        assert device.not_stopped == "node 17 has not reported that it stands still"
        reports.last.clear()
        await reports.until(lambda last: last.get("turns") == Speed(rpm=-4095))
        assert device.not_stopped, "it turns: it has not stopped"
        node.is_stuck = False
        await host.until(lambda: not device.not_stopped)
        assert node.power == 0


@pytest.mark.parametrize(
    ("kind", "port", "message"),
    [
        ("range", "distance", Distance(metres=1.25, in_range=True)),
        ("battery", "battery", Battery(volts=11.0, amperes=2.0, percent=80.0)),
    ],
)
async def test_a_sensor_is_heard(kind: str, port: str, message: Message) -> None:
    async with plugged(kind, 17) as (node, device, _):
        reports = Reports()
        device.begin(reports)
        await reports.until(lambda last: last.get(port) == message)
        device.stop()
        assert device.not_stopped == "", "there is nothing to stop"
        if kind == "range":
            node.reading = 3  # too far
            await reports.until(lambda last: last[port] == Distance(metres=0.0, in_range=False))


async def test_a_receiver_of_satellites_says_its_place_when_it_has_a_fix() -> None:
    async with plugged("gnss", 17) as (node, device, _):
        reports = Reports()
        device.begin(reports)
        node.reading = 3
        await reports.until(lambda last: last)
        place = Place(latitude=-36.73, longitude=174.7, altitude=20.5, satellites=9)
        assert reports.last == {"place": place}
        node.reading = 2
        await reports.until(lambda last: math.isnan(last["place"].altitude))  # type: ignore[attr-defined]


async def test_a_node_without_an_id_asks_for_one_and_becomes_a_device() -> None:
    async with plugged("servo", None) as (node, device, _):
        assert node.node.node_id == 125, "the highest that is free"
        assert (device.identity.where, device.identity.unique) == ("node 125", UNIQUE)
