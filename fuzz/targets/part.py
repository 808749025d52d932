"""A whole part against a master that talks nonsense: profiles, verdicts, beats, configurations and samples."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from random import Random
from typing import assert_never

from fuzz.bounds import hold
from fuzz.case import Case, Step, Violation
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, read_logs, the_loop
from msbot.part import Client, Entity, HelloWorld, JoinState, Message, Part, ServiceNames
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.part.join.pnp_messages import (
    INVENTORY_REPLY_TYPE,
    INVENTORY_REQUEST_TYPE,
    INVENTORY_SERVICE,
    MOST_BINDINGS,
    NO_BINDING,
    PROFILE_TOPIC,
    PROFILE_TYPE,
    Beat,
    BeatReply,
    Challenge,
    ClaimMessage,
    ConfigurationMessage,
    ConfigurationRequest,
    DescriptionMessage,
    NatureMessage,
    Notice,
    NoticeKind,
    PortBinding,
    ProfileMessage,
    Proof,
    SealedChallenge,
    SealedProof,
    Setting,
    StoppedBeat,
    TypeMessage,
    VerdictMessage,
    decode_request,
)
from msbot.part.messages.wire_types import uint32
from msbot_agent.agent import Agent
from msbot_agent.link import InprocHub
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import ConfigError, LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT
from msbot_xrce.objects import EndpointQos

TURNS = 2_000_000
"""A master may ask for a beat every few milliseconds."""
HEALED_S = 30.0
HONEST_VERSION = 12345
MOST_OBJECTS = 2 * MOST_BINDINGS + 10
"""Objects that a configuration can make a part create."""

_PROFILE = ProfileMessage(index=1, message="MSBOT_MASTER", name="MSBOT_V1", id="X", dof="8-4-2021", make="M")


def _configuration(version: int = 1, *, out: str = "one", into: str = "two") -> ConfigurationMessage:
    bindings = [
        PortBinding(port="out", topic=out, topic_type="HelloWorld", direction=0, reliable=1),
        PortBinding(port="in", topic=into, topic_type="HelloWorld", direction=1, reliable=1),
    ]
    settings = [Setting(name="period_s", value="1.0"), Setting(name="in.safe.message", value="safe")]
    return ConfigurationMessage(version=version, slot="AA", bindings=bindings, settings=settings)


class Boundless(Message):
    """A configuration without the limits that an honest master keeps."""

    version: uint32
    slot: str
    bindings: list[PortBinding]
    settings: list[Setting]


class PartWorld:
    """A part, an honest agent, and a client that plays master and inventory."""

    def __init__(self) -> None:
        hub = InprocHub()
        self.agent = Agent(MemorySpace(), epoch_ns=lambda: 0)
        self.agent.add_link(hub.server)
        self.master = Client(hub.connect(), key=1, epoch_ns=lambda: 0, on_request=self._request)
        self.part_link = hub.connect()
        self.part = Part("ABCD", robot="MSBOT_MASTER", uid=b"12345678", random=Random(1))
        self.heard: list[str] = []
        self.seen: set[str] = set()
        self.is_honest = False
        self._requests: list[tuple[bytes, bytes]] = []
        master = self.master
        participant = master.create_participant()
        publisher = master.create_publisher(participant)
        profile = master.create_topic(participant, PROFILE_TOPIC, PROFILE_TYPE)
        self.profile = master.create_writer(publisher, profile, EndpointQos(transient_local=True, depth=1))
        self.samples, self.honest_samples = (
            master.create_writer(publisher, master.create_topic(participant, name, "HelloWorld"))
            for name in ("two", "honest two")
        )
        service = ServiceNames(INVENTORY_SERVICE, INVENTORY_REQUEST_TYPE, INVENTORY_REPLY_TYPE)
        self.replier = master.create_replier(participant, service)
        master.read(self.replier, stream_id=STREAM_BEST_EFFORT)
        self._make_part()

    def _make_part(self) -> None:
        part = self.part

        @part.every(0.5)
        def publish() -> None:
            try:
                part.publish("out", HelloWorld(index=1, message="x"))
            except ConfigError as error:
                # Left to itself it would end the part, as it should: the program and the robot do not fit.
                self.seen.add(str(error)[:30])

        def hear(message: HelloWorld) -> None:
            self.heard.append(message.message)

        part.on("in", HelloWorld)(hear)
        part.on_setting("period_s", float)(lambda period: self.seen.add(f"period {period}"[:20]))
        part.on_partner_lost(lambda port: self.seen.add(f"lost {port}"[:20]))

    def _request(self, _object: int, _request: int, identity: bytes, body: bytes) -> None:
        self._requests.append((identity, body))
        del self._requests[:-4]
        if self.is_honest:
            self.answer(honest_answer(body))

    def answer(self, answer: bytes | None) -> None:
        """Answer the last request; None: with silence."""
        if self._requests and answer is not None:
            self._write(self.replier, self._requests[-1][0] + answer)

    def do(self, step: Step) -> None:
        """One step of the master."""
        match step.verb:
            case "profile":
                self._write(self.profile, step.data)
            case "sample":
                self._write(self.samples, step.data)
            case "answer":
                self.answer(step.data)
            case "honest" if self._requests:
                self.answer(honest_answer(self._requests[-1][1]))
            case "restart":
                self.agent.disconnect(client.key if (client := self._client()) is not None else 0, "fuzz")

    def _write(self, entity: Entity, payload: bytes) -> None:
        try:
            self.master.write(entity, payload)
        except (LinkFull, LocalProtocolError) as error:
            self.seen.add(str(error)[:40])

    def _client(self) -> Client | None:
        membership = self.part._runner._membership
        return None if membership is None else membership.client

    def check(self) -> None:
        """Nothing was raised, nothing grows; a part that is active knows its slot."""
        the_loop().check()
        client = self._client()
        if client is None:
            raise Violation("the part has ended by itself")
        hold("objects", len(client.entities), MOST_OBJECTS)
        self.seen.add(f"{self.part.state.value}: {self.part.reason[:40]}")

    async def heal(self) -> None:
        """The master is honest from now on; the part must become active and work.

        Raises:
            Violation: it does not.
        """
        self.is_honest = True
        for _ in range(int(HEALED_S)):
            self._write(self.profile, _PROFILE.encode())
            await asyncio.sleep(1.0)
        if self.part.state is not JoinState.ACTIVE:
            raise Violation(f"{HEALED_S} s after healing the part is {self.part.state}: {self.part.reason}")
        # A false STOP holds until the honest master's GO, whatever number it had.
        go = Notice(number=0xFFFFFFFF, binding=NO_BINDING, kind=NoticeKind.GO)
        self._write(self.replier, self._requests[-1][0][:16] + bytes(8) + go.encode())
        await asyncio.sleep(0.2)
        self.heard.clear()
        for number in range(3):
            self._write(self.honest_samples, HelloWorld(index=number, message=f"m{number}").encode())
            await asyncio.sleep(0.2)
        if self.heard != ["m0", "m1", "m2"]:
            raise Violation(f"the part heard {self.heard}")
        self.check()


def honest_answer(body: bytes) -> bytes | None:
    """What an honest inventory says; None: nothing."""
    match request := decode_request(body):
        case ClaimMessage() | Proof() | SealedProof():
            return VerdictMessage(lease=7, configuration_version=HONEST_VERSION, beat_period_ms=250).encode()
        case Beat(lease=lease) | StoppedBeat(lease=lease):
            return BeatReply(configuration_version=HONEST_VERSION if lease == 7 else 0).encode()
        case ConfigurationRequest():
            # Topics of its own: the agent keeps the type that a topic was first created with.
            return _configuration(HONEST_VERSION, out="honest one", into="honest two").encode()
        case NatureMessage() | TypeMessage() | DescriptionMessage() | TroublePiece():
            return None
        case _:  # mypy says so if a request has come that is not here
            assert_never(request)


class PartTarget:
    """See the module's docstring."""

    name = "part"
    about = "a whole part: nothing raises, it does not grow, with an honest master it becomes active"

    def make(self, random: Random) -> Case:
        """A master that is mostly right."""
        steps = [_step(random) for _ in range(random.randrange(2, 30))]
        if random.random() < 0.7:
            # Profile, lease, configuration: each waits for the request before it.
            wait, last = Step("wait", b"", (0.05,)), Step("answer", _configurations(random))
            steps[:0] = [
                Step("profile", _PROFILE.encode()),
                wait,
                Step("honest"),
                wait,
                last,
                Step("wait", b"", (0.6,)),
            ]
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Play the master."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            world = PartWorld()
            tasks = [asyncio.create_task(world.agent.run()), asyncio.create_task(world.master.run())]
            await world.master.connect(5.0)
            await world.master.until_all_statuses(5.0)
            tasks.append(asyncio.create_task(world.part.run_async(world.part_link, epoch_ns=lambda: 0)))
            await asyncio.sleep(0.1)
            for step in case:
                if step.verb == "wait":
                    await asyncio.sleep(min(abs(step.number(0)), 5.0))
                else:
                    world.do(step)
                    await asyncio.sleep(0.01)
                world.check()
            await world.heal()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            return world.seen

        return play(main(), TURNS) | reader.take()


