"""Real drivers of real controllers, emulated: two SJA1000 (classic CAN) on one bus, two CTU CAN FD on another one.

Two controllers are two ends of a wire: what one sends the other one hears, and only that. The emulation has bit
rates and modes but no bit errors (those come from `test_error_states`).
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from random import Random

import pytest

from msbot_agent.link import Signal, open_link
from msbot_agent.link.can import CanPartLink
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.frames import TOO_SLOW
from msbot_xrce.errors import LinkDown
from tests.socketcan.bus import SETTINGS, End, cansend, ip, listening, running, until

pytestmark = pytest.mark.controllers
CLASSIC = ("can0", "can1")
FD = ("can2", "can3")
FD_ON = "bitrate 500000 dbitrate 2000000 fd on"


@asynccontextmanager
async def both_up(names: tuple[str, str], settings: str) -> AsyncIterator[None]:
    """Two controllers with these settings."""
    for name in names:
        await asyncio.to_thread(ip, f"set {name} up type can {settings}")
    try:
        yield
    finally:
        for name in names:
            await asyncio.to_thread(ip, f"set {name} down")


async def carry(packet: bytes, sender: End, to: int, receiver: End) -> None:
    """Send a packet until it has come: again, as the streams above would, when the emulated computer stood still
    between two of its frames for longer than a receiver waits, which beside other work it does."""
    received = len(receiver.packets)
    while len(receiver.packets) == received:
        lost = Counter(receiver.link.counters.dropped)[TOO_SLOW]
        await sender.send_all([packet], to)
        await until(
            lambda lost=lost: (
                len(receiver.packets) > received  # type: ignore[misc]
                or Counter(receiver.link.counters.dropped)[TOO_SLOW] > lost
            )
        )


async def link_both_ways(names: tuple[str, str], query: str, sizes: tuple[int, ...]) -> CanPartLink:
    """Packets of these sizes go from a master on the first to a part on the second and back; none is lost in the link.

    One at a time, because an emulated frame takes no time on the bus: more of them than a receive buffer holds
    (five classic ones) can get lost in a controller, as on a computer that is too slow.
    """
    master = open_link(f"can:{names[0]}{query}", serve=True, can=SETTINGS)
    part = open_link(f"can:{names[1]}", can=replace(SETTINGS, uid=b"12345678"))
    assert isinstance(part, CanPartLink)
    packets = [Random(size).randbytes(size) for size in sizes]
    async with running(master, part) as (top, end):
        await top.until_told(Signal.PEER_JOINED)
        for packet in packets:
            await carry(packet, top, part.node_id, end)
            await carry(packet, end, 0, top)
        assert [packet for packet, _ in top.packets] == [packet for packet, _ in end.packets] == packets
        assert {*master.counters.dropped, *part.counters.dropped} <= {TOO_SLOW}
    return part


@pytest.mark.parametrize("bitrate", [125_000, 500_000])
async def test_t5_a_channel_of_that_bit_rate_carries_frames_and_packets(bitrate: int) -> None:
    """Thesis 4.2.4.1: bit rate 125000, `123#1234567890` sent by a tool."""
    async with both_up(CLASSIC, f"bitrate {bitrate}"):
        async with listening(f"can:can1?bitrate={bitrate}") as ear:
            await cansend("can0", "123#1234567890")
            assert await ear.heard(1) == [Frame(0x123, bytes.fromhex("1234567890"))]
            assert (ear.bus.info.bits_per_second, ear.bus.info.fd) == (bitrate, False)
        await link_both_ways(CLASSIC, "", (1, 8, 27))


async def test_a_classic_controller_refuses_fd_and_other_bit_rates_with_the_commands() -> None:
    async with both_up(CLASSIC, "bitrate 250000"):
        for query, words in (
            ("?fd=1", "takes classic frames only"),
            ("?bitrate=500000", "runs at a bit rate of 250000"),
        ):
            with pytest.raises(LinkDown, match=words):
                await open_link(f"can:can0{query}", serve=True, can=SETTINGS).run()
    with pytest.raises(LinkDown, match="is down: `sudo ip link set can0 up type can bitrate 250000` brings it up"):
        await open_link("can:can0", serve=True, can=SETTINGS).run()


async def test_fd_frames_with_bit_rate_switch_carry_packets() -> None:
    async with both_up(FD, FD_ON), listening("can:can3?fd=1") as ear:
        await cansend("can2", "123##1" + "A5" * 64)
        assert await ear.heard(1) == [Frame(0x123, b"\xa5" * 64, fd=True, brs=True)]
        assert (ear.bus.info.bits_per_second, ear.bus.info.data_bits_per_second) == (500_000, 2_000_000)
        part = await link_both_ways(FD, "?fd=1", (1, 62, 63, 200))
        data = [frame for frame in ear.frames[1:] if 0x100 < frame.can_id < 0x200 and not frame.extended]
        assert part.info.bits_per_second == 500_000
        assert data
        assert {(frame.fd, frame.brs) for frame in data} == {(True, True)}


async def test_the_same_bus_carries_classic_packets() -> None:
    async with both_up(FD, FD_ON):
        await link_both_ways(FD, "", (1, 8, 27))
