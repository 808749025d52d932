"""What the registry gives back about robots, parts and the journal."""

from __future__ import annotations

from dataclasses import dataclass

from msbot.pnp import PartEvent

NO_UID = bytes(8)


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """A robot the database knows."""

    id: int
    name: str
    serial_number: str
    version: str
    released: str
    manufacturer: str
    applied_ns: int
    """When its blueprint was applied last, nanoseconds since 1970."""


@dataclass(frozen=True, slots=True)
class PartRecord:
    """A part the database knows, as after its last change of state."""

    robot: str
    """Name of the robot it was seen at."""
    uid: bytes
    """8 octets; empty when it has none."""
    part_number: str
    local_name: str
    slot: str | None
    """The slot it is in, or was in last."""
    state: str
    """Value of `PartState`."""
    reason: str
    address: str
    first_seen_ns: int
    changed_ns: int

    @property
    def name(self) -> str:
        """What people call it: local name, else slot, else part number."""
        return self.local_name or self.slot or self.part_number


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One line of the journal."""

    number: int
    """Counts up through the whole database."""
    robot: str
    at_ns: int
    """Nanoseconds since 1970."""
    event: PartEvent
    """What happened; its `at` is in seconds since 1970, its session is not kept."""


def uid_text(uid: bytes) -> str:
    """A UID as the tables hold it: 16 hexadecimal digits; empty for a part without one."""
    return "" if not uid or uid == NO_UID else uid.hex()
