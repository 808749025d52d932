"""A real agent on a link in memory, spoken to in octets: what is said is answered in the same turn of virtual time.

    agent.log_in()
    assert agent.say(participant("81 80 00 00")) == packets("81 80 00 00 05 01 06 00 00 0a 00 11 00 00")

Packets are written in hex; blanks and `|` are for the reader.
"""

from __future__ import annotations

import asyncio
import struct
from collections import defaultdict
from collections.abc import Coroutine
from dataclasses import replace
from typing import TypeVar

from msbot.process.virtual_time import VirtualTimeLoop
from msbot_agent.agent import Agent, AgentSettings, ClientView
from msbot_agent.link import Peer
from msbot_agent.space import MemorySpace
from msbot_xrce import References
from tests.agent.wiring import FakeLink

Result = TypeVar("Result")

CLIENT = "client"
KEY = "aa bb cc dd"
CLOCK_NS = 1_795_000_000_123_456_789
"""What the agent's wall clock says."""
ENTITIES = [
    "00 0a 00 11 01 03 00 00 | 02 00 00 00 00 00 | 00 00",
    "00 0b 00 12 02 03 00 00 | 08 00 00 00 02 00 00 00 74 00 00 00 | 00 11",
    "00 0c 00 13 03 03 00 00 | 02 00 00 00 00 00 | 00 11",
    "00 0d 00 14 04 03 00 00 | 02 00 00 00 00 00 | 00 11",
    "00 0e 00 15 05 03 00 00 | 03 00 00 00 00 12 00 | 00 13",
    "00 0f 00 16 06 03 00 00 | 03 00 00 00 00 12 00 | 00 14",
]
"""Contents of the CREATEs of participant 0011, topic 0012 "t", publisher 0013, subscriber 0014, data writer 0015 and
data reader 0016, in binary form and without quality of service."""
TURNS = 12
"""Turns of the loop in which everything that a packet causes has happened."""


def octets(text: str) -> bytes:
    """Octets written in hex."""
    return bytes.fromhex(text.replace("|", " "))


def packets(*texts: str) -> list[str]:
    """Packets as the rig gives them back: hex without blanks."""
    return [octets(text).hex() for text in texts]


