"""A part's program in a robot of its own, in virtual time: no sockets, no waiting, the same result each time.

The robot is real: a master with its inventory and its agent, in memory. Beside the part under test it has one other
part, the partner, with the opposite of each of its ports and services. So a message goes the way that it goes in a
robot, and STOP, settings, lost partners and cut cables have the effects that they have there.
"""

from __future__ import annotations

import asyncio
import atexit
import logging
import runpy
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Final, Self

from msbot.config import Blueprint, Direction, Library, PartType, RobotProfile, Scalar, Slot, load_library, scalar_text
from msbot.config.blueprint.blueprint_model import PRESETS
from msbot.master import Master
from msbot.part import Message, Part
from msbot.part.join.joining import ANY
from msbot.part.join.pnp_messages import range_setting, safe_setting
from msbot.part.messages.leaves import leaves_of
from msbot.part.ports import NOT_TO_PUBLISH_ON
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.process.virtual_time import VirtualTimeLoop
from msbot.sim.model_part import message_class
from msbot.testing.own_messages import ProgramMessages, as_message
from msbot.testing.service_stand_ins import Answer, ServiceStandIns
from msbot_agent.link import InprocHub, LossyLink
from msbot_agent.space import Deliver, Qos, Sample, Topic
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.errors import CallError, ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

SLOT: Final = "part"
PARTNER: Final = "partner"
_NUMBER: Final = "MSBOT-TEST-PARTNER"
_SETTLED_S: Final = 0.1
"""A message has reached its functions after this time."""
_PATIENCE_S: Final = 30.0
"""Virtual seconds in which a part joins, or is missed."""
_STEP_S: Final = 0.05
MOST_KEPT: Final = 10_000
"""Messages, log lines and errors kept of each kind, the newest."""


