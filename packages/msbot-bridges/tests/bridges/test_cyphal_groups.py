"""Motor controllers of one group, and a battery, as nodes of the genuine library; and the rules without a bus."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Battery, Level, Number, Temperature, Text
from msbot_bridges.bridge import ForeignDevice
from msbot_bridges.cyphal.aspect import ENGAGED, READINESS, STANDBY
from msbot_bridges.cyphal.node_registers import Register, SubjectPort, ports_of, settings_of
from msbot_bridges.cyphal.service_types import VECTORS, vector_type
from msbot_bridges.cyphal.subject_groups import SubjectGroups, may_share
from tests.bridges.hosts import Host, Reports, running
from tests.bridges.test_cyphal import living
from tests.bridges.test_cyphal_rules import port

pytest.importorskip("pycyphal")

BIG = vector_type(31)
SET_POINTS, READY = 300, 301


def test_a_vector_has_each_ones_place_and_grows() -> None:
    groups = SubjectGroups()
    assert groups.vector(7, "a", 1, 0.5) == (vector_type(2), [0.0, 0.5])
    assert groups.vector(7, "b", 3, -1.0) == (vector_type(4), [0.0, 0.5, 0.0, -1.0])
    groups.leave("b")
    assert groups.vector(7, "a", 1, 0.25) == (vector_type(4), [0.0, 0.25, 0.0, 0.0]), "it does not shrink"
    groups.leave("a")
    assert groups.vector(7, "c", 0, 1.0) == (vector_type(2), [1.0, 0.0])
    assert {vector_type(VECTORS[one]) for one in VECTORS} == set(VECTORS)


def test_a_group_is_engaged_when_all_that_hear_it_want_it() -> None:
    groups = SubjectGroups()
    assert groups.readiness(7, "a", ENGAGED, ["a", "b"]) == STANDBY, "b is in no robot"
    assert groups.readiness(7, "b", ENGAGED, ["a", "b"]) == ENGAGED
    assert groups.readiness(7, "a", STANDBY, ["a", "b"]) == STANDBY
    groups.leave("b")
    assert groups.readiness(7, "a", ENGAGED, ["a"]) == ENGAGED


def test_a_register_says_the_place_and_is_no_setting() -> None:
    registers = {**port("sub", "esc.setpoint", 9, BIG), "esc.index": Register("natural8", (2,))}
    registers["motor.index"] = Register("natural8", (5,))
    assert [one.place for one in ports_of(registers).subscribed] == [2], "of the port's own name"
    assert settings_of(registers) == []
    del registers["esc.index"]
    assert ports_of(registers).subscribed[0].place == 5
    registers["other.idx"] = Register("natural8", (1,))
    assert not ports_of(registers).subscribed[0].is_usable, "it is not known which"
    alone = {"motor.index": Register("natural8", (5,))}
    assert [one.register for one in settings_of(alone)] == ["motor.index"]
    beyond = {**port("sub", "setpoint", 9, vector_type(4)), "index": Register("natural8", (4,))}
    assert ports_of(beyond).subscribed[0].place is None


def test_who_may_share_a_subject() -> None:
    def at(place: int | None, kind: str = BIG) -> SubjectPort:
        return SubjectPort("x", "uavcan.sub.x.id", kind, 7, True, place)

    assert may_share(at(0), at(1, vector_type(4)))
    assert not may_share(at(0), at(0))
    assert not may_share(at(0), at(None))
    assert may_share(at(None, READINESS), at(None, READINESS))
    assert not may_share(at(None, "uavcan.si.unit.angle.Scalar.1.0"), at(None, "uavcan.si.unit.angle.Scalar.1.0"))


async def kinds() -> dict[str, Any]:
    """Nodes of the library; it is loaded here."""
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    import reg.udral.service.actuator.common
    import reg.udral.service.actuator.common.sp
    import reg.udral.service.battery
    import reg.udral.service.common
    from pycyphal.application.register import Natural8, Natural16, Value

    from msbot_bridges.cyphal.simulated.library_node import LibraryNode

    class MotorController(LibraryNode):
        """It obeys its place of the vector, as the standard says."""

        product = "simesc"
        place, subjects = 0, (SET_POINTS, READY)

        def set_up(self, node: Any) -> None:
            self.power, self.readiness, self.silent, self.is_stuck = 0.0, STANDBY, 0, False
            self.widths = set[int]()
            node.registry.setdefault("esc.index", Value(natural8=Natural8([self.place])))
            for name, subject in zip(("setpoint", "readiness"), self.subjects, strict=True):
                node.registry.setdefault(f"uavcan.sub.{name}.id", Value(natural16=Natural16([subject])))
            own = Value(natural16=Natural16([400 + self.node_id]))
            node.registry.setdefault("uavcan.pub.feedback.id", own)
            sp = reg.udral.service.actuator.common.sp.Vector31_0_1
            self.port(node.make_subscriber, sp, "setpoint").receive_in_background(self._told)
            ready = reg.udral.service.common.Readiness_0_1
            self.port(node.make_subscriber, ready, "readiness").receive_in_background(self._made_ready)
            feedback = reg.udral.service.actuator.common.Feedback_0_1
            self._feedback = self.port(node.make_publisher, feedback, "feedback")

        def live(self) -> None:
            self.silent += 1
            if self.silent > 10:
                self.readiness = STANDBY
            told = reg.udral.service.actuator.common.Feedback_0_1()
            told.heartbeat.readiness.value = self.readiness
            told.demand_factor_pct = round(100 * self.power) if self.readiness == ENGAGED else 0
            self._feedback.publish_soon(told)

        async def _told(self, told: Any, _: object) -> None:
            self.power = float(told.value[self.place])

        async def _made_ready(self, told: Any, _: object) -> None:
            self.silent = 0
            if not self.is_stuck:
                self.readiness = int(told.value)

    class SmartBattery(LibraryNode):
        product = "simbattery"

        def set_up(self, node: Any) -> None:
            for number, name in enumerate(("status", "parameters")):
                value = Value(natural16=Natural16([500 + number]))
                node.registry.setdefault(f"uavcan.pub.{name}.id", value)
            self._status = self.port(node.make_publisher, reg.udral.service.battery.Status_0_2, "status")
            self._facts = self.port(node.make_publisher, reg.udral.service.battery.Parameters_0_3, "parameters")
            self.error = 0

        def live(self) -> None:
            status = reg.udral.service.battery.Status_0_2()
            status.temperature_min_max[0].kelvin, status.temperature_min_max[1].kelvin = 290.15, 300.15
            status.available_charge.coulomb, status.error.value = 7200.0, self.error
            status.cell_voltages = [4.0, 3.5, 4.0]
            facts = reg.udral.service.battery.Parameters_0_3(state_of_health_pct=90, cycle_count=12)
            self._status.publish_soon(status)
            self._facts.publish_soon(facts)

    return {"esc": MotorController, "battery": SmartBattery}


class Group:
    """Motor controllers on one bus, and their devices."""

    def __init__(self, bus: str, kind: Any, host: Host, stack: AsyncExitStack) -> None:
        self.bus, self.kind, self.host, self.stack = bus, kind, host, stack

    async def put_in(self, node_id: int, place: int) -> tuple[Any, ForeignDevice]:
        node = self.kind(self.bus, node_id)
        node.place = place
        node.pull = await self.stack.enter_async_context(living(node))
        return node, await self.host.devices.get()


async def until(condition: Callable[[], object]) -> None:
    while not condition():  # noqa: ASYNC110 - nodes are no source of events
        await asyncio.sleep(0.02)


async def test_each_of_a_group_is_a_part_and_has_its_place_of_the_vector() -> None:
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld

    kind = (await kinds())["esc"]
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(CyphalWorld(bus)) as host, AsyncExitStack() as stack:
        group = Group(bus, kind, host, stack)
        one, first = await group.put_in(41, 0)
        assert [(part.name, part.message) for part in first.inputs] == [("setpoint", Level)]
        first.begin(Reports())
        first.act("setpoint", Level(percent=25))
        await until(lambda: one.readiness == ENGAGED and one.power == 0.25)
        two, second = await group.put_in(42, 5)
        said = await host.said.get()
        assert said == (
            "node 42 hears the orders to node 41: both have subject 301, so they are engaged only when both are in the "
            "robot"
        )
        await until(lambda: one.readiness == STANDBY)
        assert two.readiness == STANDBY, "it is in no robot"
        reports = Reports()
        second.begin(reports)
        second.act("setpoint", Level(percent=-50))
        await until(lambda: (one.readiness, two.readiness) == (ENGAGED, ENGAGED))
        await until(lambda: (one.power, two.power) == (0.25, -0.5))
        await reports.until(lambda last: last.get("feedback") == Level(percent=-50))
        assert (first.fault, second.fault) == ("", "")

        two.is_stuck = True
        for device in (first, second):
            device.stop()
        await host.until(lambda: not first.not_stopped)
        assert second.not_stopped == "node 42 has not reported that it is disengaged"
        two.is_stuck = False
        await host.until(lambda: not second.not_stopped)
        await until(lambda: (one.power, two.power) == (0.0, 0.0))
        for device in (first, second):
            device.go()
        first.act("setpoint", Level(percent=10))
        await until(lambda: one.readiness == ENGAGED and math.isclose(one.power, 0.1, rel_tol=1e-2))

        two.pull()
        assert await host.lost_why.get() == "node 42 has sent no heartbeat for 3 s"
        second.end()
        await until(lambda: one.readiness == ENGAGED and math.isclose(one.power, 0.1, rel_tol=1e-2))


async def test_two_with_one_place_are_named() -> None:
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld

    kind = (await kinds())["esc"]
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(CyphalWorld(bus)) as host, AsyncExitStack() as stack:
        group = Group(bus, kind, host, stack)
        _, first = await group.put_in(41, 1)
        first.begin(Reports())
        _, second = await group.put_in(42, 1)
        second.begin(Reports())
        assert second.fault == (
            "nodes 42 and 41 both have place 1 of subject 300: give node 42 another place, and restart it"
        )


async def test_a_battery_says_how_it_is() -> None:
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld

    kind = (await kinds())["battery"]
    bus = f"msbot:{uuid4().hex[:12]}"
    node = kind(bus, 50)
    async with running(CyphalWorld(bus)) as host, living(node):
        device = await host.devices.get()
        reports = Reports()
        device.begin(reports)
        await reports.until(lambda last: len(last) == 6)
        assert reports.last["status_weakest_cell"] == Number(value=3.5)
        assert reports.last["status_ampere_hours"] == Number(value=2.0)
        assert reports.last["status_error"] == Text(text="")
        assert reports.last["status_temperature"].celsius == pytest.approx(27.0, abs=1e-3)  # type: ignore[attr-defined]
        assert reports.last["parameters_health"] == Level(percent=90.0)
        assert reports.last["parameters_cycles"] == Number(value=12.0)
        node.error = 101
        await reports.until(lambda last: last["status_error"] == Text(text="it is too cold"))
        assert {type(one) for one in reports.last.values()} == {Number, Text, Temperature, Level}
        assert Battery not in {one.message for one in device.outputs}, "that is another subject of the service"
