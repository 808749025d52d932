"""`msbot class find`: the robots that announce themselves in the network."""

from __future__ import annotations

import json

import click

from msbot_agent.cli.numbers import FiniteRange
from msbot_agent.cli.options import json_option
from msbot_school.classroom.access import AccessBook

SECONDS = 3.0


@click.command("find")
@click.argument("class_name", metavar="[CLASS]", required=False, default="")
@click.option("--seconds", type=FiniteRange(0.5, 60.0), default=SECONDS, show_default=True,
              help="How long to listen.")  # fmt: skip
@json_option
def find(class_name: str, seconds: float, *, as_json: bool) -> None:
    """Find the robots in the network whose masters run with --announce; only those for CLASS, if it is named.

    To be found gives no right: a robot is stopped and changed by an access, `msbot class join`.
    """
    from msbot_school.classroom import mdns  # the other commands of the class do not need it

    accesses = {one.address for one in AccessBook().all()}
    found = mdns.find(seconds, class_name)
    if as_json:
        told = [
            {"name": one.robot, "serial_number": one.serial_number, "version": one.version, "class": one.class_name,
             "page": one.address, "has_access": one.address in accesses}
            for one in found
        ]  # fmt: skip
        click.echo(json.dumps(told))
        return
    if not found:
        who = f"for class {class_name} " if class_name else ""
        click.echo(f"Nobody announces a robot {who}in these networks; `msbot master --announce CLASS` does.")
    for one in found:
        access = "in the class" if one.address in accesses else f"no access: msbot class join {one.address}"
        click.echo(f"{one.robot} {one.serial_number}  {one.version}  class {one.class_name}  {one.address}  {access}")
