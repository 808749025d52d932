"""Feeds the clients' half of recorded dialogues into our agent and compares the answers with the genuine agent's.

What must be equal, in order for each stream of each client: kind, request and object ids, statuses, payloads, sequence
numbers, acknowledgements. What cannot be: HEARTBEATs (they follow timers, not messages), clocks in TIMESTAMP_REPLY,
and the GUIDs in front of requests; ours are put into the recorded replies, as the client would have done.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.link.byte_frames import SerialReceiver, TcpReceiver
from msbot_agent.space import MemorySpace
from msbot_xrce import References
from msbot_xrce.messages import (
    Data,
    Heartbeat,
    ObjectKind,
    Submessage,
    TimestampReply,
    WriteData,
    decode_header,
    iter_submessages,
    kind_of,
)
from tests import ROOT
from tests.agent.wiring import FakeLink, serving

VECTORS = ROOT / "tests" / "vectors"
IDENTITY_SIZE = 24
_BEFORE_BODY = {int(ObjectKind.DATAREADER): 0, int(ObjectKind.REPLIER): IDENTITY_SIZE}
AGENT_ADDRESS = 0
"""The agent's address on a serial line."""

AS_GENUINE = AgentSettings(packs=False, heartbeat_min_s=AgentSettings().heartbeat_s)
"""One submessage in a message, and no sooner questions after losses, as with the genuine agent."""

Place = tuple[str, int]
"""A client in the recordings: name of the file, index of the client in it."""


@dataclass(frozen=True, slots=True)
class Line:
    """One recorded packet."""

    at: float
    place: Place
    from_client: bool
    packet: bytes
    lost: bool


@dataclass(slots=True)
class Answers:
    """What an agent sent to one client."""

    streams: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    """All messages in words, by stream."""
    samples: dict[tuple[int, int], bytes] = field(default_factory=dict)
    """Bodies of samples and requests, by stream and sequence number: repetitions count once."""

    def add(self, packet: bytes) -> None:
        """Note a packet of the agent."""
        header = decode_header(packet)
        for submessage in iter_submessages(packet, header.size):
            if not isinstance(submessage, Heartbeat):
                words = f"{header.session_id:02x} {header.sequence_nr} {_words(submessage)}"
                self.streams[header.stream_id].append(words)
            if isinstance(submessage, Data) and kind_of(submessage.object_id) in _BEFORE_BODY:
                body = submessage.payload[_BEFORE_BODY[kind_of(submessage.object_id)] :]
                self.samples[header.stream_id, header.sequence_nr] = body


def _words(submessage: Submessage) -> str:
    if isinstance(submessage, TimestampReply):
        return f"TimestampReply(originate {submessage.originate_ns})"
    if isinstance(submessage, Data) and kind_of(submessage.object_id) == ObjectKind.REPLIER:
        body = submessage.payload[IDENTITY_SIZE:].hex()
        return f"Data(request {submessage.request_id}, object {submessage.object_id:04x}, identity, {body})"
    return repr(submessage)


def load(*names: str) -> list[Line]:
    """The lines of some recordings, which share one clock, in the order of time."""
    lines = []
    for name in names:
        for text in (VECTORS / f"{name}.jsonl").read_text().splitlines():
            entry = json.loads(text)
            lines.append(
                Line(
                    at=entry["t"],
                    place=(name, entry.get("client", 0)),
                    from_client=entry["dir"] == "client>agent",
                    packet=_unframed(name, bytes.fromhex(entry["hex"]), from_client=entry["dir"] == "client>agent"),
                    lost=bool(entry.get("dropped")),
                )
            )
    return sorted(lines, key=lambda line: line.at)


def _unframed(name: str, octets: bytes, *, from_client: bool) -> bytes:
    """The packet without the framing of its transport; every line of a recording is one whole frame."""
    if name.startswith("tcp_"):
        (packet,) = TcpReceiver().receive(octets)
        return packet
    if name.startswith("serial_"):
        ((_, packet),) = SerialReceiver(address=AGENT_ADDRESS if from_client else octets[2]).receive(octets)
        return packet
    return octets


