"""One robot with a real agent and visitors on a wire, for tests in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from random import Random

from msbot.part import Client, ServiceNames
from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp import (
    PROFILE_TOPIC,
    PROFILE_TYPE,
    Inventory,
    InventoryService,
    Keys,
    MasterService,
    MemoryStore,
    PartState,
    Profile,
    RobotGate,
)
from msbot_agent.agent import Agent
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import MemorySpace
from msbot_xrce.messages import STREAM_BEST_EFFORT
from tests.pnp.robot import uid

INVENTORY = ServiceNames(
    pnp_messages.INVENTORY_SERVICE, pnp_messages.INVENTORY_REQUEST_TYPE, pnp_messages.INVENTORY_REPLY_TYPE
)
ORIGINAL = ServiceNames(thesis_messages.SERVICE, thesis_messages.REQUEST_TYPE, thesis_messages.REPLY_TYPE)


def epoch_ns() -> int:
    return 1_600_000_000_000_000_000


class Robot:
    """One robot: agent, master and inventory on the in-process link; parts come in by another one."""

    def __init__(
        self, store: MemoryStore, *, explain: bool = False, limit: int | None = None, keys: Keys | None = None
    ) -> None:
        loop = asyncio.get_running_loop()
        self.inventory = Inventory(store, random=Random(1), now=loop.time())
        self.access = RobotGate(self.inventory, clock=loop.time)
        self.agent = Agent(MemorySpace(), gate=self.access, epoch_ns=epoch_ns, agent_id=b"agent-id")
        self.inventory.on_rights(self.agent.recheck)
        self.inventory.on_superseded(partial(self.agent.disconnect, reason="its part came back from another address"))
        self.inventory.watch.use_agent(last_heard=self.agent.last_heard, probe=self.agent.probe)
        inside, self.outside = InprocHub(), InprocHub()
        self.outside.server.info = LinkInfo("wire", 65535)
        self.agent.add_link(inside.server)
        self.agent.add_link(self.outside.server)
        make_client = partial(Client, epoch_ns=epoch_ns)
        self.master = MasterService(partial(make_client, inside.connect(), key=1), Profile(), limit=limit)
        self.service = InventoryService(
            partial(make_client, inside.connect(), key=2), self.inventory, explain=explain, keys=keys
        )

    def state(self, key: int) -> PartState:
        return [part.state for part in self.inventory.view(0.0) if part.client_key == key][-1]


class Visitor:
    """A client on the wire that reads the profile, may ask the inventory, publishes as AA and hears one ring topic."""

    def __init__(self, robot: Robot, key: int, service: ServiceNames = INVENTORY, *, hears: str = "3_to_1") -> None:
        self.client = Client(
            robot.outside.connect(),
            key=key,
            epoch_ns=epoch_ns,
            on_topic=self._sample,
            on_reply=lambda _object, _request, payload: self.replies.append(payload),
        )
        self.profiles: list[tuple[float, pnp_messages.ProfileMessage]] = []
        self.heard: list[bytes] = []
        self.replies: list[bytes] = []
        client = self.client
        participant = client.create_participant()
        publisher, subscriber = client.create_publisher(participant), client.create_subscriber(participant)
        self.reader = client.create_reader(subscriber, client.create_topic(participant, PROFILE_TOPIC, PROFILE_TYPE))
        out = client.create_topic(participant, "HelloWorldTopic_1_to_2", "HelloWorld")
        self.writer = client.create_writer(publisher, out)
        into = client.create_topic(participant, f"HelloWorldTopic_{hears}", "HelloWorld")
        self.ring_reader = client.create_reader(subscriber, into)
        self.requester = client.create_requester(participant, service)
        for entity in (self.reader, self.ring_reader, self.requester):
            client.read(entity)

    def _sample(self, object_id: int, _request_id: int, payload: bytes) -> None:
        if object_id == self.reader.object_id:
            self.profiles.append((asyncio.get_running_loop().time(), pnp_messages.ProfileMessage.decode(payload)))
        else:
            self.heard.append(payload)

    async def ask(self, body: bytes, *, patience_s: float = 0.2) -> bytes | None:
        """Send one request; the reply, or None if there is none in time."""
        self.replies.clear()
        self.client.write(self.requester, body, stream_id=STREAM_BEST_EFFORT)
        await asyncio.sleep(patience_s)
        return self.replies[-1] if self.replies else None

    async def claim(self, number: str = "ABCD", serial: int = 1) -> pnp_messages.VerdictMessage | None:
        message = pnp_messages.ClaimMessage(part_number=number, local_name="", uid=uid(serial), session_nonce=1)
        await self.ask(message.encode())
        told = [pnp_messages.decode_reply(reply) for reply in self.replies]
        return next((one for one in reversed(told) if isinstance(one, pnp_messages.VerdictMessage)), None)

    def publish(self, payload: bytes) -> None:
        self.client.write(self.writer, payload)


async def with_robot(robot: Robot, *visitors: Visitor, play: Callable[[], Awaitable[None]]) -> None:
    """Run everybody until the play is over."""
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(robot.agent.run())]
        running += [tasks.create_task(service.run()) for service in (robot.service, robot.master)]
        await robot.service.until_ready()
        running += [tasks.create_task(visitor.client.run()) for visitor in visitors]
        for visitor in visitors:
            await visitor.client.connect(1.0)
            await visitor.client.until_all_statuses(1.0)
        await play()
        for task in running:
            task.cancel()
