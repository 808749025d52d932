"""The addresses of a CAN bus beside a second model, written from docs/reference/can.md, "Joining".

The model is a list of lines, one for each part that has an address or is remembered with one. It asks at each step what
the page says, in the page's order, and knows nothing of how `MasterJoin` finds it. The bus has three addresses here, so
that it is full most of the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from unittest import mock

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from msbot_agent.link.can.protocol import join_master
from msbot_agent.link.can.protocol.ids import NOBODY, Assign, MemoryNodeIds, join_frame, read_assign
from msbot_agent.link.can.protocol.join_master import (
    LISTEN_S,
    MasterJoin,
    NodeEvicted,
    NodeJoined,
    NodeRefused,
)
from tests.effort import tries
from tests.link.joining import HASH, IDS, uid

ADDRESSES = 3
CAPS = 3
parts = st.integers(1, 6)
addresses = st.integers(1, ADDRESSES)


@dataclass
class Line:
    """A part and its address."""

    part: int
    address: int
    is_known: bool = False
    """Whether it has ever sent data from there: its address is remembered."""
    is_here: bool = False
    """Whether it has the address now, in this epoch."""
    since: float = 0.0
    """When it got the address, in this epoch."""
    heard: float = float("-inf")
    """When it was last heard, in this epoch."""
    use: int = 0
    has_sent: bool = False
    """Whether it has sent data since it last joined."""
    confirmed: int = 0
    """The order in which remembered addresses were given or confirmed."""


class Page:
    """What the page says."""

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.now = 20.0
        self.confirmations = 0

    def at(self, address: int) -> Line | None:
        """Who has that address now."""
        return next((line for line in self.lines if line.is_here and line.address == address), None)

    def candidates(self, part: int) -> set[int]:
        """The addresses that a JOIN may be answered with; none: the part is refused."""
        mine = {line.address for line in self.lines if line.part == part}
        ever_had = {line.address for line in self.lines}
        newcomers = [line for line in self.lines if not line.is_known and self.now - line.since > 1.0]
        known = [line for line in self.lines if line.is_known and self._may_be_given_away(line)]
        if mine:
            return mine
        if len(ever_had) < ADDRESSES:
            return set(range(1, ADDRESSES + 1)) - ever_had
        if newcomers:
            first = min(line.since for line in newcomers)
            return {line.address for line in newcomers if line.since == first}
        if not known:
            return set()
        longest = min(line.heard for line in known)
        silent = [line for line in known if line.heard == longest]
        if longest == float("-inf"):  # nobody knows how long they are silent: the oldest address goes first
            silent = [min(silent, key=lambda line: line.confirmed)]
        return {line.address for line in silent}

    def _may_be_given_away(self, line: Line) -> bool:
        other = self.at(line.address)
        if other is not None and other is not line:
            return False  # a newcomer has it now
        return self.now - line.heard > 10.0

    def give(self, part: int, address: int, use: int) -> list[object]:
        """The part has this address from now on; returns what the owner is told."""
        told: list[object] = []
        holder = self.at(address)
        mine = next((line for line in self.lines if line.part == part), None)
        if holder is not None and holder.part != part:
            told.append(NodeEvicted(address, uid(holder.part)))
            self._leave(holder)
        if mine is None:
            mine = Line(part, address)
            self.lines.append(mine)
        if mine.is_here and mine.use == use and not mine.has_sent:
            mine.heard = self.now
            return told  # it has asked again before it heard the answer
        if not mine.is_here:
            mine.since = self.now
        mine.is_here, mine.heard, mine.use, mine.has_sent = True, self.now, use, False
        if mine.is_known:
            self._confirm(mine)
        return [*told, NodeJoined(address, uid(part), use)]

    def data(self, address: int) -> None:
        """Data comes from who has that address."""
        line = self.at(address)
        assert line is not None
        line.heard = self.now
        line.has_sent = True
        if not line.is_known:
            line.is_known = True
            self.lines = [other for other in self.lines if other is line or other.address != address]
            self._confirm(line)

    def master_restarts(self) -> None:
        """Nobody has an address; who has sent data is remembered."""
        for line in list(self.lines):
            line.heard = float("-inf")
            self._leave(line)

    def _leave(self, line: Line) -> None:
        line.is_here = line.has_sent = False
        if not line.is_known:
            self.lines.remove(line)

    def _confirm(self, line: Line) -> None:
        self.confirmations += 1
        line.confirmed = self.confirmations


class JoinMachine(RuleBasedStateMachine):
    """Parts join, speak and fall silent in any order, and the master starts again."""

    def __init__(self) -> None:
        super().__init__()
        self.page = Page()
        self.node_ids = MemoryNodeIds()
        self.taken_back: dict[int, float] = {}
        self.starts = 0
        self.patch = mock.patch.object(join_master, "NODES", ADDRESSES)
        self.patch.start()

    def teardown(self) -> None:
        self.patch.stop()

    @initialize()
    def master_starts(self) -> None:
        self.starts += 1
        self.taken_back.clear()
        self.join = MasterJoin(self.node_ids, profile_hash=HASH, random=Random(self.starts), caps=CAPS)
        self.join.start(self.page.now - 2 * LISTEN_S)
        self.join.handle_timer(self.join.timer() or 0.0)
        self.join.take_frames()

    @rule()
    def master_starts_again(self) -> None:
        self.page.master_restarts()
        self.master_starts()

    @rule(seconds=st.sampled_from([0.03, 0.07, 0.4, 0.7, 3.0, 7.0]))
    def time_passes(self, seconds: float) -> None:
        self.page.now += seconds

    @rule(part=parts, caps=st.integers(0, CAPS))
    def part_joins(self, part: int, caps: int) -> None:
        allowed = self.page.candidates(part)
        told = self.join.receive(join_frame(uid(part), caps, IDS), self.page.now)
        (frame,) = self.join.take_frames()
        answer = read_assign(frame, IDS)
        assert answer is not None
        assert (answer.uid, answer.epoch) == (uid(part), self.join.epoch)
        if not allowed:
            assert answer.node_id == answer.use == 0
            assert told == [NodeRefused(uid(part))]
            return
        assert answer.node_id in allowed
        assert answer.use == caps
        assert told == self.page.give(part, answer.node_id, caps)

    @rule(address=addresses)
    def data_comes(self, address: int) -> None:
        now = self.page.now
        if self.page.at(address) is not None:
            member = self.join.members[address]
            member.heard_at = now  # the link does both
            if not member.spoke:
                self.join.claim_address(address)
            self.page.data(address)
            return
        self.join.stranger(address, now)
        due = now - self.taken_back.get(address, float("-inf")) >= 0.1
        back = [Assign(NOBODY, address, self.join.epoch, 0)] if due else []
        assert [read_assign(frame, IDS) for frame in self.join.take_frames()] == back
        if due:
            self.taken_back[address] = now

    @precondition(lambda self: self.page.lines)
    @rule(data=st.data())
    def all_but_one_go_on_sending(self, data: st.DataObject) -> None:
        here = [line.address for line in self.page.lines if line.is_here]
        quiet = data.draw(st.sampled_from([0, *here]))
        for address in here:
            if address != quiet:
                self.data_comes(address)

    @invariant()
    def the_table_is_that_of_the_page(self) -> None:
        here = {line.address: (uid(line.part), line.use) for line in self.page.lines if line.is_here}
        assert {address: (member.uid, member.use) for address, member in self.join.members.items()} == here
        known = {line.part: line.address for line in self.page.lines if line.is_known}
        assert {part: self.node_ids.find(uid(part)) for part in range(1, 10)} == {
            part: known.get(part) for part in range(1, 10)
        }


JoinMachine.TestCase.settings = settings(max_examples=tries(60, 3000), stateful_step_count=50, deadline=None)
TestJoining = JoinMachine.TestCase
