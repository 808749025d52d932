"""The states of a part, and its changes from one to another, with the reason and the evidence."""

from __future__ import annotations

from dataclasses import field
from enum import Enum

from msbot_agent.text.sentence import said
from msbot_xrce.lazy import dataclass

Evidence = tuple[tuple[str, str], ...]
"""Why something was decided: pairs of (rule or message, outcome), in the order in which they were tried."""


class PartState(Enum):
    """The state of a part in the inventory; the legal changes are `msbot.pnp.life_status.TRANSITIONS`."""

    NEW = "new"
    CHECKING = "checking"
    ACTIVE = "active"
    LATE = "late"
    LOST = "lost"
    REFUSED = "refused"
    STANDBY = "standby"
    LEFT = "left"

    @property
    def is_registered(self) -> bool:
        """Whether the part holds a lease and may use its slot's topics."""
        return self is PartState.ACTIVE or self is PartState.LATE

    @property
    def is_over(self) -> bool:
        """Whether the part is delisted: gone, politely or not."""
        return self is PartState.LOST or self is PartState.LEFT


@dataclass(frozen=True, slots=True)
class PartEvent:
    """One change of one part's state."""

    at: float
    """Seconds of the caller's monotonic clock."""
    part: str
    """The part's name for people: local name, else slot, else part number, else address."""
    slot: str | None
    """The slot that it holds, or has lost by this change."""
    from_state: PartState | None
    """None: the part was not there before."""
    to_state: PartState
    reason: str
    evidence: Evidence = ()
    part_number: str = ""
    local_name: str = ""
    uid: bytes = b""
    client_key: int = 0
    """The session to which it happened."""
    address: str = ""
    """The peer in words."""
    identity: bytes = b""
    """Who the part is: `identity_of` its claim; empty before it has claimed."""
    trouble: str = field(default="", compare=False)
    """What it has said is wrong with its hardware; not stored."""

    def sentences(self) -> list[str]:
        """The event in plain words: one sentence, then one indented line for each piece of evidence."""
        change: str = said(self.to_state.value)
        if self.from_state not in (None, self.to_state):
            change = said("{before} -> {after}", before=said(self.from_state.value), after=change)
        if self.slot:
            change = said("{change} in slot {slot}", change=change, slot=self.slot)
        lines: list[str] = [said("{part}: {change}: {reason}", part=self.part, change=change, reason=self.reason)]
        lines.extend(said("  - {rule}: {outcome}", rule=rule, outcome=outcome) for rule, outcome in self.evidence)
        return lines
