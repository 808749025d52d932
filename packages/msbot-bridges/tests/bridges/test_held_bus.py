"""A simulated bus that is held: a node alone there is acknowledged, and the bus outlasts whoever opened it first."""

from __future__ import annotations

import asyncio
from uuid import uuid4

import pytest

import can
from msbot_bridges.canbus import held_bus, open_bus

FRAMES = 50
"""More than a controller has room for."""


def send(address: str, frames: int) -> None:
    with open_bus(address) as bus:
        for _ in range(frames):
            bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"x"), timeout=5)


async def test_a_node_alone_on_a_held_bus_is_acknowledged(caplog: pytest.LogCaptureFixture) -> None:
    address = f"msbot:{uuid4().hex[:12]}"
    async with held_bus(address):
        for _ in range(2):  # it goes, and another comes
            await asyncio.to_thread(send, address, FRAMES)
    assert not caplog.records


async def test_a_real_bus_is_left_alone() -> None:
    async with held_bus("socketcan:there_is_none0"):
        pass
