"""A device reports what no message has room for: that report is left out, and those beside it are told."""

from __future__ import annotations

import asyncio
import struct

import pytest

from msbot.part.messages.standard import Count, Text
from msbot_bridges.bridge.quantity import NUMBER, quantity, text_message
from msbot_bridges.bridge.thread import WorldThread
from msbot_bridges.modbus.points import ModbusPoint, PointUse, RegisterTable

pytest.importorskip("canopen")

from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.port_mappings import PortMapping


def test_a_number_without_room_is_no_message() -> None:
    assert NUMBER.made(1e39) is None
    assert quantity("bar").made(3e38) is None
    made = NUMBER.made(1e30)
    assert made is not None
    assert made.encode() == struct.pack("<f", 1e30)


def test_words_with_nul_are_said_without_it_and_long_ones_are_cut() -> None:
    text = text_message("a\0b" + "x" * 300)
    assert isinstance(text, Text)
    assert text.text == "a\N{REPLACEMENT CHARACTER}b" + "x" * 197
    assert text.encode()


def test_registers_with_too_great_a_number_are_no_message() -> None:
    point = ModbusPoint("total", PointUse.OUT, RegisterTable.INPUT, 0, "float64")
    words = [int.from_bytes(struct.pack(">d", 1e300)[at : at + 2], "big") for at in range(0, 8, 2)]
    assert point.message_of(point.read(words)) is None
    assert point.message_of(7.0) is not None


@pytest.mark.parametrize(("value", "message"), [(2**32 - 1, None), (2**31 - 1, Count(value=2**31 - 1))])
def test_a_count_of_a_device_on_canopen_beyond_a_messages_is_left_out(value: int, message: Count | None) -> None:
    assert PortMapping("counter", Entry(0x2000, 0, 32, signed=False), Count, "value").to_message(value) == message


async def test_what_others_have_reported_is_told_after_a_report_that_fails(caplog: pytest.LogCaptureFixture) -> None:
    told = asyncio.Event()

    def fail() -> None:
        raise ZeroDivisionError("of one device")

    thread = WorldThread("a world")
    thread.tell(fail)
    thread.tell(told.set)
    async with asyncio.timeout(60):
        await told.wait()
    assert "a world: ZeroDivisionError: of one device" in caplog.text
