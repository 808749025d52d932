"""Reliable streams on a CAN bus with faults: when it has healed, every sample has arrived once and in order."""

from __future__ import annotations

import asyncio
from random import Random

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bench.buses import Rates
from bench.can_setup import CLASSIC, COMPRESSED, Component, component
from msbot.part import ConnectionState
from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.sim import SimBus
from msbot_xrce.errors import LinkFull
from msbot_xrce.objects import EndpointQos
from tests.effort import tries

SAMPLES = 40
QOS = EndpointQos(reliable=True, depth=SAMPLES)
"""The reader keeps them all: with less the oldest would give way while the bus is busy, as they should."""

trouble = st.lists(
    st.tuples(
        st.sampled_from(("bit errors", "loss at the master", "loss at the part", "burst", "pull", "calm")),
        st.integers(1, 63),
    ),
    min_size=1,
    max_size=6,
)


class ShakyRates(Rates):
    """A bus that can be disturbed at random."""

    def bus(self) -> SimBus:
        return SimBus(self.nominal, data_bitrate=self.data, fd=self.fd, random=Random(5))


async def suffer(room: Component, what: str, amount: int) -> None:
    bus = room.driver.bus
    part = room.part.node
    match what:
        case "bit errors":
            bus.set_bit_error_rate(amount * 5e-6)
        case "loss at the master":
            bus.deafen(room.master.node, probability=amount / 300)
        case "loss at the part":
            bus.deafen(part, probability=amount / 300)
        case "burst":
            bus.deafen(room.master.node, frames=amount)
        case "pull":
            room.driver.unplug("component")
            await asyncio.sleep(amount / 63)
            room.driver.plug("component")
    await asyncio.sleep(0.5)
    bus.set_bit_error_rate(0)
    for node in (room.master.node, part):
        bus.deafen(node)


@settings(max_examples=tries(12, 2000))
@given(trouble, st.sampled_from((CLASSIC, COMPRESSED)), st.integers(0, 1 << 30))
def test_every_sample_arrives_once_and_in_order(story: list[tuple[str, int]], framing: str, seed: int) -> None:
    random = Random(seed)
    samples = [
        number.to_bytes(2, "big") + random.randbytes(random.choice((0, 2, 9, 60, 400))) for number in range(SAMPLES)
    ]

    async def scene() -> tuple[list[bytes], int, list[str]]:
        came: list[bytes] = []
        lost: list[str] = []
        roomy = asyncio.Event()

        def take(_object_id: int, _request_id: int, payload: bytes) -> None:
            came.append(payload)

        def hear(state: ConnectionState, reason: str) -> None:
            if state is ConnectionState.LOST:
                lost.append(reason)
                roomy.set()

        rates = ShakyRates(500_000)
        async with component(rates, framing, on_topic=take, on_room=roomy.set, on_state=hear) as room:
            client = room.client
            participant = client.create_participant()
            topic = client.create_topic(participant, "echo", "Echo")
            writer = client.create_writer(client.create_publisher(participant), topic, QOS)
            reader = client.create_reader(client.create_subscriber(participant), topic, QOS)
            client.read(reader)
            await client.until_all_statuses(timeout_s=5.0)

            async def write() -> None:
                left = list(samples)
                while left and not lost:
                    roomy.clear()
                    try:
                        client.write(writer, left[0])
                        del left[0]
                    except LinkFull:
                        await roomy.wait()
                    await asyncio.sleep(random.choice((0.0, 0.02, 0.1)))

            writing = asyncio.create_task(write())
            for what, amount in story:
                await suffer(room, what, amount)
            await writing
            await asyncio.sleep(20.0)
            logins = client.counters.logins
        return came, logins, lost[:1]

    came, logins, lost = run_virtual(scene())
    # Three beacons in a row are rarely lost, but then the part has to give up: another story.
    assume(lost != ["no beacon of the master for 3.5 s"])
    assert (came, logins) == (samples, 1), lost
