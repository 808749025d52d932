"""`msbot set`: the parameters of a slot."""

from __future__ import annotations

import json

import click

from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import answer_options, wants_json
from msbot.config import scalar_text
from msbot_xrce.errors import ConfigError


@click.command("set")
@click.argument("slot")
@click.argument("name", required=False)
@click.argument("value", required=False)
@click.option("--reset", is_flag=True, help="Take back what was set by hand: blueprint or library hold again.")
@answer_options
def command(slot: str, name: str | None, value: str | None, db: str | None, robot: str | None, *, reset: bool) -> None:
    """Set parameter NAME of SLOT to VALUE; its part gets it at once.

    Without VALUE the parameters are shown, with the values that hold and where these come from.
    """
    if reset and (name is None or value is not None):
        raise click.UsageError("--reset takes SLOT and NAME, and no VALUE")
    if reset:
        say(db, robot, "reset", {"slot": slot, "name": name})
    elif value is not None:
        say(db, robot, "set", {"slot": slot, "name": name, "value": value})
    else:
        _show(db, robot, slot, name)


def _show(db: str | None, robot: str | None, slot: str, name: str | None) -> None:
    values = perform(db, robot, "values", {"slot": slot})["values"]
    assert isinstance(values, list)
    shown = [value for value in values if name in (None, value["name"])]
    if not shown and name is not None:
        known = ", ".join(value["name"] for value in values) or "none"
        raise ConfigError(f"slot {slot} has no parameter {name!r}; it has {known}")
    if wants_json():
        click.echo(json.dumps(shown))
        return
    if not shown:
        click.echo(f"slot {slot} has no parameters")
    for value in shown:
        unit = f" {value['unit']}" if value["unit"] else ""
        origin = f"by hand, {value['who']}" if value["origin"] == "hand" else value["origin"]
        words = f"{value['name']} = {scalar_text(value['value'])}{unit}  ({origin})  {value['description']}"
        click.echo(words.rstrip())