class AgentRig:
    """An agent and the peers that talk to it (see the module's docstring)."""

    def __init__(self, *, settings: AgentSettings | None = None, references: References | None = None) -> None:
        self.link = FakeLink()
        # One submessage in a message, so that the octets can be those of the genuine agent.
        settings = replace(settings or AgentSettings(), packs=False)
        self.agent = Agent(MemorySpace(), settings=settings, references=references, epoch_ns=lambda: CLOCK_NS)
        self.agent.add_link(self.link)
        self._loop = VirtualTimeLoop()
        self._heard: dict[Peer, list[tuple[float, str]]] = defaultdict(list)
        self._serving = self._loop.create_task(self.agent.run())
        self._run(_turns())

    def say(self, *sent: str | bytes, peer: Peer = CLIENT) -> list[str]:
        """Have packets come in, one after the other; what that peer was sent since the last call."""
        self._run(self._say(sent, peer))
        return self.take(peer)

    def say_at_once(self, sent: list[bytes], peer: Peer = CLIENT) -> list[str]:
        """Have packets come in within one turn of the loop; what that peer was sent since the last call."""
        self._run(self._say_at_once(sent, peer))
        return self.take(peer)

    def inject(self, *sent: bytes, peer: Peer) -> None:
        """Have packets come in; nothing else happens before `turn`, and the answers are not kept."""
        self._run(self._inject(sent, peer))

    def make_room(self) -> None:
        """The link, which was full, takes any number of packets again."""
        self._run(self._make_room())
        self.turn()

    def turn(self) -> None:
        """Let everything happen that the packets so far cause."""
        self._run(_turns())
        self.link.sent.clear()

    def take(self, peer: Peer = CLIENT) -> list[str]:
        """What that peer was sent since the last call."""
        return [packet for _, packet in self._heard.pop(peer, [])]

    def wait(self, seconds: float, peer: Peer = CLIENT) -> list[tuple[float, str]]:
        """Let time pass; what that peer was sent, with the seconds since the call."""
        start = self._loop.time()
        self._run(asyncio.sleep(seconds))
        self._run(_turns())
        return [(round(at - start, 6), packet) for at, packet in self._heard.pop(peer, [])]

    def log_in(self, key: str = KEY, *, session: str = "81", mtu: str = "fc 01", peer: Peer = CLIENT) -> None:
        """Open a session; fails the test when the agent refuses."""
        answer = f"{session} 00 00 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00"
        assert self.say(create_client(key, session=session, mtu=mtu), peer=peer) == packets(answer)

    def set_up(self, *, peer: Peer = CLIENT) -> int:
        """Create `ENTITIES` on stream 0x80 and acknowledge; returns the next sequence number of the client, 6.

        The agent's next one on 0x80 is 6, too.
        """
        for number, entity in enumerate(ENTITIES):
            length = len(octets(entity))
            answers = self.say(f"81 80 {_u16(number)} 01 01 {_u16(length)} {entity}", peer=peer)
            ids = octets(entity)[:4].hex()
            assert answers == packets(f"81 80 {_u16(number)} 05 01 06 00 {ids} 00 00", acknack(number + 1)), answers
        assert self.say(acknack(len(ENTITIES)), peer=peer) == []
        return len(ENTITIES)

    def set_up_two(self) -> None:
        """Log in two clients, `CLIENT` to read topic `t` with reader 0016 and `"writer"` to write it with 0015."""
        self.log_in()
        self.set_up()
        self.log_in("aa bb cc ee", peer="writer")
        self.set_up(peer="writer")

    def view(self, key: int = 0xAABBCCDD) -> ClientView:
        """What people see of that client."""
        (found,) = [view for view in self.agent.clients() if view.key == key]
        return found

    def serve_somebody(self) -> None:
        """Fail unless the agent serves a newcomer."""
        self.log_in("0e 0e 0e 0e", peer="newcomer")
        assert self.say(participant("81 80 00 00"), peer="newcomer") == packets(status("81 80 00 00"), acknack(1))

    def close(self) -> None:
        """End the agent; fails the test when it had ended by itself."""
        died = self._serving.done()
        self._serving.cancel()
        outcome = self._loop.run_until_complete(asyncio.gather(self._serving, return_exceptions=True))
        self._loop.close()
        assert not died, outcome

    async def _say(self, sent: tuple[str | bytes, ...], peer: Peer) -> None:
        self._attach(peer)
        for packet in sent:
            self.link.inject(octets(packet) if isinstance(packet, str) else packet, peer)
            await _turns()
        self.link.sent.clear()

    async def _say_at_once(self, sent: list[bytes], peer: Peer) -> None:
        self._attach(peer)
        for packet in sent:
            self.link.inject(packet, peer)
        for _ in range(3):
            await asyncio.sleep(0)
        self.link.sent.clear()

    async def _inject(self, sent: tuple[bytes, ...], peer: Peer) -> None:
        for packet in sent:
            self.link.inject(packet, peer)

    async def _make_room(self) -> None:
        self.link.make_room(None)

    def _attach(self, peer: Peer) -> None:
        self.link.plug(peer, lambda packet: self._heard[peer].append((self._loop.time(), packet.hex())))

    def _run(self, job: Coroutine[object, object, Result]) -> Result:
        return self._loop.run_until_complete(job)


async def _turns() -> None:
    for _ in range(TURNS):
        await asyncio.sleep(0)


