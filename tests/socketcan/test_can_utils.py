"""Our socket beside candump and cansend: T5 to T7 of the requirements, each kind of frame both ways."""

from __future__ import annotations

from random import Random

import pytest

from msbot_agent.link import open_link
from msbot_agent.link.can import CanMasterLink, CanPartLink, open_can_bus
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_agent.link.can.protocol.notation import parse_frame
from msbot_agent.link.can.self_test import selftest
from tests.socketcan.bus import SETTINGS, candump, cansend, listening, running

FRAMES = [
    "123#1234567890",
    "123#12345678",
    "000#",
    "7FF#1122334455667788",
    "00000123#12",
    "1FFFFFFF#1122334455667788",
    "321#R",
    "321#R5",
    "1E000000#R8",
    "123##0",
    "123##1A5",
    "123##2" + "5A" * 12,
    "7FF##3" + "00" * 32,
    "1FFFFFFF##1" + "00112233445566778899AABBCCDDEEFF" * 4,
]


@pytest.mark.parametrize("text", FRAMES)
async def test_t6_what_cansend_sends_is_heard(text: str) -> None:
    async with listening("can:vcan0?fd=1") as ear:
        await cansend("vcan0", text)
        assert await ear.heard(1) == [parse_frame(text)]


async def test_t5_what_we_send_is_shown_by_candump() -> None:
    async with candump("vcan0") as tool, listening("can:vcan0?fd=1") as ear:
        for text in FRAMES:
            await ear.send(parse_frame(text))
            assert await tool.next() == parse_frame(text)


async def test_t7_the_frames_of_the_first_stage_both_ways() -> None:
    """Thesis 4.2.5 stages 1 and 2: identifier 0x123, DLC 4, data 12 34 56 78."""
    frame = Frame(0x123, bytes.fromhex("12345678"))
    async with listening("can:vcan0") as master, listening("can:vcan0") as component:
        for number in range(1, 101):
            await master.send(frame)
            await component.heard(number)
            await component.send(frame)
            await master.heard(number)
        assert master.frames == component.frames == [frame] * 100


async def test_t1_to_t4_the_checks_of_a_bus_pass() -> None:
    checks = await selftest(open_can_bus("can:vcan0"), open_can_bus("can:vcan0"), frames=300)
    assert [(check.passed, check.words) for check in checks if not check.passed] == []
    assert len(checks) == 4


async def test_a_classic_socket_hears_no_fd_frames_and_buses_are_separate() -> None:
    async with listening("can:vcan0?fd=0") as classic, listening("can:vcan1") as elsewhere:
        await cansend("vcan0", "123##1A5", "124#A5")
        assert await classic.heard(1) == [Frame(0x124, b"\xa5")]
        await cansend("vcan1", "125#A5")
        assert await elsewhere.heard(1) == [Frame(0x125, b"\xa5")]
        assert len(classic.frames) == 1


async def test_the_kernel_keeps_foreign_traffic_away_from_a_link() -> None:
    master, part = open_link("can:vcan0", serve=True, can=SETTINGS), open_link("can:vcan0", can=SETTINGS)
    async with running(master, part) as (one, other), listening("can:vcan0") as ear:
        foreign = [f"{can_id:03X}#01" for can_id in (0x000, 0x080, 0x0FF, 0x100, 0x179, 0x1FF, 0x701, 0x7FF)]
        await cansend("vcan0", *foreign, "123#R8", "00000123#01", "18DAF110#0102", "1E123456#0102030405060708")
        await ear.heard(12)
        packet = Random(1).randbytes(100)
        await other.send_all([packet], 0)
        await one.until_packets(1)
        assert one.packets == [(packet, 1)]
        answers = [frame for frame in ear.frames if frame.extended and frame.can_id & 0x1F000000 == CanIds().assign]
        assert answers == []  # to the JOIN whose identifier does not fit its UID
        assert isinstance(master, CanMasterLink)
        assert isinstance(part, CanPartLink)
        assert (master.foreign, part.foreign) == (0, 0)
        assert master.counters.dropped == part.counters.dropped == {}


async def test_candump_shows_the_segments_of_a_message() -> None:
    """The 24 octets of a CREATE_CLIENT as four classic frames, as docs/reference/can.md has them."""
    settings = "compression=0"
    master = open_link(f"can:vcan0?{settings}", serve=True, can=SETTINGS)
    part = open_link(f"can:vcan0?{settings}", can=SETTINGS)
    async with running(master, part) as (_, end), candump("vcan0,100:780") as tool:
        await end.send_all([bytes(range(24))], 0)
        frames = [await tool.next() for _ in range(4)]
    assert [frame.can_id for frame in frames] == [0x101] * 4
    assert [frame.data[0] for frame in frames] == [0x80, 0x01, 0x02, 0x43]
    assert b"".join(frame.data[1:] for frame in frames)[:24] == bytes(range(24))
