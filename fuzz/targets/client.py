"""Our client against any octets that claim to come from an agent, and a user who does things meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable
from random import Random

from fuzz import grammar
from fuzz.bounds import check_session, hold
from fuzz.case import Case, Step, Violation
from fuzz.corpus import packets
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, read_logs, the_loop
from msbot.part import Client, ClientSettings, ConnectionState, Entity, ServiceNames
from msbot_agent.agent import Agent
from msbot_agent.link import Signal
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import LinkFull, LocalProtocolError, RequestError
from msbot_xrce.messages import Acknack, Data, Header, StatusAgent, StatusReply, SubmessageId
from tests.agent.wiring import FakeLink, serving

AGENT = "agent"
KEY = 7
MOST_SENT = 3000
"""Packets that the client may send for one step."""
HEALED_S = 30.0
"""Seconds of an honest agent after which everything must be well again."""
SESSIONS = (0x81, 1)


class ClientWorld:
    """A client, a link, somebody on the other side who answers what he likes, and in the end an honest agent."""

    def __init__(self, random: Random) -> None:
        self.link = FakeLink("fake:", mtu=512)
        self.link.remote = AGENT
        self.session_id = random.choice(SESSIONS)
        self.client = Client(
            self.link,
            key=KEY,
            settings=ClientSettings(session_id=self.session_id),
            epoch_ns=lambda: 1_700_000_000_000_000_000,
            random=Random(1),
            on_state=lambda state, reason: self.seen.add(f"{state.value}: {reason[:50]}"),
            on_topic=lambda _object, _request, payload: self.samples.append(payload),
        )
        self.samples: list[bytes] = []
        self.seen: set[str] = set()
        self.tasks: list[asyncio.Task[None]] = []
        self._more: list[Entity] = []
        self._next: dict[int, int] = {}
        client = self.client
        participant = client.create_participant("fuzz")
        topic = client.create_topic(participant, "light", "T")
        self.writer = client.create_writer(client.create_publisher(participant), topic)
        self.reader = client.create_reader(client.create_subscriber(participant), topic)
        service = ServiceNames("add", "Q", "A")
        self.requester = client.create_requester(participant, service)
        self.replier = client.create_replier(participant, service)
        self.participant = participant
        for entity in (self.reader, self.requester, self.replier):
            client.read(entity)

    # The other side.

    def do(self, step: Step) -> None:
        """One step of the other side, or of the user."""
        before = len(self.link.sent)
        match step.verb:
            case "packet":
                self.link.inject(step.data, AGENT)
            case "stream":
                self._in_stream(step.data, step.whole(0, 0x80))
            case "answer":
                self._answer(step.whole(0) & 0xFF)
            case "data":
                self._data(step)
            case "room":
                self.link.make_room(step.whole(0) if step.whole(0) >= 0 else None)
            case "signal":
                self.link.signal(tuple(Signal)[step.whole(0) % len(Signal)], None, "fuzz")
            case _:
                self._use(step)
        if len(self.link.sent) - before > MOST_SENT:
            raise Violation(f"more than {MOST_SENT} packets for one step {step.verb}")

    def _header(self, stream_id: int) -> bytes:
        number = 0
        if stream_id:
            number = self._next.get(stream_id, 0)
            self._next[stream_id] = (number + 1) & 0xFFFF
        session_id = self.client._connection.session.session_id
        return Header(session_id, stream_id & 0xFF, number, KEY).encode()

    def _in_stream(self, body: bytes, stream_id: int) -> None:
        self.link.inject(self._header(stream_id & 0xFF) + body, AGENT)

    def _answer(self, status: int) -> None:
        """Answer what the client has asked since the last time, as an agent would."""
        asked, self.link.sent = self.link.sent, []
        for _, packet in asked:
            at = 4 if packet[0] >= 0x80 else 8
            kind = packet[at]
            if kind == SubmessageId.CREATE_CLIENT:
                self._next.clear()
                self._in_stream(StatusAgent(status).encode(), 0)
            elif kind in (SubmessageId.CREATE, SubmessageId.DELETE):
                ids = int.from_bytes(packet[at + 4 : at + 6], "big"), int.from_bytes(packet[at + 6 : at + 8], "big")
                self._in_stream(StatusReply(*ids, status).encode(), 0x80 if packet[1] else 0)
            if packet[1] >= 0x80:
                first = ((packet[2] | packet[3] << 8) + 1) & 0xFFFF
                self._in_stream(Acknack(first, 0, packet[1]).encode(), 0)

    def _data(self, step: Step) -> None:
        entities = (self.reader, self.requester, self.replier, self.writer)
        entity = entities[step.whole(0) % len(entities)]
        request_id = entity.reading.request_id if entity.reading is not None else 10
        self._in_stream(Data(request_id, entity.object_id, step.data).encode(), step.whole(1, 0x80))

    # The user.

    def _use(self, step: Step) -> None:
        client = self.client
        stream = (0x80, 0x01, 0x81, 0x00)[step.whole(0) % 4]
        try:
            match step.verb:
                case "write":
                    client.write(self.writer, step.data, stream_id=stream)
                case "request":
                    client.write(self.requester, step.data, stream_id=stream)
                case "reply":
                    client.reply(self.replier, bytes(24), step.data, stream_id=stream)
                case "create":
                    if len(self._more) < 40:
                        self._more.append(client.create_topic(self.participant, f"t{len(self._more)}", "T"))
                case "delete" if self._more:
                    client.delete(self._more.pop())
                case "read":
                    client.read(self.reader, stream_id=stream)
                case "ping":
                    self.tasks.append(asyncio.create_task(self._later(client.ping(0.3))))
                case "sync":
                    self.tasks.append(asyncio.create_task(self._later(client.sync_time(0.3))))
                case "check":
                    client.check_agent()
                case "reconnect":
                    client.reconnect("fuzz")
        except (LinkFull, LocalProtocolError) as error:
            self.seen.add(f"{type(error).__name__}: {str(error)[:30]}")

    async def _later(self, what: Coroutine[object, object, object]) -> None:
        try:
            await what
        except (RequestError, LocalProtocolError) as error:
            self.seen.add(str(error)[:40])

    # What must hold.

    def check(self) -> None:
        """Nothing was raised in a call-back, and every queue is bounded."""
        the_loop().check()
        session = self.client._connection.session
        check_session(session, statuses=session._settings.backlog)
        hold("unanswered creations", len(self.client._entities._asked), 12)

    def look(self) -> None:
        """Note what is to be seen."""
        session = self.client._connection.session
        self.seen.update(f"session: {reason}" for reason in session.dropped)
        self.seen.add(f"state: {self.client.state} {session.state}")
        self.seen.update(f"status: {entity.status}" for entity in self.client.entities)
        self.seen.update(f"sent {packet[4:6].hex()}" for _, packet in self.link.sent)

    async def heal(self) -> None:
        """From now on there is an honest agent; after a while everything must be there and work.

        Raises:
            Violation: it does not.
        """
        self.link.make_room(None)
        far = FakeLink("far:", mtu=512)
        agent = Agent(MemorySpace(), epoch_ns=lambda: 0)
        loop = asyncio.get_running_loop()
        async with serving(agent, far):
            far.plug(KEY, lambda packet: self.link.inject(packet, AGENT))
            self.link.plug(AGENT, lambda packet: far.inject(packet, KEY))
            for signal in (Signal.LINK_UP, Signal.PEER_JOINED):
                self.link.signal(signal, None, "healed")
            begun = loop.time()
            await asyncio.sleep(HEALED_S)
            client = self.client
            if client.state is not ConnectionState.CONNECTED:
                raise Violation(f"{HEALED_S} s after healing the client is {client.state}: {client.reason}")
            missing = [entity.describe for entity in client.entities if not entity.created]
            if missing:
                raise Violation(f"{loop.time() - begun} s after healing these do not exist: {missing}")
            self.samples.clear()
            written = [bytes([number]) * 40 for number in range(6)]
            for payload in written:
                client.write(self.writer, payload)
                await asyncio.sleep(0.3)
            if self.samples != written:
                raise Violation(f"{len(written)} samples written after healing, {len(self.samples)} came")
            self.check()
            await client.close()


class ClientTarget:
    """See the module's docstring."""

    name = "client"
    about = "a whole client: nothing raises, memory is bounded, with an honest agent all is well again"

    def make(self, random: Random) -> Case:
        """An agent that is mostly right, with noise between."""
        steps = [Step("answer", b"", (0,)) for _ in range(random.choice((0, 1, 2, 3, 4)))]
        for _ in range(random.randrange(25)):
            steps.append(_step(random))
        for _ in range(random.choice((0, 0, 0, 1, 2))):
            steps.insert(random.randrange(len(steps) + 1), _step(random))
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Attack a client."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            world = ClientWorld(Random(len(case)))
            running = asyncio.create_task(world.client.run())
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            for step in case:
                if step.verb == "wait":
                    await asyncio.sleep(min(abs(step.number(0)), 5.0))
                else:
                    world.do(step)
                    await asyncio.sleep(0)
                world.check()
                if running.done():
                    running.result()
                    raise Violation("the client has ended by itself")
            world.look()
            await world.heal()
            await running
            await asyncio.gather(*world.tasks)
            return world.seen

        return play(main()) | reader.take()


