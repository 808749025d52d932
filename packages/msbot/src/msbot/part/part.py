"""What a student imports: a part that joins its robot by itself, stays in it, and calls the student's functions.

::

    part = Part("ABCD", robot="MSBOT_MASTER")

    @part.every(1.0)
    def greet() -> None:
        part.publish("out", HelloWorld(index=1, message="hello"))

    part.run()

A part has two halves: the `ProgramDeclarations` holds its functions, the `ProgramRunner` calls them in a robot.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from math import inf
from random import Random, SystemRandom
from typing import Any, TypeVar, overload

from msbot.part.beginner_hints import part_is_run, part_was_made
from msbot.part.boards.gpio import UsbGpio
from msbot.part.client.client_settings import ClientSettings
from msbot.part.description import describe
from msbot.part.handler_guard import check_handler
from msbot.part.join.home import own_home
from msbot.part.join.joining import ANY, ExpectedRobot, JoinState
from msbot.part.join.part_keys import check_key, parse_key
from msbot.part.join.part_log import log_level
from msbot.part.join.pnp_messages import TEXT_OCTETS, UID_OCTETS, Nature
from msbot.part.messages.message import Message
from msbot.part.part_settings import DeclaredSetting, V
from msbot.part.program import Action, Exchange, Listener, PortAction, ProgramDeclarations, Server, When
from msbot.part.program_runner import Identity, PartCounters, ProgramRunner
from msbot_agent.link import Link
from msbot_xrce.errors import ConfigError

_M = TypeVar("_M", bound=Message)
_R = TypeVar("_R", bound=Message)
_A = TypeVar("_A", bound=Action)
_P = TypeVar("_P", bound=PortAction)
_F = TypeVar("_F")
_BEGINS_WITH_NUMBER = re.compile(r"\s*\d+(?:\.\d+)?")


class Part:
    """One part of a robot: a part number, ports, and functions that are called when something happens.

    All functions are called in one thread, one after the other, and must return quickly, or wait: `yield 1.0`.
    """

    def __init__(
        self,
        part_number: str,
        *,
        local_name: str | None = None,
        robot: str | ExpectedRobot = ANY,
        uid: bytes | None = None,
        board: UsbGpio | None = None,
        random: Random | None = None,
        key: bytes | str | None = None,
        describes: bool | str = False,
    ) -> None:
        """Describe a part; `run` or `run_async` brings it to life.

        Args:
            part_number: what kind of part it is, a key into the robot's library, for example `ABCD`.
            local_name: what this one is called, for example `left eye`; the part number if absent.
            robot: name of the robot the part is made for, or more of its profile; `*` = any robot.
            uid: 8 octets that identify the piece of hardware; if absent, `run` keeps one per part on this computer.
            board: the GPIO board that the part's functions drive; available as `part.board`.
            random: draws the client key and the session nonce, and the UID if there is none.
            key: the key with which the part proves its UID, as octets or as `msbot key new` writes it; never sent.
            describes: when a robot does not know the part number, tell it what the part is, from what the program
                declares; a text says it in a few words, for example `Light sensor of room 12`.

        Raises:
            ConfigError: a name is empty or too long, the UID does not have 8 octets, or the key is malformed.
        """
        self.part_number = _name("part number", part_number)
        self.local_name = _name("local name", part_number if local_name is None else local_name)
        self.robot = ExpectedRobot(robot) if isinstance(robot, str) else robot
        if uid is not None and len(uid) != UID_OCTETS:
            raise ConfigError(f"a UID has {UID_OCTETS} bytes, not {len(uid)}")
        self.uid = uid
        self.key = parse_key(key) if isinstance(key, str) else check_key(key) if key is not None else None
        """The part's key; if there is none, `run` uses the one kept for the part."""
        self.nature = Nature.UNKNOWN
        """What is behind its ports; the part tells its robot, and the page shows it."""
        self.hardware = self.software = ""
        """Versions of the hardware and of its program, as its maker counts them; the part tells its robot, and the page
        shows them. Empty: not known."""
        self.home = own_home()
        """What runs the part; it tells its robot, with the version of MsBOT."""
        self.describes = describes is not False
        """Whether it tells a robot that does not know its part number what it is."""
        self._called = describes if isinstance(describes, str) else self.local_name
        self._board = board
        self._random = random or SystemRandom()
        self._program = ProgramDeclarations()
        self._runner = ProgramRunner(self._program)
        part_was_made(self)

    # What a student's program declares.

    def every(self, period: float | str, *, default: float | None = None) -> Callable[[_A], _A]:
        """Call the decorated function every `period` seconds while the part is active (the first time at once).

        Args:
            period: seconds, or the name of a setting that holds them; a change of the setting takes effect at once.
            default: of that setting, seconds; declares it.

        Raises:
            ConfigError: the period is not positive, or the decorated object is not a plain function without arguments.
        """
        if callable(period):
            name = getattr(period, "__name__", "...")
            raise ConfigError(f"@part.every above {name} needs the seconds in parentheses: @part.every(1.0)")
        if isinstance(period, str) and (number := _BEGINS_WITH_NUMBER.match(period)):
            raise ConfigError(
                f'every("{period}"): seconds are a number without quotes: every({number[0].strip()}); '
                "a text is the name of a setting"
            )
        if not isinstance(period, str) and not period > 0:
            raise ConfigError(f"every({period}): the period must be more than 0 seconds")
        if default is not None and not isinstance(period, str):
            raise ConfigError(f'every({period}, default=...): only a setting has a default: every("period_s", ...)')

        def remember(function: _A) -> _A:
            self._program.add_timed(period, function, default)
            return function

        return remember

    @overload
    def after(self, seconds: float) -> Callable[[_A], _A]: ...

    @overload
    def after(self, seconds: float, function: _A) -> _A: ...

    def after(self, seconds: float, function: _A | None = None) -> _A | Callable[[_A], _A]:
        """Call a function once, `seconds` from now; it is forgotten when the part stops being active.

        Said before the part runs, it is called so long after each time that the part has become active.

        Args:
            seconds: 0 or more.
            function: a plain function without arguments; left out: the decorated one.

        Raises:
            ConfigError: the time is negative, or this is not a plain function without arguments.
            LocalProtocolError: the part runs and is not active, or 100 functions wait already.
        """
        if not isinstance(seconds, int | float) or not 0 <= seconds < inf:
            raise ConfigError(f"after({seconds!r}): the time must be 0 seconds or more")
        if function is None:
            return lambda decorated: self.after(seconds, decorated)
        check_handler(function)
        self._runner.after(seconds, function)
        return function

    def on(
        self,
        port: str,
        message_class: type[_M] | None = None,
        *,
        optional: bool = False,
        safe: _M | None = None,
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> Callable[[Callable[[_M], object]], Callable[[_M], object]]:
        """Call the decorated function with each message that comes in at the port.

        Args:
            port: the part's own name for it.
            message_class: the class of the incoming messages.
            optional: the robot need not use the port; otherwise the part reports it when the robot does not.
            safe: the port's safe value, which a part that describes itself declares.
            ranges: the least and the greatest value of fields, which a part that describes itself declares.

        Raises:
            ConfigError: not a message class, a second function for the port, not a plain function of one argument, or
                not ranges of numbers that the message has.
        """
        if callable(port):
            name = getattr(port, "__name__", "...")
            raise ConfigError(f'@part.on above {name} needs port and message: @part.on("in", HelloWorld)')
        if not (isinstance(message_class, type) and issubclass(message_class, Message)):
            what = "" if message_class is None else f", not {message_class!r}"
            raise ConfigError(f"@part.on({port!r}, ...) needs the class of the message{what}: on({port!r}, HelloWorld)")
        if safe is not None and not isinstance(safe, message_class):
            raise ConfigError(f"the safe value of port {port!r} must be a {message_class.__name__}, not {safe!r}")

        def remember(function: Callable[[_M], object]) -> Callable[[_M], object]:
            self._program.add_listener(port, Listener(message_class, function, optional, safe, ranges or {}))  # type: ignore[arg-type]  # decoded as _M
            return function

        return remember

    def publishes(self, port: str, message_class: type[Message]) -> None:
        """Declare that the part publishes such messages at that port; a part that describes itself must.

        Raises:
            ConfigError: not a message class, or the port has another one.
        """
        if not (isinstance(message_class, type) and issubclass(message_class, Message)):
            raise ConfigError(
                f"part.publishes({port!r}, ...) needs the class of the messages, not {message_class!r}: "
                f"publishes({port!r}, HelloWorld)"
            )
        self._program.add_publication(port, message_class)

    def serves(
        self,
        port: str,
        request_class: type[_M] | None = None,
        reply_class: type[_R] | None = None,
        *,
        optional: bool = False,
    ) -> Callable[[Callable[[_M], _R]], Callable[[_M], _R]]:
        """Call the decorated function with each request at the port, and send back the message that it returns.

        It raises `CallError` to refuse a request; the caller gets its sentence. While STOP holds, all are refused.

        Args:
            port: the part's own name for it.
            request_class: the class of the incoming messages.
            reply_class: the class of the message that the function returns.
            optional: the robot need not use the port; otherwise the part reports it when the robot does not.

        Raises:
            ConfigError: not message classes, another use of the port, or not a plain function of one argument.
        """
        if callable(port):
            name = getattr(port, "__name__", "...")
            raise ConfigError(f'@part.serves above {name} needs port and messages: @part.serves("in", Number, Number)')
        exchange = _exchange("@part.serves", port, request_class, reply_class)

        def remember(function: Callable[[_M], _R]) -> Callable[[_M], _R]:
            self._program.add_server(port, Server(exchange, function, optional))  # type: ignore[arg-type]  # decoded as _M
            return function

        return remember

    def calls(self, port: str, request_class: type[Message], reply_class: type[Message]) -> None:
        """Declare that the part sends such requests out of that port, and gets such replies; `call` sends one.

        Raises:
            ConfigError: not message classes, or another use of the port.
        """
        self._program.add_call(port, _exchange("part.calls", port, request_class, reply_class))

    def on_setting(
        self,
        name: str,
        kind: type[V] = str,  # type: ignore[assignment]  # the kind follows the argument
        *,
        default: V | None = None,
        least: float | None = None,
        most: float | None = None,
        unit: str = "",
    ) -> Callable[[Callable[[V], object]], Callable[[V], object]]:
        """Call the decorated function with the setting's value, before `on_join`, and whenever it changes.

        Args:
            name: name of the setting.
            kind: bool, int, float or str.
            default: the value in a robot that does not set it; declares the setting.
            least: lowest value of a number; only with a default.
            most: highest value of a number; only with a default.
            unit: unit of a number; only with a default.

        Raises:
            ConfigError: the kind is not bool, int, float or str, the default is not of that kind, or this is not a
                plain function of one argument.
        """
        declared = None if default is None else DeclaredSetting(kind, default, least, most, unit)  # type: ignore[arg-type]  # V is one of the kinds
        if declared is None and (least is not None or most is not None or unit):
            raise ConfigError(f"on_setting({name!r}, ...): a range or unit needs a default, too")

        def remember(function: Callable[[V], object]) -> Callable[[V], object]:
            self._program.settings.follow(name, kind, function, declared)
            return function

        return remember

    def on_join(self, function: _A | None = None) -> _A:
        """Call the decorated function whenever the part has become active."""
        return self._remember("join", function)

    def on_lost(self, function: _A | None = None) -> _A:
        """Call the decorated function whenever the part stops being active without ending; see `reason`."""
        return self._remember("lost", function)

    def on_end(self, function: _A | None = None) -> _A:
        """Call the decorated function once, when the part ends."""
        return self._remember("end", function)

    def on_stop(self, function: _A | None = None) -> _A:
        """Call the decorated function when somebody says STOP, after every port has its safe value."""
        return self._remember("stop", function)

    def on_go(self, function: _A | None = None) -> _A:
        """Call the decorated function when somebody says GO: messages reach the part's functions again."""
        return self._remember("go", function)

    def on_identify(self, function: _A | None = None) -> _A:
        """Call the decorated function when somebody asks which part this is: make it blink, beep or move."""
        return self._remember("identify", function)

    def on_partner_lost(self, function: _P | None = None) -> _P:
        """Call the decorated function with the name of a port for which nobody publishes any more."""
        handler = _given("on_partner_lost", function)
        self._program.add_partner_lost(handler)
        return handler

    def safe_state(self, function: _A | None = None) -> _A:
        """Call the decorated function when nobody is in command any more: master or partner lost, STOP, part ended."""
        return self._remember("safe", function)

    # What it does.

    def publish(self, port: str, message: Message) -> bool:
        """Send a message out of a port; False when there was no room for it (counted as `not_sent`), or when the port
        is declared by `publishes` and this robot does not use it.

        Raises:
            LocalProtocolError: the part is not active (no part publishes before both steps are done), or the message
                has more than 262,000 octets.
            ConfigError: no such port, or a message of another type; the part ends with this error.
        """
        return self._runner.publish(port, message)

    def publish_octets(self, port: str, type_name: str, octets: bytes) -> bool:
        """The same with a message that is encoded already, from a recording or a gateway.

        Args:
            port: the part's own name for it.
            type_name: what type the message has.
            octets: the message as CDR, little endian, without encapsulation header; they are not looked into.

        Raises:
            LocalProtocolError: as `publish`.
            ConfigError: no such port, or it carries another type.
        """
        return self._runner.publish_octets(port, type_name, octets)

    def call(
        self,
        port: str,
        request: Message,
        *,
        timeout: float = 1.0,
        on_reply: Callable[[Any, str], object] | None = None,
    ) -> Any:  # noqa: ANN401 - the class that `calls` declared
        """Send a request out of a port, and return the reply of the part that serves it.

        While the function waits, the part goes on: it beats, and calls its other functions. With `on_reply` nothing
        waits: this returns None at once, and the function is called later with the reply and "", or with None and a
        sentence.

        Args:
            port: the part's own name for it, declared by `calls`.
            request: the message.
            timeout: seconds until the call ends without a reply.
            on_reply: a function of two arguments, `reply` and `error`.

        Raises:
            CallError: there is no reply: too late, refused, or nobody is there; the text says why. With `on_reply`:
                the request could not be sent.
            LocalProtocolError: the part is not active, or nothing can wait here.
            ConfigError: not declared, or another message or timeout than possible; the part ends with this error.
        """
        return self._runner.call(port, request, timeout, on_reply)

    def start(self, function: Action) -> None:
        """Call a function that waits (`yield 1.0`), unless it is waiting already.

        Raises:
            ConfigError: it is no function without arguments.
            LocalProtocolError: the part does not run.
        """
        self._runner.start(function)

    # What it reads.

    def bound(self, port: str) -> bool:
        """Whether the robot uses that port of the part now."""
        return self._runner.is_bound(port)

    def setting(self, name: str, kind: type[V] = str, default: V | None = None) -> V:  # type: ignore[assignment]  # the kind follows the argument
        """The value of a setting, for example `part.setting("period_s", float)`.

        Args:
            name: name of the parameter in the library.
            kind: bool, int, float or str.
            default: the value when this robot does not set it (and before the part is active).

        Raises:
            ConfigError: it is not set and there is no default, or its value is not of that kind.
        """
        return self._runner.settings.value(name, kind, default)

    @property
    def state(self) -> JoinState:
        """The state of the part; its `.value` is a word."""
        return self._runner.joining.state

    @property
    def reason(self) -> str:
        """Why it is in that state, in words."""
        return self._runner.joining.reason

    @property
    def board(self) -> UsbGpio:
        """The GPIO board the part was made with.

        Raises:
            ConfigError: it was made without one.
        """
        if self._board is None:
            raise ConfigError(f"part {self.local_name} has no board: make it with Part(..., board=SimGpio())")
        return self._board

    @property
    def program(self) -> ProgramDeclarations:
        """What its program has declared."""
        return self._program

    @property
    def slot(self) -> str:
        """The slot that the part is in, "" before it is active for the first time."""
        return self._runner.slot

    @property
    def settings(self) -> Mapping[str, str]:
        """The slot's settings, as text; they may change while the part runs. `setting` returns one with its type."""
        return self._runner.settings.texts

    @property
    def stopped(self) -> bool:
        """Whether STOP was said and GO was not yet: no message reaches a function, and nothing should move."""
        return self._runner.safety.stopped

    def safe_value(self, port: str) -> Message | None:
        """The safe value of a port in the part's slot, kept while the part is out of its robot; None: it has none."""
        return self._runner.safety.value_at(port)

    @property
    def busy_with(self) -> tuple[str, float] | None:
        """The function that is running now and when it began, by the loop's clock; None: no function is running."""
        return self._runner.guard.running

    @property
    def counters(self) -> PartCounters:
        """Counts of what happened since the part began to run."""
        return self._runner.counters

    # Running.

    def run(self, args: list[str] | None = None) -> None:
        """Run the part until Ctrl-C; reads `--link` and `--uid` from the command line, see `msbot.run`."""
        part_is_run(self)
        from msbot.part.run import run  # not needed by those who run the part on a loop of their own

        run(self, args=args)

    async def run_async(
        self,
        link: Link,
        *,
        settings: ClientSettings | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
        absent: str = "",
    ) -> None:
        """Run the part on the current loop until `end` (cleanly) or cancellation (without telling the master).

        Args:
            link: the connection to the master's agent; the part takes it over.
            settings: periods and limits of the client.
            epoch_ns: wall clock for time synchronisation, in ns since 1970.
            absent: why its hardware is not there: then the part only tells the robot so, and this returns.

        Raises:
            LinkDown: the link broke before it ever carried anything.
            ConfigError: the program or its robot has a mistake that going on cannot cure.
            LocalProtocolError: the part is already running.
        """
        part_is_run(self)
        if self.uid is None:
            self.uid = self._random.randbytes(UID_OCTETS)
        description = describe(self.part_number, self._called, self._program) if self.describes else ""
        identity = Identity(
            self.part_number,
            self.local_name,
            self.robot,
            self.uid,
            lambda: self.key,
            self.nature,
            self.hardware,
            self.software,
            self.home,
            description,
            absent,
        )
        await self._runner.run(link, identity, random=self._random, settings=settings, epoch_ns=epoch_ns)

    def say_stop(self) -> None:
        """Say STOP to the whole robot: this part stops at once, and its master tells all others.

        While no master serves the part, the next one is told. Only a person ends STOP.
        """
        self._runner.say_stop()

    def hold_stop(self, is_pressed: bool) -> None:
        """Tell how a STOP button at the part stands; pressed, it says STOP, and nobody can say GO until it is released.

        Releasing it is no GO.
        """
        self._runner.hold_stop(is_pressed)

    def log(self, text: object, level: str = "info") -> None:
        """Write a line into the log: at this part, and while it is active into its robot's (`msbot log --follow`).

        The robot gets 180 octets of a line, and of one part 5 lines a second, at most 20 at once; the rest is counted.

        Args:
            text: the line; what is no text is written as `print` does.
            level: `info`, `warning` or `error`.

        Raises:
            ConfigError: there is no such level.
        """
        self._runner.log(str(text), log_level(level))

    def is_safe_now(self) -> None:
        """The hardware reports something that bears on STOP: functions that have raised `NotSafeYet` are called again.

        When all of them return, STOP is confirmed at once. Nothing happens while no STOP holds, or it is confirmed.
        """
        self._runner.is_safe_now()

    def trouble(self, sentence: str) -> None:
        """Say what is wrong with the part's hardware, before `end`: the robot shows it (up to 180 octets).

        Nothing is said while the part has no place in a robot.
        """
        self._runner.say_trouble(sentence)

    @property
    def out_of_range(self) -> int:
        """Messages that it published with a value outside of the range that the robot's library declares."""
        return self._runner.ranges.count

    @property
    def trouble_heard(self) -> bool:
        """Whether the robot has acknowledged what `trouble` said in the run that ended last."""
        return self._runner.trouble_heard

    def end(self) -> None:
        """End `run_async` cleanly: the session is deleted, so the master knows at once.

        After `trouble`, the session stays until the robot has acknowledged what was said, but at most 6 s.
        """
        self._runner.end()

    def _remember(self, when: When, function: _A | None) -> _A:
        handler = _given("safe_state" if when == "safe" else f"on_{when}", function)
        self._program.add_action(when, handler)
        return handler


def _given(decorator: str, function: _F | None) -> _F:
    if function is None:
        raise ConfigError(f"@part.{decorator} is written without parentheses")
    return function


def _exchange(verb: str, port: str, request_class: object, reply_class: object) -> Exchange:
    for given in (request_class, reply_class):
        if not (isinstance(given, type) and issubclass(given, Message)):
            what = "" if given is None else f", not {given!r}"
            own = f"; or class {given.__name__}(Message) for one of your own" if isinstance(given, type) else ""
            raise ConfigError(
                f"{verb}({port!r}, ...) needs the classes of request and reply{what}: ({port!r}, Number, Text){own}"
            )
    assert isinstance(request_class, type)
    assert isinstance(reply_class, type)
    return Exchange(request_class, reply_class)


def _name(what: str, text: str) -> str:
    if not isinstance(text, str):
        raise ConfigError(f'the {what} is a text, not {text!r}: write "{text}"')
    if not text or "\0" in text or len(text.encode()) > TEXT_OCTETS:
        raise ConfigError(f"the {what} {text!r} must have 1 to {TEXT_OCTETS} bytes and no NUL")
    return text
