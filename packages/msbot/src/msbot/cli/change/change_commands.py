"""The commands that change a robot by one operation, made from the table of operations.

`msbot.cli.change.change_commands:swap` is the command for the operation `swap`, for entry points. Commands that
do more than one operation have a file each.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import click

from msbot.cli import completers
from msbot.cli.change.robot_access import perform, say
from msbot.cli.change.stop_commands import ChosenRobots, say_go
from msbot.cli.message_input import is_message, typed_values
from msbot.cli.robot_options import robot_and_json_options, robot_options, stop_group_option, wants_json
from msbot.config import scalar_text
from msbot.operations.operation import Argument, ArgumentKind, Operation
from msbot.operations.table import OPERATIONS
from msbot_agent.cli.options import FiniteRange, WholeRange
from msbot_agent.cli.table import print_table
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError

MESSAGE = "values"
"""The argument that is a message."""
MESSAGE_HELP = "VALUE: the values of the message in their order, FIELD=VALUE, or one text '{field: value, ...}'."


def verb(name: str) -> click.Command:
    """The command that carries out an operation."""
    operation = OPERATIONS[name]

    def run(db: str | None, robot: str | None, **given: object) -> None:
        say(db, robot, name, _arguments(operation, given))

    takes_message = any(argument.name == MESSAGE for argument in operation.arguments)
    run.__doc__ = "\n\n".join([operation.summary, operation.help, *([MESSAGE_HELP] if takes_message else [])])
    decorated: Callable[..., object] = robot_and_json_options(run)
    for argument in reversed(operation.arguments):
        decorated = _decorate(argument)(decorated)
    # Several values may be negative numbers, which look like options.
    takes_values = any(argument.kind is ArgumentKind.TEXTS and not argument.option for argument in operation.arguments)
    return click.command(name, context_settings={"ignore_unknown_options": takes_values})(decorated)


def _arguments(operation: Operation, given: Mapping[str, object]) -> dict[str, object]:
    """What the person typed, in the form that the operation takes."""
    wish: dict[str, object] = {}
    for argument in operation.arguments:
        value = given[argument.passed_as]
        if argument.kind is ArgumentKind.FLAG:
            value = bool(value) != argument.default  # the option reverses the default
        if argument.name == MESSAGE and isinstance(value, tuple):
            # A type in front of a whole message, as other tools want it, is checked by the master.
            is_typed = len(value) == 2 and is_message(value[1]) and not is_message(value[0])
            value = [value[0], *typed_values(value[1:])] if is_typed else typed_values(value)
        wish[argument.name] = list(value) if isinstance(value, tuple) else value
    return wish


def _decorate(argument: Argument) -> Callable[[Callable[..., object]], Callable[..., object]]:
    complete = completers.BY_METAVAR.get(argument.shown_as)
    if not argument.option:
        count = -1 if argument.kind is ArgumentKind.TEXTS else 1
        return click.argument(
            argument.passed_as,
            required=argument.is_needed,
            metavar=argument.shown_as or None,
            nargs=count,
            shell_complete=complete,
        )
    if argument.kind is ArgumentKind.FLAG:
        return click.option(argument.option, argument.passed_as, is_flag=True, help=argument.help)
    default = "" if argument.default == "" else None
    return click.option(
        argument.option,
        argument.passed_as,
        required=argument.is_needed,
        metavar=argument.shown_as or None,
        shell_complete=complete,
        multiple=argument.kind is ArgumentKind.TEXTS,
        default=() if argument.kind is ArgumentKind.TEXTS else default,
        help=argument.help,
        type=FiniteRange() if argument.kind is ArgumentKind.NUMBER else str,
    )


def __getattr__(name: str) -> click.Command:
    if name not in OPERATIONS:
        raise AttributeError(f"there is no operation {name!r}")
    return verb(name)


# `msbot adopt`: let a part into a slot.


WINDOW_S = 60.0


@click.command("adopt")
@click.argument("part", required=False, shell_complete=completers.parts)
@click.option(
    "--slot",
    metavar="SLOT",
    shell_complete=completers.slots,
    help="The slot that it gets; default: the only empty slot that fits.",
)
@click.option(
    "--window",
    type=FiniteRange(),
    metavar="SECONDS",
    help="Open the adoption window for so long, in which unknown parts and parts that do not fit can be adopted.",
)
@robot_and_json_options
def adopt_command(part: str | None, slot: str | None, window: float | None, db: str | None, robot: str | None) -> None:
    """Put PART, which stands by or is not let in, into a slot.

    A part that the library does not know, and that describes itself, gets a part type and a slot of its own, which
    --slot names. The wires that fit are printed as commands.

    Without PART, opens the adoption window (60 s by default); with --slot, the next newcomer gets that slot.
    """
    if part is None or window is not None:
        wish = None if part is not None else slot
        say(db, robot, "window", {"seconds": WINDOW_S if window is None else window, "slot": wish})
    if part is not None:
        answer = say(db, robot, "adopt", {"part": part, "slot": slot})
        for what, key in (
            ("fits", "offers"),
            ("to look at or call by hand", "for_people"),
            ("to send to it by hand", "by_hand"),
        ):
            for offer in () if wants_json() else answer.get(key, ()):
                click.echo(f"  {what}: {_bind(offer)}")


def _bind(offer: dict[str, Any]) -> str:
    """The command that makes a wire."""
    to = " ".join(f"--to {shlex.quote(end)}" for end in offer["to"])
    topic, kind = (shlex.quote(offer[key]) for key in ("topic", "type"))
    source = f" --from {shlex.quote(offer['from'])}" if offer["from"] else ""
    return f"msbot bind {topic} --type {kind}{source} {to}".rstrip()


# `msbot go`: STOP is over.


@click.command("go")
@click.option("--stop", "number", type=WholeRange(1), help="End this STOP, but no later one.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@stop_group_option
@robot_options
def go_command(db: str | None, robot: str | None, *, number: int | None, as_json: bool, stop_group: str | None) -> None:
    """End STOP at one robot: its parts may work again. Where several run, say which one."""
    answer = say_go(ChosenRobots(db, robot, stop_group), number)
    if as_json:
        click.echo(json.dumps({"stopped": answer["stopped"], "stored": answer["stored"]}))
        return
    click.echo("STOP is over: the parts may work again")
    if answer["trouble"]:
        click.echo(f"{answer['trouble']}; after a restart of the master STOP may hold again")
    elif not answer["stored"]:
        click.echo("this is not stored yet: if the master is started anew before, STOP may hold again")


# `msbot set`: the parameters of a slot.


@click.command("set")
@click.argument("slot", shell_complete=completers.slots)
@click.argument("name", required=False, shell_complete=completers.parameters)
@click.argument("value", required=False)
@click.option("--reset", is_flag=True, help="Reset to the value of the blueprint or library.")
@robot_and_json_options
def set_command(
    slot: str, name: str | None, value: str | None, db: str | None, robot: str | None, *, reset: bool
) -> None:
    """Set parameter NAME of SLOT to VALUE; its part gets it at once.

    Without VALUE, shows the parameters, their values, and where these come from.
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
        hint = instead_of(name, [value["name"] for value in values])
        raise ConfigError(f"slot {slot} has no parameter {name!r}; {hint}")
    if wants_json():
        click.echo(json.dumps(shown))
        return
    if not shown:
        click.echo(f"slot {slot} has no parameters")
        return
    print_table(("parameter", "value", "unit", "from", "what it does"), [_value_row(value) for value in shown])


