"""A whole agent under attack, with honest clients that must not notice."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from random import Random

from fuzz.bounds import check_agent
from fuzz.case import Step, Violation
from fuzz.virtual import the_loop
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, OpenGate
from msbot_agent.link import Peer, Signal
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientState, References
from msbot_xrce.messages import STREAM_RELIABLE, Acknack, Header, SubmessageId, encode_message
from msbot_xrce.objects import EndpointQos
from msbot_xrce.sessions import Pong
from tests.agent.wiring import FakeLink, WiredClient, serving

PEERS = 6
"""Addresses of the attackers; the last two are on a slow link."""
KEYS = (1, 2, 3, 0xAABBCCDD)
"""Client keys of the attackers; fewer than peers, so that they take over each other's sessions."""
SLOW_FROM = 4
SETTINGS = AgentSettings(
    heartbeat_s=0.2,
    dead_after_s=3.0,
    max_clients=8,
    max_objects=12,
    max_objects_in_all=40,
    max_message=6000,
    max_held_in_all=10_000,
    max_unacked_in_all=8_000,
    max_burst=24,
    max_requests=4,
    max_topics=10,
    default_depth=3,
    max_depth=6,
)
"""Small limits, so that they are met."""
REFERENCES = References.parse(
    '<profiles><participant profile_name="p"><rtps><name>n</name></rtps></participant>'
    '<topic profile_name="light"><name>light</name><dataType>T</dataType></topic></profiles>',
    "fuzz",
)
HONEST = "a topic of honest clients"
MOST_ANSWERS = 3000
"""Packets that the agent may send for one step of an attacker."""


class MoodyGate(OpenGate):
    """Bars topics and clients as it is told."""

    def __init__(self) -> None:
        self.barred: set[str] = set()
        self.closed = False

    def may_join(self, client: ClientInfo) -> bool:
        return not self.closed or client.key not in KEYS

    def may_write(self, client: ClientInfo, topic: str) -> bool:  # noqa: ARG002 - the protocol's signature
        return topic not in self.barred

    def may_read(self, client: ClientInfo, topic: str) -> bool:  # noqa: ARG002
        return topic not in self.barred


class BurstyLink(FakeLink):
    """A fake link that receives its packets in bursts, as sockets do: the agent answers at the end of each."""

    def __init__(self, name: str) -> None:
        super().__init__(name, in_bursts=True)
        self.burst = 0
        """Packets that the burst still has."""

    def inject(self, packet: bytes, peer: Peer = "client") -> None:
        """A packet arrives, as the last of its burst or not."""
        super().inject(packet, peer)
        self.burst -= 1
        if self.burst <= 0:
            self._burst_end_handler()

    def end_burst(self) -> None:
        """Whatever burst goes on ends."""
        self.burst = 0
        self._burst_end_handler()


