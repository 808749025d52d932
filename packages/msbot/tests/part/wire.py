"""What the tests of this room stand on: a link in the test's hand, a quiet link, and a small master."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from random import Random

from msbot.part.client.client_settings import ConnectionState
from msbot.part.join import pnp_messages
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.part.join.membership import INVENTORY
from msbot.part.join.part_log import LEVEL_BITS, LEVEL_SHIFT, VersionOf
from msbot.part.join.refusal import Refusal
from msbot_agent.agent import Agent, Gate, OpenGate, client_key_of
from msbot_agent.link import (
    BaseLink,
    InprocHub,
    Link,
    LinkInfo,
    PacketHandler,
    Peer,
    RoomHandler,
    Signal,
    SignalHandler,
    Tap,
)
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import LinkDown, LinkFull, RemoteProtocolError
from msbot_xrce.objects import EndpointQos
from tests.hearing_client import HearingClient

AGENT = 0
"""The peer at the other end of a `HandLink`."""

STATUS_AGENT_OK = bytes.fromhex("8100000004010b000000585243450100010f00")


class HandLink(BaseLink):
    """A link whose other end is the test."""

    def __init__(self, mtu: int = 512) -> None:
        super().__init__(LinkInfo("hand", mtu), remote=AGENT)
        self.sent: list[bytes] = []
        self.room = True
        self.failure: Exception | None = None
        """Raised by `send`."""
        self.breaks: asyncio.Queue[Exception | None] = asyncio.Queue()
        """What `run` ends with: an error, or None = it just returns."""
        self.runs = 0

    def has_room(self, peer: Peer) -> bool:
        assert peer == AGENT
        return self.room

    def send(self, packet: bytes, peer: Peer) -> None:
        assert peer == AGENT
        if self.failure is not None:
            raise self.failure
        if not self.room:
            raise LinkFull("full")
        self.sent.append(packet)

    def describe(self, peer: Peer) -> str:
        return f"hand {peer!r}"

    async def run(self) -> None:
        self.runs += 1
        failure = await self.breaks.get()
        if failure is not None:
            raise failure

    def receive(self, packet: bytes | str) -> None:
        """Have a packet come in now."""
        octets = bytes.fromhex(packet) if isinstance(packet, str) else packet
        self._packet_handler(octets, AGENT, asyncio.get_running_loop().time())

    def signal(self, signal: Signal, reason: str = "") -> None:
        """Have a signal come in now."""
        self._signal_handler(signal, AGENT, reason, asyncio.get_running_loop().time())

    def give_room(self) -> None:
        """Take packets again, and say so."""
        self.room = True
        self._room_handler(AGENT)

    def take(self) -> list[str]:
        """The packets sent since the last call, as hexadecimal digits."""
        sent, self.sent = self.sent, []
        return [packet.hex() for packet in sent]


class QuietLink:
    """Wraps a link whose partner's going makes no noise (as on UDP), and lets the test cut it."""

    def __init__(self, link: Link) -> None:
        self.info = replace(link.info, sparse_acknacks=False)  # packets may be lost
        self.counters = link.counters
        self.remote = link.remote
        self.tap: Tap | None = None
        self.cut = False
        self._link = link

    def attach(
        self,
        *,
        packet: PacketHandler | None = None,
        signal: SignalHandler | None = None,
        room: RoomHandler | None = None,
        burst_end: Callable[[], None] | None = None,
    ) -> None:
        def pass_packet(octets: bytes, peer: Peer, now: float) -> None:
            if not self.cut and packet is not None:
                if self.tap is not None:
                    self.tap(now, "in", peer, octets)
                packet(octets, peer, now)

        def pass_signal(what: Signal, peer: Peer | None, reason: str, now: float) -> None:
            if what not in (Signal.PEER_GONE, Signal.PEER_JOINED) and signal is not None:
                signal(what, peer, reason, now)

        self._link.attach(
            packet=pass_packet if packet else None,
            signal=pass_signal if signal else None,
            room=room,
            burst_end=burst_end,
        )

    def origin(self, peer: Peer) -> Hashable:
        return self._link.origin(peer)

    def has_room(self, peer: Peer) -> bool:
        return self._link.has_room(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        if self.tap is not None:
            self.tap(asyncio.get_running_loop().time(), "out", peer, packet)
        if not self.cut:
            self._link.send(packet, peer)

    def describe(self, peer: Peer) -> str:
        return self._link.describe(peer)

    async def run(self) -> None:
        await self._link.run()


@contextmanager
def background(*tasks: asyncio.Task[None]) -> Iterator[None]:
    """Cancel the tasks at the end of the block."""
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()


def start_agent(link: Link, gate: Gate | None = None) -> asyncio.Task[None]:
    """A fresh agent on a link; cancel it to kill it."""
    agent = Agent(MemorySpace(), gate=gate, epoch_ns=lambda: 5_000_000_000)
    agent.add_link(link)
    return asyncio.get_running_loop().create_task(agent.run())


class _Latching(OpenGate):
    """Newcomers get the profile at once, as in a real master."""

    def is_latched(self, topic: str) -> bool:
        return topic == pnp_messages.PROFILE_TOPIC


class SmallMaster:
    """An agent, a profile and an inventory that knows part numbers: just enough rules to join.

    Parts come in at `hub`, or at the server link given. After `kill`, `start` begins anew with nothing remembered.
    """

    def __init__(self, bindings: dict[str, list[pnp_messages.PortBinding]], *, server: Link | None = None) -> None:
        self.bindings = bindings
        self.profile = ("MSBOT_MASTER", "MSBOT_V1", "X100Y100Z100", "8-4-2021", "MASSEY")
        self.refuse: Refusal | None = None
        """Refuse claims, and say so."""
        self.version = 1
        self.settings: list[pnp_messages.Setting] = []
        self.beat_ms = 1000
        self.answers_beats = True
        self.requests: list[tuple[str, str]] = []
        """(what was asked, part number or "") in order."""
        self.types: list[tuple[str, int, bytes]] = []
        """(part number, place of the binding, hash) of the types that parts tell."""
        self.odd_types: dict[int, pnp_messages.Notice] = {}
        """Place of a binding -> the answer to its hash."""
        self.parts: dict[int, str] = {}
        """Lease -> part number."""
        self.configured: set[int] = set()
        """Client keys that have fetched their configuration: a part repeats what is not answered in time."""
        self.nonce: bytes | None = None
        """Answer claims with this challenge."""
        self.proofs: list[bytes] = []
        self.askers: dict[str, bytes] = {}
        """Part number -> GUID of its requests."""
        self.hub = InprocHub()
        self._server = server or self.hub.server
        self._next_lease = 1
        self._tasks: list[asyncio.Task[None]] = []

    def link(self) -> QuietLink:
        """A way for one part."""
        return QuietLink(self.hub.connect())

    def start(self) -> None:
        """Begin; the leases of an earlier life are unknown."""
        self.parts.clear()
        own = InprocHub()
        agent = Agent(MemorySpace(), gate=_Latching(), epoch_ns=lambda: 0)
        agent.add_link(self._server)
        agent.add_link(own.server)
        self.agent = agent
        self.client = HearingClient(own.connect(), key=0x4D000001, random=Random(1))
        participant = self.client.create_participant("master")
        topic = self.client.create_topic(participant, pnp_messages.PROFILE_TOPIC, pnp_messages.PROFILE_TYPE)
        publisher = self.client.create_publisher(participant)
        self._writer = self.client.create_writer(publisher, topic, EndpointQos(transient_local=True, depth=1))
        self._replier = self.client.create_replier(participant, INVENTORY)
        self.client.read(self._replier)
        self.client.on_request = self._requested
        self.client.on_state = self._connected
        loop = asyncio.get_running_loop()
        self._tasks = [loop.create_task(agent.run()), loop.create_task(self.client.run())]

    async def kill(self) -> None:
        """End at once; nobody is told."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def say(self, number: str, message: pnp_messages.Reply) -> None:
        """Say something to a part that did not ask."""
        self.client.reply(self._replier, self.askers[number] + bytes(8), message.encode())

    def publish_profile(self) -> None:
        """Say who the robot is."""
        name, version, serial, released, make = self.profile
        message = pnp_messages.ProfileMessage(index=1, message=name, name=version, id=serial, dof=released, make=make)
        self.client.write(self._writer, message.encode())

    def _connected(self, state: ConnectionState, _reason: str) -> None:
        if state is ConnectionState.CONNECTED:
            self.publish_profile()

    def _requested(self, _object_id: int, _request_id: int, identity: bytes, body: bytes) -> None:
        try:
            request = pnp_messages.decode_request(body)
        except RemoteProtocolError:
            self.requests.append(("rubbish", body.hex()))
            return
        if isinstance(request, pnp_messages.ClaimMessage):
            self.askers[request.part_number] = identity[:16]
        answer = self._answer(request, client_key_of(identity[:16]))
        if answer is not None and self.client.has_room():
            self.client.reply(self._replier, identity, answer.encode())

    def _answer(self, request: pnp_messages.Request, key: int) -> pnp_messages.Reply | None:
        assert key
        match request:
            case pnp_messages.ClaimMessage(part_number=number):
                self.requests.append(("claim", number))
                return self._verdict(number) if self.nonce is None else pnp_messages.Challenge(nonce=self.nonce)
            case pnp_messages.Proof(proof=proof) | pnp_messages.SealedProof(proof=proof):
                self.requests.append(("proof", ""))
                self.proofs.append(proof)
                return self._verdict(next(iter(self.bindings)))
            case pnp_messages.Beat(lease=lease) | pnp_messages.StoppedBeat(lease=lease):
                self.requests.append(("beat", self.parts.get(lease, "")))
                known = lease in self.parts
                return (
                    pnp_messages.BeatReply(configuration_version=self.version if known else 0)
                    if self.answers_beats
                    else None
                )
            case pnp_messages.DescriptionMessage(text=text):
                self.requests.append(("description", text.rstrip()))
                return None
            case pnp_messages.NatureMessage(lease=lease, nature=nature):
                self.requests.append((f"nature {nature}", self.parts.get(lease, "")))
                return None
            case pnp_messages.TypeMessage(lease=lease, binding=binding, hash=octets):
                self.types.append((self.parts.get(lease, ""), binding, octets))
                return self.odd_types.get(binding)
            case TroublePiece(place=place) if place & LEVEL_BITS == VersionOf.HOME << LEVEL_SHIFT:
                return None  # every part says where it runs
            case TroublePiece(lease=lease, place=place):
                self.requests.append((f"trouble {place}", self.parts.get(lease, "")))
                return None
            case pnp_messages.ConfigurationRequest(lease=lease):
                number = self.parts.get(lease, "")
                self.requests.append(("configuration", number))
                self.configured.add(key)
                return pnp_messages.ConfigurationMessage(
                    version=self.version,
                    slot=f"slot of {number}",
                    bindings=self.bindings[number],
                    settings=self.settings,
                )

    def _verdict(self, number: str) -> pnp_messages.VerdictMessage | None:
        if self.refuse is not None:
            return pnp_messages.VerdictMessage(lease=0, configuration_version=0, beat_period_ms=0, reason=self.refuse)
        if number not in self.bindings:
            return None
        lease = self._next_lease
        self._next_lease += 1
        self.parts[lease] = number
        return pnp_messages.VerdictMessage(lease=lease, configuration_version=self.version, beat_period_ms=self.beat_ms)


def publishes(
    port: str, topic: str, type_name: str = "HelloWorld", *, reliable: bool = True
) -> pnp_messages.PortBinding:
    """A binding of a port that sends."""
    return pnp_messages.PortBinding(
        port=port,
        topic=topic,
        topic_type=type_name,
        direction=pnp_messages.BindingDirection.PUBLISH,
        reliable=int(reliable),
    )


def subscribes(
    port: str, topic: str, type_name: str = "HelloWorld", *, reliable: bool = True
) -> pnp_messages.PortBinding:
    """A binding of a port that receives."""
    return pnp_messages.PortBinding(
        port=port,
        topic=topic,
        topic_type=type_name,
        direction=pnp_messages.BindingDirection.SUBSCRIBE,
        reliable=int(reliable),
    )


__all__ = ["AGENT", "STATUS_AGENT_OK", "HandLink", "LinkDown", "QuietLink", "SmallMaster", "background"]
