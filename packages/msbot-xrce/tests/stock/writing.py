"""How a stock C client keeps what it has sent, and how it loses it.

Facts, not code, of clients 2.0.0 to 3.0.1:

* A message lies in one of `history` slots until an ACKNACK covers it. The slots that an ACKNACK frees are counted with
  16 bits without a sign: an ACKNACK from a number *lower* than one before it makes some 65,530 of them, so every slot
  is emptied, and "last acknowledged" goes back.
* Any bit in an ACKNACK has every slot sent again that is not empty, from the last acknowledged message on.
* It may write as long as the next number is at most `history` beyond the last acknowledged, and send as long as fewer
  than `history` are unacknowledged.
* A HEARTBEAT comes 100 ms after the last call of its run function in which it looked, so a client that is run in
  shorter slices sends none at all.
"""

from __future__ import annotations

import struct

HEARTBEAT_S = 0.1
_NO_KEY = bytes((0x81, 0, 0, 0))


def _compare(one: int, other: int) -> int:
    return 0 if one == other else (-1 if (other - one) & 0xFFFF < 0x8000 else 1)


class StockOutput:
    """Its reliable output stream 0x80."""

    def __init__(self, history: int) -> None:
        self.emptied = 0
        """ACKNACKs that emptied the history."""
        self._history = history
        self._slots: dict[int, bytes] = {}
        self.acknowledged = 0xFFFF
        self.sent = 0xFFFF
        self._heartbeat_at: float | None = None

    @property
    def has_room(self) -> bool:
        """Whether one more message may be written and sent."""
        return (self.sent - self.acknowledged) & 0xFFFF < self._history

    @property
    def is_confirmed(self) -> bool:
        """Whether the agent has acknowledged everything, as far as the client knows."""
        return self.sent == self.acknowledged

    def write(self, body: bytes) -> bytes:
        """Put a body into a message; returns it, padded as C clients do. The caller has asked `has_room`."""
        self.sent = (self.sent + 1) & 0xFFFF
        packet = bytes((0x81, 0x80)) + struct.pack("<H", self.sent) + body
        packet += bytes(-len(packet) & 3)
        self._slots[self.sent % self._history] = packet
        return packet

    def take_acknack(self, first: int, bits: int) -> list[bytes]:
        """Take an ACKNACK; returns what is sent again."""
        last = (first - 1) & 0xFFFF
        freed = (last - self.acknowledged) & 0xFFFF
        if freed >= 0x8000:
            self.emptied += 1
        for number in range(min(freed, self._history)):
            self._slots.pop(((self.acknowledged + 1 + number) & 0xFFFF) % self._history, None)
        self.acknowledged = last
        self._heartbeat_at = None
        again: list[bytes] = []
        number = (last + 1) & 0xFFFF
        while bits and _compare(number, self.sent) <= 0:
            if (packet := self._slots.get(number % self._history)) is not None:
                again.append(packet)
            number = (number + 1) & 0xFFFF
        return again

    def run(self, now: float) -> bytes | None:
        """It is run, and looks whether to ask; returns the HEARTBEAT, if it is time for one."""
        if _compare(self.acknowledged, self.sent) >= 0:
            self._heartbeat_at = None
            return None
        is_due = self._heartbeat_at is not None and now >= self._heartbeat_at
        self._heartbeat_at = now + HEARTBEAT_S
        if not is_due:
            return None
        numbers = struct.pack("<HH", (self.acknowledged + 1) & 0xFFFF, self.sent)
        return _NO_KEY + bytes((0x0B, 1, 5, 0)) + numbers + b"\x80"


class StockInput:
    """Its reliable input stream 0x80."""

    def __init__(self, history: int) -> None:
        self._history = history
        self._held: dict[int, bytes] = {}
        self.handled = self.announced = 0xFFFF

    def take(self, packet: bytes) -> list[bytes]:
        """Take a message; returns the submessages of those that can be read now, each message on its own."""
        number = packet[2] | packet[3] << 8
        if 0 < (number - self.handled) & 0xFFFF <= self._history:
            self._held.setdefault(number, packet[4:])
        self.announce(number)
        ready: list[bytes] = []
        while (whole := self._next_whole()) is not None:
            ready.append(whole)
        return ready

    def announce(self, last: int) -> None:
        """Note a HEARTBEAT."""
        if _compare(self.announced, last) < 0:
            self.announced = last

    def acknack(self) -> bytes:
        """What it answers to each message and HEARTBEAT: held pieces count as received."""
        first = self.handled
        for index in range(1, self._history + 1):
            if (number := (self.handled + index) & 0xFFFF) not in self._held:
                first = number
                break
        bits = 0
        for index in range((self.announced - first + 1) & 0xFFFF):
            if index < 16 and (first + index) & 0xFFFF not in self._held:
                bits |= 1 << index
        return _NO_KEY + bytes((0x0A, 1, 5, 0)) + struct.pack("<H", first) + bits.to_bytes(2, "big") + b"\x80"

    def _next_whole(self) -> bytes | None:
        whole = b""
        number = self.handled
        while (body := self._held.get(number := (number + 1) & 0xFFFF)) is not None:
            is_piece = body[0] == 0x0D
            whole += body[4:] if is_piece else body
            if not is_piece or body[1] & 0x02:
                while self.handled != number:
                    self.handled = (self.handled + 1) & 0xFFFF
                    del self._held[self.handled]
                return whole
        return None
