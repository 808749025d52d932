"""`msbot pupils`: a class at one robot: its groups, freeze all, take over, hand back; and a robot for a class."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import answer_options, library_option, robot_options
from msbot_agent.cli.options import json_option
from msbot_xrce.common.amount import amount


@click.group("pupils")
def command() -> None:
    """A class at one robot: groups with slots of their own, freeze all, take over, hand back, raised hands.

    The page Pupils has the same, and makes the pupils' accounts and tickets.
    """


@command.command("robot")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--groups", required=True, metavar="NAME,NAME", help="The groups: letters and digits.")
@click.option("--from", "source", type=click.Path(path_type=Path), help="The robot of one group; left out: a sample "
              "with a program, a distance sensor, a bumper, two motors, a lamp.")  # fmt: skip
@library_option
def robot(path: Path, groups: str, source: Path | None, folders: tuple[Path, ...]) -> None:
    """Write the blueprint of a robot in which every group has the same slots and wires to the new file PATH.

    A slot `fan` becomes `fan_Red`, `fan_Blue`; the page Pupils makes the groups by these names.
    """
    from msbot.config import (
        GROUP_ROBOT_TOML,
        blueprint_toml,
        for_groups,
        load_library,
        open_blueprint,
        parse_blueprint,
        write_new,
    )

    if source is None:
        one = parse_blueprint(GROUP_ROBOT_TOML, load_library(*folders))
    else:
        one, _ = open_blueprint(source, *folders)
    names = [name.strip() for name in groups.split(",") if name.strip()]
    made = for_groups(one, names)
    groups_made = amount(len(names), "group")
    write_new(path, f"# A robot for {groups_made}, written by `msbot pupils robot`.\n\n{blueprint_toml(made)}")
    click.echo(
        f"{path}: {amount(len(made.slots), 'slot')} for {groups_made}; `msbot master {path} --host 0.0.0.0` runs it"
    )


@command.command("list")
@json_option
@robot_options
def list_pupils(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show groups, who runs a program, whose is held and why, and whose hand is up."""
    found = perform(db, robot, "classroom", {})
    if as_json:
        click.echo(json.dumps(found))
        return
    click.echo("\n".join(_lines(found)))


@command.command("freeze")
@click.argument("reason", default="")
@answer_options
def freeze(reason: str, db: str | None, robot: str | None) -> None:
    """Hold the programs of all pupils; what they drive goes to its safe value. REASON is for the pupils' pages."""
    say(db, robot, "freeze", {"reason": reason})


@command.command("go")
@answer_options
def go(db: str | None, robot: str | None) -> None:
    """Let the pupils' programs go on; STOP is ended by `msbot go`."""
    say(db, robot, "thaw", {})


@command.command("take-over")
@click.argument("pupil")
@click.option("--run", is_flag=True, help="It is not held, but runs under the teacher's hands.")
@answer_options
def take_over(pupil: str, db: str | None, robot: str | None, *, run: bool) -> None:
    """Take the program of PUPIL: it is held until it is handed back."""
    say(db, robot, "take_over", {"pupil": pupil, "run": run})


@command.command("hand-back")
@click.argument("pupil")
@answer_options
def hand_back(pupil: str, db: str | None, robot: str | None) -> None:
    """Give PUPIL the program back."""
    say(db, robot, "hand_back", {"pupil": pupil})


@command.command("group")
@click.argument("group")
@click.option("--pupil", "pupils", multiple=True, metavar="NAME", help="A pupil of it; may be given several times.")
@click.option("--slot", "slots", multiple=True, metavar="SLOT", help="A slot of its own; may be given several times.")
@answer_options
def group(group: str, pupils: tuple[str, ...], slots: tuple[str, ...], db: str | None, robot: str | None) -> None:
    """Make a group of pupils with slots of its own, or change it; they leave the groups that they were in."""
    say(db, robot, "group", {"group": group, "pupils": list(pupils), "slots": list(slots)})


@command.command("ungroup")
@click.argument("group")
@answer_options
def ungroup(group: str, db: str | None, robot: str | None) -> None:
    """Take a group away: its slots are everybody's."""
    say(db, robot, "remove_group", {"group": group})


def _lines(found: Mapping[str, Any]) -> Iterable[str]:
    frozen = found["frozen"]
    if frozen is not None:
        yield f"FROZEN by {frozen['by']}{': ' if frozen['reason'] else ''}{frozen['reason']}"
    for one in found["groups"]:
        pupils, slots = ", ".join(one["pupils"]) or "nobody", ", ".join(one["slots"]) or "no slots"
        yield f"{one['group']}: {pupils} ({slots})"
    for one in found["pupils"]:
        where = ", ".join(one["slots"]) or ("a program without a slot" if one["runs"] else "no program")
        hand = "" if one["hand_s"] is None else f"  hand up for {one['hand_s']:.0f} s"
        yield f"{one['pupil']:<20}{where}{'  held: ' if one['held'] else ''}{one['held']}{hand}"
    if not found["pupils"]:
        yield "No pupil is here, and no group has any: `msbot pupils group` makes one, the page Pupils makes accounts."
