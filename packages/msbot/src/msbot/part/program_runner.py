"""Runs a student's program as a part of a robot: joins the robot, binds ports to topics, calls the program's functions.

`join` decides how a part joins, `safe_state` what makes it safe; this file passes on to them what comes in, and tells
the program the outcome.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from random import Random

from msbot.part.beginner_hints import SILENCE_S, silence_words
from msbot.part.client.client import Client
from msbot.part.client.client_settings import ClientSettings
from msbot.part.handler_guard import Guard, check_handler
from msbot.part.join.home import Home, home_text
from msbot.part.join.joining import PATIENT, QUICK, Changed, ExpectedRobot, Joining, JoinState
from msbot.part.join.membership import Membership
from msbot.part.join.part_keys import prove, prove_sealed
from msbot.part.join.part_log import BURST, PER_S, LineRate, LogLevel, printable
from msbot.part.join.pnp_messages import (
    STOP_SETTING,
    BindingDirection,
    ClaimMessage,
    ConfigurationMessage,
    Nature,
    Notice,
    NoticeKind,
)
from msbot.part.join.refusal import displayed_state, refusal_hint
from msbot.part.messages.message import Message
from msbot.part.part_services import PartCalls, PartServices
from msbot.part.part_settings import Settings
from msbot.part.ports import Ports
from msbot.part.program import Action, After, ProgramDeclarations, When, check_room
from msbot.part.range_watch import RangeWatch
from msbot.part.safe_state import Safety
from msbot.part.type_reports import TypeTelling
from msbot_agent.link import Link, Peer, Signal
from msbot_agent.log import ALWAYS
from msbot_xrce.errors import ConfigError, LocalProtocolError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

_log = logging.getLogger("msbot.part")
_LEVELS = {LogLevel.INFO: logging.INFO, LogLevel.WARNING: logging.WARNING, LogLevel.ERROR: logging.ERROR}


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a part says it is, and which robot it looks for."""

    part_number: str
    local_name: str
    robot: ExpectedRobot
    uid: bytes
    key: Callable[[], bytes | None]
    """The key that proves its UID; called at each challenge, because a part may get its key while it runs."""
    nature: Nature = Nature.UNKNOWN
    """What is behind its ports."""
    hardware: str = ""
    software: str = ""
    """Versions; empty: it says none."""
    home: Home = Home.PC
    """What runs it."""
    description: str = ""
    """What it says of itself to a robot that does not know its part number; empty: nothing."""
    absent: str = ""
    """Why its hardware is not there: it only says so, and never becomes active; empty: it is there."""

    def prove(self, nonce: bytes, session_key: int) -> bytes | None:
        """The answer to a challenge in that session; None = the part has no key."""
        key = self.key()
        if key is None:
            return None
        return prove(
            key,
            nonce,
            self.uid,
            part_number=self.part_number,
            local_name=self.local_name,
            session_key=session_key,
        )

    def prove_sealed(self, nonce: bytes, session_key: int, session_nonce: int) -> tuple[bytes, bytes] | None:
        """The same in a robot whose samples are sealed, and the secret for the seals."""
        key = self.key()
        if key is None:
            return None
        return prove_sealed(
            key,
            nonce,
            self.uid,
            part_number=self.part_number,
            local_name=self.local_name,
            session_key=session_key,
            session_nonce=session_nonce,
        )


@dataclass(slots=True)
class PartCounters:
    """Counts of what happened to a part since it began to run."""

    messages_in: int = 0
    """Samples handed to a handler."""
    messages_out: int = 0
    """Samples published."""
    not_sent: int = 0
    """Samples not sent because the stream or the link had no room."""
    dropped: int = 0
    """Samples that arrived and could not be used."""
    refused: int = 0
    """Samples without a good seal, in a robot with `authentication = "key+data"`."""
    held: int = 0
    """Samples that arrived after STOP and were not used."""
    beats: int = 0
    """Beats that the inventory answered."""
    missed_beats: int = 0
    handler_errors: int = 0


