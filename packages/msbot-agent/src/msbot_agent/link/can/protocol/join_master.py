"""The master's side of joining: who gets which address, and the beacon.

Theory of operation. A JOIN is answered at once: a known UID gets the address it had; a new one gets an address that was
never used, or else that of the part that was silent for longest. An address is remembered for a part once the part has
sent data, so asking for addresses, however often, never uses up the one that a known part will come back to. The beacon
says each second that the master is there, in which epoch and for which robot. Pure: frames and times in, frames and
events out.

A bus has one master. A master that starts first asks, with a frame that parts ignore, whether another one is there, and
says nothing else until it has listened for the answer: a beacon of a new epoch would throw every part off its address.
The answer can be lost, and two can listen at once. So a master that has just started says so in its beacons, and ends
when it hears one that was there before; of two that start at once, the one with the smaller (epoch, profile hash)
stays. The one that stays answers at once, so that the other one hears it. A master past its start never ends because of
another one's frames: any node can send those.
"""

from __future__ import annotations

from dataclasses import field
from random import Random
from typing import Final

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import (
    EPOCHS,
    NOBODY,
    NODES,
    STARTING,
    Assign,
    Beacon,
    CanIds,
    NodeIds,
    assign_frame,
    beacon_frame,
    question_frame,
    read_beacon,
    read_join,
    read_question,
)
from msbot_xrce.lazy import dataclass

BEACON_PERIOD_S: Final = 1.0
LISTEN_S: Final = 0.2
"""How long a starting master listens after its question has left the controller, or waits for that. A running one
answers at once."""
STARTING_S: Final = 1.5
"""How long a master counts as starting after its first beacon has left the controller; until then another one's beacon
ends it. A running master answers ours at once, so this is ample."""
HEARD_S: Final = 0.3
"""A master that was on the bus for this long was there before one that says it is starting."""
SILENT_S: Final = 10.0
"""A node that was silent for this long may lose its address to a newcomer. Longer than `BEACON_TIMEOUT_S`: a part that
cannot hear the master has given up its address by then."""
UNPROVEN_S: Final = 1.0
"""A newcomer that has not sent any data for this long may lose its address to the next one."""
REPEAT_S: Final = 0.1
"""Shortest time between two answers: beacons to other masters, or take-backs of one address."""


@dataclass(frozen=True, slots=True)
class NodeJoined:
    """A part has got an address, for the first time or again after a restart."""

    node_id: int
    uid: bytes
    use: int


@dataclass(frozen=True, slots=True)
class NodeEvicted:
    """A silent part has lost its address to a newcomer."""

    node_id: int
    uid: bytes


@dataclass(frozen=True, slots=True)
class NodeRefused:
    """A part was refused because every address is held by a live part."""

    uid: bytes


@dataclass(frozen=True, slots=True)
class OtherMaster:
    """A second master is on this bus; `fatal` if this one was still starting and must give way."""

    profile_hash: int
    fatal: bool
    at_once: bool = False
    """Whether both were starting."""


MasterEvent = NodeJoined | NodeEvicted | NodeRefused | OtherMaster


@dataclass(slots=True)
class JoinedPart:
    """A part that has an address in this epoch."""

    uid: bytes
    use: int
    heard_at: float
    """When its last frame came; set by the link, which sees the data frames. Of a newcomer that has sent no data: when
    it got its address, however often it has asked since."""
    spoke: bool = False
    """Whether it has sent data since it joined: another JOIN then means that it has restarted."""


