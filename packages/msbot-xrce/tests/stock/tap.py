"""Has a model of the stock client read everything that agents send to stock clients, in every test of the suite.

The agents' sessions are tapped where their packets leave for the link. What belongs to a session whose client said at
its login that it is one of ours is not looked at. A test fails, after it has run, on the first thing that a stock
client could not have read or would have been harmed by.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from unittest.mock import patch
from weakref import WeakKeyDictionary

from msbot_xrce.sessions.agent import AgentSession
from tests.stock.reading import ACKNACK, FRAGMENT, LAST_PIECE, complaints

_HALF = 0x8000


class StockEar:
    """What one stock client hears of its agent."""

    def __init__(self) -> None:
        self.complaints: list[str] = []
        self._pieces: dict[int, bytes] = {}
        self._newest: dict[int, int] = {}
        self._acknowledged: dict[int, int] = {}

    def hear(self, packet: bytes) -> None:
        """Take one packet in the order in which it was sent."""
        head = 4 if packet[0] >= 0x80 else 8
        stream_id, number, body = packet[1], packet[2] | packet[3] << 8, packet[head:]
        if stream_id >= 0x80:
            newest = self._newest.get(stream_id)
            if newest is not None and not 0 < (number - newest) & 0xFFFF < _HALF:
                return  # sent again, octet for octet
            self._newest[stream_id] = number
        if body[:1] == bytes((FRAGMENT,)) and stream_id >= 0x80:
            self._join(stream_id, body)
            return
        self._pieces.pop(stream_id, None)
        if len(body) > 4 and body[0] == ACKNACK:
            self._compare(body)
        self._say(packet, body)

    def _join(self, stream_id: int, body: bytes) -> None:
        joined = self._pieces.pop(stream_id, b"") + body[4:]
        if body[1] & LAST_PIECE:
            self._say(body, joined)
        else:
            self._pieces[stream_id] = joined

    def _compare(self, body: bytes) -> None:
        first, stream_id = body[4] | body[5] << 8, body[8]
        before = self._acknowledged.get(stream_id, first)
        self._acknowledged[stream_id] = first
        if (first - before) & 0xFFFF >= _HALF:
            self.complaints.append(f"ACKNACK from {first} after one from {before}: its history is emptied")

    def _say(self, packet: bytes, body: bytes) -> None:
        self.complaints += (f"{text} (packet {packet[:24].hex()}...)" for text in _complaints(body))


@cache
def _kept(body: bytes) -> tuple[str, ...]:
    return tuple(complaints(body))


def _complaints(body: bytes) -> tuple[str, ...]:
    # Short messages (ACKNACKs, HEARTBEATs) come again and again.
    return _kept(body) if len(body) <= 16 else tuple(complaints(body))


class Tap:
    """What was wrong since the last look."""

    def __init__(self) -> None:
        self._ears: WeakKeyDictionary[AgentSession, StockEar] = WeakKeyDictionary()
        self._found: list[str] = []

    def sent(self, session: AgentSession, packets: list[bytes]) -> None:
        """An agent's session gave these to its link."""
        if session.is_stock:
            ear = self._ears.get(session)
            if ear is None:
                ear = self._ears[session] = StockEar()
            for packet in packets:
                ear.hear(packet)
            if ear.complaints:
                self._found += ear.complaints
                ear.complaints = []

    def restarted(self, session: AgentSession) -> None:
        """The streams of that session start over: numbers begin anew."""
        self._ears.pop(session, None)

    def take(self) -> list[str]:
        """What was wrong since the last call."""
        found, self._found = self._found, []
        return found


@contextmanager
def tapped() -> Iterator[Tap]:
    """Listen to the sessions of all agents of this process."""
    tap = Tap()
    send, restart = AgentSession.packets_to_send, AgentSession._restart_streams

    def packets_to_send(self: AgentSession, now: float, limit: int | None = None) -> list[bytes]:
        packets = send(self, now, limit)
        if packets:
            tap.sent(self, packets)
        return packets

    def restart_streams(self: AgentSession, *args: object) -> None:
        tap.restarted(self)
        restart(self, *args)  # type: ignore[arg-type]

    with (
        patch.object(AgentSession, "packets_to_send", packets_to_send),
        patch.object(AgentSession, "_restart_streams", restart_streams),
    ):
        yield tap
