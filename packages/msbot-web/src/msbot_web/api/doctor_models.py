"""What the API tells of an examination by the doctor."""

from __future__ import annotations

from msbot_web.api.model import Model
from msbot_web.api.said import Said


class FindingLine(Model):
    """One thing that is not as it should be."""

    check: str
    problem: str
    """What sort of problem, for programs: `bus-off`."""
    about: str
    must: bool
    """False: worth knowing, may be wanted."""
    saw: Said
    why: Said
    wire: Said
    """How it shows in the traffic."""
    first: Said
    """What hands must do before; empty: nothing."""
    mend: str
    """The command that mends it."""


class CheckLine(Model):
    """A check that could not, or need not, be made."""

    check: str
    why: Said


class ExaminationState(Model):
    """What the doctor says of the robot and its computer, as `msbot doctor --json`."""

    well: bool
    findings: list[FindingLine]
    not_looked_at: list[CheckLine]
    not_needed: list[CheckLine]
    in_order: list[str]
