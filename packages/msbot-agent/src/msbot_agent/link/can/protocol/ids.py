"""Who may send what on the bus: the CAN identifiers, and the layouts of JOIN, ASSIGN, BEACON and STOP.

Data frames have 11-bit identifiers (20 bits cheaper). Only joining uses 29 bits: the identifier contains 22 bits of a
hash of the UID, so that two new parts that ask in the same bit have different identifiers, and arbitration orders them.
Readers are tolerant: a frame that does not look exactly like one of ours gives None, which means foreign traffic.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct
from typing import Final, Protocol
from zlib import crc32

from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

NODES: Final = 120
"""Addresses on one bus: node ids 1 to 120."""
UID_SIZE: Final = 8
"""Bytes of the identity of a part's CAN end."""
EPOCHS: Final = 1 << 14
"""Epochs of a master are drawn from 0 to 16383."""
VERSION: Final = 1
"""Version of this link format, first byte of every BEACON."""

CAN_FD: Final = 1
"""Capability bit: CAN FD data frames."""
COMPRESSION: Final = 2
"""Capability bit: header compression."""

STARTING: Final = 4
"""Flag of a BEACON: this master has just started, and gives way to one that was there before. Parts ignore it."""

NOBODY: Final = bytes(UID_SIZE)
"""An ASSIGN with this UID takes an address back: the part that uses it must join again."""

STOP_REASONS: Final = {0: "no reason given", 1: "STOP was pressed", 2: "a program called for it"}
"""Reason byte of a STOP frame in words; other numbers are free for applications."""

_BEACON = Struct("<BBHI")
_QUESTION = Struct("<BI")
_HASH_MASK = (1 << 22) - 1


@dataclass(frozen=True, slots=True)
class CanIds:
    """The bases of all identifiers; change them only on a bus shared with other equipment, and then at both ends."""

    stop: int = 0x008
    up: int = 0x100
    """Part n to master: `up + n`."""
    down: int = 0x180
    """Master to part n: `down + n`."""
    beacon: int = 0x700
    join: int = 0x1E000000
    """29 bits, the low 24 are 0; lowest priority of all, so that newcomers wait while the bus is busy."""
    assign: int = 0x02000000
    """29 bits, the low 24 are 0; before all messages, so that a part gets its answer before it asks again."""

    def __post_init__(self) -> None:
        """Make sure that no two kinds of frame can have one identifier.

        Raises:
            ConfigError: they can.
        """
        taken = [range(self.stop, self.stop + 1), range(self.beacon, self.beacon + 1)]
        taken += [range(base + 1, base + NODES + 1) for base in (self.up, self.down)]
        numbers = [number for block in taken for number in block]
        if len(set(numbers)) != len(numbers) or not all(0 <= number <= 0x7FF for number in numbers):
            raise ConfigError(
                f"the CAN identifier bases stop={self.stop:#x} up={self.up:#x} down={self.down:#x} "
                f"beacon={self.beacon:#x} overlap or leave 0 to 0x7ff: up and down need {NODES} identifiers each"
            )
        if self.join <= self.assign or any(base & 0xFFFFFF or base >> 29 for base in (self.join, self.assign)):
            raise ConfigError(
                f"the CAN identifier bases assign={self.assign:#x} and join={self.join:#x} must have 29 bits, end in "
                "24 zero bits, and assign must be below join, so that answers go before questions"
            )


@dataclass(frozen=True, slots=True)
class Beacon:
    """What a master says about itself each second."""

    flags: int
    """Capabilities the master offers (`CAN_FD`, `COMPRESSION`), and whether it is `STARTING`."""
    epoch: int
    """Drawn at random at every start of the master; 14 bits."""
    profile_hash: int
    """CRC-32 of robot name, version and serial number."""


@dataclass(frozen=True, slots=True)
class Assign:
    """The master's answer to a JOIN."""

    uid: bytes
    node_id: int
    """1 to 120, or 0: refused."""
    epoch: int
    use: int
    """The capabilities both sides will use."""


def check_uid(uid: bytes) -> bytes:
    """Check a UID and return it.

    Raises:
        LocalProtocolError: it is not 8 bytes, or all zero.
    """
    if len(uid) != UID_SIZE or uid == NOBODY:
        raise LocalProtocolError(f"a part's UID has {UID_SIZE} bytes that are not all zero, not {uid.hex() or 'none'}")
    return uid


def uid_hash(uid: bytes) -> int:
    """The 22 bits that stand for a UID in the identifier of its JOIN."""
    return crc32(uid) & _HASH_MASK


def is_joining(frame: Frame, ids: CanIds) -> bool:
    """Whether the identifier is that of a JOIN, an ASSIGN or a BEACON."""
    if frame.extended:
        return frame.can_id & ~0xFFFFFF in (ids.join, ids.assign)
    return frame.can_id == ids.beacon


