"""Addresses that nobody types: how a part gets its node id (`ComponentJoin`) and a master gives it (`MasterJoin`).

Theory of operation. A part says JOIN with its UID, again after 10, 20, 40, ... ms (at most 1 s, +-25 % at random)
until an ASSIGN with its UID comes. The master says BEACON each second; in it stands the `epoch`, drawn anew whenever
a master starts, so that a part notices a restart and joins again at once.

====================  =======================================  ====================================================
part's state          goes to                                  when
====================  =======================================  ====================================================
JOINING               JOINED                                   ASSIGN with its UID and an address
JOINED                JOINING                                  another epoch; no beacon for 3.5 s; address given away
JOINING, JOINED       FOREIGN (says nothing)                   beacon of another robot's master
FOREIGN               JOINING                                  beacon of its own robot; no beacon for 3.5 s
====================  =======================================  ====================================================

Both machines are pure: frames and times in, frames and events out. `take_frames` gives what is to be sent; the part's
back-off starts when its JOIN has really left (`sent`), so a loaded bus is not loaded further by repetitions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import Final

from msbot.link.can_frames import Frame
from msbot.link.can_ids import (
    EPOCHS,
    NOBODY,
    NODES,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    check_uid,
    join_frame,
    read_assign,
    read_beacon,
    read_join,
)
from msbot.link.can_nodes import NodeIds

BEACON_PERIOD_S: Final = 1.0
BEACON_TIMEOUT_S: Final = 3.5
"""Without a beacon for this long a part has lost its master."""
FIRST_PAUSE_S: Final = 0.010
JITTER: Final = 0.25
LONGEST_PAUSE_S: Final = 1.0 / (1 + JITTER)
"""So that no pause is longer than 1 s, and the jitter still spreads the parts of a bus without a master."""
STARTING_S: Final = 1.5
"""While a master starts, another master's beacon stops it; the other answers ours at once, so this is ample."""
SILENT_S: Final = 10.0
"""A node that was not heard for this long may lose its address to a newcomer. Longer than `BEACON_TIMEOUT_S`: a part
that cannot hear the master has given up its address by then."""
REPEAT_S: Final = 0.1
"""Shortest time between two beacons, or two take-backs of one address, that are sent as answers."""


@dataclass(frozen=True, slots=True)
class Joined:
    """The part has an address."""

    node_id: int
    use: int


@dataclass(frozen=True, slots=True)
class AddressLost:
    """The part has no address any more, or gets none; `reason` in words."""

    reason: str


ComponentEvent = Joined | AddressLost


class ComponentState(Enum):
    """See the table of the module."""

    OFF = "off"
    JOINING = "joining"
    JOINED = "joined"
    FOREIGN = "on another robot's bus"


