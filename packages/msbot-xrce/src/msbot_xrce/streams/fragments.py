"""Reassembles the pieces of a large submessage (XRCE 1.0 §8.3.5.14).

A submessage that does not fit into one message is cut into FRAGMENTs with consecutive numbers of one reliable stream;
they contain neither a length nor an offset, so the joiner must never see a gap: its owner clears it when a message is
given up, at RESET and at every login (seen on the wire: an agent that keeps half a message across a RESET spoils the
next one). Cutting is done by `ReliableOutput`, one piece at a time, so that a large sample is stored once.
"""

from __future__ import annotations

from msbot_xrce.sessions.counters import Memory, SessionCounters

TOO_LARGE = "fragmented message larger than allowed"


class FragmentJoiner:
    """Collects the pieces of one reliable stream."""

    __slots__ = ("_buffer", "_counters", "_memory", "_refused")

    def __init__(self, memory: Memory, counters: SessionCounters) -> None:
        self._memory = memory
        self._counters = counters
        self._buffer = bytearray()
        self._refused = False

    def add(self, piece: bytes, *, last: bool) -> bytes | None:
        """Take the next piece; returns the whole string of submessages if it was the last one, else None.

        A message that outgrows the memory is dropped as a whole, up to and including its last piece, and counted once.
        """
        if not self._refused:
            if self._memory.take(len(piece)):
                self._buffer += piece
            else:
                self._counters.dropped.count(TOO_LARGE)
                self.clear()
                self._refused = True
        if not last:
            return None
        whole = None if self._refused else bytes(self._buffer)
        self.clear()
        return whole

    def clear(self) -> None:
        """Forget what was collected."""
        if self._buffer:
            self._memory.give(len(self._buffer))
            self._buffer = bytearray()
        self._refused = False
