"""`msbot check`: is a blueprint correct?"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import click

from msbot.cli.change.robot_access import one_robot
from msbot.cli.database_place import DEFAULT_BLUEPRINT, existing_database
from msbot.cli.robot_options import db_option, library_option, mistakes_told, robot_option
from msbot.cli.run.bridges_beside import check_bridges
from msbot.config import Blueprint, Library, blueprint_toml, open_blueprint, write_sample
from msbot.part.run import CAN
from msbot.registry import open_registry
from msbot.service_types import service_type
from msbot_agent.link import open_link
from msbot_agent.toml.problems import FileLocation, Problems
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError


@click.command("check")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@click.option(
    "--link",
    "links",
    metavar="ADDRESS",
    multiple=True,
    help="Where parts will connect (as for msbot master): also check whether bridges can share that bus.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: problems and hints.")
def check_command(blueprint: Path, folders: tuple[Path, ...], links: tuple[str, ...], *, as_json: bool) -> None:
    """Check BLUEPRINT (robot.toml) against the part library.

    Every problem is shown with file, line and key; status 2 when there are any. Hints are not mistakes.
    """
    with mistakes_told(as_json=as_json, hints=[]):
        robot, library = open_blueprint(blueprint, *folders)
        for link in links:
            open_link(link, serve=True, can=CAN)
        crowded = _check_bridges(blueprint, robot, library, links)
        unknown = _check_ros(blueprint, robot, library)
    told = hints(robot, library) + crowded + unknown
    if as_json:
        click.echo(json.dumps({"problems": [], "hints": told}))
        return
    for hint in told:
        click.echo(f"hint: {hint}")
    click.echo(f"{blueprint} is in order: {_counted(robot)}.")


def _check_bridges(path: Path, robot: Blueprint, library: Library, links: tuple[str, ...]) -> list[str]:
    """As `msbot master` does, and whether their buses have room; a mistake is one of the file. Returns hints."""
    if not robot.bridges:
        return []
    from msbot.cli.bus.load import crowded_buses

    try:
        check_bridges(robot, links)
        return crowded_buses(robot, library, links)
    except ConfigError as error:
        problems = Problems()
        problems.add(FileLocation(str(path), path=("bridge",)), str(error).removeprefix("[[bridge]]: "))
        problems.raise_if_any()
        raise


def _check_ros(path: Path, robot: Blueprint, library: Library) -> list[str]:
    """Whether ROS 2 has a form for what is shared with it; every mistake is one of the file. Returns hints."""
    shared = [(place, one) for place, one in enumerate(robot.bindings) if one.in_dds.ros]
    if not shared:
        return []
    from msbot.master.robot_as_part import dds_topic_lookup
    from msbot.ros2.known_types import hint_of

    problems, told = Problems(), []
    for place, binding in shared:
        try:
            dds_topic_lookup(replace(robot, bindings=(binding,)), library, "")
        except ConfigError as error:
            begin = f'the binding of "{binding.topic}" with ros = true: '
            problems.add(FileLocation(str(path), path=("binding", place)), str(error).removeprefix(begin))
        else:
            kind = "msg" if service_type(binding.type_name) is None else "srv"
            told += [hint for hint in [hint_of(binding.in_dds.ros_type, kind)] if hint]
    problems.raise_if_any()
    return list(dict.fromkeys(told))


def hints(blueprint: Blueprint, library: Library) -> list[str]:
    """What is allowed but perhaps unintended."""
    bound = {str(end) for binding in blueprint.bindings for end in binding.ends}
    told = []
    for slot in blueprint.slots:
        part_type = library.get(slot.part_number)
        assert part_type is not None
        loose = [port.name for port in part_type.ports if f"{slot.name}.{port.name}" not in bound]
        if part_type.ports and len(loose) == len(part_type.ports) and not part_type.carries:
            told.append(f"no port of slot {slot.name} is bound to a topic: its part will do nothing")
        elif loose:
            told.append(f"slot {slot.name}: not bound to a topic: {', '.join(loose)}")
        told += [
            f"slot {slot.name}: at STOP {port.name} gets {port.stops_by}, and not its value in [slot.safe]"
            for port in part_type.ports
            if port.stops_by and port.name in slot.safe
        ]
    numbers = [slot.part_number for slot in blueprint.slots]
    for number in sorted({number for number in numbers if numbers.count(number) > 1}):
        alike = [slot for slot in blueprint.slots if slot.part_number == number]
        if any(not slot.local_name for slot in alike):
            names = ", ".join(slot.name for slot in alike)
            told.append(f"slots {names} take the same part {number}: the parts need these as local names")
    return told


def _counted(robot: Blueprint) -> str:
    return f"robot {robot.robot.name}, {amount(len(robot.slots), 'slot')}, {amount(len(robot.bindings), 'binding')}"


# `msbot init`: write the sample blueprint.


@click.command("init")
@click.argument("path", type=click.Path(path_type=Path), default="robot.toml")
def init_command(path: Path) -> None:
    """Write a commented blueprint to PATH (robot.toml by default); an existing file is never overwritten."""
    write_sample(path)
    click.echo(f"{path} is written: the thesis' sample robot, with every key explained.")
    click.echo(f"Next: msbot master {path}    and in other terminals: msbot part AA, msbot part BB, msbot part CC")


# `msbot export`: write a robot of the database as a blueprint.


@click.command("export")
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option("--without-hand", is_flag=True, help="The blueprint as last applied, without what was changed by hand.")
@robot_option
@db_option
def export_command(file: Path | None, robot: str | None, db: str | None, *, without_hand: bool) -> None:
    """Write a robot of the database as a blueprint to a new FILE, or to standard output.

    It includes what was set by hand, with comments that say by whom; once applied, that belongs to the blueprint.
    """
    address = existing_database(db)
    with open_registry(address, read_only=True) as registry:
        record = one_robot(registry.database, registry.robots.all(), robot)
        blueprint = registry.robots.blueprint(record, by_hand=not without_hand)
        notes = {} if without_hand else registry.robots.made_by_hand(record)
        where = registry.database
    text = f"# Robot {record.name}, written by `msbot export` from {where}.\n\n{blueprint_toml(blueprint, notes)}"
    if file is None:
        click.echo(text, nl=False)
        return
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise ConfigError(f"{file}: exists already and is not overwritten; name another file") from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written ({error.strerror}); name another file") from None
    click.echo(f"{file} is written: robot {record.name}.")
