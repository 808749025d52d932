"""What a relay and a master say to each other, in words, and the packet of a part that is inside. Pure."""

from __future__ import annotations

from msbot_agent.link.relay import MARK, Bye, Down, Heard, Hello, Refused, RelayBeat, Room, Up, Welcome, Who, decode
from msbot_xrce.counting import amount
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class RelayWords:
    """A message between a relay and a master."""

    words: str
    packet: bytes = b""
    """The packet of a part in it."""
    part: int = 0
    """The relay's number of that part."""
    up: bool = False
    """Whether the packet comes from the part."""


def relay_words(octets: bytes) -> RelayWords | None:
    """What a message of a relay or for one says; None: it is none. Never raises."""
    if not octets.startswith(MARK):
        return None
    try:
        message = decode(octets)
    except RemoteProtocolError as error:
        return RelayWords(f"relay: {error}")
    match message:
        case Up(number, words, packet):
            where = f" ({words})" if words else ""
            return RelayWords(f"relay: a packet from part {number}{where}, {len(packet)} bytes", packet, number, True)
        case Down(number, count, packet):
            return RelayWords(f"relay: packet {count} for part {number}, {len(packet)} bytes", packet, number)
        case Hello():
            return RelayWords(f"relay: HELLO, I am {message.name} and carry the parts of {message.carried}")
        case RelayBeat():
            return RelayWords(f"relay: BEAT {message.count}{_stops(message.stops_said)}{_events(message)}")
        case Room(handled):
            return RelayWords(f"relay: ROOM, {amount(len(handled), 'part')} can take more")
        case Welcome():
            return RelayWords("relay: WELCOME, the master takes the relay")
        case Heard():
            return RelayWords(f"relay: HEARD beat {message.count}{_stops(message.stops)}")
        case Who():
            return RelayWords("relay: WHO are you? The master does not know this relay")
        case Refused(words):
            return RelayWords(f"relay: REFUSED, {words}")
        case Bye():
            return RelayWords("relay: BYE, the relay ends")


def _stops(number: int) -> str:
    return f", STOP {number}" if number else ""


def _events(message: RelayBeat) -> str:
    return "".join(f", part {event.number} {event.what.name.lower()}" for event in message.events)
