"""Options of the commands for robots: which database, robot, blueprint and link."""

from __future__ import annotations

import getpass
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from msbot.cli import completers
from msbot.cli.database_place import DEFAULT_BLUEPRINT
from msbot.stop.socket_names import GROUP_VARIABLE, group_in
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import WholeRange
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.config import Library

DEFAULT_LINK = "udp:127.0.0.1:8888"

_C = TypeVar("_C", bound=Callable[..., object])


library_option = click.option(
    "--library",
    "folders",
    multiple=True,
    type=click.Path(path_type=Path),
    help="A folder with more part types (TOML files), besides those that robot.toml names; repeatable.",
)
robot_option = click.option(
    "--robot", metavar="NAME", shell_complete=completers.robots, help="Name of the robot, if the database has several."
)

db_option = click.option(
    "--db",
    metavar="FILE",
    help="The robot's database, a file or postgresql://...; default: the blueprint's name with .db, in its folder; "
    "without a blueprint: robot.db in this folder, or that of the only blueprint here that has one.",
)


metrics_option = click.option(
    "--metrics",
    "metrics_port",
    type=WholeRange(0, 65535),
    metavar="PORT",
    help="Serve figures for Prometheus at this port of this computer; 0 = any free one (extra msbot[metrics]).",
)


class LinkType(click.ParamType[str]):
    """A part's way to its master, such as `udp:127.0.0.1:8888`; what makes no sense is told before anything begins."""

    name = "link"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The address, as it is."""
        from msbot.part.run import CAN
        from msbot_agent.link import open_link

        try:
            open_link(value, can=CAN)
        except ConfigError as error:
            self.fail(str(error), param, ctx)
        return value


link_option = click.option(
    "--link",
    type=LinkType(),
    metavar="ADDRESS",
    default=DEFAULT_LINK,
    show_default=True,
    envvar="MSBOT_LINK",
    help="How to reach the master; $MSBOT_LINK sets it, too.",
)


class StopGroupType(click.ParamType[str]):
    """A STOP group; what is no name for one is told before anything begins."""

    name = "group"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The group, as it is."""
        try:
            return group_in(value)
        except ConfigError as error:
            undelivered = "NOT delivered: " if ctx is not None and ctx.info_name in ("stop", "go") else ""
            self.fail(f"{undelivered}{error}", param, ctx)


stop_group_option = click.option(
    "--stop-group",
    type=StopGroupType(),
    metavar="NAME",
    help=f"Only the robots of this STOP group; default: ${GROUP_VARIABLE}.",
)


def robot_options(function: _C) -> _C:
    """The options of every command that changes a robot: which one."""
    robot = click.option(
        "--robot",
        metavar="NAME",
        shell_complete=completers.robots,
        help="Name of the robot, if several run or share a database.",
    )
    return db_option(robot(function))


def robot_and_json_options(function: _C) -> _C:
    """The options of a command that answers in words or as JSON: which robot, and `--json`."""
    as_json = click.option(
        "--json",
        "as_json",
        is_flag=True,
        expose_value=False,
        callback=_note_json,
        help="Print the answer as a JSON object.",
    )
    return robot_options(as_json(function))


def wants_json() -> bool:
    """Whether the running command was given the `--json` of `robot_and_json_options`."""
    return bool(click.get_current_context().meta.get(_JSON))


_JSON = "msbot.json"


def _note_json(context: click.Context, _: click.Parameter, value: bool) -> None:
    context.meta[_JSON] = value


def library_here(folders: Sequence[Path]) -> Library:
    """The part library for a command that takes no blueprint: MsBOT's own types, those that the robot.toml here names,
    and `folders`.

    Raises:
        ConfigError: something in it is wrong.
    """
    from msbot.config import library_folders, load_library

    return load_library(*library_folders(DEFAULT_BLUEPRINT), *folders)


@contextmanager
def mistakes_told(*, as_json: bool, **beside: object) -> Iterator[None]:
    """Around the reading of a file that a command checks: with `--json` its mistakes are printed as one object, and the
    command ends with status 2; else they go on as the error that they are.

    Args:
        as_json: whether `--json` was given.
        beside: what the object has besides `problems`.
    """
    from msbot.config import InvalidFileError, problems_json

    try:
        yield
    except InvalidFileError as found:
        if not as_json:
            raise
        click.echo(json.dumps({"problems": problems_json(found), **beside}))
        sys.exit(ExitStatus.MISTAKE)


def user_name() -> str:
    """Who gives the command, for the record of changes."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "somebody"
