"""What the page shows of real CAN buses: their frames, and how busy they are."""

from __future__ import annotations

import asyncio

import pytest

from msbot.link import InprocHub, Link, LinkInfo
from msbot.link.can.protocol import Frame
from msbot.link.can.sim import SimBus
from msbot.runtime.virtual_time import run_virtual
from msbot.web.real_buses import LinkMeter, seen_of_links
from tests.link.can_robot import Robot
from tests.web.access.test_accounts import Clock


def test_the_load_is_that_of_the_last_second() -> None:
    clock = Clock()
    meter = LinkMeter("can0", 100_000, clock)
    assert meter.load_percent() == 0.0
    for number in range(100):
        clock.now = number / 100
        meter.tap(clock.now, "x", Frame(0x100, bytes(8)))  # 111 bits
    assert meter.load_percent() == pytest.approx(11.1)
    clock.now = 1.495
    assert meter.load_percent() == pytest.approx(5.55, rel=0.05)
    clock.now = 9.0
    assert meter.load_percent() == 0.0


def test_long_identifiers_take_longer_and_an_unknown_bit_rate_gives_no_load() -> None:
    clock = Clock()
    short, long, unknown = LinkMeter("a", 1000, clock), LinkMeter("b", 1000, clock), LinkMeter("c", 0, clock)
    for meter in (short, long, unknown):
        meter.tap(0.0, "x", Frame(0x100, extended=meter is long))
    assert (short.load_percent(), long.load_percent(), unknown.load_percent()) == (4.7, 6.7, 0.0)


def test_a_million_frames_leave_no_more_than_a_second_of_them_behind() -> None:
    clock = Clock()
    meter = LinkMeter("can0", 500_000, clock)
    for number in range(20_000):
        clock.now = number / 2000
        meter.tap(clock.now, "x", Frame(0x100, bytes(8)))
    assert meter.load_percent() == pytest.approx(100 * 2000 * 111 / 500_000, rel=0.001)


def test_frames_of_a_can_link_are_shown_and_measured() -> None:
    async def main() -> None:
        robot = Robot(SimBus(bitrate=125_000))
        link = robot.master().link
        seen = seen_of_links([link])
        await asyncio.sleep(3.0)
        await robot.stop_all()
        assert seen.frames.total > 2
        assert any("BEACON: robot 00c0ffee" in row.words[0] for row in seen.frames.rows())
        assert seen.bus is not None
        assert seen.bus.name == link.info.name
        assert seen.bus.bitrate == (link.info.bits_per_second or 0)
        assert seen.bench is None

    run_virtual(main())


def test_a_robot_without_a_can_bus_has_none_to_show() -> None:
    async def main() -> None:
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        links: list[Link] = [hub.server]
        seen = seen_of_links(links)
        assert seen.bus is None
        assert seen.frames.rows() == []

    run_virtual(main())
