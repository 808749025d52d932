"""Streams as DDS-XRCE 1.0 §8.4 describes them, written from its text and from what genuine ends were seen to do.

Nothing here knows `msbot`: positions are whole numbers that never wrap, what is kept is a list or a dictionary, and
nothing is quick. Only at the edge a position becomes a sequence number of 16 bits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

NUMBERS = 65536
BITS = 16
LOST = None


def near(number: int, position: int) -> int | None:
    """The position with that sequence number that is nearest to a position; None: two are equally near."""
    ahead = (number - position) % NUMBERS
    if ahead == NUMBERS // 2:
        return None
    return position + ahead if ahead < NUMBERS // 2 else position + ahead - NUMBERS


@dataclass
class SpecBestEffortReceiver:
    """Takes what is newer than the newest."""

    newest: int = -1

    def take(self, number: int) -> bool:
        """Whether it is handed on."""
        position = near(number, self.newest)
        if position is None or position <= self.newest:
            return False
        self.newest = position
        return True


@dataclass
class SpecReceiver:
    """Hands on each message once and in order; a gap is waited for until the sender says that it has nothing there."""

    window: int
    next: int = 0
    """Position of the first message that has not been handed on."""
    early: dict[int, bytes] = field(default_factory=dict)
    announced: int = -1
    """The last position that the sender is known to have used."""
    suspected: int = -1
    """The last that a message beyond the window spoke of: an agent forgets that, a client remembers it."""
    done: list[bytes | None] = field(default_factory=list)
    """What has been handed on; `LOST` where messages were given up."""

    def take(self, number: int, octets: bytes) -> None:
        """A message."""
        position = near(number, self.next - 1)
        if position is None or position < self.next:
            return
        self.suspected = max(self.suspected, position)
        if position >= self.next + self.window:
            return
        self.announced = max(self.announced, position)
        self.early.setdefault(position, octets)
        self._hand_on()

    def hear(self, first: int, last: int) -> None:
        """A HEARTBEAT: the sender has `first` to `last`, and nothing before that any more."""
        from_position, to_position = near(first, self.next - 1), near(last, self.next - 1)
        if from_position is None or to_position is None:
            return
        while self.next < from_position:
            self.done.append(self.early.pop(self.next, LOST))
            self.next += 1
        self.announced = max(self.announced, to_position)
        self._hand_on()

    def _hand_on(self) -> None:
        while self.next in self.early:
            self.done.append(self.early.pop(self.next))
            self.next += 1

    def may_report(self, first: int, bitmap: int) -> bool:
        """Whether an ACKNACK says what is missing. Of messages beyond the window it may speak or not."""
        if first != self.next % NUMBERS or bitmap >> BITS:
            return False
        for bit in range(BITS):
            position = self.next + bit
            is_missing = position not in self.early
            if bitmap >> bit & 1:
                if not is_missing or position > max(self.announced, self.suspected):
                    return False
            elif is_missing and position <= self.announced:
                return False
        return True

    def report(self) -> tuple[int, int]:
        """Its own ACKNACK."""
        missing = [p for p in range(self.next, self.next + BITS) if p <= self.announced and p not in self.early]
        return self.next % NUMBERS, sum(1 << p - self.next for p in missing)


@dataclass
class SpecSender:
    """Numbers what it is given as far as the window goes, and keeps it until it is acknowledged."""

    window: int
    start: int = 0
    acked: int = 0
    """Position of the first message that is not acknowledged."""
    messages: list[bytes] = field(default_factory=list)
    """All that it was ever given, from the position `start` on."""

    def __post_init__(self) -> None:
        self.acked = self.start

    @property
    def end(self) -> int:
        """Position behind the last message that may have been sent."""
        return min(self.acked + self.window, self.start + len(self.messages))

    def at(self, position: int) -> bytes:
        """The message at a position."""
        return self.messages[position - self.start]

    def hear(self, first: int, bitmap: int) -> list[int] | None:
        """An ACKNACK; the positions that are asked for, or None when it speaks of what was never sent, or long ago."""
        sent = self.end
        position = near(first, self.acked)
        if position is None or not self.acked <= position <= sent:
            return None
        self.acked = position
        return [position + bit for bit in range(BITS) if bitmap >> bit & 1 and position + bit < sent]


def message(stream: int, position: int, submessage: bytes) -> bytes:
    """A message of session 0x81 with one submessage."""
    return bytes((0x81, stream)) + (position % NUMBERS).to_bytes(2, "little") + submessage


def cut(submessage: bytes, mtu: int) -> list[bytes]:
    """A submessage as the bodies of messages: itself, or FRAGMENTs (§8.3.5.14) when it does not fit."""
    if 4 + len(submessage) <= mtu:
        return [submessage]
    size = mtu - 8
    pieces = [submessage[at : at + size] for at in range(0, len(submessage), size)]
    return [bytes((0x0D, 0x03 if one is pieces[-1] else 0x01)) + len(one).to_bytes(2, "little") + one for one in pieces]


def write_data(request: int, writer: int, payload: bytes) -> bytes:
    """WRITE_DATA (§8.3.5.8), data format."""
    head = request.to_bytes(2, "big") + writer.to_bytes(2, "big")
    return bytes((0x07, 0x01)) + (4 + len(payload)).to_bytes(2, "little") + head + payload


def acknack(first: int, bitmap: int, stream: int) -> bytes:
    """An ACKNACK in a message of its own."""
    body = first.to_bytes(2, "little") + bitmap.to_bytes(2, "big") + bytes((stream,))
    return message(0, 0, bytes((0x0A, 0x01, 0x05, 0x00)) + body)


def heartbeat(first: int, last: int, stream: int) -> bytes:
    """A HEARTBEAT in a message of its own; positions."""
    body = (first % NUMBERS).to_bytes(2, "little") + (last % NUMBERS).to_bytes(2, "little") + bytes((stream,))
    return message(0, 0, bytes((0x0B, 0x01, 0x05, 0x00)) + body)


@dataclass(frozen=True)
class Heard:
    """What one submessage of the other end says."""

    stream: int
    number: int
    kind: int
    flags: int
    body: bytes


def read(packet: bytes) -> list[Heard]:
    """The submessages of a packet of session 0x81; each begins at a multiple of 4."""
    stream, number = packet[1], int.from_bytes(packet[2:4], "little")
    found, at = [], 4
    while at + 4 <= len(packet):
        kind, flags = packet[at], packet[at + 1]
        length = int.from_bytes(packet[at + 2 : at + 4], "little")
        found.append(Heard(stream, number, kind, flags, packet[at + 4 : at + 4 + length]))
        at = (at + 4 + length + 3) // 4 * 4
    return found
