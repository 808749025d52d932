"""The queue before a CAN bus beside a second model, written from docs/reference/can.md, "Sending".

The model keeps all that waits in one list and looks through it at each step. Who is next: of the peers that have
something waiting, the one that was served, or began to wait, longest ago.
"""

from __future__ import annotations

from unittest.mock import patch

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from msbot_agent.link.can.protocol import frame_queue
from msbot_agent.link.can.protocol.frame_queue import FrameQueue
from msbot_agent.link.can.protocol.frames import Frame
from tests.effort import tries

LIMIT = 4
URGENT_FRAMES = 12
"""Few, because the model looks through all of them at each step."""
peers = st.integers(1, 4)


class QueueMachine(RuleBasedStateMachine):
    """Packets and urgent frames come, frames go, peers leave, the bus goes down."""

    def __init__(self) -> None:
        super().__init__()
        self.few_urgent = patch.object(frame_queue, "URGENT_FRAMES", URGENT_FRAMES)
        self.few_urgent.start()
        self.queue = FrameQueue(LIMIT)
        self.waiting: list[tuple[int, Frame]] = []
        self.urgent: list[Frame] = []
        self.since: dict[int, int] = {}
        self.steps = self.number = 0
        self.told: set[int] = set()
        """Peers that were refused, and must be named when they have room."""

    def teardown(self) -> None:
        self.few_urgent.stop()

    def of(self, peer: int) -> list[Frame]:
        return [frame for to, frame in self.waiting if to == peer]

    @rule(peer=peers, count=st.integers(1, 12))
    def a_packet_comes(self, peer: int, count: int) -> None:
        assert self.queue.has_room(peer) == (len(self.of(peer)) < LIMIT)
        if not self.queue.has_room(peer):
            self.told.add(peer)
            return
        if not self.of(peer):
            self.steps += 1
            self.since[peer] = self.steps
        frames = [Frame(peer, (self.number + index).to_bytes(4, "big")) for index in range(count)]
        self.number += count
        self.waiting += [(peer, frame) for frame in frames]
        self.queue.put(peer, frames)

    @rule(kind=st.integers(0, 9), count=st.sampled_from([1, 1, 1, URGENT_FRAMES]))
    def urgent_frames_come(self, kind: int, count: int) -> None:
        for index in range(count):
            frame = Frame(0x100 + kind, index.to_bytes(2, "big"))
            fits = frame in self.urgent or len(self.urgent) < URGENT_FRAMES
            assert self.queue.put_urgent(frame) == fits
            if fits and frame not in self.urgent:
                self.urgent.append(frame)

    @rule(reason=st.integers(0, 2))
    def stop(self, reason: int) -> None:
        frame = Frame(8, bytes([reason]))
        self.queue.put_stop(frame, 3)
        if frame not in self.urgent:
            self.urgent[:0] = [frame] * 3

    @rule(count=st.integers(1, 20), urgent_only=st.booleans())
    def the_bus_takes_frames(self, count: int, urgent_only: bool) -> None:
        for _ in range(count):
            if self.urgent:
                expected: Frame | None = self.urgent.pop(0)
            elif urgent_only or not self.waiting:
                expected = None
            else:
                peer = min({to for to, _ in self.waiting}, key=lambda peer: self.since[peer])
                expected = self.of(peer)[0]
                self.waiting.remove((peer, expected))
                self.steps += 1
                self.since[peer] = self.steps
            assert self.queue.next(urgent_only=urgent_only) == expected

    @rule(peer=peers)
    def a_peer_leaves(self, peer: int) -> None:
        assert self.queue.clear(peer) == len(self.of(peer))
        self.waiting = [(to, frame) for to, frame in self.waiting if to != peer]

    @rule()
    def the_bus_goes_down(self) -> None:
        assert self.queue.clear_all() == len(self.waiting) + len(self.urgent)
        self.waiting.clear()
        self.urgent.clear()

    @rule()
    def those_with_room_are_told(self) -> None:
        """Each is named once, and whoever was refused and has room now is among them."""
        named, self.queue.roomy = self.queue.roomy, []
        waiting_for_it = {peer for peer in self.told if len(self.of(peer)) < LIMIT}
        assert waiting_for_it <= set(named)
        self.told -= waiting_for_it

    @invariant()
    def as_much_waits_as_should(self) -> None:
        assert len(self.queue) == len(self.waiting) + len(self.urgent)
        assert all(self.queue.has_room(peer) == (len(self.of(peer)) < LIMIT) for peer in range(1, 5))


QueueMachine.TestCase.settings = settings(max_examples=tries(60, 3000), stateful_step_count=50, deadline=None)
TestQueue = QueueMachine.TestCase