def create_client(
    key: str = KEY,
    *,
    session: str = "81",
    mtu: str = "fc 01",
    header: str = "80 00 00 00",
    cookie: str = "58 52 43 45",
    version: str = "01 00",
    vendor: str = "01 0f",
    properties: str = "00",
) -> str:
    """A CREATE_CLIENT as the C client sends it, with anything changed."""
    return f"{header} 00 01 10 00 {cookie} {version} {vendor} {key} {session} {properties} {mtu}"


def hard_liveliness(milliseconds: str) -> str:
    """The property `uxr_hl` for `create_client`, with six digits."""
    return f"01 00 00 01 00 00 00 07 00 00 00 75 78 72 5f 68 6c 00 00 07 00 00 00 {milliseconds.encode().hex()} 00 00"


def participant(
    header: str, *, request: str = "00 0a", object_id: str = "00 11", flags: str = "01", domain: str = "00 00"
) -> str:
    """P(object id) of the conformance list: a message with a CREATE of a participant in binary form."""
    return f"{header} 01 {flags} 10 00 {request} {object_id} 01 03 00 00 02 00 00 00 00 00 {domain}"


def status(
    header: str, request: str = "00 0a", object_id: str = "00 11", code: str = "00", implementation: str = "00"
) -> str:
    """A STATUS message."""
    return f"{header} 05 01 06 00 {request} {object_id} {code} {implementation}"


def acknack(first: int, bitmap: str = "00 00", stream: str = "80", session: str = "81") -> str:
    """An ACKNACK message."""
    return f"{session} 00 00 00 0a 01 05 00 {_u16(first)} {bitmap} {stream}"


def heartbeat(first: int, last: int, stream: str = "80", session: str = "81") -> str:
    """A HEARTBEAT message."""
    return f"{session} 00 00 00 0b 01 05 00 {_u16(first)} {_u16(last)} {stream}"


def reliable(sequence_nr: int, body: str, stream: str = "80") -> str:
    """A message of a reliable (or other) stream."""
    return f"81 {stream} {_u16(sequence_nr)} {body}"


def write(payload: str, *, request: str = "00 20", object_id: str = "00 15") -> str:
    """A WRITE_DATA submessage."""
    return f"07 01 {_u16(4 + len(octets(payload)))} {request} {object_id} {payload}"


def read(
    *,
    request: str = "00 21",
    object_id: str = "00 16",
    stream: str = "80",
    max_samples: str = "ff ff",
    elapsed: str = "00 00",
    rate: str = "00 00",
    pace: str = "00 00",
) -> str:
    """A READ_DATA submessage with delivery control."""
    return f"08 01 10 00 {request} {object_id} {stream} 00 00 01 {max_samples} {elapsed} {rate} {pace}"


def data(payload: str, *, request: str = "00 21", object_id: str = "00 16") -> str:
    """A DATA submessage."""
    return f"09 01 {_u16(4 + len(octets(payload)))} {request} {object_id} {payload}"


def fragment(piece: str, *, last: bool = False) -> str:
    """A FRAGMENT submessage."""
    return f"0d {'03' if last else '01'} {_u16(len(octets(piece)))} {piece}"


def info(header: str, *, request: str = "00 0a", object_id: str = "ff fd", known: bool) -> str:
    """An INFO message of the agent without locators."""
    return (
        f"{header} 06 01 1c 00 {request} {object_id} 00 {'01' if known else '00'}"
        "01 0d 58 52 43 45 01 00 01 0f 00 | 01 0d 00 01 00 00 00 00 00 00 00"
    )


PING = "80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00"
PING_INSIDE = "81 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00"
PROBE = "81 00 00 00 02 01 08 00 00 00 ff fe 01 00 00 00"
DELETE_CLIENT = "03 01 04 00 00 02 ff fe"
DELETED = "81 00 00 00 05 01 06 00 00 02 ff fe 00 00"
WELCOME = "81 00 00 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00"


def _u16(number: int) -> str:
    return struct.pack("<H", number & 0xFFFF).hex(" ")
