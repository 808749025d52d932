"""The safe state: what a part does by itself when nobody is in command any more (design PNP 7).

A port that drives something has a safe value in the library, which comes with the configuration as settings
`PORT.safe.FIELD`. When the master, the agent or the port's partner is lost, or on STOP, the part hands the safe value
to the port's own function as if it had been received, and then calls the functions decorated with `@part.safe_state`.

STOP holds: no message reaches a function until GO, or until the part has joined again (the master then says STOP again
if it still holds). A part that is unplugged from its robot cannot be told GO, and need not be.

The master numbers its STOPs, and repeats STOP and GO in case one is lost. A repeated GO of an earlier STOP may still be
on its way when the next STOP is said on the bus, which overtakes everything else and carries no number: only a GO newer
than anything heard before ends such a STOP.

A part hears the bus also while it is not in its robot, and nobody tells it GO then. What was said before it asks for
its configuration, the master has heard as well: the answer says which STOP holds, or, by naming none, that none does.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from msbot.errors import ConfigError, LocalProtocolError
from msbot.part.handler_guard import Guard
from msbot.part.join.plug import SAFE_MARK
from msbot.part.messages.message import Message, fields_of
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
        functions: those decorated with `@part.safe_state`.
        guard: calls them.
    """

    def __init__(self, listeners: Mapping[str, Listener], functions: list[Callable[[], object]], guard: Guard) -> None:
        self.stopped = False
        """STOP was said and GO was not yet."""
        self.number = 0
        """The number of the master's STOP that the part obeys: every port has its safe value. 0 = no STOP, or it was
        only said on the bus, or a function failed."""
        self._is_safe = False
        """STOP holds, and every function that makes the part safe did so without an error."""
        self._listeners = listeners
        self._functions = functions
        self._guard = guard
        self._messages: dict[str, Message] = {}
        self._heard = 0
        """The highest number of a STOP that the master has spoken of."""
        self._over = 0
        """The highest number of a STOP that is over."""
        self._ends_with = 0
        """The lowest number of a GO that ends the present STOP."""
        self._is_for_robot = False
        """STOP holds, and was said before the part asked the robot whether one does."""

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

    def enter(self, port: str | None = None) -> bool:
        """Go to the safe state: hand the safe values to the functions of their ports, of one port or of all.

        False: a function ended with an error, so that nobody knows whether it is safe.
        """
        is_safe = True
        for name, message in self._messages.items():
            if port in (None, name):
                is_safe &= self._guard.call(self._listeners[name].function, message)
        for function in self._functions:
            is_safe &= self._guard.call(function)
        return is_safe

    def stop(self, reason: str, number: int | None = None) -> bool:
        """STOP: go to the safe state, and let nothing through from now on; False: already done, or this STOP is over.

        What failed is tried again whenever STOP is repeated.

        Args:
            reason: why, in words.
            number: which STOP of the master this is; None: somebody said it on the bus.
        """
        if number is None:
            self._ends_with = self._heard + 1
        else:
            if number <= self._over:
                return False
            # This also ends a STOP said on the bus earlier: the master's STOP came after it, so its GO ends both.
            self._heard = self._ends_with = max(self._heard, number)
        is_news = not self.stopped
        self.stopped, self._is_for_robot = True, False
        if is_news:
            _log.warning("STOP: %s", reason)
            self._is_safe = False
        if not self._is_safe:
            self._is_safe = self.enter()
        self.number = self._heard if self._is_safe and self._heard >= self._ends_with else 0
        return is_news

    def go(self, number: int) -> bool:
        """The master's STOP of that number is over; False: there is none to end, or a later one holds."""
        self._heard, self._over = max(self._heard, number), max(self._over, number)
        if not self.stopped or number < self._ends_with:
            return False
        self.stopped, self.number = False, 0
        _log.warning("GO: STOP is over")
        return True

    def ask(self) -> None:
        """The part asks for its configuration, which also says whether STOP holds in the robot."""
        self._is_for_robot = self.stopped

    def none_holds(self) -> bool:
        """The configuration has come and names no STOP; False: there was none to end, or one was said since `ask`."""
        if not (self.stopped and self._is_for_robot):
            return False
        self.stopped = self._is_for_robot = False
        self.number = self._ends_with = 0
        _log.warning("GO: no STOP holds in the robot that the part has joined")
        return True

    def leave(self) -> None:
        """The part is out of its robot: it goes to the safe state, and an earlier STOP no longer counts."""
        self.enter()
        self.stopped = self._is_for_robot = False
        self.number = self._heard = self._over = self._ends_with = 0


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
