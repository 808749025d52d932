"""What API and pages say of the robots of a class."""

from __future__ import annotations

from pydantic import Field

from msbot_web.api.model import Model
from msbot_web.api.said import Said


class RobotStatus(Model):
    """The robot in short, for the class that it is in."""

    robot: str
    version: str
    serial_number: str
    released: str
    manufacturer: str
    stop_group: str
    """Its STOP group; empty: none."""
    msbot: str
    """The version of MsBOT that runs it."""
    blueprint: str
    """A mark of the blueprint in force: robots with the same mark have the same slots, wires, settings and options."""
    database: str
    """A mark of its database: robots with the same mark share one; empty: it has none."""
    slots: int
    active: int
    """Slots with a part that is in."""
    stopped: bool
    told: int
    """Parts that STOP was said to."""
    not_confirmed: int
    """Parts that have not confirmed it: they may still move."""
    silent: list[str] = Field(default_factory=list)
    """Their names, the first hundred."""
    trouble: Said = ""
    """Why changes are not being stored; empty: they are."""


class RobotTile(Model):
    """One robot of the database, for the class view."""

    name: str
    serial_number: str
    running: bool
    here: bool
    """Whether this server is its master's."""
    owner: str
    slots: int
    active: int
    last_event: Said
    last_event_age_s: float | None
    address: str = ""
    """Where its own page is, when it is known."""
    stopped: bool = False
    """Whether STOP holds, as its master says."""
    reachable: bool = False
    """Whether its master answers, here or elsewhere by an access: one STOP for all reaches it."""
    version: str = ""
    """Of its blueprint's profile."""
    blueprint: str = ""
    """The mark of its blueprint in force; empty: not known."""
    msbot: str = ""
    """The version of MsBOT that runs it; empty: not known."""
    elsewhere: bool = False
    """Whether there is an access to its master on another computer."""
    trouble: Said = ""
    """Why a master elsewhere does not answer."""
    database: str = ""
    """A mark of its database, which tells robots of the same name apart; empty: it has none, or it is not known."""
