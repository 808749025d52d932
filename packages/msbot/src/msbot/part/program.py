"""What a student's program has declared: functions, and when to call each of them.

The program knows nothing of a robot: `program_runner` reads these tables, even while they grow.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Literal

from msbot.part.handler_guard import Guard, check_handler
from msbot.part.messages.leaves import leaf_codecs
from msbot.part.messages.message import Message
from msbot.part.part_settings import DeclaredSetting, DeclaredSettings
from msbot.service_types import ServiceType
from msbot_agent.process.timer_grid import first_time
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

SHORTEST_PERIOD_S = 0.001
"""Shortest period that a setting can give a function."""

SMOOTHED = 8
"""Calls over which it is smoothed how late they are."""

# `@part.every`: a student's function that is called again and again.


class Every:
    """Calls a handler periodically, on a grid that does not drift; late calls are skipped, not made up for.

    A handler that knows that it has nothing to do for a while may `rest_until` then. The grid stays.
    """

    def __init__(self, period_s: float, function: Callable[[], object]) -> None:
        self.period_s = period_s
        self.function = function
        self._guard: Guard | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._due_at = 0.0
        """A point of the grid: the next call's, while it does not rest."""
        self._rests = False
        self.late_s = 0.0
        """How late the loop calls it, smoothed: a measure of how busy the process is."""

    def start(self, guard: Guard) -> None:
        """Have the guard call it in the next turn of the loop (a grid's next point), and then every period."""
        self.cancel()
        self._guard = guard
        loop = asyncio.get_running_loop()
        self._arm(loop, first_time(loop), guard)

    def cancel(self) -> None:
        """Stop calling it."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._guard = None

    def rest_until(self, at: float) -> None:
        """Leave out the calls before `at`, a time of the loop (inf: all), until `resume`; for the handler to call."""
        if self._guard is None or at <= self._due_at:
            return
        self._rests = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if at < math.inf:
            steps = math.ceil((at - self._due_at) / self.period_s - 1e-6)
            self._arm(asyncio.get_running_loop(), self._due_at + steps * self.period_s, self._guard)

    @property
    def is_resting(self) -> bool:
        """Whether calls are left out."""
        return self._rests

    def resume(self, at: float = 0.0) -> None:
        """End that rest: the next call comes at the next point of the grid; not before `at`, as in `rest_until`."""
        if not self._rests or self._guard is None:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        loop = asyncio.get_running_loop()
        if at < math.inf:
            steps = math.ceil((max(loop.time(), at) - self._due_at) / self.period_s - 1e-6)
            self._arm(loop, self._due_at + steps * self.period_s, self._guard)

    def check(self, period_s: float) -> None:
        """Refuse what is no period.

        Raises:
            ConfigError: it is too short.
        """
        if not period_s >= SHORTEST_PERIOD_S:
            raise ConfigError(f"{period_s} s is not a period; {self.period_s} s stays")

    def change(self, period_s: float) -> None:
        """Change the period; if it is running, it starts over with the new period at once."""
        if period_s == self.period_s:
            return
        self.period_s = period_s
        if self._guard is not None:
            self.start(self._guard)

    def _arm(self, loop: asyncio.AbstractEventLoop, due_at: float, guard: Guard) -> None:
        self._due_at = due_at
        self._timer = loop.call_at(due_at, self._due, loop, due_at, guard)

    def _due(self, loop: asyncio.AbstractEventLoop, due_at: float, guard: Guard) -> None:
        self._rests = False
        now = loop.time()
        if self._timer is not None:
            self.late_s += (now - self._timer.when() - self.late_s) / SMOOTHED
        behind = max(0.0, now - due_at)
        self._due_at = due_at + (behind // self.period_s + 1) * self.period_s
        self._timer = None
        try:
            if not guard.is_waiting(self.function):
                guard.call(self.function)
        finally:
            # Only now: most functions that may rest say during their call until when.
            if self._timer is None and self._guard is guard and not self._rests:
                self._arm(loop, self._due_at, guard)


# `part.after`: a student's function that is called once.


MOST_DELAYED = 100
"""So many functions can wait for their time."""


class After:
    """Calls a handler once, some time after it was started."""

    def __init__(self, delay_s: float, function: Callable[[], object]) -> None:
        self._delay_s = delay_s
        self._function = function
        self._timer: asyncio.TimerHandle | None = None

    def start(self, guard: Guard, on_called: Callable[[After], object] = lambda _: None) -> None:
        """Have the guard call it after its time; `on_called` hears of it just before."""
        self.cancel()
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(self._delay_s, self._due, guard, on_called)

    def cancel(self) -> None:
        """Do not call it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _due(self, guard: Guard, on_called: Callable[[After], object]) -> None:
        self._timer = None
        on_called(self)
        guard.call(self._function)


Action = Callable[[], object]
"""A student's function without arguments; what it returns is ignored."""
PortAction = Callable[[str], object]
"""A student's function that gets the name of a port."""
When = Literal["join", "lost", "end", "stop", "go", "safe", "identify", "configured"]
"""The events of a part that call functions without arguments."""