class ProgramRunner:
    """Runs one program each time `run` is awaited; its counters and state are kept between the runs."""

    def __init__(self, program: ProgramDeclarations) -> None:
        self.program = program
        self.guard = Guard(self._mistaken, self._tell_robot)
        self.ranges = RangeWatch()
        """What it publishes, and what the library says of that."""
        self.settings = Settings(self.guard, program.settings)
        self.safety = Safety(program.listeners, program.when["safe"], self.guard)
        self.joining = Joining(ExpectedRobot())
        """The state of the part; between runs, that of the last run."""
        self.slot = ""
        """The slot that the part is in, "" before it is active for the first time."""
        self._own_lines = LineRate(PER_S, BURST)
        self.trouble_heard = False
        """See `Part.trouble_heard`."""
        self._local_name = ""
        self._describes = False
        self._counters = PartCounters()
        self._configurations = 0
        self.types = TypeTelling(program)
        self._mistake: ConfigError | None = None
        self._faults: list[tuple[LogLevel, str]] = []
        """What is wrong with ports of the configuration; the robot is told when the part is active."""
        self._told_faults: dict[str, str] = {}
        self._pending: set[After] = set()
        """What is called once, and waits for its time."""
        self._ports: Ports | None = None
        self._membership: Membership | None = None
        self._loop_thread = 0
        self._calls = PartCalls(program, self.guard)
        self._services = PartServices(program, self.guard)

    @property
    def counters(self) -> PartCounters:
        """Counts of what happened since the part began to run."""
        self._counters.beats = self.joining.beats
        self._counters.missed_beats = self.joining.missed_beats
        self._counters.handler_errors = self.guard.errors
        if self._membership is not None:
            self._counters.refused = self._membership.seals.refused
        return self._counters

    def is_bound(self, port: str) -> bool:
        """Whether the robot uses that port of the part now."""
        return self._ports is not None and port in self._ports

    def publish(self, port: str, message: Message) -> bool:
        """Send a message out of a port (`Part.publish`)."""
        ports = self._open_ports()
        if not isinstance(port, str):
            raise ConfigError('the port comes first, and is a text: publish("out", message)')
        if type(message) is self.program.publications.get(port) and port not in ports:
            return False  # declared, and not wired in this robot (yet): nobody listens
        if port not in self.types.told and self._membership is not None and isinstance(message, Message):
            self.types.tell_port(port, type(message), ports, self._membership)
        is_sent = self._count(ports.publish(port, message))
        if words := self.ranges.look(port, message):
            self.log(words, LogLevel.WARNING)
        return is_sent

    def publish_octets(self, port: str, type_name: str, octets: bytes) -> bool:
        """Send an encoded message out of a port (`Part.publish_octets`)."""
        return self._count(self._open_ports().publish_octets(port, type_name, octets))

    def call(
        self, port: str, request: Message, timeout_s: float, on_reply: Callable[..., object] | None
    ) -> Message | None:
        """Send a request and wait for the reply, or have `on_reply` called with it (`Part.call`)."""
        return self._calls.call(self._open_ports("call"), port, request, timeout_s, on_reply)

    def after(self, delay_s: float, function: Action) -> None:
        """Call a function once (`Part.after`)."""
        if self._membership is None:
            self.program.add_delayed(delay_s, function)
            return
        self._open_ports("call after()")
        check_room(len(self._pending))
        self._wait(After(delay_s, function))

    def _wait(self, one: After) -> None:
        self._pending.add(one)
        one.start(self.guard, self._pending.discard)

    def start(self, function: Callable[[], object]) -> None:
        """Call a function that may wait (`Part.start`)."""
        name = check_handler(function)
        if self._ports is None:
            raise LocalProtocolError(f"the part does not run: start {name} in a function below @part.every or @part.on")
        self._check_thread("start")
        self.guard.call(function)

    def _open_ports(self, does: str = "publish") -> Ports:
        if self._ports is None or self.joining.state is not JoinState.ACTIVE:
            if self._ports is None:
                raise LocalProtocolError(f"the part does not run: {does} in a function below @part.every or @part.on")
            raise LocalProtocolError(
                f"the part is {self.joining.state.value}, not active ({self.joining.reason}): {does} after on_join"
            )
        self._check_thread(does.removeprefix("call "))
        return self._ports

    def _check_thread(self, verb: str) -> None:
        if threading.get_ident() != self._loop_thread:
            name = threading.current_thread().name
            raise LocalProtocolError(
                f"{verb} was called from another thread ({name}): call it in a function below @part.every or @part.on"
            )

    def _count(self, sent: bool) -> bool:
        if sent:
            self._counters.messages_out += 1
        else:
            self._counters.not_sent += 1
        return sent

    async def run(
        self,
        link: Link,
        identity: Identity,
        *,
        random: Random,
        settings: ClientSettings | None,
        epoch_ns: Callable[[], int],
    ) -> None:
        """Run the program over that link until `end` or cancellation (`Part.run_async`)."""
        if self._membership is not None:
            raise LocalProtocolError(f"part {self._local_name} runs already")
        self._loop_thread = threading.get_ident()
        self._local_name = self.guard.part = identity.local_name
        self._describes = bool(identity.description)
        self.joining = Joining(identity.robot, PATIENT if link.info.shared_bus else QUICK)
        self._mistake = None
        self.trouble_heard = False
        self._configurations = 0
        self.settings.forget()
        # Not derived from the UID: two devices with the same UID must be seen as two (else they would silently take
        # over each other's session).
        key = random.randrange(1, 1 << 32)
        # On a bus a login is one compressed frame, and nothing copies it.
        has_room = not link.info.shared_bus
        claim = ClaimMessage(
            part_number=identity.part_number,
            local_name=identity.local_name,
            uid=identity.uid,
            session_nonce=random.getrandbits(32),
        )
        self._membership = membership = Membership(
            partial(
                Client,
                link,
                key=key,
                settings=settings
                or replace(ClientSettings.for_link(link.info), asks_again=has_room, numbers_logins=has_room),
                epoch_ns=epoch_ns,
                random=random,
                on_signal=self._signal_received,
                on_request=self._requested,
            ),
            self.joining,
            claim,
            profile_once=link.info.shared_bus,
            prove=lambda nonce: identity.prove(nonce, key),
            prove_sealed=lambda nonce: identity.prove_sealed(nonce, key, claim.session_nonce),
            changed=self._changed,
            configure=self._configure,
            noticed=self._noticed,
            on_topic=self._sample_received,
            on_reply=self._calls.replied,
            stop_in_beats=lambda: self.safety.beats,
            nature=identity.nature,
            hardware=identity.hardware,
            software=identity.software,
            home=home_text(identity.home),
            description=identity.description,
            absent=identity.absent,
        )
        self._ports = Ports(membership.client, membership.participant, membership.subscriber, membership.seals.seal)
        self._calls.begin(membership.seals.open, lambda: self.safety.stopped)
        self.guard.lets_wait = bool(self.program.calls)
        membership.start()
        loop = asyncio.get_running_loop()
        told = [loop.call_later(after_s, self._tell_of_silence, link.info.name) for after_s in SILENCE_S]
        try:
            await membership.client.run()
        finally:
            for timer in told:
                timer.cancel()
            membership.end("ended")
            self._calls.end_all("the part has ended")
            self.guard.waiting.end_all()
            self.trouble_heard = membership.trouble_heard
            self._ports = self._membership = None
        if self._mistake is not None:
            raise self._mistake

    def say_stop(self) -> None:
        """See `Part.say_stop`."""
        self._stop_said("said at this part")
        self._say_stop_soon()

    def hold_stop(self, is_pressed: bool) -> None:
        """See `Part.hold_stop`."""
        is_news, self.safety.is_held = is_pressed is not self.safety.is_held, is_pressed
        if is_pressed and not self.safety.stopped:
            self.say_stop()
        elif is_news:
            self._say_stop_soon()

    def is_safe_now(self) -> None:
        """See `Part.is_safe_now`."""
        if self.safety.try_again() and self._membership is not None:
            self._membership.beat_soon()

    def say_trouble(self, sentence: str) -> None:
        """See `Part.trouble`."""
        if self._membership is not None:
            self._membership.say_trouble(sentence)

    def log(self, text: str, level: LogLevel) -> None:
        """See `Part.log`."""
        line = printable(text)
        # What a program writes is shown however often it says the same; a flood is bounded as all other lines are.
        shown = {ALWAYS: True} if self._own_lines.passes(time.monotonic()) else None
        _log.log(_LEVELS[level], "%s: %s", self._local_name or "part", line, extra=shown)
        if self._membership is not None:
            self._membership.say_log(level, line)

    def _tell_robot(self, words: str) -> None:
        """Say an error of the program in the robot's log, too: people there do not see this terminal."""
        if self._membership is not None:
            self._membership.say_log(LogLevel.ERROR, printable(words))

    def end(self) -> None:
        """End `run` cleanly (`Part.end`)."""
        if self._membership is not None:
            if self.safety.is_unsafe and not self._membership.has_trouble:
                self.say_trouble("it has ended while STOP holds, and has not been made safe")
            self._membership.leave("ended")

    def _tell(self, when: When) -> None:
        for function in self.program.when[when]:
            self.guard.call(function)

    def _tell_of_silence(self, link: str) -> None:
        if words := silence_words(self.joining, link, self._local_name):
            _log.warning("%s", words)

    def _changed(self, change: Changed) -> None:
        told = f"is {displayed_state(change.after.value, change.reason)}: {change.reason}"
        if change.after is JoinState.REFUSED:
            told += refusal_hint(change.reason, self._local_name, describes=self._describes)
        _log.info("%s %s", self._local_name, "has ended" if change.after is JoinState.ENDED else told)
        assert self._ports is not None
        if change.after is JoinState.CONFIGURING:
            self.types.told.clear()
            self._faults.clear()
            self._told_faults.clear()
        if JoinState.ACTIVE in (change.before, change.after):
            self.guard.waiting.end_all()
        if change.after is JoinState.ACTIVE:
            self._tell_faults()
            self._tell("join")
            for timed in self.program.timed:
                timed.start(self.guard)
            for delayed in self.program.delayed:
                self._wait(delayed)
        elif change.before is JoinState.ACTIVE:
            for timed in self.program.timed:
                timed.cancel()
            self._end_calls(change)  # what its functions do of it, the safe state undoes
            for delayed in self._pending:
                delayed.cancel()
            self._pending.clear()
            self.safety.leave()
        elif change.after is JoinState.ENDED and self._calls.stand_still:
            self._end_calls(change)
            self.safety.leave()
        self._follow_master(change)
        if change.after is JoinState.ENDED:
            self._tell("end")
        elif change.before is JoinState.ACTIVE:
            self._tell("lost")
        if change.after is JoinState.LOST:
            # The next agent learns of topics only from a part that has joined its robot.
            self._ports.unbind_all()

    def _end_calls(self, change: Changed) -> None:
        why = f"the part is {change.after.value}, not active any more ({change.reason})"
        if change.after is JoinState.ENDED:
            self._calls.end_all(why)
        else:
            self._calls.end(why)

    def _follow_master(self, change: Changed) -> None:
        """What the change means for a STOP that holds."""
        match change.after:
            case JoinState.LOST | JoinState.WRONG_ROBOT:
                self.safety.change_master(is_there=False)
            case JoinState.RECOGNISING:
                self.safety.change_master(is_there=True)
            case JoinState.CLAIMING:
                if change.before is not JoinState.RECOGNISING:
                    self.safety.change_master(is_there=True)
                if self.safety.recognise(self.joining.robot):
                    self._stop_is_over()
            case JoinState.CONFIGURING:
                self.safety.ask()
                self._say_stop_soon()
            case JoinState.ENDED:
                self.safety.forget_stop()

    def _say_stop_soon(self) -> None:
        """The master may not know of the STOP that holds."""
        if self._membership is not None and self.safety.stopped:
            self._membership.beat_soon()

    def _stop_is_over(self) -> None:
        self._tell("go")
        self._calls.stop_is_over()
        if self.safety.is_held:
            self.say_stop()

    def _configure(self, configuration: ConfigurationMessage) -> None:
        assert self._ports is not None
        self._configurations += 1
        self.slot = configuration.slot
        settings = [setting for setting in configuration.settings if setting.name != STOP_SETTING]
        self.safety.configure(self.settings.take(settings))
        self.ranges.configure(self.settings.ranges)
        for setting in configuration.settings:
            if setting.name == STOP_SETTING and setting.value.isdecimal():
                self._stop_said("it holds in the robot that the part has joined", int(setting.value))
        if len(settings) == len(configuration.settings) and self.safety.no_stop_holds():
            self._stop_is_over()
        before = {port: self._ports.binding(port) for port in self._told_faults}
        self._ports.bind(configuration.bindings)
        for port, binding in before.items():
            if self._ports.binding(port) != binding:
                del self._told_faults[port]  # what was said of another wire does not count for this one
        for port, listener in self.program.listeners.items():
            fault = self._ports.fault_of(port, listener.message_class.type_name, optional=listener.optional)
            self._report_fault(port, fault)
        for port, server in self.program.servers.items():
            name = server.exchange.type_name
            self._report_fault(port, self._ports.service_fault(port, name, BindingDirection.SERVE))
            if not server.optional:
                self._report_fault(port, self._ports.uncalled(port, self.slot, name), LogLevel.WARNING)
        for port, exchange in self.program.calls.items():
            self._report_fault(port, self._ports.service_fault(port, exchange.type_name, BindingDirection.CALL))
            if port not in self._ports:
                self._calls.end("the robot has taken its wire away", port)
        if self._membership is not None:
            self.types.tell(self._ports, self._membership)
        self._tell_faults()
        self.settings.tell()
        self._tell("configured")

    def _report_fault(self, port: str, fault: str, level: LogLevel = LogLevel.ERROR) -> None:
        """Say what is wrong with a port here at once, and to the robot's people once for each of its wires."""
        words = f"port {port!r}: {fault}"
        if fault and level is LogLevel.ERROR:
            self.guard.report(f"port {port!r}", fault)
        if fault and self._told_faults.get(port) != words:
            if level is not LogLevel.ERROR:
                _log.info("%s", words)
            self._told_faults[port] = words
            self._faults.append((level, words))

    def _tell_faults(self) -> None:
        """Lines of an active part reach the robot's log, and its journal."""
        if self._membership is not None and self.joining.state is JoinState.ACTIVE:
            for level, words in self._faults:
                self._membership.say_log(level, printable(words))
            self._faults.clear()

    def _noticed(self, notice: Notice) -> None:
        match notice.kind:
            case NoticeKind.STOP:
                self._stop_said("said by the master", notice.number)
            case NoticeKind.GO:
                if self.safety.go(notice.number):
                    self._stop_is_over()
            case NoticeKind.IDENTIFY:
                _log.info("%s: somebody asks which part this is", self._local_name)
                self._tell("identify")
            case NoticeKind.PARTNER_LOST:
                self._partner_lost_at(notice)
            case NoticeKind.TYPE_DIFFERS if notice.number == self.joining.configuration_version:
                self._type_differs(notice)

    def _type_differs(self, notice: Notice) -> None:
        if self._ports is None or self._membership is None:
            return
        found = self.types.differs(notice, self._ports, self._membership)
        if found is not None:
            port, words = found
            self.guard.report(f"port {port!r}", f"{words}; `msbot why {self.slot}` shows both")

    def _stop_said(self, reason: str, number: int | None = None) -> None:
        before = self.safety.number
        is_news = self.safety.stop(reason, number)
        if is_news:
            self._tell("stop")
        if self._membership is not None and self.safety.number not in (0, before):
            self._membership.beat_soon()

    def _partner_lost_at(self, notice: Notice) -> None:
        assert self._ports is not None
        port = self._ports.port_at(notice.binding)
        if port is None or notice.number != self.joining.configuration_version:
            return
        what = "serves what port %s calls" if port in self.program.calls else "sends to port %s"
        _log.info(f"%s: nobody {what} any more", self._local_name, port)
        self._calls.end("the part that served it has left, or is held: `msbot parts` shows who is there", port)
        self.safety.enter(port)
        for function in self.program.partner_lost:
            self.guard.call(function, port)

    def _sample_received(self, object_id: int, _request_id: int, payload: bytes) -> None:
        assert self._ports is not None
        bound = self._ports.port_of(object_id)
        listener = self.program.listeners.get(bound.binding.port) if bound is not None else None
        if bound is None or listener is None or self.joining.state is not JoinState.ACTIVE:
            self._counters.dropped += 1
            return
        if listener.message_class.type_name != bound.binding.topic_type:
            self._counters.dropped += 1
            return
        try:
            message = listener.message_class.decode(payload)
        except RemoteProtocolError as error:
            self._counters.dropped += 1
            self.guard.report(
                f"port {bound.binding.port!r}", f"a message that cannot be read: {error}", kind="unreadable"
            )
            return
        if self.safety.stopped:
            self._counters.held += 1
            return
        self._counters.messages_in += 1
        self.guard.call(listener.function, message)

    def _requested(self, object_id: int, _request_id: int, identity: bytes, payload: bytes) -> None:
        assert self._ports is not None
        assert self._membership is not None
        bound = self._ports.port_of(object_id)
        opened = self._membership.seals.open(object_id, identity + payload)
        if bound is None or opened is None or self.joining.state is not JoinState.ACTIVE:
            self._counters.dropped += 1
            return
        identity, request = opened[: len(identity)], opened[len(identity) :]

        def reply(octets: bytes) -> None:
            self._count(self._ports is not None and self._ports.send_reply(bound, identity, octets))

        if self._services.serve(bound.binding, request, stopped=self.safety.stopped, reply=reply):
            self._counters.messages_in += 1
        elif self.safety.stopped:
            self._counters.held += 1

    def _signal_received(self, signal: Signal, _peer: Peer | None, reason: str, _now: float) -> None:
        if signal is Signal.STOP:
            self._stop_said(reason)

    def _mistaken(self, error: ConfigError) -> None:
        """A handler asked for a port that is not there, or with the wrong type."""
        if self._configurations > 1:
            # It worked with an earlier configuration: the program is not at fault, and the robot goes on.
            self.guard.report(str(error), "since the configuration has changed")
            return
        self._mistake = self._mistake or error
        self.end()
