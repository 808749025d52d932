"""A report that was on its way when STOP came confirms nothing: nodes of genuine libraries, which report unasked."""

from __future__ import annotations

from typing import Any

import pytest

from msbot.part.messages.standard import Level, Speed
from msbot_bridges.canbus import FreshReports
from msbot_bridges.cyphal.aspect import STANDBY
from tests.bridges.hosts import Reports

pytest.importorskip("dronecan")

import tests.bridges.test_cyphal as cyphal
import tests.bridges.test_dronecan_nodes as dronecan


def test_the_first_report_of_each_kind_after_the_order_may_be_of_before() -> None:
    reports = FreshReports()
    assert reports.is_old(1, "turns", 1.0), "STOP has not gone out"
    reports.told(1, 2.0)
    assert reports.is_old(1, "turns", 1.5), "it was heard before, and handed over late"
    assert reports.is_old(1, "turns", 2.1)
    assert not reports.is_old(1, "turns", 2.2)
    reports.told(1, 2.3)
    assert not reports.is_old(1, "turns", 2.4), "the order is only repeated"
    assert reports.is_old(1, "power", 2.5)
    assert reports.is_old(2, "turns", 2.6), "the next STOP has not gone out"
    reports.told(2, 3.0)
    assert reports.is_old(2, "turns", 3.1)
    assert not reports.is_old(2, "turns", 3.2)


class Counted(Reports):
    """Counts what it gets."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __call__(self, port: str, message: Any) -> None:
        self.count += 1
        super().__call__(port, message)

    async def more(self, number: int) -> None:
        until = self.count + number
        await self.until(lambda _: self.count >= until)


async def test_a_motor_that_stands_before_stop_has_gone_out_is_not_stopped() -> None:
    async with dronecan.plugged("esc", 17) as (_, device, host):
        reports, held = Counted(), list[bool]()
        device.begin(reports)
        await reports.until(lambda last: last.get("turns") == Speed(rpm=0))
        order, device._order = device._order, held.append  # type: ignore[attr-defined]
        device.act("power", Level(percent=50))
        device.stop()
        await reports.more(6)  # three messages of each report
        assert held == [False, True]
        assert device.not_stopped == "node 17 has not reported that it stands still"
        order(True)
        await host.until(lambda: not device.not_stopped)


class Held:
    """The bus of a device, that keeps what is urgent."""

    def __init__(self, bus: Any) -> None:
        self.bus = bus
        self.kept: list[tuple[tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.bus, name)

    def publish(self, *arguments: Any, **options: Any) -> None:
        self.kept.append((arguments, options))


async def test_a_servo_in_standby_before_stop_has_gone_out_is_not_stopped() -> None:
    pytest.importorskip("pycyphal")
    async with cyphal.plugged("servo") as (node, found, host):
        device: Any = (await cyphal.in_the_robot(found, host))[0]
        reports = Counted()
        device._report = reports
        device._bus = held = Held(device._bus)
        node.is_stuck, node.readiness = True, STANDBY
        await reports.more(5)
        device.stop()
        await reports.more(5)
        assert held.kept
        assert device.not_stopped == "node 42 has not reported that it is disengaged"
        device._bus = held.bus
        for arguments, options in held.kept:
            held.bus.publish(*arguments, **options)
        await host.until(lambda: not device.not_stopped)