def _value_row(value: dict[str, Any]) -> tuple[str, ...]:
    origin = f"hand, {value['who']}" if value["origin"] == "hand" else value["origin"]
    return value["name"], scalar_text(value["value"]), value["unit"], origin, value["description"]


# `msbot undo`: undo a change.


@click.command("undo")
@click.argument("number", type=WholeRange(1, 2**53), required=False)
@click.option("--list", "show", is_flag=True, help="List recent changes, newest last, and change nothing.")
@click.option("--last", type=WholeRange(1, 10_000), default=20, show_default=True, help="How many --list shows.")
@robot_and_json_options
def undo_command(number: int | None, last: int, db: str | None, robot: str | None, *, show: bool) -> None:
    """Undo change NUMBER, or the newest one; a spare's takeover is a change, too."""
    if not show:
        say(db, robot, "undo", {"edit": number})
        return
    edits = perform(db, robot, "edits", {"limit": last})["edits"]
    assert isinstance(edits, list)
    if wants_json():
        click.echo(json.dumps(edits[::-1]))
        return
    if not edits:
        click.echo("Nothing was changed yet.")
        return
    print_table(
        ("change", "when", "who", "what"),
        [
            (
                str(edit["id"]),
                datetime.fromtimestamp(edit["at_ns"] / 1e9).strftime("%Y-%m-%d %H:%M:%S"),
                edit["who"],
                f"{edit['words']}{_undo_mark(edit)}",
            )
            for edit in reversed(edits)
        ],
    )


def _undo_mark(edit: Mapping[str, Any]) -> str:
    if edit["undone"]:
        return " (undone)"
    return "" if edit.get("can_be_undone", True) else " (cannot be undone)"
