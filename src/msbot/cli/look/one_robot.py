"""Which robot of a database is meant."""

from __future__ import annotations

from msbot.errors import ConfigError
from msbot.registry import Registry, RobotRecord


def one_robot(registry: Registry, name: str | None) -> RobotRecord:
    """The robot that is meant: by name or serial number, or the only one.

    Raises:
        ConfigError: there is none, or it is not clear which.
    """
    robots = registry.robots.all()
    if not robots:
        raise ConfigError(f"the database {registry.database} has no robot: `msbot apply robot.toml` puts one there")
    found = [robot for robot in robots if name is None or name in (robot.name, robot.serial_number)]
    known = ", ".join(f"{robot.name} ({robot.serial_number})" for robot in robots)
    if not found:
        raise ConfigError(f"the database {registry.database} has no robot {name!r}; there are {known}")
    if len(found) > 1:
        raise ConfigError(f"the database {registry.database} has several robots: say which with --robot; {known}")
    return found[0]
