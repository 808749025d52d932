"""The commands that change a robot by one operation, made from the table of operations.

`msbot.cli.change.verbs:swap` is the command for the operation `swap`, for entry points. Commands that do more than one
operation have a file each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import click

from msbot.cli.change.robot_access import say
from msbot.cli.robot_options import answer_options
from msbot.operations.operation import Argument, ArgumentKind, Operation
from msbot.operations.table import OPERATIONS
from msbot_agent.cli.numbers import FiniteRange


def verb(name: str) -> click.Command:
    """The command that carries out an operation."""
    operation = OPERATIONS[name]

    def run(db: str | None, robot: str | None, **given: object) -> None:
        say(db, robot, name, _arguments(operation, given))

    run.__doc__ = f"{operation.summary}\n\n{operation.help}"
    decorated: Callable[..., object] = answer_options(run)
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
        wish[argument.name] = list(value) if isinstance(value, tuple) else value
    return wish


def _decorate(argument: Argument) -> Callable[[Callable[..., object]], Callable[..., object]]:
    if not argument.option:
        count = -1 if argument.kind is ArgumentKind.TEXTS else 1
        return click.argument(
            argument.passed_as, required=argument.is_needed, metavar=argument.shown_as or None, nargs=count
        )
    if argument.kind is ArgumentKind.FLAG:
        return click.option(argument.option, argument.passed_as, is_flag=True, help=argument.help)
    default = "" if argument.default == "" else None
    return click.option(
        argument.option, argument.passed_as, required=argument.is_needed, metavar=argument.shown_as or None,
        multiple=argument.kind is ArgumentKind.TEXTS, default=() if argument.kind is ArgumentKind.TEXTS else default,
        help=argument.help, type=FiniteRange() if argument.kind is ArgumentKind.NUMBER else str,
    )  # fmt: skip


def __getattr__(name: str) -> click.Command:
    if name not in OPERATIONS:
        raise AttributeError(f"there is no operation {name!r}")
    return verb(name)
