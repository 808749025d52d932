"""Frames of any content on a bus end no bridge, and a device is found beside them."""

from __future__ import annotations

import asyncio
from random import Random
from uuid import uuid4

import pytest

from msbot_bridges.bridge import BridgeLink, worlds
from msbot_bridges.canbus import open_bus
from tests.bridges.hosts import running

pytest.importorskip("canopen")
pytest.importorskip("dronecan")
pytest.importorskip("pycyphal")

import can

FRAMES = 1500
DEVICES = {"canopen": "io", "dronecan": "servo", "cyphal": "range"}


def garbage(random: Random, *, is_extended: bool) -> can.Message:
    """A frame as a node with a fault, or an enemy, might send it; few identifiers, so that transfers meet."""
    if not is_extended:  # of three node ids: each that is heard is asked who it is
        number = random.choice((0x080, 0x180, 0x280, 0x580, 0x700)) + random.randint(1, 3)
    else:
        number = random.getrandbits(29) if random.random() < 0.3 else random.choice((0x1001557, 0x1E0180, 0x107D55FF))
    data = random.randbytes(random.randint(0, 8))
    return can.Message(arbitration_id=number, data=data, is_extended_id=is_extended)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("world", DEVICES)
@pytest.mark.promise("Frames of any content on a CAN bus end no bridge")
async def test_a_bridge_goes_on(world: str) -> None:
    kind = worlds()[world]
    link = BridgeLink(f"msbot:{uuid4().hex[:12]}")
    random = Random(world)

    def send() -> None:
        with open_bus(link.address) as bus:
            for _ in range(FRAMES):
                bus.send(garbage(random, is_extended=world != "canopen"), timeout=10)

    async with running(kind.open(link)) as host:
        await asyncio.to_thread(send)
        device = asyncio.create_task(kind.simulated[DEVICES[world]](link, {}).run())
        number = ""
        while "sim" not in number.lower():
            number = (await host.devices.get()).identity.part_number
        device.cancel()
        await asyncio.wait([device])