@dataclass(frozen=True, slots=True)
class Listener:
    """The function of one port."""

    message_class: type[Message]
    function: Callable[[Message], object]
    optional: bool = False
    """The robot need not use the port."""
    safe: Message | None = None
    """The port's safe value, if the part describes itself."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The least and the greatest value of fields, if the part describes itself."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """The two messages of a service port."""

    request: type[Message]
    reply: type[Message]

    @property
    def type_name(self) -> str:
        """As the robot's configuration has it."""
        return str(ServiceType(self.request.type_name, self.reply.type_name))


@dataclass(frozen=True, slots=True)
class Server:
    """The function of a port that serves."""

    exchange: Exchange
    function: Callable[[Message], Message]
    optional: bool = False
    """The robot need not use the port."""


class ProgramDeclarations:
    """The functions of one part; the `add_...` methods raise ConfigError for a function that cannot be called."""

    def __init__(self) -> None:
        self.timed: list[Every] = []
        self.delayed: list[After] = []
        self.listeners: dict[str, Listener] = {}
        """Port -> its function."""
        self.stops_by: dict[str, str] = {}
        """Port -> what STOP does there instead of the safe value, for the description."""
        self.settings = DeclaredSettings()
        self.publications: dict[str, type[Message]] = {}
        """Port -> what it publishes; only the ports that the program declares."""
        self.servers: dict[str, Server] = {}
        """Port -> the function that serves there."""
        self.calls: dict[str, Exchange] = {}
        """Port -> what it sends and gets."""
        self.when: dict[When, list[Action]] = {
            "join": [],
            "lost": [],
            "end": [],
            "stop": [],
            "go": [],
            "safe": [],
            "identify": [],
            "configured": [],
        }
        self.partner_lost: list[PortAction] = []

    def add_timed(self, period: float | str, function: Action, default: float | None = None) -> None:
        """Call it periodically; a text is the name of the setting that holds the seconds, with that default."""
        check_handler(function)
        if not isinstance(period, str):
            self.timed.append(Every(period, function))
            return
        timed = Every(1.0, function)
        declared = None
        if default is not None:
            declared = DeclaredSetting(float, float(default), least=SHORTEST_PERIOD_S, unit="s")
        self.settings.follow(period, float, timed.change, declared, check=timed.check)
        self.timed.append(timed)

    def add_delayed(self, delay_s: float, function: Action) -> None:
        """Call it once, so long after the part has become active."""
        check_room(len(self.delayed))
        self.delayed.append(After(delay_s, function))

    def add_listener(self, port: str, listener: Listener) -> None:
        """Call it with the messages of a port."""
        check_handler(listener.function, "message")
        if port in self.listeners:
            raise ConfigError(f"port {port!r} has a function already: one function per port")
        _check_ranges(port, listener)
        self.listeners[port] = listener

    def add_publication(self, port: str, message_class: type[Message]) -> None:
        """The part publishes such messages there."""
        if self.publications.setdefault(port, message_class) is not message_class:
            other = self.publications[port].__name__
            raise ConfigError(f"port {port!r} publishes {other} already: a port has one message class")

    def add_server(self, port: str, server: Server) -> None:
        """Call it with the requests at a port; what it returns is the reply."""
        check_handler(server.function, "request", at_once="serves")
        self._check_one_use(port)
        self.servers[port] = server

    def add_call(self, port: str, exchange: Exchange) -> None:
        """The part sends such requests there."""
        if self.calls.get(port) != exchange:
            self._check_one_use(port)
            self.calls[port] = exchange

    def _check_one_use(self, port: str) -> None:
        for used, words in ((self.listeners, "on"), (self.servers, "serves"), (self.calls, "calls")):
            if port in used:
                raise ConfigError(f"port {port!r} is in part.{words}(...) already: one port is for one thing")

    def add_action(self, when: When, function: Action) -> None:
        """Call it when this happens."""
        check_handler(function, at_once={"safe": "safe_state", "end": "on_end"}.get(when, ""))
        self.when[when].append(function)

    def add_partner_lost(self, function: PortAction) -> None:
        """Call it with each port for which nobody publishes any more."""
        check_handler(function, "port")
        self.partner_lost.append(function)


def _check_ranges(port: str, listener: Listener) -> None:
    codecs = leaf_codecs(listener.message_class)
    for name, ends in listener.ranges.items():
        kind = codecs[name].kind if name in codecs else ""
        if not kind.startswith(("int", "uint", "float")):
            raise ConfigError(
                f"the ranges of port {port!r}: {name!r} is no number in a {listener.message_class.__name__}"
            )
        if len(ends) != 2 or not -math.inf < ends[0] < ends[1] < math.inf:
            raise ConfigError(
                f"the ranges of port {port!r}: {name!r} needs the least and the greatest value, for example (0, 100); "
                f"it has {ends!r}"
            )


def check_room(waiting: int) -> None:
    """Refuse one more function that waits for its time.

    Raises:
        LocalProtocolError: there are too many.
    """
    if waiting >= MOST_DELAYED:
        raise LocalProtocolError(
            f"{MOST_DELAYED} functions wait for their time already: does `after` call itself more than once?"
        )