class AgentWorld:
    """The agent, its links, the attackers' side of the wire, and two honest clients."""

    def __init__(self, random: Random) -> None:
        self.gate = MoodyGate()
        self.space = MemorySpace()
        references = REFERENCES if random.random() < 0.3 else None
        self.agent = Agent(
            self.space,
            gate=self.gate,
            settings=SETTINGS,
            references=references,
            epoch_ns=lambda: 1_700_000_000_000_000_000,
            agent_id=b"agent-id",
        )
        self.fast = BurstyLink("fast:")
        self.slow = FakeLink("slow:", mtu=128, bits_per_second=125_000)
        self.seen: set[str] = set()
        self._next: dict[tuple[int, int], int] = defaultdict(int)
        self._heard: dict[int, list[bytes]] = defaultdict(list)
        for peer in range(PEERS):
            self._link(peer).plug(peer, self._heard[peer].append)

    # What a case does.

    def do(self, step: Step) -> None:
        """One step of the attack."""
        peer = abs(step.whole(0)) % PEERS
        before = len(self.fast.sent) + len(self.slow.sent)
        match step.verb:
            case "packet":
                self._send(step.data, peer, numbered=bool(step.whole(1)))
            case "ack":
                self._acknowledge(peer, step.whole(1))
            case "reply":
                self._reply(peer, step.data)
            case "burst":
                self.fast.burst = abs(step.whole(0)) % 20
            case "room":
                self.slow.make_room(step.whole(0) if step.whole(0) >= 0 else None)
            case "signal":
                signal = Signal.PEER_GONE if step.whole(1) else Signal.PEER_BACK
                self._link(peer).signal(signal, peer, "fuzz")
            case "gate":
                self._change_gate(step.whole(0))
            case "kick":
                for view in self.agent.clients():
                    if view.key == KEYS[peer % len(KEYS)]:
                        self.agent.disconnect(view.key, "fuzz")
        if len(self.fast.sent) + len(self.slow.sent) - before > MOST_ANSWERS:
            raise Violation(f"more than {MOST_ANSWERS} packets for one step {step.verb}")

    def _send(self, packet: bytes, peer: int, *, numbered: bool) -> None:
        if numbered and len(packet) >= 4 and packet[1]:
            number = self._next[peer, packet[1]]
            self._next[peer, packet[1]] = (number + 1) & 0xFFFF
            packet = packet[:2] + number.to_bytes(2, "little") + packet[4:]
        elif len(packet) > 8 and packet[1] == 0 and 0 in (packet[4], packet[8]):
            for key in [key for key in self._next if key[0] == peer]:
                del self._next[key]
        self._link(peer).inject(packet, peer)

    def _acknowledge(self, peer: int, bitmap: int) -> None:
        newest: dict[int, tuple[bytes, int]] = {}
        for packet in self._heard[peer]:
            if len(packet) >= 4 and packet[1] >= STREAM_RELIABLE:
                newest[packet[1]] = packet[:1] + packet[4:8], packet[2] | packet[3] << 8
        for stream, (origin, number) in newest.items():
            key = int.from_bytes(origin[1:5], "big") if origin[0] < 0x80 else None
            first = (number + 1 - (2 if bitmap else 0)) & 0xFFFF
            report = Acknack(first, bitmap & 0xFFFF, stream)
            self._link(peer).inject(encode_message(Header(origin[0], client_key=key), [report], pad_end=False), peer)
        if not bitmap:
            self._heard[peer].clear()

    def _reply(self, peer: int, body: bytes) -> None:
        """Answer the last request that a replier of that peer got."""
        for packet in reversed(self._heard[peer]):
            at = 4 if packet[0] >= 0x80 else 8
            if len(packet) >= at + 32 and packet[at] == 0x09 and packet[at + 7] & 0xF == 8:
                contents = b"\0\x0a" + packet[at + 6 : at + 32] + body
                write = b"\x07\x01" + (len(contents) & 0xFFFF).to_bytes(2, "little") + contents
                self._send(packet[:1] + b"\x80\0\0" + packet[4:at] + write, peer, numbered=True)
                return

    def _change_gate(self, number: int) -> None:
        from fuzz.grammar import TOPICS

        self.gate.closed = number % 7 == 0
        self.gate.barred = {topic for bit, topic in enumerate(TOPICS) if number >> bit & 1}
        for view in self.agent.clients():
            self.agent.recheck(view.key)

    def _link(self, peer: int) -> FakeLink:
        return self.slow if peer >= SLOW_FROM else self.fast

    # What must hold.

    def settle(self) -> None:
        """Whatever burst goes on ends."""
        self.fast.end_burst()

    def check(self) -> None:
        """Nothing was raised in a call-back, and nothing has grown beyond its limit."""
        the_loop().check()
        check_agent(self.agent, SETTINGS)

    def look(self) -> None:
        """Note what is to be seen."""
        for link in (self.fast, self.slow):
            self.seen.update(f"sent {_kind(packet)}" for peer, packet in link.sent if isinstance(peer, int))
            link.sent.clear()
        self.seen.update(f"port: {reason}" for reason in self.agent.dropped())
        for view in self.agent.clients():
            self.seen.update(f"client: {reason}" for reason in view.dropped)
            self.seen.update(f"object: {thing.kind} {thing.attached}" for thing in view.objects)
            self.seen.add(f"refused: {bool(view.refused)}, gone: {view.gone}, waits: {bool(view.waiting)}")

    async def heal(self) -> None:
        """The attackers fall silent; whoever is left is thrown out."""
        self.gate.closed = False
        self.gate.barred = set()
        self.slow.make_room(None)
        await asyncio.sleep(10.0)
        self.check()
        for key in KEYS:
            self.agent.disconnect(key, "end of the case")

    def check_empty(self) -> None:
        """Nobody is there any more, so nothing may be left of anybody."""
        self.check()
        left = [view.key for view in self.agent.clients()]
        if len(left) > len(Honest.KEYS):
            raise Violation(f"these clients should be gone: {left}")


