"""The queue before the bus: frames per peer, taken in turn, so that a long packet delays other peers by one frame.

It is bounded: packets for a peer are accepted until `limit` frames wait, so at most `limit - 1` frames and one more
packet wait. Urgent frames (STOP, BEACON, JOIN, ASSIGN) go before all others.
"""

from __future__ import annotations

from collections import deque

from msbot_agent.link.can.protocol.frames import Frame

QUEUE_FRAMES = 32
"""Frames that may wait for one peer before there is no room: 7 ms of a 500 kbit/s bus. With more, the streams above
would repeat messages that are still on their way."""
URGENT_FRAMES = 256
"""Urgent frames that may wait: two for each node of a full bus."""


class FrameQueue:
    """Frames that wait for the controller (see the module docstring)."""

    def __init__(self, limit: int = QUEUE_FRAMES) -> None:
        """Start empty; `limit` frames per peer."""
        self.roomy: list[int] = []
        """Peers that got room again since the owner last emptied this list."""
        self._limit = limit
        self._lanes: dict[int, deque[Frame]] = {}
        self._turns: deque[int] = deque()
        self._urgent: deque[Frame] = deque()

    @property
    def is_empty(self) -> bool:
        """Whether no frame waits."""
        return not (self._turns or self._urgent)

    def has_room(self, peer: int) -> bool:
        """Whether another packet for that peer is accepted now."""
        lane = self._lanes.get(peer)
        return lane is None or len(lane) < self._limit

    def put(self, peer: int, frames: list[Frame]) -> None:
        """Queue the frames of one packet; the caller has checked `has_room`."""
        lane = self._lanes.get(peer)
        if lane is None:
            lane = self._lanes[peer] = deque()
        if not lane:
            self._turns.append(peer)
        lane.extend(frames)

    def put_urgent(self, frame: Frame) -> bool:
        """Queue a frame before all packets; an equal one that still waits is enough. False: no room."""
        if frame in self._urgent:
            return True
        if len(self._urgent) >= URGENT_FRAMES:
            return False
        self._urgent.append(frame)
        return True

    def put_stop(self, frame: Frame, times: int) -> None:
        """Queue a frame several times before everything else, unless it is waiting already."""
        if frame not in self._urgent:
            self._urgent.extendleft([frame] * times)

    def next(self, *, urgent_only: bool = False) -> Frame | None:
        """Take the frame whose turn it is; with `urgent_only` leave the frames of packets where they are."""
        if self._urgent:
            return self._urgent.popleft()
        if urgent_only or not self._turns:
            return None
        peer = self._turns.popleft()
        lane = self._lanes[peer]
        frame = lane.popleft()
        if lane:
            self._turns.append(peer)
        if len(lane) == self._limit - 1:
            self.roomy.append(peer)
        return frame

    def clear(self, peer: int) -> int:
        """Forget the frames for a peer; returns how many there were."""
        lane = self._lanes.pop(peer, None)
        if not lane:
            return 0
        self._turns.remove(peer)
        if len(lane) >= self._limit:
            self.roomy.append(peer)
        return len(lane)

    def clear_all(self) -> int:
        """Forget everything; returns how many frames there were."""
        waiting = len(self)
        self.roomy += [peer for peer, lane in self._lanes.items() if len(lane) >= self._limit]
        self._lanes.clear()
        self._turns.clear()
        self._urgent.clear()
        return waiting

    def __len__(self) -> int:
        """Frames that wait."""
        return len(self._urgent) + sum(map(len, self._lanes.values()))