@dataclass(slots=True)
class MasterJoin:
    """The master's side of joining."""

    node_ids: NodeIds
    profile_hash: int
    random: Random
    """Source of the epoch."""
    caps: int = 0
    ids: CanIds = field(default_factory=CanIds)
    members: dict[int, JoinedPart] = field(default_factory=dict, init=False)
    """By node id."""
    epoch: int = field(default=0, init=False)
    _outbox: list[Frame] = field(default_factory=list, init=False)
    _is_listening: bool = field(default=False, init=False)
    """It has asked whether it is alone, and says nothing until it knows."""
    _has_asked: bool = field(default=False, init=False)
    """The question has left the controller."""
    _first_sent_at: float | None = field(default=None, init=False)
    """When the first beacon was on the bus; while nobody else is there, it waits in the controller."""
    _answered_at: float = field(default=-REPEAT_S, init=False)
    _beacon_due: float | None = field(default=None, init=False)
    _taken_back_at: dict[int, float] = field(default_factory=dict, init=False)

    def start(self, now: float) -> None:
        """Begin a new epoch, in which no part has an address; the first BEACON comes when no other master answers."""
        self.epoch = self.random.randrange(EPOCHS)
        self.members.clear()
        self._taken_back_at.clear()
        self._first_sent_at = None
        self._ask(now)

    def resume(self, now: float) -> None:
        """Go on in the same epoch after a time off the bus: parts that still wait for a beacon need not join again."""
        if self._is_listening:
            self._ask(now)
        else:
            self._send_beacon(now)

    def receive(self, frame: Frame, now: float) -> list[MasterEvent]:
        """Take a frame that is not a data frame; anything but JOIN, BEACON and another master's question is ignored."""
        join = read_join(frame, self.ids)
        if join is not None:
            return [] if self._is_listening else self._admit(*join, now)
        asking = read_question(frame, self.ids)
        if asking is not None:
            return self._asked(asking, now)
        beacon = read_beacon(frame, self.ids)
        if beacon is None:
            return []
        return [self._meet(beacon, now)]

    @property
    def is_listening(self) -> bool:
        """Whether it has asked if another master is there, and does not know yet."""
        return self._is_listening

    def sent(self, now: float) -> bool:
        """Note that all frames have left the controller; True: the timer has changed, as the question was among them.

        A question that nobody acknowledges stays in the controller: then there is no other node, and no need to wait.
        """
        if self._is_listening and not self._has_asked:
            self._has_asked = True
            self._beacon_due = now + LISTEN_S
            return True
        if not self._is_listening and self._first_sent_at is None:
            self._first_sent_at = now
        return False

    def stranger(self, node_id: int, now: float) -> None:
        """Data came from an address that was not given in this epoch: take it back, so that the part joins again."""
        if not self._is_listening and now - self._taken_back_at.get(node_id, -REPEAT_S) >= REPEAT_S:
            self._taken_back_at[node_id] = now
            self._outbox.append(assign_frame(Assign(NOBODY, node_id, self.epoch, 0), self.ids))

    def claim_address(self, node_id: int) -> None:
        """A part has sent its first data since it joined: it owns the address from now on."""
        member = self.members[node_id]
        member.spoke = True
        if self.node_ids.find(member.uid) != node_id:
            self.node_ids.assign(node_id, member.uid)

    def take_frames(self) -> list[Frame]:
        """The frames to be sent now."""
        frames, self._outbox = self._outbox, []
        return frames

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called."""
        return self._beacon_due

    def handle_timer(self, now: float) -> None:
        """Send the beacon when it is time."""
        if self._beacon_due is not None and now >= self._beacon_due:
            self._send_beacon(now)

    def _is_starting(self, now: float) -> bool:
        return self._first_sent_at is None or now - self._first_sent_at < STARTING_S

    def _asked(self, profile_hash: int, now: float) -> list[MasterEvent]:
        """Another master asks whether it is alone: it would not hear one that only starts, so this one has started."""
        if self._first_sent_at is None:
            return []
        self._first_sent_at = min(self._first_sent_at, now - STARTING_S)
        self._answer_master(now)
        return [OtherMaster(profile_hash, fatal=False)]

    def _meet(self, beacon: Beacon, now: float) -> OtherMaster:
        """Another master is on the bus: end, or stay and answer it."""
        if not self._is_starting(now):
            self._answer_master(now)
            return OtherMaster(beacon.profile_hash, fatal=False)
        if not beacon.flags & STARTING:
            return OtherMaster(beacon.profile_hash, fatal=True)
        was_first = self._first_sent_at is not None and now - self._first_sent_at >= HEARD_S
        if was_first:
            self._first_sent_at = now - STARTING_S  # that one does not hear a master that is only starting
        elif (beacon.epoch, beacon.profile_hash) <= (self.epoch, self.profile_hash):
            return OtherMaster(beacon.profile_hash, fatal=True, at_once=True)
        self._send_beacon(now)
        return OtherMaster(beacon.profile_hash, fatal=False)

    def _answer_master(self, now: float) -> None:
        # Not counted from the last beacon: if both were sent at once, the other one may not have heard ours.
        if now - self._answered_at >= REPEAT_S:
            self._answered_at = now
            self._send_beacon(now)

    def _ask(self, now: float) -> None:
        self._is_listening, self._has_asked = True, False
        self._beacon_due = now + LISTEN_S
        self._outbox.append(question_frame(self.profile_hash, self.ids))

    def _send_beacon(self, now: float) -> None:
        self._is_listening = False
        self._beacon_due = now + BEACON_PERIOD_S
        flags = self.caps | (STARTING if self._is_starting(now) else 0)
        self._outbox.append(beacon_frame(Beacon(flags, self.epoch, self.profile_hash), self.ids))

    def _admit(self, uid: bytes, caps: int, now: float) -> list[MasterEvent]:
        node_id = self._address(uid, now)
        use = caps & self.caps
        self._outbox.append(assign_frame(Assign(uid, node_id or 0, self.epoch, use if node_id else 0), self.ids))
        if node_id is None:
            return [NodeRefused(uid)]
        events: list[MasterEvent] = []
        member = self.members.get(node_id)
        is_known = self.node_ids.find(uid) is not None
        heard_at = member.heard_at if member is not None and member.uid == uid and not is_known else now
        if member is not None and member.uid == uid and member.use == use and not member.spoke:
            member.heard_at = heard_at
            return events  # the same JOIN again: our answer was still on its way
        if member is not None and member.uid != uid:
            events.append(NodeEvicted(node_id, member.uid))
        if is_known:
            self.node_ids.assign(node_id, uid)
        self.members[node_id] = JoinedPart(uid, use, heard_at)
        return [*events, NodeJoined(node_id, uid, use)]

    def _address(self, uid: bytes, now: float) -> int | None:
        """The address for a part: its own, else a fresh one, that of an unproven newcomer, or the one unused for
        longest.

        None = all are held by live parts, or by newcomers of the last second.
        """
        own = self.node_ids.find(uid)
        if own is not None:
            return own
        unproven = {n: member for n, member in self.members.items() if self.node_ids.find(member.uid) is None}
        for node_id, member in unproven.items():
            if member.uid == uid:
                return node_id
        taken = self.node_ids.oldest_first()
        held = {*taken, *self.members}
        fresh = next((node_id for node_id in range(1, NODES + 1) if node_id not in held), None)
        if fresh is not None:
            return fresh
        idle = [n for n, member in unproven.items() if now - member.heard_at > UNPROVEN_S]
        if idle:
            return min(idle, key=lambda n: unproven[n].heard_at)
        silent = [
            n
            for n in taken
            if n not in unproven and (n not in self.members or now - self.members[n].heard_at > SILENT_S)
        ]
        never = float("-inf")
        return min(silent, key=lambda n: self.members[n].heard_at if n in self.members else never, default=None)
