"""Checks the arguments that another process or a browser sends against the table of operations."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.operations.operation import Argument, ArgumentKind, Operation
from msbot_agent.text.sentence import printable, said, whole
from msbot_xrce.errors import ConfigError

MOST_WHOLE = 2**63
"""No number is larger; JSON has such as no float and no database takes."""


def read_arguments(operation: Operation, given: object) -> dict[str, object]:
    """The keywords for the method that carries the operation out.

    Args:
        operation: the operation to carry out.
        given: the arguments by name; one that is None counts as left out.

    Raises:
        ConfigError: an argument is missing, unknown, or of the wrong kind.
    """
    if not isinstance(given, Mapping):
        raise ConfigError(said("{operation}: the arguments must be an object", operation=operation.name))
    names = [argument.name for argument in operation.arguments]
    if unknown := sorted(str(name) for name in given.keys() - set(names)):
        raise ConfigError(
            said(
                "{operation} knows no {unknown}; it takes {names}",
                operation=operation.name,
                unknown=printable(", ".join(unknown)),
                names=", ".join(names) or "nothing",
            )
        )
    return {
        argument.passed_as: _read(operation.name, argument, given.get(argument.name))
        for argument in operation.arguments
    }


def usable_arguments(operation: Operation, given: object) -> dict[str, object]:
    """The same for an operation that nothing odd refuses: a text that is too long is cut, whatever is wrong dropped.

    Args:
        operation: the operation to carry out.
        given: whatever has come.
    """
    named = given if isinstance(given, Mapping) else {}
    return {argument.passed_as: _usable(operation.name, argument, named) for argument in operation.arguments}


def _usable(do: str, argument: Argument, given: Mapping[object, object]) -> object:
    value = given.get(argument.name)
    try:
        return _read(do, argument, value[: argument.longest] if isinstance(value, str) else value)
    except ConfigError:
        return argument.default


def _read(do: str, argument: Argument, value: object) -> object:
    if value is None:
        if argument.is_needed:
            raise ConfigError(said("{do}: {argument} is missing", do=do, argument=argument.name))
        return argument.default
    found = _of_kind(argument.kind, value)
    if found is None:
        raise ConfigError(
            said("{do}: {argument} must be {kind}", do=do, argument=argument.name, kind=argument.kind.value)
        )
    texts = [found] if isinstance(found, str) else found if isinstance(found, list) else []
    if any(len(text) > argument.longest for text in texts):
        raise ConfigError(
            said(
                "{do}: {argument} is too long; it may have {longest} characters",
                do=do,
                argument=argument.name,
                longest=argument.longest,
            )
        )
    if isinstance(found, int | float) and not isinstance(found, bool):
        is_low = argument.least is not None and not found >= argument.least
        is_high = argument.most is not None and not found <= argument.most
        if is_low or is_high:
            raise ConfigError(
                said(
                    "{do}: {argument} is {found}; it must be {least} to {most}",
                    do=do,
                    argument=argument.name,
                    found=_figure(found),
                    least=_figure(argument.least),
                    most=_figure(argument.most),
                )
            )
    return found


def _figure(value: float | None) -> str:
    """A number as people write it; a whole one with all its digits."""
    return "any" if value is None else str(value) if isinstance(value, int) else f"{value:g}"


def _of_kind(kind: ArgumentKind, value: object) -> str | list[str] | float | int | bool | None:
    """The value if it is of that kind, else None."""
    is_truth = isinstance(value, bool)
    match kind:
        case ArgumentKind.TEXT if isinstance(value, str):
            return whole(value)
        case ArgumentKind.TEXTS if isinstance(value, list | tuple) and all(isinstance(one, str) for one in value):
            return [whole(one) for one in value]
        case ArgumentKind.NUMBER if isinstance(value, int | float) and not is_truth:
            return None if isinstance(value, int) and abs(value) > MOST_WHOLE else float(value)
        case ArgumentKind.WHOLE if isinstance(value, int) and not is_truth:
            return None if abs(value) > MOST_WHOLE else value
        case ArgumentKind.FLAG if isinstance(value, bool):
            return value
        case ArgumentKind.VALUE if isinstance(value, str | int | float):
            return str(value).lower() if is_truth else whole(str(value))
    return None