class ComponentJoin:
    """The part's side of joining."""

    def __init__(
        self, uid: bytes, *, random: Random, caps: int = 0, profile_hash: int | None = None, ids: CanIds | None = None
    ) -> None:
        """Make a part that is still silent.

        Args:
            uid: 8 bytes, the same for the life of the part.
            random: source of the jitter.
            caps: capability bits the part can use.
            profile_hash: the robot the part is made for; None = any.
            ids: the identifier bases of this bus.

        Raises:
            LocalProtocolError: the UID is not 8 bytes, or all zero.
        """
        self.uid = check_uid(uid)
        self.state = ComponentState.OFF
        self.node_id = 0
        """The address, 1 to 120; 0 = none."""
        self.beacon: Beacon | None = None
        """The last beacon heard, of any robot."""
        self._random = random
        self._caps = caps
        self._profile_hash = profile_hash
        self._ids = ids or CanIds()
        self._epoch = -1
        self._due: float | None = None
        self._deadline: float | None = None
        self._pause = FIRST_PAUSE_S
        self._outbox: list[Frame] = []
        self._awaiting_departure = False
        self._refused = False

    def start(self, now: float) -> None:
        """Ask for an address (power-up, or back on the bus)."""
        self._join(now)

    def stop(self) -> None:
        """Be silent and forget the address (off the bus)."""
        self.state = ComponentState.OFF
        self._be_silent()
        self._deadline = None

    def receive(self, frame: Frame, now: float) -> ComponentEvent | None:
        """Take a frame that is not a data frame; anything else than BEACON and ASSIGN is ignored."""
        beacon = read_beacon(frame, self._ids)
        if beacon is not None:
            return self._hear_beacon(beacon, now)
        assign = read_assign(frame, self._ids)
        if assign is not None and self.state is not ComponentState.OFF:
            return self._hear_assign(assign, now)
        return None

    def take_frames(self) -> list[Frame]:
        """The JOIN that is to be sent now, if any."""
        frames, self._outbox = self._outbox, []
        return frames

    def sent(self, now: float) -> bool:
        """All frames have left the controller: the back-off begins when a JOIN was among them (True)."""
        if not self._awaiting_departure or self._outbox:
            return False
        self._awaiting_departure = False
        jitter = 1 + JITTER * (2 * self._random.random() - 1)
        self._due = now + self._pause * jitter
        self._pause = min(2 * self._pause, LONGEST_PAUSE_S)
        return True

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called."""
        if self._due is None or self._deadline is None:
            return self._deadline if self._due is None else self._due
        return min(self._due, self._deadline)

    def handle_timer(self, now: float) -> ComponentEvent | None:
        """Repeat the JOIN, or give the master up for lost."""
        if self._due is not None and now >= self._due:
            self._ask()
        if self._deadline is None or now < self._deadline:
            return None
        self._deadline = None
        if self.state is ComponentState.FOREIGN:
            self._join(now)
            return None
        return self._lose(f"no beacon of the master for {BEACON_TIMEOUT_S} s", now)

    def _hear_beacon(self, beacon: Beacon, now: float) -> ComponentEvent | None:
        news = self.beacon is None or beacon.epoch != self.beacon.epoch
        self.beacon = beacon
        if self.state is ComponentState.OFF:
            return None
        if self._profile_hash is not None and beacon.profile_hash != self._profile_hash:
            return self._hear_foreign(beacon, now)
        if self.state is ComponentState.JOINED:
            self._deadline = now + BEACON_TIMEOUT_S
            return None if beacon.epoch == self._epoch else self._lose("the master has started anew", now)
        if news or self.state is ComponentState.FOREIGN:
            self._join(now)
        return None

    def _hear_foreign(self, beacon: Beacon, now: float) -> ComponentEvent | None:
        if self.state is ComponentState.JOINED and beacon.epoch != self._epoch:
            return None  # our own master is here as well; it deals with the other
        known = self.state is ComponentState.FOREIGN
        self.state = ComponentState.FOREIGN
        self._be_silent()
        self._deadline = now + BEACON_TIMEOUT_S
        return (
            None
            if known
            else AddressLost(f"this bus belongs to another robot (profile hash {beacon.profile_hash:08x})")
        )

    def _hear_assign(self, assign: Assign, now: float) -> ComponentEvent | None:
        if assign.uid != self.uid:
            if self.state is ComponentState.JOINED and assign.node_id == self.node_id:
                return self._lose("the master has given the address to another part", now)
            return None
        if self.state is not ComponentState.JOINING:
            return None
        if assign.node_id == 0:
            self._pause = LONGEST_PAUSE_S
            known, self._refused = self._refused, True
            return None if known else AddressLost(f"the master has no free address: all {NODES} are held by live parts")
        self._be_silent()
        self.state = ComponentState.JOINED
        self.node_id = assign.node_id
        self._epoch = assign.epoch
        self._refused = False
        self._deadline = now + BEACON_TIMEOUT_S
        return Joined(assign.node_id, assign.use & self._caps)

    def _lose(self, reason: str, now: float) -> AddressLost:
        self._join(now)
        return AddressLost(reason)

    def _join(self, now: float) -> None:
        self.state = ComponentState.JOINING
        self.node_id = 0
        self._deadline = None
        self._pause = FIRST_PAUSE_S
        self._due = now
        self._ask()

    def _be_silent(self) -> None:
        self.node_id = 0
        self._due = None
        self._outbox.clear()
        self._awaiting_departure = False

    def _ask(self) -> None:
        self._due = None
        self._awaiting_departure = True
        self._outbox = [join_frame(self.uid, self._caps, self._ids)]


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
    """A second master is on this bus; `fatal` when this one was only starting and must give way."""

    profile_hash: int
    fatal: bool


MasterEvent = NodeJoined | NodeEvicted | NodeRefused | OtherMaster


@dataclass(slots=True)
class Member:
    """A part that has an address in this epoch."""

    uid: bytes
    use: int
    heard_at: float
    """When the last frame of it came; set by the link, which sees the data frames."""
    spoke: bool = False
    """It has sent data since it joined: another JOIN means that it has started anew."""


@dataclass(slots=True)
class MasterJoin:
    """The master's side of joining."""

    node_ids: NodeIds
    profile_hash: int
    random: Random
    """The epoch is drawn from it."""
    caps: int = 0
    ids: CanIds = field(default_factory=CanIds)
    members: dict[int, Member] = field(default_factory=dict, init=False)
    """By node id."""
    epoch: int = field(default=0, init=False)
    _outbox: list[Frame] = field(default_factory=list, init=False)
    _starting_until: float = field(default=0.0, init=False)
    _beacon_at: float = field(default=0.0, init=False)
    _beacon_due: float | None = field(default=None, init=False)
    _taken_back_at: dict[int, float] = field(default_factory=dict, init=False)

    def start(self, now: float) -> None:
        """Begin a new epoch: nobody has an address, BEACON at once."""
        self.epoch = self.random.randrange(EPOCHS)
        self.members.clear()
        self._taken_back_at.clear()
        self._starting_until = now + STARTING_S
        self._send_beacon(now)

    def resume(self, now: float) -> None:
        """Go on in the same epoch after a time off the bus: parts that still wait for a beacon need not join again."""
        self._send_beacon(now)

    def receive(self, frame: Frame, now: float) -> list[MasterEvent]:
        """Take a frame that is not a data frame; anything else than JOIN and BEACON is ignored."""
        join = read_join(frame, self.ids)
        if join is not None:
            return self._admit(*join, now)
        beacon = read_beacon(frame, self.ids)
        if beacon is None:
            return []
        fatal = now < self._starting_until
        if not fatal and now - self._beacon_at >= REPEAT_S:
            self._send_beacon(now)
        return [OtherMaster(beacon.profile_hash, fatal)]

    def stranger(self, node_id: int, now: float) -> None:
        """Data came from an address that nobody has in this epoch: take it back, so that the part joins again."""
        if now - self._taken_back_at.get(node_id, -REPEAT_S) >= REPEAT_S:
            self._taken_back_at[node_id] = now
            self._outbox.append(assign_frame(Assign(NOBODY, node_id, self.epoch, 0), self.ids))

    def take_frames(self) -> list[Frame]:
        """What is to be sent now."""
        frames, self._outbox = self._outbox, []
        return frames

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called."""
        return self._beacon_due

    def handle_timer(self, now: float) -> None:
        """Send the beacon when it is time."""
        if self._beacon_due is not None and now >= self._beacon_due:
            self._send_beacon(now)

    def _send_beacon(self, now: float) -> None:
        self._beacon_at = now
        self._beacon_due = now + BEACON_PERIOD_S
        self._outbox.append(beacon_frame(Beacon(self.caps, self.epoch, self.profile_hash), self.ids))

    def _admit(self, uid: bytes, caps: int, now: float) -> list[MasterEvent]:
        node_id = self._address(uid, now)
        use = caps & self.caps
        self._outbox.append(assign_frame(Assign(uid, node_id or 0, self.epoch, use if node_id else 0), self.ids))
        if node_id is None:
            return [NodeRefused(uid)]
        events: list[MasterEvent] = []
        member = self.members.get(node_id)
        if member is not None and member.uid == uid and member.use == use and not member.spoke:
            member.heard_at = now
            return events  # the same JOIN once more: our answer was still on its way
        if member is not None and member.uid != uid:
            events.append(NodeEvicted(node_id, member.uid))
        self.node_ids.keep(node_id, uid)
        self.members[node_id] = Member(uid, use, now)
        return [*events, NodeJoined(node_id, uid, use)]

    def _address(self, uid: bytes, now: float) -> int | None:
        """The address for a part: its own, else a fresh one, else the one unused for longest; None = all are live."""
        own = self.node_ids.find(uid)
        if own is not None:
            return own
        taken = self.node_ids.oldest_first()
        fresh = next((node_id for node_id in range(1, NODES + 1) if node_id not in taken), None)
        if fresh is not None:
            return fresh
        silent = [n for n in taken if n not in self.members or now - self.members[n].heard_at > SILENT_S]
        never = float("-inf")
        return min(silent, key=lambda n: self.members[n].heard_at if n in self.members else never, default=None)