def _step(random: Random) -> Step:
    stream = random.choice((0x80, 0x80, 0x80, 0x01, 0x00, 0x81))
    match random.randrange(22):
        case 0 | 1 | 2:
            return Step("answer", b"", (random.choice(grammar.STATUSES),))
        case 3 | 4 | 5:
            return Step("data", grammar.payload(random), (random.randrange(4), stream))
        case 6 | 7:
            corpus = packets(of_clients=False)
            packet = random.choice(corpus)
            return Step("packet", mutate_octets(random, packet, corpus) if random.random() < 0.7 else packet)
        case 8:
            return Step("packet", random.randbytes(random.choice((0, 1, 3, 4, 8, 12, 50))))
        case 9:
            return Step("wait", b"", (random.choice((0.0, 0.01, 0.1, 0.5, 1.0, 2.5, 5.0)),))
        case 10:
            return Step("room", b"", (random.choice((0, 1, 5, -1, -1)),))
        case 11:
            return Step("signal", b"", (random.randrange(len(Signal)),))
        case 12:
            return Step(
                random.choice(("ping", "sync", "check", "reconnect", "create", "delete", "read")),
                b"",
                (random.randrange(4),),
            )
        case 13 | 14:
            size = random.choice((0, 4, 40, 40, 600, 3000))
            return Step(
                random.choice(("write", "write", "request", "reply")),
                random.randbytes(size),
                (random.choice((0, 0, 0, 1, 2, 3)),),
            )
        case 15:
            session_id = random.choice((0x80, 0x81, 0x82, 0x00, 0x01, 0x02, 0xFF))
            header = Header(session_id, random.choice(grammar.STREAMS), random.choice((0, 1, 2, 16, 0x8000)), KEY)
            return Step("packet", grammar.message(random, header, [grammar.from_agent(random)], wrong=0.3))
    said = [grammar.from_agent(random) for _ in range(random.choice((1, 1, 2, 4)))]
    outside = Header(0x80)
    body = grammar.message(random, outside, said, wrong=0.15)[outside.size :]
    return Step("stream", body, (stream,))
