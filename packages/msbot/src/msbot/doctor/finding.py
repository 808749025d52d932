"""What the doctor says: a finding, or why something could not be looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path

from msbot_agent.agent import AgentStatus
from msbot_agent.link import parse_host_and_port
from msbot_agent.space import SpaceAddress
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Mending:
    """What the page may do to mend something: it can be undone, or it only adds a file."""

    name: str
    """An operation of the table, or `backup`."""
    arguments: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is not as it should be."""

    problem: str
    """What sort of problem, for programs: `bus-off`."""
    about: str
    """What has it: `can0`, `slot BB`, a file."""
    saw: str
    """What was seen, in a sentence."""
    why: str
    """Why it matters."""
    wire: str
    """How it shows in the traffic."""
    mend: str
    """The command that mends it, complete."""
    first: str = ""
    """What hands must do before; empty: nothing."""
    must: bool = True
    """False: worth knowing, may be wanted."""
    mending: Mending | None = None
    """How the page can mend it; None: not from there."""


@dataclass(frozen=True, slots=True)
class Unavailable:
    """A fact that could not be had."""

    why: str
    """Why, and where possible what would let it be seen."""


class NotNeeded(Exception):
    """Raised while facts are gathered: there is nothing here that this check could be about. The text says why."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why


class CannotSee(Exception):
    """Raised while facts are gathered: this check cannot be made here. The text says why."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why


# Whom the doctor examines: which robot, over which links.


PAGE_PORT = 8080
"""Where `msbot master` serves its page unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Examined:
    """What is to be examined."""

    database: str | None
    """File or address; None: there is none yet."""
    robot: str | None = None
    """Its name; None: the only one."""
    blueprint: Path | None = None
    """A `robot.toml`, examined where there is no database."""
    links: tuple[str, ...] = ()
    """Addresses of links, as a master gets them."""
    space: SpaceAddress = field(default_factory=SpaceAddress)
    """Where its topics are."""
    page_port: int = PAGE_PORT
    masters: tuple[AgentStatus, ...] = ()
    """The agents and masters of this user that run and answer."""
    backups: Path | None = None
    """Folder of the backups; None: `backups` beside the database."""

    @property
    def database_file(self) -> Path | None:
        """The file of the database; None: there is none, or it is on a server."""
        return None if self.database is None or "://" in self.database else Path(self.database)

    @property
    def backup_folder(self) -> Path | None:
        """Where backups are expected."""
        file = self.database_file
        return self.backups or (None if file is None else file.absolute().parent / "backups")

    def of_kind(self, *kinds: str) -> list[str]:
        """What follows the kind in the addresses of all links of that kind."""
        pairs = [link.partition(":") for link in self.links]
        return [rest for kind, _, rest in pairs if kind in kinds]

    def net_ports(self) -> list[tuple[str, str, int]]:
        """`(udp or tcp, host, port)` of the links in networks, and of the page."""
        found = [("tcp", "127.0.0.1", self.page_port)]
        for link in self.links:
            kind, _, rest = link.partition(":")
            if kind in ("udp", "tcp"):
                try:
                    host, port = parse_host_and_port(rest, any_port=True)
                except ConfigError:
                    continue  # said by `msbot master`, and by the command before it gets here
                if port:
                    found.append((kind, host, port))
        return found
