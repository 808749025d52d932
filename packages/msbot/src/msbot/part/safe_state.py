"""The safe state: what a part does by itself when nobody is in command any more (design PNP 7).

A port that drives something has a safe value in the library, which comes with the configuration as settings
`PORT.safe.FIELD`. When the master, the agent or the port's partner is lost, or on STOP, the part hands the safe value
to the port's own function as if it had been received, and then calls the functions decorated with `@part.safe_state`.

STOP holds: no message reaches a function until GO, also when the part loses its robot and joins again: nobody needs to
have heard what the part has heard. A part that has started anew knows of no STOP.

The master numbers its STOPs, and repeats STOP and GO in case one is lost. STOP that is said on the bus, or at the part
itself, has no number until a master gives it one. In a session with a master:

==========================================  ==========================  ==============================================
STOP that holds for the part                its beats say               it ends with
==========================================  ==========================  ==============================================
told by this master as number n             n, when all is safe         GO with n or a later number
told by a master before as number n         n, from the lease on        the same, or STOP m of this master, then GO
without a number                            0, from the lease on        STOP m of this master, then GO
==========================================  ==========================  ==============================================

A master where no STOP holds answers n with GO if it has ended that one itself; if it has never counted so far (STOP was
not stored, or its database is another one), and on 0, it takes the beat for a STOP that the part says, gives it a
number, and tells everybody. So a STOP that was said while no master served holds as soon as one does. Numbers count in
the robot that gave them: a part that recognises another robot leaves a numbered STOP behind. A database of the same
robot that has counted further by itself takes n for its own.

A repeated GO of an earlier STOP may still be on its way when the next STOP is said on the bus, which overtakes
everything else: only a GO newer than anything heard before ends such a STOP. GO of a master that the part has joined
later ends it only after that master has said STOP.

A part hears the bus also while it is joining, and may not be told GO then. What it hears after the robot was found and
before it asks for its configuration, the master has heard as well, and has told with its number: the answer says which
STOP holds, or, by naming none, that this one is over.

While a STOP button at the part is pressed, each beat that says n is followed by one that says 0: the master refuses GO
until there is another one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from msbot.part.handler_guard import Guard
from msbot.part.join.pnp_messages import SAFE_MARK
from msbot.part.messages.leaves import leaf_codecs, with_leaves
from msbot.part.messages.message import Message
from msbot.part.part_settings import Value, read_value
from msbot.part.program import Listener
from msbot_xrce.errors import ConfigError, LocalProtocolError

_log = logging.getLogger("msbot.part")

NEVER = 1 << 32
"""No GO has such a number."""

_KINDS: dict[str, type[Value]] = {
    "bool": bool,
    "text": str,
    "float32": float,
    "float64": float,
    **{f"{sign}int{width}": int for sign in ("", "u") for width in (8, 16, 32, 64)},
}


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
        self.is_held = False
        """A STOP button at the part is pressed."""
        self._is_safe = False
        """STOP holds, and every function that makes the part safe did so without an error."""
        self._listeners = listeners
        self._functions = functions
        self._guard = guard
        self._messages: dict[str, Message] = {}
        self._told = 0
        """The number of the STOP that holds; 0 = none, or it was only said on the bus or here."""
        self._heard = 0
        """The highest number of a STOP that this master has spoken of."""
        self._over = 0
        """The highest number of a STOP that is over."""
        self._ends_with = 0
        """The lowest number of a GO that ends the present STOP."""
        self._hears_master = False
        """A master serves the part, as far as the part knows."""
        self._is_masters = False
        """That master knows of the STOP that holds: it has told it, or was there when it was said."""
        self._is_asked = False
        """It was asked for the configuration since, whose answer says whether STOP still holds."""
        self._robot: object = None
        """The robot that was recognised last."""

    @property
    def number(self) -> int:
        """The number of the STOP that the part obeys: every port has its safe value. 0 = no STOP, or it was only said
        on the bus, or a function failed."""
        return self._told if self._is_safe and self.stopped else 0

    @property
    def is_unsafe(self) -> bool:
        """STOP holds, and a function that makes the part safe has failed."""
        return self.stopped and not self._is_safe

    @property
    def beats(self) -> tuple[int, ...]:
        """What the part's beats say of STOP, one after the other; empty: nothing.

        The number of the one that is obeyed, and 0 for one that the master has to take up, or must not end.
        """
        if not self.stopped:
            return ()
        confirms = (self.number,) if self.number else ()
        waits = self._is_asked or (self._is_masters and self._told)  # for the answer, or to be told again
        return (*confirms, 0) if self.is_held or not (confirms or waits) else confirms

    def value_at(self, port: str) -> Message | None:
        """The safe value of a port by the latest configuration; None: that has none."""
        return self._messages.get(port)

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
                drive = self._listeners[name].function
                self._guard.waiting.end(drive)  # it begins anew: a safe value is not skipped
                is_safe &= self._guard.call(drive, message)
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
            self._told, self._ends_with = 0, self._heard + 1 if self._hears_master else NEVER
            self._is_masters = self._hears_master
        else:
            if number <= self._over:
                return False
            # This also ends a STOP said on the bus earlier: the master's STOP came after it, so its GO ends both.
            self._heard = self._told = self._ends_with = max(self._heard, number)
            self._is_masters = True
        is_news = not self.stopped
        self.stopped, self._is_asked = True, False
        if is_news:
            _log.warning("STOP: %s", reason)
            self._is_safe = False
            self._guard.waiting.hold()
        if not self._is_safe:
            self._is_safe = self.enter()
        return is_news

    def try_again(self) -> bool:
        """What was not safe yet may be now; True: it has become so, and the master is to know."""
        if not self.stopped or self._is_safe:
            return False
        self._is_safe = self.enter()
        return self._is_safe

    def go(self, number: int) -> bool:
        """The master's STOP of that number is over; False: there is none to end, or a later one holds."""
        self._heard, self._over = max(self._heard, number), max(self._over, number)
        if not self.stopped or number < self._ends_with:
            return False
        self._end()
        _log.warning("GO: STOP is over")
        return True

    def recognise(self, robot: object) -> bool:
        """The part has recognised a robot; True: a STOP has ended that only another one had said."""
        is_other, self._robot = self._robot not in (None, robot), robot
        if not (is_other and self.stopped and self._told):
            return False
        self._end()
        _log.warning("GO: STOP was said in another robot")
        return True

    def ask(self) -> None:
        """The part asks for its configuration, which also says whether STOP holds in the robot."""
        self._is_asked = self.stopped and self._is_masters

    def no_stop_holds(self) -> bool:
        """The configuration has come and names no STOP; False: that does not end one, or one was said since `ask`."""
        if not (self.stopped and self._is_asked):
            return False
        self._end()
        _log.warning("GO: no STOP holds in the robot that the part has joined")
        return True

    def change_master(self, *, is_there: bool) -> None:
        """Whatever the part agreed with a master is void, but STOP holds on.

        Args:
            is_there: whether a master, the same or another one, serves the part from now on.
        """
        if self.stopped and not self._told:
            self._ends_with = NEVER
        self._heard = self._over = 0
        self._is_masters = self._is_asked = False
        self._hears_master = is_there

    def leave(self) -> None:
        """The part was active and is not any more: it goes to the safe state."""
        self._is_safe = self.enter()

    def forget_stop(self) -> None:
        """The part ends; when it starts anew, it knows of no STOP."""
        self._end()
        self.change_master(is_there=False)
        self._robot = None

    def _end(self) -> None:
        if self.stopped:
            self._guard.waiting.release()
        self.stopped = self._is_masters = self._is_asked = False
        self._told = self._ends_with = 0


def safe_message(message_class: type[Message], fields: Mapping[str, str]) -> Message:
    """A message of that class with these fields, given as text; the others have their defaults.

    Raises:
        ConfigError: there is no such field, or the text does not fit it.
        LocalProtocolError: the value is out of the field's range.
    """
    known = leaf_codecs(message_class)
    values: dict[str, object] = {}
    for name, text in fields.items():
        codec = known.get(name)
        if codec is None:
            raise ConfigError(f"{message_class.__name__} has no field {name!r}; it has {', '.join(known)}")
        if codec.element is not None and not text.startswith("["):
            raise ConfigError(f"{message_class.__name__}.{name} is a list such as [1, 2, 3], not {text!r}")
        kind = _KINDS.get(codec.kind.partition("<=")[0])
        values[name] = text if kind is None else read_value(name, text, kind)
    return with_leaves(message_class, values)
