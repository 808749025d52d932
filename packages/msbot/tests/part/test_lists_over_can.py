"""The largest message of a library type, 4,096 octets, from part to part over CAN and CAN FD, with disturbances."""

from __future__ import annotations

import asyncio
from random import Random
from typing import Annotated

import pytest

from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import Message, Part
from msbot.part.messages.wire_types import AtMost, float32
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import LossyLink
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBus, SimBusDriver

MOST = 1023
COUNT = 5


class Waves(Message):
    """A list as long as a library type may have it: 4 octets of its length, and 1,023 numbers."""

    values: Annotated[list[float32], AtMost(MOST)]


def waves(number: int) -> Waves:
    """No two messages, and no two places in one, are the same."""
    return Waves(values=[float(number * 2048 + place) for place in range(MOST)])


def send_over(bus: SimBus, drop: float, patience_s: float) -> list[Waves]:
    """What one part hears of five messages of another one."""
    heard: list[Waves] = []

    async def main() -> None:
        slots = (Slot("mouth", "MOUTH"), Slot("ear", "EAR"))
        store = MemoryStore(
            types=tuple(PartType(slot.part_number, slot.name) for slot in slots),
            slots=slots,
            configurations=tuple(
                Configuration(1, slot.name, (SlotBinding("waves", "waves", "Waves", publishes=slot.name == "mouth"),))
                for slot in slots
            ),
        )
        driver = SimBusDriver(bus)
        master = Master(Blueprint(RobotProfile("R", "1", "2", "3", "4"), slots), store, random=Random(3))
        profile_hash = master.profile.profile_hash()
        master.add_link(CanMasterLink(driver.attach("master"), profile_hash=profile_hash, random=Random(4)))
        mouth, ear = (Part(number, uid=number.encode().rjust(8, b"."), random=Random(5)) for number in ("MOUTH", "EAR"))
        ear.on("waves", Waves)(heard.append)
        told: list[int] = []

        @mouth.every(0.1)
        def speak() -> None:
            if ear.state.value == "active" and len(told) < COUNT and mouth.publish("waves", waves(len(told))):
                told.append(len(told))

        tasks = [asyncio.create_task(master.run())]
        for seed, part in enumerate((mouth, ear)):
            link = CanPartLink(driver.attach(part.part_number), uid=part.uid or b"", random=Random(8 + seed))
            tasks.append(
                asyncio.create_task(part.run_async(LossyLink(link, random=Random(seed), drop=drop), epoch_ns=lambda: 0))
            )
        async with asyncio.timeout(patience_s):
            while len(heard) < COUNT:  # noqa: ASYNC110 - time is virtual
                await asyncio.sleep(0.1)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main())
    return heard


@pytest.mark.promise("A message of 4,096 bytes arrives over CAN and CAN FD, whole and once, also when frames are lost")
@pytest.mark.parametrize(("drop", "bit_error_rate"), [(0.0, 0.0), (0.05, 2e-5)], ids=["clean", "disturbed"])
@pytest.mark.parametrize("fd", [False, True], ids=["classic", "fd"])
def test_the_largest_list_arrives_whole_and_in_order(fd: bool, drop: float, bit_error_rate: float) -> None:
    assert len(waves(0).encode()) == 4096
    bus = SimBus(500_000, 2_000_000 if fd else None, fd=fd, random=Random(7), bit_error_rate=bit_error_rate)
    assert send_over(bus, drop, 600.0) == [waves(number) for number in range(COUNT)]
