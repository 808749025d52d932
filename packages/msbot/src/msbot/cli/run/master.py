"""`msbot master`: a robot's master on real links."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Coroutine, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from msbot.cli.change.robot_access import MOST_NAMED, master_details, robot_words
from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_beside, tell_of_password
from msbot.cli.robot_options import DEFAULT_LINK, StopGroupType, db_option, library_option, metrics_option
from msbot.cli.run.bridges_beside import bridges_beside, check_bridges
from msbot.cli.run.master_services import (
    STOP_AND_GO,
    MasterCommand,
    MasterContext,
    RobotRecording,
    log_event,
    log_stop,
    metrics_beside,
    rec_option,
)
from msbot.cli.run.ring_folders import ring_folder
from msbot.config import Blueprint, Library, open_blueprint
from msbot.master import (
    ExportedPort,
    Master,
    RobotAsPart,
    StopSocket,
    exported_ports,
    profile_of,
    robot_space,
    stop_file,
)
from msbot.operations.dispatch import InProcessOperations, PerformedOperation, perform
from msbot.part.join.part_keys import given_key
from msbot.pnp import PartEvent
from msbot.recording.recorder.batch import RecordingRequest
from msbot.registry import LeaseLost, MasterLease, Registry, RobotStore, open_registry
from msbot.registry.maintenance import waiting_restore
from msbot.registry.records import database_identity
from msbot.ros.robot_in_ros import read_description
from msbot.stop.socket_names import own_group
from msbot_agent.agent import MASTER, StatusServer, running_processes
from msbot_agent.cli.command_services import WantedService, wanted_services
from msbot_agent.cli.logs import LogOptions, log_options
from msbot_agent.cli.options import space_option
from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.link import Link, bound_name, open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_agent.process.timer_grid import TimerGridLoop
from msbot_agent.space import SharedSpace, SpaceAddress
from msbot_agent.text.sentence import printable
from msbot_xrce import compress, decompress, is_whole
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.lazy import dataclass

# `msbot master --part-of ADDRESS --as NUMBER`: a robot that is a part of a bigger one.


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


CAN = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)
LOOK_S = 0.1
"""How often a master that shares its robot looks whether it may go on."""


@dataclass(frozen=True, slots=True)
class _Beside:
    """What else the user wants while the robot runs."""

    rec: RecordingRequest
    metrics_port: int | None
    log: LogOptions
    bigger: BiggerRobot | None
    """The robot that this one is a part of."""
    stop_group: str | None
    """Its STOP group; None: as the variable or the blueprint says."""
    services: Sequence[WantedService]


@click.command("master", cls=MasterCommand)
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@click.option(
    "--link",
    "addresses",
    multiple=True,
    default=(DEFAULT_LINK,),
    show_default=True,
    help="Where parts connect; repeatable.",
)
@library_option
@space_option
@db_option
@rec_option
@click.option(
    "--standby",
    is_flag=True,
    help="Share the robot with a master on another computer: wait while that one "
    "serves it, take over when it ends; needs --db postgresql://...",
)
@metrics_option
@log_options
@click.option("--part-of", metavar="ADDRESS", help="Also join a bigger robot as a part: the address of its master.")
@click.option("--as", "as_number", metavar="NUMBER", help="Its part number in the bigger robot; with --part-of.")
@click.option(
    "--stop-group",
    type=StopGroupType(),
    metavar="NAME",
    help="The robot's STOP group: a STOP for another group does not reach it; default: $MSBOT_STOP_GROUP, else "
    "that of BLUEPRINT.",
)
@click.option("-v", "--verbose", is_flag=True, help="Print more.")
def command(
    blueprint: Path,
    addresses: tuple[str, ...],
    folders: tuple[Path, ...],
    space: SpaceAddress,
    db: str | None,
    *,
    rec: RecordingRequest,
    standby: bool,
    part_of: str | None,
    as_number: str | None,
    metrics_port: int | None,
    log_wishes: LogOptions,
    stop_group: str | None,
    verbose: bool,
) -> None:
    """Run the master of the robot that BLUEPRINT (robot.toml) describes, until Ctrl-C.

    With msbot-web installed it serves a page and prints its address; at the first start, a link that makes you its
    administrator.
    """
    services = wanted_services()
    own_group()  # as below
    log_wishes.set_up(logging.INFO if verbose else logging.WARNING)
    robot, library = open_blueprint(blueprint, *folders)
    check_bridges(robot, addresses)
    description = read_description(robot)
    for address in addresses:
        open_link(address, serve=True, can=CAN)  # report mistakes before the database is touched
    bigger = bigger_robot(robot, library, part_of, as_number)
    where = db or database_beside(blueprint)
    tell_of_password(where)
    with contextlib.suppress(KeyboardInterrupt):
        wishes = _Beside(rec, metrics_port, log_wishes, bigger, stop_group, services)
        while _with_database(robot, library, addresses, space, where, wishes, description, standby=standby):
            pass  # it has lost the robot to another master, and waits again


def _with_database(  # noqa: PLR0917 - what the command was given
    blueprint: Blueprint,
    library: Library,
    addresses: Sequence[str],
    where: SpaceAddress,
    db: str,
    beside: _Beside,
    description: str,
    *,
    standby: bool,
) -> bool:
    """Opening and closing a database may be slow: no event loop runs during that time, and Ctrl-C ends it.

    Returns True when another master may have taken over the robot in the meantime.
    """
    profile = profile_of(blueprint)
    kept = waiting_restore.bring_back_held(db)
    if kept is not None:
        click.echo(f"the backup that was handed in is in force; what the database had is kept in {kept}")
    with open_registry(db) as registry:
        lease = _wait_for_turn(registry, blueprint, library, beside.services) if standby else None
        robot = registry.robots.apply_blueprint(blueprint, library)
        store = registry.runs.begin(robot)
        can = replace(CAN, profile_hash=profile.profile_hash(), node_ids=partial(registry.runs.node_ids, robot))
        links = [open_link(address, serve=True, can=can) for address in addresses]
        try:
            with nonblocking_output():
                main = _main(blueprint, library, links, where, (registry, store, db), beside, description, lease)
                try:
                    run_to_end(main, TimerGridLoop)
                except LinkDown as error:
                    raise LinkDown(f"{error}{_who_runs(profile.name)}") from error
        except LeaseLost as error:
            click.echo(str(error))
            return True
        finally:
            if lease is not None:
                lease.silent()
        return False


def _who_runs(name: str) -> str:
    """The robots that run on this computer, one of which may have the address that is wanted."""
    others = [one.details for one in running_processes() if one.what == MASTER and one.file.pid != os.getpid()]
    words = ", ".join(map(robot_words, others[:MOST_NAMED]))
    return f". On this computer runs {words}: end it, or give {name} another --link" if others else ""


def _wait_for_turn(
    registry: Registry, blueprint: Blueprint, library: Library, services: Sequence[WantedService]
) -> MasterLease:
    """Wait until no other master serves the robot; whatever takes time to load is loaded before."""
    for service in services:
        service.preload()
    robot = registry.robots.find(blueprint) or registry.robots.apply_blueprint(blueprint, library)
    return registry.runs.wait_for_lease(robot, click.echo)


async def _until_lost(lease: MasterLease) -> None:
    """Ends everything beside it when this master may not serve any more.

    Raises:
        LeaseLost: that is so.
    """
    while True:
        left_s = lease.left_s()
        if left_s == 0:
            raise lease.why_lost()
        await asyncio.sleep(min(left_s, LOOK_S))


async def _serve(master: Master, lease: MasterLease | None) -> None:
    """Serve; when this ends, nothing speaks to parts any more."""
    try:
        await master.run()
    finally:
        if lease is not None:
            lease.silent()


async def _main(  # noqa: PLR0917
    blueprint: Blueprint,
    library: Library,
    links: Sequence[Link],
    where: SpaceAddress,
    database: tuple[Registry, RobotStore, str],
    wishes: _Beside,
    description: str,
    lease: MasterLease | None,
) -> None:
    registry, store, db = database
    robot, profile = store.robot, profile_of(blueprint)
    with robot_space(where, blueprint, library) as space:
        file = stop_file(profile.name, profile.serial_number, database_identity(db))
        recording = RobotRecording(wishes.rec, ring_folder(profile.name, database_identity(db)), library)
        master = Master(
            blueprint,
            store,
            space=recording.space(space),
            stop_file=file,
            is_shared=lease is not None,
            library=library,
            stop_group=wishes.stop_group,
        )
        operations = InProcessOperations(master, registry, robot, library=library)
        master.inventory.on_event(log_event if wishes.log.is_json else _say)
        operations.on_done(log_stop if wishes.log.is_json else _say_stop)
        for link in links:
            master.add_link(link)
        space_words = "" if space.words is None else f"; {space.words}"

        def greet() -> None:
            links_words = ", ".join(map(bound_name, links))
            click.echo(
                f"{profile.name} {profile.version} is up on {links_words}; database {registry.database}{space_words}. "
                "Ctrl-C ends it."
            )
            if master.stop.stopped:
                click.echo(f"STOP holds since before, said by {master.stop.by}: `msbot go` ends it")

        beside: list[Coroutine[object, object, None]] = [] if lease is None else [_until_lost(lease)]
        if isinstance(space, SharedSpace):
            from msbot.ros.robot_in_ros import RobotInRos

            beside.append(RobotInRos(master, operations, space, description=description).run())
        if wishes.bigger is not None:
            beside.append(wishes.bigger.make(master).run())
        beside += bridges_beside(blueprint, master, click.echo)
        context = MasterContext(master, operations, library, registry, robot, db, links, where, click.echo)
        for service in wishes.services:
            beside += service.coroutines(context)
        beside += metrics_beside(
            wishes.metrics_port,
            master.agent,
            click.echo,
            master=master,
            registry=registry,
            page=context.page_figures,
        )
        status = StatusServer(
            master.agent,
            what=MASTER,
            name=f"{profile.name} {profile.version}",
            details=lambda: master_details(
                master,
                db,
                mark=operations.blueprint_mark,
                page=context.page_address(),
                trouble=registry.storage.health.trouble,
            ),
            control=partial(perform, operations),
        )
        stop = StopSocket(
            master, lambda: master_details(master, db, mark=operations.blueprint_mark, page=context.page_address())
        )
        await run_until_signal(
            _serve(master, lease),
            beside=[stop.run(), status.run(), *recording.coroutines(master, operations), *beside],
            ready=master.ready,
            say=greet,
        )


def _say(event: PartEvent) -> None:
    click.echo(event.sentences()[0])


def _say_stop(deed: PerformedOperation) -> None:
    if deed.operation in STOP_AND_GO:
        click.echo(printable(deed.words))