ANSWERS = (
    VerdictMessage(lease=7, configuration_version=9, beat_period_ms=250).encode(),
    VerdictMessage(lease=8, configuration_version=1, beat_period_ms=0).encode(),
    VerdictMessage(lease=0, configuration_version=1, beat_period_ms=1000, reason=4).encode(),
    BeatReply(configuration_version=9).encode(),
    BeatReply(configuration_version=0).encode(),
    Challenge(nonce=bytes(16)).encode(),
    SealedChallenge(nonce=bytes(16)).encode(),
    Notice(number=9, binding=1, kind=NoticeKind.PARTNER_LOST).encode(),
    *(Notice(number=1, binding=NO_BINDING, kind=kind).encode() for kind in NoticeKind),
    _configuration(9).encode(),
    _configuration(0).encode(),
)


def _step(random: Random) -> Step:
    match random.randrange(12):
        case 0 | 1:
            octets = _PROFILE.encode()
            return Step("profile", mutate_octets(random, octets) if random.random() < 0.3 else octets)
        case 2 | 3 | 4:
            return Step("honest")
        case 5 | 6:
            octets = random.choice(ANSWERS)
            return Step("answer", mutate_octets(random, octets, ANSWERS) if random.random() < 0.5 else octets)
        case 7:
            return Step("answer", _large(random))
        case 8:
            octets = HelloWorld(index=3, message="hello").encode()
            return Step("sample", mutate_octets(random, octets) if random.random() < 0.6 else octets)
        case 9:
            return Step("restart") if random.random() < 0.3 else Step("wait", b"", (6.0,))
    return Step("wait", b"", (random.choice((0.01, 0.1, 0.5, 1.0, 3.0)),))


