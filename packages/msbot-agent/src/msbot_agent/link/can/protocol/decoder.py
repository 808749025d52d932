"""Frames of a CAN bus in words, for people who watch it: who sends what to whom, down to the DDS-XRCE message.

Theory of operation. A decoder is fed every frame of a bus, in order, and keeps for each node and direction what the
receiver keeps: a `FrameJoiner`. The caller supplies the meaning of a whole packet (`PacketExplainer`), because a link
does not know DDS-XRCE. A decoder that starts in the middle has not seen the ASSIGN that says whether headers are
compressed, so it tries both (the first octet distinguishes a short form from a message). Nothing here raises, whatever
the input.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Final, Protocol

from msbot_agent.link.can.protocol.frames import COUNTER, FIRST, LAST, MTU, Frame, FrameJoiner
from msbot_agent.link.can.protocol.ids import (
    CAN_FD,
    COMPRESSION,
    NOBODY,
    NODES,
    STARTING,
    Assign,
    CanIds,
    read_assign,
    read_beacon,
    read_join,
    read_question,
    read_stop,
    stop_words,
)
from msbot_agent.link.can.protocol.legacy_frames import DOWN, UP, LegacyJoiner
from msbot_xrce.counting import Tally
from msbot_xrce.errors import RemoteProtocolError

ERROR_CLASSES: Final = {
    0x01: "a frame was not sent in time",
    0x02: "arbitration lost",
    0x04: "controller problem",
    0x08: "protocol violation",
    0x10: "transceiver problem",
    0x20: "nobody acknowledged",
    0x40: "bus-off",
    0x80: "bus error",
    0x100: "restarted",
    0x200: "error counters changed",
}
"""Bits of the identifier of an error report (Linux, `can/error.h`)."""

FOREIGN: Final = "foreign"
_SESSION_ID: Final = 0x80
"""Uncompressed messages of our parts begin with at least this value."""
_CAPS = {CAN_FD: "CAN FD", COMPRESSION: "header compression"}


class PacketExplainer(Protocol):
    """Says what a packet means."""

    def __call__(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        """Lines of text for a packet from that peer to the master (`up`) or the other way."""


class CanDecoder:
    """Understands the bus of a robot (docs/reference/can.md)."""

    def __init__(
        self, explain: PacketExplainer, *, decompress: Callable[[bytes], bytes] | None = None, ids: CanIds | None = None
    ) -> None:
        """Begin to listen.

        Args:
            explain: says what a packet means.
            decompress: undoes header compression; raises RemoteProtocolError for octets that are not a short form.
            ids: identifier bases, when the bus is shared with other equipment.
        """
        self._explain = explain
        self._decompress = decompress
        self._ids = ids or CanIds()
        self._lanes: dict[tuple[int, bool], _NodeDirection] = {}
        self._use: dict[int, int] = {}

    def decode(self, frame: Frame, now: float) -> list[str]:
        """The meaning of a frame: a line for itself, and more if it completes a packet."""
        if words := report_words(frame):
            return [words]
        if not frame.extended:
            for base, up in ((self._ids.up, True), (self._ids.down, False)):
                if 0 < frame.can_id - base <= NODES:
                    return self._segment(frame, frame.can_id - base, now, up=up)
        return [self._joining_words(frame) or _stop(frame, self._ids) or FOREIGN]

    def _segment(self, frame: Frame, node: int, now: float, *, up: bool) -> list[str]:
        lane = self._lanes.get((node, up))
        if lane is None:
            lane = self._lanes[node, up] = _NodeDirection()
        words = f"node {node} to master" if up else f"master to node {node}"
        if frame.data:
            header = frame.data[0]
            words += f", {'S' * bool(header & FIRST)}{'E' * bool(header & LAST)}{header & COUNTER:3}"
        message = lane.joiner.receive(frame.data, now)
        if message is None:
            faults = lane.dropped.news()
            return [f"{words}: {', '.join(faults)}" if faults else words]
        packet, remark = self._unpack(message, node)
        first = f"{words}: {remark or _bytes(len(message))}"
        return [first, *self._explain(packet, node, up=up)] if packet else [first]

    def _unpack(self, message: bytes, node: int) -> tuple[bytes, str]:
        """The packet in a message, and words about its compression."""
        use = self._use.get(node)
        compressed = message[0] < _SESSION_ID if use is None else bool(use & COMPRESSION)
        if self._decompress is None or not compressed:
            return message, ""
        try:
            packet = self._decompress(message)
        except RemoteProtocolError as error:
            return (message, "") if use is None else (b"", str(error))
        return packet, "" if len(packet) == len(message) else f"{_bytes(len(message))} for {len(packet)}"

    def _joining_words(self, frame: Frame) -> str:
        ids = self._ids
        if join := read_join(frame, ids):
            uid, caps = join
            return f"JOIN: part {uid.hex()} asks for an address{_caps_words(', knows', caps)}"
        if assign := read_assign(frame, ids):
            return self._assigned(assign)
        if beacon := read_beacon(frame, ids):
            words = f"BEACON: robot {beacon.profile_hash:08x}, epoch {beacon.epoch}"
            return words + _caps_words(", offers", beacon.flags) + (", starts" if beacon.flags & STARTING else "")
        asking = read_question(frame, ids)
        return "" if asking is None else f"question: a master starts, robot {asking:08x}; is there one on this bus?"

    def _assigned(self, assign: Assign) -> str:
        node, uid = assign.node_id, assign.uid.hex()
        self._lanes.pop((node, True), None)
        self._lanes.pop((node, False), None)
        self._use.pop(node, None)
        if assign.uid == NOBODY:
            return f"ASSIGN: node {node} must ask again"
        if node == 0:
            return f"ASSIGN: no address for part {uid}"
        self._use[node] = assign.use
        return f"ASSIGN: part {uid} is node {node}, epoch {assign.epoch}{_caps_words(', with', assign.use)}"


class LegacyDecoder:
    """Understands the bus of the thesis' firmware: one component, one pair of identifiers (`legacy_frames.py`)."""

    def __init__(
        self, explain: PacketExplainer, is_whole: Callable[[bytes], bool], *, up: int = UP, down: int = DOWN
    ) -> None:
        """Begin to listen.

        Args:
            explain: says what a packet means.
            is_whole: whether octets are one message from its beginning to its end.
            up: identifier from the component to the master.
            down: identifier from the master to the component.
        """
        self._explain = explain
        self._ways = {
            down: _LegacyDirection(is_whole, "master to component"),
            up: _LegacyDirection(is_whole, "component to master"),
        }
        self._up = up

    def decode(self, frame: Frame, now: float) -> list[str]:
        """The meaning of a frame: a line for itself, and more if it completes a packet."""
        if words := report_words(frame):
            return [words]
        way = self._ways.get(frame.can_id)
        if way is None or frame.extended or frame.fd:
            return [_stop(frame, CanIds()) or FOREIGN]
        words = f"{way.words}, {frame.data[0]}" if frame.data else way.words
        packet = way.joiner.receive(frame.data, now)
        if packet is None:
            faults = way.dropped.news()
            return [f"{words}: {', '.join(faults)}" if faults else words]
        return [f"{words}: {_bytes(len(packet))}", *self._explain(packet, 0, up=frame.can_id == self._up)]


