"""The CAN framing of the thesis' firmware, bit by bit as it was, with a receiver that is more careful.

Theory of operation (thesis 4.2.5). A message is cut into pieces of 7 bytes; byte 0 of a frame counts down from the
number of pieces minus one to 0, which marks the last. 24 bytes are 4 frames with 3, 2, 1, 0 and DLC 8, 8, 8, 4. There
is no mark for the first frame, no length, no checksum, and one pair of identifiers for all.

The original receiver did not even compare the count: a lost frame gave a wrong message, a lost last frame glued two
together. This one does. After a frame that does not fit, it skips to the end of the message. A complete message must
then also pass `is_whole`, because a message without its first frames counts down like a shorter one. One weakness of
the format remains: if exactly as many frames in a row are lost as the next message has, the head of one and the tail of
the other fit together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot_agent.link.can.protocol.frames import EMPTY_FRAME, FRAME_LOST, REPEAT_S, REPEATED, TOO_SLOW
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError

MAX_FRAMES: Final = 256
MTU: Final = 7 * MAX_FRAMES
"""1792 bytes; the original announced more, and delivered nonsense above this."""
UP: Final = 0x123
"""Identifier from the component to the master (thesis 4.2.5)."""
DOWN: Final = 0x120
TIMEOUT_S: Final = 2.0
"""Longest pause inside a message; the original waits 0.5 s before every frame."""

SHORT_FRAME: Final = "a frame that is not the last of its message is not full"
NOT_WHOLE: Final = "message without its first frames, or of two in one"


def split_legacy(packet: bytes) -> list[bytes]:
    """The data fields of the frames of a packet.

    Raises:
        LocalProtocolError: it is empty, or longer than 1792 bytes.
    """
    if not packet:
        raise LocalProtocolError("an empty packet cannot be sent on CAN")
    if len(packet) > MTU:
        raise LocalProtocolError(
            f"a packet of {len(packet)} bytes: the CAN framing of the thesis takes at most {MTU} "
            f"({MAX_FRAMES} frames of 7 bytes); use the native mode for longer ones"
        )
    count = (len(packet) + 6) // 7
    return [bytes((count - 1 - i,)) + packet[7 * i : 7 * i + 7] for i in range(count)]


class LegacyJoiner:
    """Puts the frames of one direction together; counts what it drops by reason in words."""

    def __init__(self, is_whole: Callable[[bytes], bool], *, dropped: Tally, repeat_s: float = REPEAT_S) -> None:
        """Start without a message in progress.

        Args:
            is_whole: whether octets are one message from its beginning to its end.
            dropped: where drops are counted; shared with the link's counters.
            repeat_s: a frame equal to the previous one within this time is CAN's own repetition.
        """
        self._is_whole = is_whole
        self._dropped = dropped
        self._repeat_s = repeat_s
        self._parts: list[bytes] = []
        self._expected: int | None = None
        """Count of the next frame of the message in progress."""
        self._skipping = False
        """Whether the rest of a dropped message is being skipped."""
        self._last = b""
        self._at = float("-inf")

    def receive(self, data: bytes, now: float) -> bytes | None:
        """Take the data field of one frame; returns the packet it completes, if any."""
        if not data:
            self._dropped.count(EMPTY_FRAME)
            return None
        pause_s, self._at = now - self._at, now
        if data == self._last and pause_s < self._repeat_s:
            self._dropped.count(REPEATED)
            return None
        self._last = data
        if pause_s > TIMEOUT_S:
            self._forget_overdue()
        index = data[0]
        if self._skipping:
            self._skipping = index > 0
            return None
        return self._take(index, data)

    def _take(self, index: int, data: bytes) -> bytes | None:
        if self._expected is not None and index != self._expected:
            self._drop(FRAME_LOST, index)
            return None
        if index and len(data) < 8:
            self._drop(SHORT_FRAME, index)
            return None
        self._parts.append(data[1:])
        self._expected = index - 1
        if index:
            return None
        packet, self._parts, self._expected = b"".join(self._parts), [], None
        if self._is_whole(packet):
            return packet
        self._dropped.count(NOT_WHOLE)
        return None

    def _forget_overdue(self) -> None:
        if self._expected is not None:
            self._drop(TOO_SLOW, 0)
        self._skipping = False

    def _drop(self, reason: str, index: int) -> None:
        self._parts, self._expected = [], None
        self._skipping = index > 0
        self._dropped.count(reason)