def _kind(packet: bytes) -> str:
    at = 4 if packet[0] >= 0x80 else 8
    match packet[at]:
        case SubmessageId.STATUS | SubmessageId.STATUS_AGENT:
            more = f"{packet[at + 8 if packet[at] == SubmessageId.STATUS else at + 4]:02x}"
        case SubmessageId.DATA:
            more = f"kind {packet[at + 7] & 0xF}, {len(packet).bit_length()} bits"
        case SubmessageId.ACKNACK:
            more = f"missing {(packet[at + 6] << 8 | packet[at + 7]).bit_count()}"
        case _:
            more = ""
    return f"{packet[:2].hex()} {packet[at : at + 2].hex()} {more}"


class Honest:
    """Two honest clients, one of which writes to the other."""

    KEYS = (0xF00D0001, 0xF00D0002)

    def __init__(self, link: FakeLink) -> None:
        self.writer = WiredClient(link, key=self.KEYS[0], peer="honest writer")
        self.reader = WiredClient(link, key=self.KEYS[1], peer="honest reader")
        self._count = 0
        self._ids = (0, 0)

    async def join(self) -> None:
        """Open the sessions, make the objects."""
        for client in (self.writer, self.reader):
            await client.connect()
        keep_all = EndpointQos(keep_all=True)
        self._ids = (
            await self.writer.add_writer(HONEST, qos=keep_all),
            await self.reader.add_reader(HONEST, qos=keep_all),
        )

    async def talk(self) -> None:
        """Three samples go from one to the other.

        Raises:
            Violation: they do not all arrive, once and in order.
        """
        sent = []
        for _ in range(3):
            self._count += 1
            sent.append(self._count.to_bytes(4, "big"))
            await self.writer.write(self._ids[0], sent[-1])
        heard = self.reader.received(self._ids[1])
        if heard != sent:
            raise Violation(f"honest clients: {len(sent)} samples written, {len(heard)} came")

    async def ping(self) -> None:
        """The agent answers, and knows its client."""
        self.writer.session.ping(asyncio.get_running_loop().time())
        await self.writer.settle()
        pongs = [pong for pong in self.writer.take(Pong) if isinstance(pong, Pong)]
        if [pong.agent_knows_us for pong in pongs] != [True]:
            raise Violation(f"honest client: pinged, got {pongs}")

    async def leave(self) -> None:
        """Delete the sessions."""
        for client in (self.writer, self.reader):
            client.session.close(asyncio.get_running_loop().time())
            await client.settle()
            if client.session.state is not ClientState.CLOSED:
                raise Violation(f"honest client: session is {client.session.state} after its deletion")


async def attack(world: AgentWorld, case: tuple[Step, ...]) -> set[str]:
    """Run a case against a world; raises when something is not as it must be."""
    async with serving(world.agent, world.fast, world.slow):
        bystander = Honest(world.fast)
        await bystander.join()
        for number, step in enumerate(case):
            if step.verb == "wait":
                world.settle()
                await asyncio.sleep(min(abs(step.number(0)), 5.0))
            else:
                world.do(step)
                await asyncio.sleep(0)
            the_loop().check()
            if number % 16 == 15:
                world.settle()
                world.check()
                world.look()
                await bystander.talk()
        world.settle()
        world.check()
        world.look()
        await bystander.talk()
        await bystander.ping()
        await world.heal()
        await bystander.talk()
        await bystander.leave()
        await fresh(world)
        world.check_empty()
    return world.seen


async def fresh(world: AgentWorld) -> None:
    """New honest clients on both links are served from beginning to end."""
    for link in (world.fast, world.slow):
        newcomers = Honest(link)
        await newcomers.join()
        await newcomers.talk()
        await newcomers.ping()
        await newcomers.leave()
    if world.space._meetings:
        raise Violation(f"left in the space: {list(world.space._meetings)}")