class _Dropped(Tally):
    """Drops by reason, and which of them are new."""

    def __init__(self) -> None:
        super().__init__()
        self._told: dict[str, int] = {}

    def news(self) -> list[str]:
        """The reasons that were counted since the last call."""
        news = [reason for reason, count in self.items() if count != self._told.get(reason)]
        self._told = dict(self)
        return news


class _LegacyDirection:
    """One of the two directions."""

    def __init__(self, is_whole: Callable[[bytes], bool], words: str) -> None:
        self.words = words
        self.dropped = _Dropped()
        self.joiner = LegacyJoiner(is_whole, dropped=self.dropped)


class _NodeDirection:
    """One node in one direction."""

    def __init__(self) -> None:
        self.dropped = _Dropped()
        self.joiner = FrameJoiner(MTU, dropped=self.dropped)


def report_words(frame: Frame) -> str:
    """Describes an error report of the controller, or a remote frame; empty for data frames."""
    if frame.error:
        classes = [words for bit, words in ERROR_CLASSES.items() if frame.can_id & bit]
        return f"error report: {', '.join(classes) or 'unknown'}"
    return f"{FOREIGN}: a remote frame" if frame.remote else ""


def _stop(frame: Frame, ids: CanIds) -> str:
    reason = read_stop(frame, ids)
    return "" if reason is None else f"STOP: {stop_words(reason)}"


def _caps_words(before: str, caps: int) -> str:
    words = [name for bit, name in _CAPS.items() if caps & bit]
    return f"{before} {' and '.join(words)}" if words else ""


def _bytes(number: int) -> str:
    return "1 byte" if number == 1 else f"{number} bytes"