def join_frame(uid: bytes, caps: int, ids: CanIds) -> Frame:
    """JOIN: a part asks for an address."""
    return Frame(ids.join | (caps & 3) << 22 | uid_hash(uid), uid, extended=True)


def read_join(frame: Frame, ids: CanIds) -> tuple[bytes, int] | None:
    """UID and capabilities of a JOIN; None when it is not one, or its identifier does not match its UID."""
    if not _is_classic_data(frame, 8, extended=True) or frame.can_id & ~0xFFFFFF != ids.join:
        return None
    if frame.can_id & _HASH_MASK != uid_hash(frame.data) or frame.data == NOBODY:
        return None
    return frame.data, frame.can_id >> 22 & 3


def assign_frame(assign: Assign, ids: CanIds) -> Frame:
    """ASSIGN: the master gives, refuses (node id 0) or takes back (UID `NOBODY`) an address."""
    can_id = ids.assign | assign.epoch << 10 | (assign.use & 3) << 8 | assign.node_id
    return Frame(can_id, assign.uid, extended=True)


def read_assign(frame: Frame, ids: CanIds) -> Assign | None:
    """The ASSIGN in a frame, or None."""
    if not _is_classic_data(frame, 8, extended=True) or frame.can_id & ~0xFFFFFF != ids.assign:
        return None
    node_id = frame.can_id & 0xFF
    if node_id > NODES:
        return None
    return Assign(frame.data, node_id, frame.can_id >> 10 & EPOCHS - 1, frame.can_id >> 8 & 3)


def beacon_frame(beacon: Beacon, ids: CanIds) -> Frame:
    """BEACON: the master is here."""
    return Frame(ids.beacon, _BEACON.pack(VERSION, beacon.flags, beacon.epoch, beacon.profile_hash))


def read_beacon(frame: Frame, ids: CanIds) -> Beacon | None:
    """The BEACON in a frame, or None (also for another version of the link format)."""
    if not _is_classic_data(frame, 8, extended=False) or frame.can_id != ids.beacon:
        return None
    version, flags, epoch, profile_hash = _BEACON.unpack(frame.data)
    return Beacon(flags, epoch & EPOCHS - 1, profile_hash) if version == VERSION else None


def question_frame(profile_hash: int, ids: CanIds) -> Frame:
    """A master that starts asks whether the bus has one: parts ignore it, a running master answers with its BEACON."""
    return Frame(ids.beacon, _QUESTION.pack(VERSION, profile_hash))


def read_question(frame: Frame, ids: CanIds) -> int | None:
    """The profile hash of the master that asks whether it is alone; None: the frame is something else."""
    if not _is_classic_data(frame, _QUESTION.size, extended=False) or frame.can_id != ids.beacon:
        return None
    version, profile_hash = _QUESTION.unpack(frame.data)
    return int(profile_hash) if version == VERSION else None


def stop_frame(reason: int, ids: CanIds) -> Frame:
    """STOP: every part goes to its safe state; wins every arbitration among our frames."""
    return Frame(ids.stop, bytes((reason & 0xFF,)))


def read_stop(frame: Frame, ids: CanIds) -> int | None:
    """The reason byte of a STOP (0 when it carries none), or None when it is not a STOP."""
    if frame.can_id != ids.stop or frame.extended or frame.remote or frame.error or frame.fd:
        return None
    return frame.data[0] if frame.data else 0


def stop_words(reason: int) -> str:
    """The reason of a STOP for people."""
    return STOP_REASONS.get(reason, f"reason {reason}")


def _is_classic_data(frame: Frame, size: int, *, extended: bool) -> bool:
    return frame.extended == extended and len(frame.data) == size and not (frame.remote or frame.error or frame.fd)


# Which part had which CAN address: the memory from which a master gives addresses.


class NodeIds(Protocol):
    """Where a master remembers which part had which address; in the registry, it outlives the master."""

    def find(self, uid: bytes) -> int | None:
        """The address of that part, or None when it has none (any more)."""

    def oldest_first(self) -> Sequence[int]:
        """The addresses that belong to a part, the one given or confirmed longest ago first."""

    def assign(self, node_id: int, uid: bytes) -> None:
        """Give the address to that part from now on; a part that had it before has none."""


class MemoryNodeIds:
    """`NodeIds` that are forgotten with the process."""

    def __init__(self) -> None:
        """Start with all addresses free."""
        self._uids: dict[int, bytes] = {}
        self._node_ids: dict[bytes, int] = {}

    def find(self, uid: bytes) -> int | None:
        """See `NodeIds`."""
        return self._node_ids.get(uid)

    def oldest_first(self) -> Sequence[int]:
        """See `NodeIds`."""
        return tuple(self._uids)

    def assign(self, node_id: int, uid: bytes) -> None:
        """See `NodeIds`."""
        former = self._uids.pop(node_id, None)
        if former is not None:
            del self._node_ids[former]
        self._uids.pop(self._node_ids.get(uid, 0), None)
        self._uids[node_id] = uid
        self._node_ids[uid] = node_id
