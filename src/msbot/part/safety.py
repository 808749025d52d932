"""The safe state: what a part does by itself when nobody is in command any more (design PNP 7).

A port that drives something has a safe value in the library, which comes with the configuration as settings
`PORT.safe.FIELD`. When the master, the agent or the port's partner is lost, or on STOP, the part hands the safe value
to the port's own function as if it had come in, and then calls the functions below `@part.safe_state`.

STOP holds: no message reaches a function until GO, or until the part has joined anew (the master says STOP again then
if it still holds). A part that is plugged out of its robot cannot be told GO, and need not be.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from msbot.errors import ConfigError, LocalProtocolError
from msbot.part.handlers import Guard
from msbot.part.message import Message, fields_of
from msbot.part.plug import SAFE_MARK
from msbot.part.program import Listener
from msbot.part.settings import Value, read_value

_log = logging.getLogger("msbot.part")

_KINDS: dict[str, type[Value]] = {
    "bool": bool, "str": str, "float32": float, "float64": float,
    **{f"{sign}int{width}": int for sign in ("", "u") for width in (8, 16, 32, 64)},
}  # fmt: skip


class Safety:
    """The safe values of one part's ports, and STOP.

    Args:
        listeners: the functions of the ports.
        functions: those below `@part.safe_state`.
        guard: calls them.
    """

    def __init__(self, listeners: Mapping[str, Listener], functions: list[Callable[[], object]], guard: Guard) -> None:
        self.stopped = False
        """STOP was said and GO was not."""
        self._listeners = listeners
        self._functions = functions
        self._guard = guard
        self._messages: dict[str, Message] = {}

    def configure(self, safe: Mapping[str, str]) -> None:
        """Take the safe values of a configuration: `PORT.safe.FIELD` -> text."""
        by_port: dict[str, dict[str, str]] = {}
        for name, text in safe.items():
            port, _, field = name.partition(SAFE_MARK)
            by_port.setdefault(port, {})[field] = text
        self._messages = {}
        for port, fields in by_port.items():
            listener = self._listeners.get(port)
            if listener is None:
                continue  # nothing is driven there
            try:
                self._messages[port] = safe_message(listener.message_class, fields)
            except (ConfigError, LocalProtocolError) as error:
                self._guard.report(f"safe value of port {port!r}", f"cannot be used: {error}")

    def enter(self, port: str | None = None) -> None:
        """Go to the safe state: hand the safe values to the functions of their ports, of one port or of all."""
        for name, message in self._messages.items():
            if port in (None, name):
                self._guard.call(self._listeners[name].function, message)
        for function in self._functions:
            self._guard.call(function)

    def stop(self, reason: str) -> None:
        """STOP: go to the safe state, and let nothing through from now on."""
        if not self.stopped:
            _log.warning("STOP: %s", reason)
        self.stopped = True
        self.enter()

    def go(self) -> None:
        """STOP is over; does nothing without one."""
        if self.stopped:
            _log.warning("GO: STOP is over")
        self.stopped = False


def safe_message(message_class: type[Message], fields: Mapping[str, str]) -> Message:
    """A message of that class with these fields, given as text; the others have their defaults.

    Raises:
        ConfigError: there is no such field, or the text does not fit it.
        LocalProtocolError: the value is out of the field's range.
    """
    known = {field.name: field.codec.word.partition(" ")[0] for field in fields_of(message_class)}
    values: dict[str, object] = {}
    for name, text in fields.items():
        kind = _KINDS.get(known.get(name, ""))
        if kind is None:
            raise ConfigError(f"{message_class.__name__} has no simple field {name!r}; it has {', '.join(known)}")
        values[name] = read_value(name, text, kind)
    message = message_class()
    for name, value in values.items():
        setattr(message, name, value)
    return message
