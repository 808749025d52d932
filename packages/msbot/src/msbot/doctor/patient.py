"""Whom the doctor examines: which robot, over which links."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from msbot_agent.agent import AgentStatus
from msbot_agent.link import parse_host_and_port
from msbot_agent.space import SpaceAddress
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

PAGE_PORT = 8080
"""Where `msbot master` serves its page unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Patient:
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