def _configurations(random: Random) -> bytes:
    octets = _configuration(random.choice((9, 9, 0))).encode()
    match random.randrange(4):
        case 0:
            return octets
        case 1:
            return mutate_octets(random, octets)
    return _large(random)


def _large(random: Random) -> bytes:
    """A configuration with very many or strange ports."""
    count = random.choice((1, 5, 100, MOST_BINDINGS, 300, 5000))
    topics = ("", "two", "x" * 254) if count <= MOST_BINDINGS else ("t",)
    bindings = [
        PortBinding(
            port=random.choice(("out", "in", f"p{number}", f"q{number}")),
            topic=random.choice(topics),
            topic_type=random.choice(("", "HelloWorld")),
            direction=random.choice((0, 1, 2, 255)),
            reliable=random.choice((0, 1, 77)),
        )
        for number in range(count)
    ]
    names = ("", "a", "a" * 3000, "period_s", "in.safe.index", "in.safe.x", ".safe.", "out.safe.message")
    values = ("", "x", "1", "-1", "nan", "1e400", "9" * 5000)
    settings = [
        Setting(name=random.choice(names), value=random.choice(values)) for _ in range(random.choice((0, 1, 2, 9)))
    ]
    return Boundless(version=random.choice((0, 9, 10)), slot="x", bindings=bindings, settings=settings).encode()