def recorded(lines: Iterable[Line]) -> dict[Place, Answers]:
    """What the genuine agent sent."""
    answers: dict[Place, Answers] = defaultdict(Answers)
    for line in lines:
        if not line.from_client:
            answers[line.place].add(line.packet)
    return answers


class Identities:
    """Puts our identities of requests into recorded replies; requests are matched by their bodies."""

    def __init__(self, lines: Iterable[Line]) -> None:
        requests = [_request(line.packet) for line in lines if not line.from_client]
        self._genuine = {body: identity for body, identity in filter(None, requests)}
        self._ours: dict[bytes, bytes] = {}

    def note(self, packet: bytes) -> None:
        """See a packet of our agent."""
        request = _request(packet)
        if request is not None:
            self._ours.setdefault(*request)

    def translate(self, packet: bytes) -> bytes:
        """A packet of a client, with our identities."""
        for body, genuine in self._genuine.items():
            packet = packet.replace(genuine, self._ours.get(body, genuine))
        return packet


def _request(packet: bytes) -> tuple[bytes, bytes] | None:
    """Body and identity of the request that a replier gets in this packet."""
    header = decode_header(packet)
    for submessage in iter_submessages(packet, header.size):
        if isinstance(submessage, Data) and kind_of(submessage.object_id) == ObjectKind.REPLIER:
            return submessage.payload[IDENTITY_SIZE:], submessage.payload[:IDENTITY_SIZE]
    return None


def replayed(lines: list[Line], make_agent: Callable[[], Agent] | None = None) -> dict[Place, Answers]:
    """What our agent sends when the clients do the same."""
    return run_virtual(_replay(lines, make_agent or _plain_agent))


def _plain_agent() -> Agent:
    return Agent(MemorySpace(), settings=AS_GENUINE, epoch_ns=lambda: 1_700_000_000_000_000_000)


def agent_with(references: References) -> Callable[[], Agent]:
    """Makes agents that know those profiles."""
    return lambda: Agent(MemorySpace(), settings=AS_GENUINE, references=references)


async def _replay(lines: list[Line], make_agent: Callable[[], Agent]) -> dict[Place, Answers]:
    answers: dict[Place, Answers] = defaultdict(Answers)
    identities = Identities(lines)
    link = FakeLink()
    for place in {line.place for line in lines}:
        link.plug(place, answers[place].add)
    async with serving(make_agent(), link):
        loop = asyncio.get_running_loop()
        start = loop.time()
        for line in lines:
            if line.from_client and not line.lost:
                await asyncio.sleep(start + line.at - loop.time())
                link.inject(identities.translate(line.packet), line.place)
                for _ in range(4):
                    await asyncio.sleep(0)
                for _, packet in link.sent:
                    identities.note(packet)
                link.sent.clear()
        await asyncio.sleep(1.0)
    return answers


def differences(genuine: dict[Place, Answers], ours: dict[Place, Answers]) -> list[str]:
    """Every place where the two differ, in words."""
    found = []
    for place in sorted(genuine.keys() | ours.keys()):
        for stream_id in sorted(genuine[place].streams.keys() | ours[place].streams.keys()):
            theirs, mine = genuine[place].streams[stream_id], ours[place].streams[stream_id]
            if theirs != mine:
                at = next((i for i, pair in enumerate(zip(theirs, mine, strict=False)) if pair[0] != pair[1]), 0)
                found.append(f"{place} {stream_id:02x}, {at}: genuine {theirs[at : at + 2]}, ours {mine[at : at + 2]}")
    return found


def samples_written(lines: Iterable[Line]) -> list[bytes]:
    """The payloads of all WRITE_DATA that reached the agent, each once (clients send again what may be lost)."""
    written: dict[tuple[Place, int], bytes] = {}
    for line in lines:
        if line.from_client and not line.lost:
            header = decode_header(line.packet)
            for submessage in iter_submessages(line.packet, header.size):
                if isinstance(submessage, WriteData) and kind_of(submessage.object_id) != ObjectKind.REPLIER:
                    written.setdefault((line.place, submessage.request_id), submessage.payload)
    return [written[key] for key in sorted(written)]
