"""`msbot master --part-of ADDRESS --as NUMBER`: a robot that is a part of a bigger one."""

from __future__ import annotations

from dataclasses import replace

import click

from msbot.config import Blueprint, Library
from msbot.master import ExportedPort, Master, RobotAsPart, exported_ports
from msbot.part.join.keys import given_key
from msbot_agent.link import Link, open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_xrce import compress, decompress, is_whole
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

_CAN = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)


@dataclass(frozen=True, slots=True)
class BiggerRobot:
    """The robot that this one is a part of."""

    number: str
    """The part number that this one shows there."""
    ports: tuple[ExportedPort, ...]
    address: str

    def make(self, master: Master) -> RobotAsPart:
        """This robot as a part."""
        key = given_key(None, self.number, master.profile.name)
        return RobotAsPart(master, self.ports, number=self.number, open_link=self.open, say=click.echo, key=key)

    def open(self, uid: bytes | None = None) -> Link:
        """A new link to its master."""
        return open_link(self.address, can=replace(_CAN, uid=uid))


def bigger_robot(blueprint: Blueprint, library: Library, address: str | None, number: str | None) -> BiggerRobot | None:
    """What the options say; None: nothing.

    Raises:
        ConfigError: one of them is missing, or the robot has nothing to offer.
    """
    if address is None and number is None:
        return None
    if not address or not number:
        raise ConfigError(
            "a robot that is a part of another one needs both the way to it and a part number: "
            "--part-of udp:192.168.1.20:8888 --as ARM-1"
        )
    found = BiggerRobot(number, exported_ports(blueprint, library), address)
    found.open()  # report mistakes before the database is touched
    return found
