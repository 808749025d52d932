"""What a student's program says to its part: functions, and when they are to be called."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from msbot.errors import ConfigError
from msbot.part.handler_guard import Every, Guard, check_handler
from msbot.part.messages.message import Message
from msbot.part.settings import Settings, V

_M = TypeVar("_M", bound=Message)
Action = Callable[[], object]
"""A student's function without arguments; what it returns is ignored."""
_A = TypeVar("_A", bound=Action)
PortAction = Callable[[str], object]
"""A student's function that gets the name of a port."""
_P = TypeVar("_P", bound=PortAction)
_F = TypeVar("_F")

SHORTEST_PERIOD_S = 0.001
"""A setting cannot make a function be called more often."""


@dataclass(frozen=True, slots=True)
class Listener:
    """The function of one port."""

    message_class: type[Message]
    function: Callable[[Message], object]
    optional: bool = False
    """The robot need not use the port."""


class Program:
    """The functions of a part; `Part` calls them. Not to be made by itself."""

    def __init__(self, mistake: Callable[[ConfigError], None]) -> None:
        """Begin without functions; `mistake` gets an error of the program that running on cannot mend."""
        self._guard = Guard(mistake)
        self._settings = Settings(self._guard)
        self._timed: list[Every] = []
        self._listeners: dict[str, Listener] = {}
        self._when: dict[str, list[Action]] = {
            when: [] for when in ("join", "lost", "end", "stop", "go", "safe", "identify")
        }
        self._partner_lost: list[PortAction] = []

    def every(self, period: float | str) -> Callable[[_A], _A]:
        """Call the function below every so many seconds while the part is active (the first time at once).

        Args:
            period: seconds, or the name of the setting that has them; a change of the setting counts at once.

        Raises:
            ConfigError: the period is not positive, or what is below is no plain function without arguments.
        """
        if callable(period):
            name = getattr(period, "__name__", "...")
            raise ConfigError(f"@part.every above {name} needs the seconds in parentheses: @part.every(1.0)")
        if not isinstance(period, str) and not period > 0:
            raise ConfigError(f"every({period}): the period must be more than 0 seconds")

        def remember(function: _A) -> _A:
            check_handler(function)
            timed = Every(1.0 if isinstance(period, str) else period, function)
            self._timed.append(timed)
            if isinstance(period, str):
                self._settings.follow(period, float, lambda seconds: self._pace(timed, period, seconds))
            return function

        return remember

    def on(
        self, port: str, message_class: type[_M] | None = None, *, optional: bool = False
    ) -> Callable[[Callable[[_M], object]], Callable[[_M], object]]:
        """Call the function below with each message that comes in at the port.

        Args:
            port: the part's own name for it.
            message_class: what comes in.
            optional: the robot need not use the port; otherwise it is said when it does not.

        Raises:
            ConfigError: not a message class, a port with two functions, or no plain function of one argument.
        """
        if callable(port):
            name = getattr(port, "__name__", "...")
            raise ConfigError(f'@part.on above {name} needs port and message: @part.on("in", HelloWorld)')
        if not (isinstance(message_class, type) and issubclass(message_class, Message)):
            what = "" if message_class is None else f", not {message_class!r}"
            raise ConfigError(f"@part.on({port!r}, ...) needs the class of the message{what}: on({port!r}, HelloWorld)")
        if port in self._listeners:
            raise ConfigError(f"port {port!r} has a function already: one function per port")

        def remember(function: Callable[[_M], object]) -> Callable[[_M], object]:
            check_handler(function, "message")
            self._listeners[port] = Listener(message_class, function, optional)  # type: ignore[arg-type]  # decoded as _M
            return function

        return remember

    def on_setting(self, name: str, kind: type[V] = str) -> Callable[[Callable[[V], object]], Callable[[V], object]]:  # type: ignore[assignment]  # the kind follows the argument
        """Call the function below with the setting's value, before `on_join`, and whenever it changes.

        Raises:
            ConfigError: the kind is none of bool, int, float, str; or no plain function of one argument.
        """

        def remember(function: Callable[[V], object]) -> Callable[[V], object]:
            check_handler(function, "value")
            self._settings.follow(name, kind, function)
            return function

        return remember

    def on_join(self, function: _A | None = None) -> _A:
        """Call the function below whenever the part has become active."""
        return self._remember("join", function)

    def on_lost(self, function: _A | None = None) -> _A:
        """Call the function below whenever the part is no longer active though it did not end; see `reason`."""
        return self._remember("lost", function)

    def on_end(self, function: _A | None = None) -> _A:
        """Call the function below once when the part ends."""
        return self._remember("end", function)

    def on_stop(self, function: _A | None = None) -> _A:
        """Call the function below when somebody says STOP, after every port has its safe value."""
        return self._remember("stop", function)

    def on_go(self, function: _A | None = None) -> _A:
        """Call the function below when somebody says GO: messages reach the part's functions again."""
        return self._remember("go", function)

    def on_identify(self, function: _A | None = None) -> _A:
        """Call the function below when somebody asks which part this is: let it blink, beep or move."""
        return self._remember("identify", function)

    def on_partner_lost(self, function: _P | None = None) -> _P:
        """Call the function below with the name of a port for which nobody sends any more."""
        handler = _given("on_partner_lost", function)
        check_handler(handler, "port")
        self._partner_lost.append(handler)
        return handler

    def safe_state(self, function: _A | None = None) -> _A:
        """Call the function below when nobody is in command any more: master or partner lost, STOP, part ended."""
        return self._remember("safe", function)

    def setting(self, name: str, kind: type[V] = str, default: V | None = None) -> V:  # type: ignore[assignment]  # the kind follows the argument
        """The value of a setting, for example `part.setting("period_s", float)`.

        Args:
            name: name of the parameter in the library.
            kind: bool, int, float or str.
            default: what holds when this robot does not set it (and before the part is active).

        Raises:
            ConfigError: it is not set and there is no default, or its value is not of that kind.
        """
        return self._settings.value(name, kind, default)

    def _remember(self, when: str, function: _A | None) -> _A:
        handler = _given("safe_state" if when == "safe" else f"on_{when}", function)
        check_handler(handler)
        self._when[when].append(handler)
        return handler

    def _tell(self, *whens: str) -> None:
        for when in whens:
            for function in self._when[when]:
                self._guard.call(function)

    def _pace(self, timed: Every, name: str, seconds: float) -> None:
        if not seconds >= SHORTEST_PERIOD_S:
            self._guard.report(f"setting {name!r}", f"{seconds} s is no period; {timed.period_s} s stays")
            return
        timed.change(seconds, self._guard)


def _given(decorator: str, function: _F | None) -> _F:
    if function is None:
        raise ConfigError(f"@part.{decorator} is written without parentheses")
    return function
