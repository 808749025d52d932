"""The set-up of one component on each bus, as the thesis tried it: CREATE_CLIENT, six objects by XML, all statuses OK.

The thesis allowed 1000 ms and needed 8 to 10 tries for the session; 4 of 6 statuses came (thesis 4.2.5.1).
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from random import Random

from bench.buses import BUSES, CODEC, Rates, bits, table
from msbot.part import Client, ClientSettings
from msbot.part.client.entities import Entity
from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent
from msbot_agent.link import Link
from msbot_agent.link.can import CanLegacyLink, CanMasterLink, CanPartLink
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.sim import SimBusDriver
from msbot_agent.link.can.sim.sim_bus_driver import SimCanBus
from msbot_agent.space import MemorySpace
from msbot_xrce import is_whole
from msbot_xrce.messages import CreateClient, Format, ObjectKind, ObjectVariant, decode_header, iter_submessages

KEY = 0xBA5EBA11
"""Client key of the thesis' firmware."""
THESIS, CLASSIC, COMPRESSED = "thesis' framing", "ours", "ours, compressed"

_TOPIC = "<topic><kind>NO_KEY</kind><name>rt/olimex/publisher</name><dataType>Point32_</dataType></topic>"
XML = {
    ObjectKind.PARTICIPANT: "<dds><participant><rtps><name>CAN2NODE</name></rtps></participant></dds>",
    ObjectKind.TOPIC: "<dds><topic><name>rt/olimex/publisher</name><dataType>Point32_</dataType></topic></dds>",
    ObjectKind.PUBLISHER: "",
    ObjectKind.SUBSCRIBER: "",
    ObjectKind.DATAREADER: f"<dds><data_reader>{_TOPIC}</data_reader></dds>",
    ObjectKind.DATAWRITER: f"<dds><data_writer>{_TOPIC}</data_writer></dds>",
}
_PARENTS = {ObjectKind.DATAWRITER: 0x0013, ObjectKind.DATAREADER: 0x0014}


@dataclass
class Component:
    """One component, its agent, and the bus between them."""

    driver: SimBusDriver
    agent: Agent
    client: Client
    link: Link
    master: SimCanBus
    """The master's controller."""
    part: SimCanBus
    logins: int = 0
    """CREATE_CLIENT that reached the agent."""

    def create(self) -> dict[ObjectKind, Entity]:
        """Ask for the thesis' six objects."""
        return {
            kind: self.client.create(
                ObjectVariant(kind, Format.XML, text, None, _PARENTS.get(kind, 0x0011), 0),
            )
            for kind, text in XML.items()
        }


@asynccontextmanager
async def component(rates: Rates, framing: str, **callbacks: Callable[..., None]) -> AsyncIterator[Component]:
    """An agent on a bus and a component that is switched on in this moment, with the callbacks of its client."""
    driver = SimBusDriver(rates.bus())
    driver.attach("monitor")
    master, part = driver.attach("master"), driver.attach("component")
    agent = Agent(MemorySpace(), epoch_ns=lambda: 0, agent_id=bytes(8))
    if framing == THESIS:
        agent.add_link(CanLegacyLink(master, is_whole=is_whole))
        link: Link = CanLegacyLink(part, is_whole=is_whole, component=True)
        client = Client(
            link,
            key=KEY,
            settings=ClientSettings(mtu=4092),
            epoch_ns=lambda: 0,
            random=Random(1),
            **callbacks,
        )
    else:
        codec = CODEC if framing == COMPRESSED else None
        agent.add_link(CanMasterLink(master, profile_hash=1, random=Random(1), fd=rates.fd, codec=codec))
        link = CanPartLink(part, uid=bytes(range(1, 9)), random=Random(2), codec=codec)
        client = Client(link, key=KEY, epoch_ns=lambda: 0, random=Random(3), **callbacks)  # type: ignore[arg-type]  # as above
    room = Component(driver, agent, client, link, master, part)

    def seen(_now: float, way: str, _peer: object, packet: bytes) -> None:
        header = decode_header(packet)
        if way == "out":
            room.logins += any(isinstance(one, CreateClient) for one in iter_submessages(packet, header.size))

    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(agent.run())]
        await asyncio.sleep(2.1)
        link.tap = seen
        running.append(tasks.create_task(client.run()))
        yield room
        for task in running:
            task.cancel()


@dataclass(frozen=True)
class SetUp:
    """How a set-up went."""

    seconds: float
    frames: int
    bits: int
    logins: int
    statuses: int
    """Objects that the agent says it has created."""


async def set_up(rates: Rates, framing: str) -> SetUp:
    """Set a component up, from power-up to the last status."""
    loop = asyncio.get_running_loop()
    frames: list[Frame] = []
    async with component(rates, framing) as room:
        room.driver.tap = lambda _at, _name, frame: frames.append(frame)
        start = loop.time()
        made = room.create()
        await room.client.connect()
        await room.client.until_all_statuses(timeout_s=10.0)
        took = loop.time() - start
        statuses = sum(entity.created for entity in made.values())
    cost = bits(frames)
    return SetUp(took, len(frames), cost.nominal_bits + cost.data_bits, room.logins, statuses)


def set_up_table() -> list[str]:
    """The set-up on each bus, in each framing."""
    rows = []
    for rates in BUSES:
        row = [rates.name]
        for framing in (THESIS, CLASSIC, COMPRESSED):
            if framing == THESIS and rates.fd:
                row.append("–")
                continue
            done = run_virtual(set_up(rates, framing))
            row.append(
                f"{done.seconds * 1000:.1f} ms, {done.frames} frames, {done.bits} bits, "
                f"{done.statuses} of {len(XML)} OK, {done.logins} try"
            )
        rows.append(row)
    return table(["bus", THESIS, CLASSIC, COMPRESSED], rows)
