"""Which robot of a database is meant."""

from __future__ import annotations

from collections.abc import Sequence

from msbot.registry import RobotRecord
from msbot_xrce.errors import ConfigError


def one_robot(database: str, robots: Sequence[RobotRecord], name: str | None) -> RobotRecord:
    """The robot that is meant, of those of a database: by name or serial number, or the only one.

    Raises:
        ConfigError: there is none, or it is not clear which.
    """
    if not robots:
        raise ConfigError(
            f"there is no robot in the database {database} yet: `msbot apply robot.toml` or `msbot master robot.toml` "
            "puts one there"
        )
    found = [robot for robot in robots if name is None or name in (robot.name, robot.serial_number)]
    known = ", ".join(f"{robot.name} ({robot.serial_number})" for robot in robots)
    if not found:
        raise ConfigError(f"the database {database} has no robot {name!r}; there are {known}")
    if len(found) > 1:
        raise ConfigError(f"the database {database} has several robots: say which with --robot; {known}")
    return found[0]
