"""What the page shows of real CAN buses: their frames, and how busy they are."""

from __future__ import annotations

import asyncio

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub, Link, LinkInfo
from msbot_agent.link.can import CanBusInfo, FrameTap
from msbot_agent.link.can.protocol import Frame, wire_bits
from msbot_agent.link.can.sim import SimBus
from msbot_web.link_meter import LinkMeter, seen_of_links
from tests.link.can_robot import Robot
from tests.web.access.test_accounts import Clock

ZEROS = Frame(0x100, bytes(8))


def meter_and_tap(bus: CanBusInfo, clock: Clock) -> tuple[LinkMeter, FrameTap]:
    """A meter of one bus, and what its frames are told to."""
    meter = LinkMeter([bus], clock)
    tap = meter.tap_of(bus)
    assert tap is not None
    return meter, tap


def test_the_load_is_that_of_the_last_second() -> None:
    clock = Clock()
    meter, tap = meter_and_tap(CanBusInfo("can0", 100_000), clock)
    assert meter.load_percent() == 0.0
    bits = len(wire_bits(ZEROS))
    assert bits == 47 + 64 + 15, "a frame of zeros has many stuff bits"
    for number in range(100):
        clock.now = number / 100
        tap(clock.now, "x", ZEROS)
    assert meter.load_percent() == pytest.approx(100 * 100 * bits / 100_000)
    clock.now = 1.495
    assert meter.load_percent() == pytest.approx(50 * 100 * bits / 100_000, rel=0.05)
    clock.now = 9.0
    assert meter.load_percent() == 0.0


def test_the_fast_part_of_a_frame_counts_at_its_own_rate_and_an_unknown_rate_does_not_count() -> None:
    clock = Clock()
    fast, unknown = CanBusInfo("b", 500_000, 2_000_000, fd=True), CanBusInfo("c", None)
    meter = LinkMeter([fast, unknown], clock)
    assert (meter.bitrate, meter.data_bitrate) == (500_000, 2_000_000)
    assert meter.tap_of(unknown) is None
    tap = meter.tap_of(fast)
    assert tap is not None
    frame = Frame(0x100, bytes(64), fd=True, brs=True)
    tap(0.0, "x", frame)
    bits = wire_bits(frame)
    seconds = sum(1 / (2_000_000 if bit.fast else 500_000) for bit in bits)
    assert meter.load_percent() == pytest.approx(100 * seconds)


def test_what_no_controller_can_have_sent_does_not_count() -> None:
    clock = Clock()
    meter, tap = meter_and_tap(CanBusInfo("can0", 100_000), clock)
    tap(0.0, "x", Frame(0x4, bytes(8), error=True))
    assert meter.load_percent() == 0.0


def test_a_million_frames_leave_no_more_than_a_second_of_them_behind() -> None:
    clock = Clock()
    meter, tap = meter_and_tap(CanBusInfo("can0", 500_000), clock)
    for number in range(20_000):
        clock.now = number / 2000
        tap(clock.now, "x", ZEROS)
    assert meter.load_percent() == pytest.approx(100 * 2000 * len(wire_bits(ZEROS)) / 500_000, rel=0.001)


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