class PartRobot:
    """The robot around one part; made by `robot_for`, and closed by its `with` or by the fixture."""

    def __init__(
        self,
        part: Part,
        *,
        settings: Mapping[str, Scalar] | None = None,
        publishes: Mapping[str, type[Message]] | None = None,
        library: Library | None = None,
        join: bool = True,
        names: Mapping[str, object] | None = None,
    ) -> None:
        """See `robot_for`; `names` are those that the program's file has defined."""
        self.part = part
        self._ports = _ports_of(part, publishes or {}, library or load_library())
        self._services = ServiceStandIns(part, library or load_library())
        self.messages = ProgramMessages(part, names or {}, (port.message for port in self._ports.values()))
        """The program's message classes: `robot.messages.Samples`."""
        self._published: dict[str, deque[Message]] = {
            name: deque(maxlen=MOST_KEPT) for name, port in self._ports.items() if port.publishes
        }
        self._settings = _settings_of(part, self._ports, settings or {}, library or load_library())
        part_type = (library or load_library()).find(part.part_number)
        self._parameters = [] if part_type is None else [declared.name for declared in part_type.parameters]
        self._handler = _Lines()
        self._runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self._hub = InprocHub("wire")
        self._running: asyncio.Task[None] | None = None
        self._partner_running: asyncio.Task[None] | None = None
        self._is_closed = False
        atexit.register(self.close)  # a robot that nobody closes would end in tracebacks of its tasks
        self._logger = logging.getLogger("msbot.part")
        self._level = self._logger.level
        self._logger.addHandler(self._handler)
        self._logger.setLevel(logging.INFO)
        try:
            self._runner.run(self._begin())
            self.plug_partner()
            if join:
                self.plug()
        except BaseException:
            self.close()
            raise

    async def _begin(self) -> None:
        wanted = self.part.robot
        profile = RobotProfile(
            _or(wanted.name, "ROBOT"),
            version=_or(wanted.version, "1"),
            serial_number=_or(wanted.serial_number, "1"),
            manufacturer=_or(wanted.manufacturer, "-"),
        )
        slots = (Slot(SLOT, self.part.part_number), Slot(PARTNER, _NUMBER))
        topics = (SlotBinding(n, n, p.message.type_name, p.publishes) for n, p in self._ports.items())
        bindings = (*topics, *self._services.bindings())
        opposite = tuple(replace(one, publishes=not one.publishes) for one in bindings)
        self._store = MemoryStore(
            types=(PartType(self.part.part_number, self.part.part_number), PartType(_NUMBER, PARTNER)),
            slots=slots,
            configurations=(
                Configuration(1, SLOT, bindings, self._settings_text()),
                Configuration(1, PARTNER, opposite),
            ),
        )
        blueprint = Blueprint(profile, slots, timing=PRESETS["thesis"])
        self._master = Master(blueprint, self._store, random=Random(1), epoch_ns=lambda: 0, stop_group="")
        self._master.add_link(self._hub.server)
        self._serving = asyncio.create_task(self._master.run())
        await self._master.ready.wait()
        self._partner = Part(_NUMBER, local_name=PARTNER, uid=b"partner.", random=Random(2))
        self._services.declare(self._partner)
        for name, port in self._ports.items():
            if port.publishes:  # not by the partner: what is published during STOP reaches no function of a part
                topic = Topic(name, port.message.type_name)
                self._master.space.reader(topic, Qos(), _keep(self._published[name], port.message))
        self._cable = LossyLink(self._hub.connect(), random=Random(3), drop=0.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the part and its robot."""
        if self._is_closed:
            return
        self._is_closed = True
        atexit.unregister(self.close)
        self._runner.close()
        self._logger.removeHandler(self._handler)
        self._logger.setLevel(self._level)

    # Time

    @property
    def now(self) -> float:
        """Virtual seconds since the robot began."""
        return self._runner.get_loop().time()

    def advance(self, seconds: float) -> None:
        """Let so much time pass.

        Raises:
            ConfigError: the program has a mistake with which a part ends, such as a port that it does not have.
        """
        if not seconds >= 0:
            raise ConfigError(f"advance({seconds}): time does not run backwards")
        self._runner.run(asyncio.sleep(seconds))
        if self._running is not None and self._running.done() and not self._running.cancelled():
            error = self._running.exception()
            if error is not None:
                self._running = None
                if isinstance(error, ConfigError) and NOT_TO_PUBLISH_ON in str(error):
                    raise ConfigError(
                        f"{error}; for a test, the library declares what a part publishes, or the program: "
                        'part.publishes("port", Number)'
                    ) from error
                raise error

    def _until(self, what: str, is_so: Callable[[], bool]) -> None:
        until = self.now + _PATIENCE_S
        while not is_so():
            if self.now >= until:
                why = "; ".join(self._master.why(self.part.local_name)) or self.part.reason
                raise MsbotError(f"{what} within {_PATIENCE_S:g} s: {why}")
            self.advance(_STEP_S)

    # Messages

    def send(self, port: str, message: Message) -> None:
        """Feed a message into a port of the part, and give it the time to arrive."""
        meant = self._port(port, publishes=False)
        message = as_message(f"port {port!r} carries", message, meant.message)
        if not self._partner_is_in:
            raise ConfigError(f"nobody can send to {port!r}: the partner is unplugged; plug_partner() brings it back")
        self._partner.publish(port, message)
        self.advance(_SETTLED_S)

    def published(self, port: str) -> list[Message]:
        """What the part has published at a port, oldest first, since it began or since `clear`."""
        self._port(port, publishes=True)
        return list(self._published[port])

    def last(self, port: str) -> Message:
        """The newest of these; an AssertionError if there is none."""
        found = self.published(port)
        assert found, f"nothing was published at {port!r}"
        return found[-1]

    def clear(self) -> None:
        """Forget what was published, logged and wrong so far."""
        for kept in (*self._published.values(), *self._services.asked.values()):
            kept.clear()
        self._handler.log.clear()
        self._handler.errors.clear()

    # Services

    def call(self, port: str, request: Message, timeout: float = 1.0) -> Message:
        """The part's reply to a request at a port that serves.

        Raises:
            CallError: there is none; the text says why, as a caller in a robot reads it.
        """
        exchange = self._services.port(port, serves=True).exchange
        request = as_message(f"port {port!r} takes", request, exchange.request)
        if not self._partner_is_in:
            raise ConfigError(f"nobody can call {port!r}: the partner is unplugged; plug_partner() brings it back")
        ends: list[Message | CallError] = []

        def take(reply: Message | None, error: str) -> None:
            ends.append(CallError(error) if reply is None else reply)

        self._in_loop(lambda: self._partner.call(port, request, timeout=timeout, on_reply=take))
        while not ends:  # a call always ends
            self.advance(_STEP_S)
        if isinstance(ends[0], CallError):
            raise ends[0]
        return ends[0]

    def answer(self, port: str, answer: Answer) -> None:
        """Stand in for the service that the part calls at a port, from now on; at first nobody ever answers.

        Args:
            port: a port that calls.
            answer: a reply; a `CallError`: the request is refused; a function that gets the request and returns a reply
                or raises `CallError`; None: there is never a reply.
        """
        self._in_loop(lambda: self._services.answer(port, answer))

    def asked(self, port: str) -> list[Message]:
        """What the part has asked at a port that calls, oldest first, since it began or since `clear`."""
        self._services.port(port, serves=False)
        return list(self._services.asked[port])

    # What happens to a part

    def stop(self, reason: str = "") -> None:
        """Say STOP."""
        self._in_loop(lambda: self._master.say_stop("the test", reason))

    def go(self) -> None:
        """Say GO: STOP is over."""
        self._in_loop(lambda: self._master.say_go("the test"))

    def set(self, name: str, value: Scalar) -> None:
        """Change a setting of the part.

        Raises:
            ConfigError: neither the program nor the library has such a setting.
        """
        program = self.part.program.settings
        known = {*self._settings, *program.declared, *program.followers, *program.read, *self._parameters}
        if name not in known:
            near = nearest(name, known)
            has = ", ".join(sorted(known)) or "none"
            hint = did_you_mean(near) if near else f"it has {has}; robot_for(..., settings={{...}}) gives it more"
            raise ConfigError(f"the part has no setting {name!r}; {hint}")
        self._settings[name] = value
        old = self._store.configurations[SLOT]
        self._store.configurations[SLOT] = replace(old, version=old.version + 1, settings=self._settings_text())
        self._in_loop(lambda: self._master.inventory.configuration_changed(SLOT))

    def identify(self) -> None:
        """Ask which part this is."""
        holder = self._master.inventory.holder(SLOT, self.now)
        if holder is None:
            raise ConfigError("the part is not in the robot: plug() brings it back")
        self._in_loop(lambda: self._master.inventory_service.identify(holder.client_key))

    def unplug(self) -> None:
        """Pull the part's cable: its program goes on, and notices that its master is gone."""
        self._cable.disturbance.drop = 1.0
        self._until("the part did not notice that its cable is cut", lambda: self.state != "active")

    def plug(self) -> None:
        """Plug the part in, and wait until it is active.

        Raises:
            MsbotError: it does not join; the text says why.
        """
        self._cable.disturbance.drop = 0.0
        if self._running is None or self._running.done():
            self._in_loop(self._run_part)
        self._until("the part does not join", lambda: self.state == "active")

    def unplug_partner(self) -> None:
        """Let the partner vanish: the part is told that nobody publishes to its ports any more."""
        if self._partner_running is not None:
            self._partner_running.cancel()
            self._partner_running = None
            self._until("the partner is still there", lambda: not self._partner_is_in)
            self.advance(_SETTLED_S)

    def plug_partner(self) -> None:
        """Bring the partner back."""
        if self._partner_running is None:
            self._in_loop(self._run_partner)
            self._until("the partner does not come", lambda: self._partner.state.value == "active")

    # How it is

    @property
    def state(self) -> str:
        """The part's state in a word: `active`, `lost`, `looking`, `refused`, ..."""
        return self.part.state.value

    @property
    def errors(self) -> list[str]:
        """What went wrong in functions of the part: each kind of error at each line once."""
        return list(self._handler.errors)

    @property
    def log(self) -> list[str]:
        """What the part has logged, the errors too."""
        return list(self._handler.log)

    # Inside

    def _run_part(self) -> None:
        self._running = asyncio.get_running_loop().create_task(self.part.run_async(self._cable, epoch_ns=lambda: 0))

    def _run_partner(self) -> None:
        link = self._hub.connect()
        self._partner_running = asyncio.get_running_loop().create_task(
            self._partner.run_async(link, epoch_ns=lambda: 0)
        )

    @property
    def _partner_is_in(self) -> bool:
        holder = self._master.inventory.holder(PARTNER, self.now)
        return holder is not None and holder.state.is_registered

    def _in_loop(self, act: Callable[[], object]) -> None:
        async def inside() -> None:
            act()

        self._runner.run(inside())
        self.advance(_SETTLED_S)

    def _settings_text(self) -> tuple[tuple[str, str], ...]:
        return tuple(sorted((name, scalar_text(value)) for name, value in self._settings.items()))

    def _port(self, name: str, *, publishes: bool) -> _Port:
        port = self._ports.get(name)
        if port is None or port.publishes is not publishes:
            verb = "publishes at" if publishes else "listens to"
            known = ", ".join(one for one, it in self._ports.items() if it.publishes is publishes) or "none"
            raise ConfigError(f"the part {verb} no port {name!r}; it {verb} {known}")
        return port


def robot_for(
    part: Part | str | Path,
    *,
    settings: Mapping[str, Scalar] | None = None,
    publishes: Mapping[str, type[Message]] | None = None,
    library: Library | None = None,
    join: bool = True,
) -> PartRobot:
    """A robot in virtual time for a part, or for the one part that a program makes.

    Args:
        part: the part, or the file of its program, which is run up to its `part.run()`.
        settings: values of the part's settings; else those of the library, or none.
        publishes: ports at which it publishes, with their messages, if neither the library nor the program says so.
        library: part types; MsBOT's own if absent.
        join: wait until the part is active; False: `plug` has it join.

    Raises:
        ConfigError: the program makes no part, or several, or contradicts the library.
        MsbotError: the part does not join; the text says why.
    """
    meant, names = (part, None) if isinstance(part, Part) else part_of(Path(part))
    return PartRobot(meant, settings=settings, publishes=publishes, library=library, join=join, names=names)


def part_of(file: Path) -> tuple[Part, dict[str, object]]:
    """The part that a program makes and runs, and the names that it defines; the program is run up to there.

    Raises:
        ConfigError: there is no such file, or it runs no part, or several.
    """
    if not file.is_file():
        near = nearest(file.name, [one.name for one in file.parent.glob("*.py")])
        hint = did_you_mean(near) if near else "robot_for takes the file of a part's program, or a Part"
        raise ConfigError(f"there is no file {file} (looked for in {Path.cwd()}); {hint}")
    found: list[Part] = []
    with _not_run(found):
        names = runpy.run_path(str(file), run_name="__main__")
    if len(found) != 1:
        raise ConfigError(f"{file}: the program runs {len(found)} parts; robot_for takes one")
    return found[0], names


@contextmanager
def _not_run(found: list[Part]) -> Iterator[None]:
    """Have `part.run()` note the part instead."""
    run = Part.run

    def note(self: Part, args: list[str] | None = None) -> None:  # noqa: ARG001 - as `Part.run`
        found.append(self)

    Part.run = note  # type: ignore[method-assign]  # put back below
    try:
        yield
    finally:
        Part.run = run  # type: ignore[method-assign]  # as it was


def _or(wanted: str, other: str) -> str:
    """What a part wants of its robot's profile, or anything."""
    return other if wanted == ANY else wanted


def _keep(kept: deque[Message], message: type[Message]) -> Deliver:
    def deliver(sample: Sample) -> bool:
        kept.append(message.decode(sample.payload))
        return True

    return deliver


@dataclass(frozen=True, slots=True)
class _Port:
    message: type[Message]
    publishes: bool
    safe: Mapping[str, Scalar] | None = None


def _ports_of(part: Part, publishes: Mapping[str, type[Message]], library: Library) -> dict[str, _Port]:
    program = part.program
    ports = {
        name: _Port(one.message_class, publishes=False, safe=_safe(one.safe)) for name, one in program.listeners.items()
    }
    ports |= {name: _Port(cls, publishes=True) for name, cls in (dict(program.publications) | dict(publishes)).items()}
    part_type = library.find(part.part_number)
    for declared in () if part_type is None else part_type.ports:
        says = declared.direction is Direction.PUBLISH
        known = ports.get(declared.name)
        if known is not None and (known.publishes is not says or known.message.type_name != declared.type_name):
            verb = "publishes" if says else "listens to"
            raise ConfigError(
                f"port {declared.name!r}: the library says that {part.part_number} {verb} {declared.type_name} there, "
                f"the program {'publishes' if known.publishes else 'listens to'} {known.message.type_name}"
            )
        if known is not None:
            ports[declared.name] = replace(known, safe=declared.safe or known.safe)
        elif says and declared.message is not None:
            ports[declared.name] = _Port(message_class(declared.message), publishes=True)
    return ports


def _safe(message: Message | None) -> Mapping[str, Scalar] | None:
    if message is None:
        return None
    return leaves_of(message)


def _settings_of(
    part: Part, ports: Mapping[str, _Port], given: Mapping[str, Scalar], library: Library
) -> dict[str, Scalar]:
    part_type = library.find(part.part_number)
    found: dict[str, Scalar] = {}
    for declared in () if part_type is None else part_type.parameters:
        if declared.default is not None:
            found[declared.name] = declared.default
    for name, port in ports.items():
        if not port.publishes and port.safe is not None:
            found |= {safe_setting(name, field): value for field, value in port.safe.items()}
    for declared_port in () if part_type is None else part_type.ports:
        if declared_port.direction is Direction.PUBLISH:
            for name, (least, most) in declared_port.ranges.items():
                found[range_setting(declared_port.name, name)] = f"{least:g} {most:g}"
    return found | dict(given)


class _Lines(logging.Handler):
    """Keeps what the part logs."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.log: list[str] = []
        self.errors: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        words = record.getMessage()
        if isinstance(record.args, tuple) and record.args[:1] == (PARTNER,):
            return
        if record.levelno < logging.ERROR and self.log[-1:] == [words]:
            return  # the partner hears of STOP as well
        for kept in (self.log, self.errors) if record.levelno >= logging.ERROR else (self.log,):
            kept.append(words)
            del kept[:-MOST_KEPT]
