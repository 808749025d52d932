"""`msbot check`: is a blueprint correct?"""

from __future__ import annotations

import json
from pathlib import Path

import click

from msbot.cli.robot_options import DEFAULT_BLUEPRINT, library_option, mistakes_told
from msbot.config import Blueprint, Library, open_blueprint
from msbot_xrce.common.amount import amount


@click.command("check")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: problems and hints.")
def command(blueprint: Path, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Check BLUEPRINT (robot.toml) against the part library; nothing is started and nothing is changed.

    Every problem is shown with file, line and key; status 2 when there are any. Hints are not mistakes.
    """
    with mistakes_told(as_json=as_json, hints=[]):
        robot, library = open_blueprint(blueprint, *folders)
    told = hints(robot, library)
    if as_json:
        click.echo(json.dumps({"problems": [], "hints": told}))
        return
    for hint in told:
        click.echo(f"hint: {hint}")
    click.echo(f"{blueprint} is in order: {_counted(robot)}.")


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
    numbers = [slot.part_number for slot in blueprint.slots]
    for number in sorted({number for number in numbers if numbers.count(number) > 1}):
        alike = [slot for slot in blueprint.slots if slot.part_number == number]
        if any(not slot.local_name for slot in alike):
            names = ", ".join(slot.name for slot in alike)
            told.append(f"slots {names} take the same part {number}: the parts need these as local names")
    return told


def _counted(robot: Blueprint) -> str:
    return f"robot {robot.robot.name}, {amount(len(robot.slots), 'slot')}, {amount(len(robot.bindings), 'binding')}"
