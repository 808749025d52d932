"""The message classes of a program under test: `robot.messages.Samples`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import IntEnum
from typing import Any, TypeVar

from msbot.part import Message, Part
from msbot.part.messages.message import converted, fields_of
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.errors import ConfigError

_M = TypeVar("_M", bound=Message)


class ProgramMessages:
    """The classes by their names, as attributes.

    Args:
        part: those of its ports, and those inside them.
        names: what the program's file defines and imports.
        more: further classes.
    """

    def __init__(self, part: Part, names: Mapping[str, object], more: Iterable[type[Message]]) -> None:
        program = part.program
        waiting = [one.message_class for one in program.listeners.values()]
        waiting += program.publications.values()
        for exchange in (*(one.exchange for one in program.servers.values()), *program.calls.values()):
            waiting += (exchange.request, exchange.reply)
        waiting += more
        found: dict[str, type[Message]] = {}
        while waiting:
            cls = waiting.pop(0)
            found.setdefault(cls.__name__, cls)
            waiting += [
                field.codec.inside
                for field in fields_of(cls)
                if isinstance(field.codec.inside, type) and issubclass(field.codec.inside, Message)
            ]
        named = {
            name: one for name, one in names.items() if isinstance(one, type) and issubclass(one, Message | IntEnum)
        }
        self._found: dict[str, type] = {**found, **named}
        self._found.pop("Message", None)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - the classes of a program are not known to a type checker
        if name.startswith("__"):
            raise AttributeError(name)
        cls = self._found.get(name)
        if cls is None:
            near = nearest(name, self._found)
            hint = did_you_mean(near) if near else f"it has {', '.join(self._found) or 'none'}"
            raise AttributeError(f"the program has no message class {name!r}; {hint}")
        return cls

    def __dir__(self) -> list[str]:
        return sorted(self._found)


def as_message(where: str, given: object, wanted: type[_M]) -> _M:
    """What a test gives for a message, as one of the class that the program has.

    Args:
        where: the beginning of the error, such as `port 'in' takes`.
        given: a message of that class, or of one with its name and fields.
        wanted: the class.

    Raises:
        ConfigError: it is another message, or none.
    """
    name = wanted.__name__
    if isinstance(given, Message):
        if (found := converted(given, wanted)) is not None:
            return found
        if type(given).type_name == wanted.type_name:
            raise ConfigError(
                f"{where} the program's {name}, and this class {name} has other fields: use robot.messages.{name}"
            )
    hint = f", as robot.messages.{name}(...)" if isinstance(given, dict | type) else ""
    raise ConfigError(f"{where} {name}{hint}, not {given!r}")
