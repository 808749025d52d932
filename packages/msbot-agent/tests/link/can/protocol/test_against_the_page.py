"""Segments beside a second model, written from docs/reference/can.md alone: the same frames into both."""

from __future__ import annotations

from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from msbot_agent.link.can.protocol.frames import FrameJoiner, split
from msbot_xrce.counting import Tally
from tests.effort import tries
from tests.link.can.protocol.spec_segments import SpecReceiver, spec_segments

NODES = 3
LONGEST = 200
"""Octets of a message: small, so that it is met."""
REPEAT_S = 0.005

nodes = st.integers(0, NODES - 1)
kinds = st.booleans()


@settings(max_examples=tries(150, 5000))
@given(st.binary(min_size=1, max_size=700), st.integers(0, 63), kinds)
def test_what_is_sent_is_what_the_page_says(message: bytes, counter: int, fd: bool) -> None:
    assert split(message, counter, fd) == spec_segments(message, counter, fd=fd)


class SegmentMachine(RuleBasedStateMachine):
    """Several nodes send on a bus that loses, repeats, delays and reorders their frames and puts others between."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0
        self.counters = [60] * NODES
        """Just before the wrap."""
        self.tally, self.counted = Tally(), Counter[str]()
        self.ours = [FrameJoiner(LONGEST, dropped=self.tally, repeat_s=REPEAT_S) for _ in range(NODES)]
        self.spec = [SpecReceiver(LONGEST, REPEAT_S, self.counted) for _ in range(NODES)]
        self.waiting: list[list[bytes]] = [[] for _ in range(NODES)]
        self.past: list[list[bytes]] = [[] for _ in range(NODES)]

    def hear(self, node: int, frame: bytes) -> None:
        self.past[node] = [*self.past[node][-99:], frame]
        assert self.ours[node].receive(frame, self.now) == self.spec[node].hear(frame, self.now)

    @rule(node=nodes, size=st.integers(1, LONGEST + 20), octet=st.integers(0, 255), fd=kinds)
    def a_message_is_queued(self, node: int, size: int, octet: int, fd: bool) -> None:
        """What is sent while others send; a long message that the link does not allow among them."""
        message = bytes((octet + 7 * place) % 256 for place in range(size))
        frames = spec_segments(message, self.counters[node], fd=fd)
        self.counters[node] = (self.counters[node] + len(frames)) % 64
        self.waiting[node] += frames

    @rule(turns=st.lists(nodes, min_size=1, max_size=40), step=st.sampled_from([0.0, 0.0002, 0.002]))
    def frames_pass_interleaved(self, turns: list[int], step: float) -> None:
        for node in turns:
            if self.waiting[node]:
                self.now += step
                self.hear(node, self.waiting[node].pop(0))

    @rule(node=nodes)
    def all_frames_of_a_node_pass(self, node: int) -> None:
        while self.waiting[node]:
            self.now += 0.0003
            self.hear(node, self.waiting[node].pop(0))

    @rule(node=nodes, at=st.integers(0, 3), count=st.sampled_from([1, 1, 1, 2, 3, 63, 64, 65]))
    def frames_are_lost(self, node: int, at: int, count: int) -> None:
        del self.waiting[node][at : at + count]

    @rule(node=nodes)
    def so_many_frames_are_lost_that_the_counter_fits(self, node: int) -> None:
        del self.waiting[node][1:65]

    @rule(node=nodes, back=st.integers(1, 70), pause=st.sampled_from([0.0, 0.001, 0.02]))
    def a_frame_is_repeated(self, node: int, back: int, pause: float) -> None:
        if len(self.past[node]) >= back:
            self.now += pause
            self.hear(node, self.past[node][-back])

    @rule(node=nodes, at=st.integers(0, 3), to=st.integers(0, 3))
    def frames_change_places(self, node: int, at: int, to: int) -> None:
        row = self.waiting[node]
        if max(at, to) < len(row):
            row[at], row[to] = row[to], row[at]

    @rule(node=nodes, at=st.integers(0, 3), place=st.integers(0, 63), octet=st.integers(0, 255))
    def an_octet_is_changed(self, node: int, at: int, place: int, octet: int) -> None:
        row = self.waiting[node]
        if at < len(row) and place < len(row[at]):
            row[at] = row[at][:place] + bytes([octet]) + row[at][place + 1 :]

    @rule(node=nodes, at=st.integers(0, 3), size=st.integers(0, 9))
    def a_frame_is_cut(self, node: int, at: int, size: int) -> None:
        row = self.waiting[node]
        if at < len(row):
            row[at] = row[at][:size]

    @rule(
        node=nodes,
        frame=st.binary(max_size=8)
        | st.sampled_from([12, 64]).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
    )
    def somebody_else_uses_the_identifier(self, node: int, frame: bytes) -> None:
        self.hear(node, frame)

    @rule(node=nodes)
    def a_node_starts_again(self, node: int) -> None:
        """Its new address is a new wire."""
        self.counters[node], self.waiting[node], self.past[node] = 0, [], []
        self.ours[node].reset()
        self.spec[node] = SpecReceiver(LONGEST, REPEAT_S, self.counted)

    @rule(seconds=st.sampled_from([0.001, 0.006, 0.1, 0.24, 0.26, 5.0]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds

    @invariant()
    def the_same_is_counted(self) -> None:
        assert dict(self.tally) == dict(self.counted)


SegmentMachine.TestCase.settings = settings(max_examples=tries(60, 5000), stateful_step_count=40)
test_segments_beside_the_model = SegmentMachine.TestCase
