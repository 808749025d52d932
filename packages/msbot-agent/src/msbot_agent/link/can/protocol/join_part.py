"""Automatic addresses: how a part gets its node id. The master's side is `join_master.py`.

Theory of operation. A part sends JOIN with its UID, and repeats it after 10, 20, 40, ... ms (at most 1 s, +-25 % at
random) until an ASSIGN with its UID comes. The master sends BEACON each second; it carries the `epoch`, drawn at random
whenever a master starts, so that a part notices a restart and joins again at once.

====================  =======================================  ======================================================
part's state          goes to                                  when
====================  =======================================  ======================================================
JOINING               JOINED                                   ASSIGN with its UID and an address
JOINED                JOINING                                  another epoch or robot; no beacon for 3.5 s; given away
JOINING, JOINED       FOREIGN (says nothing)                   beacon of another robot's master
FOREIGN               JOINING                                  beacon of its own robot; no beacon for 3.5 s
====================  =======================================  ======================================================

Pure: frames and times in, frames and events out. `take_frames` returns the frames to be sent. The back-off starts when
a JOIN has really left (`sent`). JOIN has the lowest priority on the bus, and its answer comes before all messages. So
parts that are switched on together join one after the other, as quickly as the bus can carry their messages, and
repetitions do not add to the load of a busy bus (docs/decisions/0005).
"""

from __future__ import annotations

from enum import Enum
from random import Random
from typing import Final

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import (
    NODES,
    Assign,
    Beacon,
    CanIds,
    check_uid,
    join_frame,
    read_assign,
    read_beacon,
)
from msbot_xrce.lazy import dataclass

BEACON_TIMEOUT_S: Final = 3.5
"""Without a beacon for this long a part has lost its master."""
FIRST_PAUSE_S: Final = 0.010
JITTER: Final = 0.25
LONGEST_PAUSE_S: Final = 1.0 / (1 + JITTER)
"""Chosen so that no pause is longer than 1 s, and the jitter still spreads the parts of a bus without a master."""


@dataclass(frozen=True, slots=True)
class Joined:
    """The part has an address."""

    node_id: int
    use: int


@dataclass(frozen=True, slots=True)
class AddressLost:
    """The part has lost its address, or gets none; `reason` in words."""

    reason: str


ComponentEvent = Joined | AddressLost


class ComponentState(Enum):
    """See the table in the module docstring."""

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
            uid: 8 bytes, constant for the life of the part.
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
        self._robot: int | None = None
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
        """Take a frame that is not a data frame; anything but BEACON and ASSIGN is ignored."""
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
        """Note that all frames have left the controller; True, and the back-off begins, if a JOIN was among them."""
        if not self._awaiting_departure or self._outbox:
            return False
        self._awaiting_departure = False
        jitter = 1 + JITTER * (2 * self._random.random() - 1)
        self._due = now + self._pause * jitter
        self._pause = min(2 * self._pause, LONGEST_PAUSE_S)
        return True

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called."""
        return self._deadline if self._due is None else self._due  # who asks has no deadline

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
            return self._hear_own_master(beacon, now)
        if self.state is ComponentState.FOREIGN or (news and not self._asks_soon(now)):
            self._join(now)
        return None

    def _asks_soon(self, now: float) -> bool:
        """Whether a JOIN still waits for the bus, or the next one is due about as soon as the answer to the last.

        A second JOIN would be answered, too, after the part has begun to send, and be mistaken for its restart.
        """
        return self._awaiting_departure or (self._due is not None and self._due - now <= FIRST_PAUSE_S * (1 + JITTER))

    def _hear_own_master(self, beacon: Beacon, now: float) -> ComponentEvent | None:
        self._deadline = now + BEACON_TIMEOUT_S
        if beacon.epoch != self._epoch:
            return self._lose("the master has restarted", now)
        known, self._robot = self._robot, beacon.profile_hash
        return None if known in (None, beacon.profile_hash) else self._lose("the robot's profile has changed", now)

    def _hear_foreign(self, beacon: Beacon, now: float) -> ComponentEvent | None:
        if self.state is ComponentState.JOINED and beacon.epoch != self._epoch:
            return None  # our own master is on the bus, too; it deals with the other
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
        self._robot = None
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
