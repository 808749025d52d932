"""How the commands about blueprints show what differs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from msbot.config import Blueprint, Difference, RobotProfile
from msbot.errors import ConfigError
from msbot.registry import Registry, RobotRecord

NOBODY = RobotProfile("", "", "", "", "")

library_option = click.option(
    "--library", "folders", multiple=True, type=click.Path(path_type=Path),
    help="A folder with more part types (TOML files); may be given several times.",
)  # fmt: skip
robot_option = click.option("--robot", metavar="NAME", help="Which robot, when the database has several.")


def empty_like(blueprint: Blueprint) -> Blueprint:
    """A robot of the same name without slots and wires: what a new robot is compared with."""
    return Blueprint(blueprint.robot, (), (), blueprint.timing, blueprint.options)


def one_robot(registry: Registry, name: str | None) -> RobotRecord:
    """The robot that is meant: by name or serial number, or the only one.

    Raises:
        ConfigError: there is none, or it is not clear which.
    """
    robots = registry.robots()
    if not robots:
        raise ConfigError(f"the database {registry.database} has no robot: `msbot apply robot.toml` puts one there")
    found = [robot for robot in robots if name is None or name in (robot.name, robot.serial_number)]
    known = ", ".join(f"{robot.name} ({robot.serial_number})" for robot in robots)
    if not found:
        raise ConfigError(f"the database {registry.database} has no robot {name!r}; there are {known}")
    if len(found) > 1:
        raise ConfigError(f"the database {registry.database} has several robots: say which with --robot; {known}")
    return found[0]


def plan_lines(differences: Sequence[Difference]) -> list[str]:
    """One line for each difference, and one that counts them."""
    count = {change: sum(difference.change == change for difference in differences) for change in _WORDS}
    summary = ", ".join(f"{number} {word}" for word, number in count.items() if number)
    return [*(f"  {difference}" for difference in differences), f"  {summary}."] if differences else []


_WORDS = ("added", "changed", "removed")


def as_json(differences: Sequence[Difference]) -> list[dict[str, str]]:
    """The same for programs."""
    return [
        {
            "change": difference.change,
            "where": difference.where,
            "before": difference.before,
            "after": difference.after,
            "consequence": difference.consequence,
        }
        for difference in differences
    ]
