"""What a student imports: a part that joins its robot by itself, stays in it, and calls the student's functions.

::

    part = Part("ABCD", robot="MSBOT_MASTER")

    @part.every(1.0)
    def greet() -> None:
        part.publish("out", HelloWorld(index=1, message="hello"))

    part.run()
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Mapping
from random import Random, SystemRandom

from msbot.errors import ConfigError, LocalProtocolError, RemoteProtocolError
from msbot.link import Link, Peer, Signal
from msbot.part.beginner import SILENCE_S, part_is_run, part_was_made, silence_words
from msbot.part.boards.gpio import UsbGpio
from msbot.part.client.client import Client
from msbot.part.client.settings import ClientSettings
from msbot.part.counters import PartCounters
from msbot.part.join.joining import ANY, PATIENT, QUICK, Changed, ExpectedRobot, Joining, JoinState
from msbot.part.join.keys import check_key, parse_key, prove
from msbot.part.join.membership import Membership
from msbot.part.join.plug import (
    STOP_SETTING,
    TEXT_OCTETS,
    UID_OCTETS,
    ClaimMessage,
    ConfigurationMessage,
    Notice,
    NoticeKind,
)
from msbot.part.messages.message import Message
from msbot.part.ports import Ports
from msbot.part.program import Program
from msbot.part.safe_state import Safety

_log = logging.getLogger("msbot.part")


class Part(Program):
    """One part of a robot: a part number, ports, and functions that are called when something happens.

    All functions are called in one thread, one after the other, and must return quickly.
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
    ) -> None:
        """Describe a part; `run` or `run_async` brings it to life.

        Args:
            part_number: what kind of part it is, a key into the robot's library, for example `ABCD`.
            local_name: what this one is called, for example `left eye`; the part number if absent.
            robot: name of the robot the part is made for, or more of its profile; `*` = any robot.
            uid: 8 octets that identify the piece of hardware; `run` keeps one per part on this computer.
            board: the GPIO board that the part's functions drive; found again as `part.board`.
            random: draws the client key and the session nonce, and the UID if there is none.
            key: what the part proves its UID with, as octets or as `msbot key new` writes it; never sent.

        Raises:
            ConfigError: a name is empty or too long, the UID has not 8 octets, or the key makes no sense.
        """
        self.part_number = _name("part number", part_number)
        self.local_name = _name("local name", part_number if local_name is None else local_name)
        self.robot = ExpectedRobot(robot) if isinstance(robot, str) else robot
        if uid is not None and len(uid) != UID_OCTETS:
            raise ConfigError(f"a UID has {UID_OCTETS} octets, not {len(uid)}")
        self.uid = uid
        self.key = parse_key(key) if isinstance(key, str) else check_key(key) if key is not None else None
        """The part's key; `run` gives it the one that is kept for the part."""
        self._board = board
        self._random = random or SystemRandom()
        super().__init__(self._mistaken)
        self._safety = Safety(self._listeners, self._when["safe"], self._guard)
        self._counters = PartCounters()
        self._slot = ""
        self._configurations = 0
        self._mistake: ConfigError | None = None
        self._joining = Joining(self.robot)
        self._client: Client | None = None
        self._ports: Ports | None = None
        self._membership: Membership | None = None
        self._loop_thread = 0
        part_was_made(self)

    # What a student's program says.

    def publish(self, port: str, message: Message) -> bool:
        """Send a message out of a port; False when there was no room for it (counted as `not_sent`).

        Raises:
            LocalProtocolError: the part is not active: nobody publishes before both steps are done.
            ConfigError: no such port, or a message of another type; the part ends with this sentence.
        """
        if self._ports is None or self._joining.state is not JoinState.ACTIVE:
            if self._client is None:
                raise LocalProtocolError("the part does not run: publish in a function below @part.every or @part.on")
            raise LocalProtocolError(
                f"the part is {self.state.value}, not active ({self.reason}): publish after on_join"
            )
        if threading.get_ident() != self._loop_thread:
            name = threading.current_thread().name
            raise LocalProtocolError(
                f"publish was called from another thread ({name}): call it in a function below @part.every or @part.on"
            )
        sent = self._ports.publish(port, message)
        if sent:
            self._counters.messages_out += 1
        else:
            self._counters.not_sent += 1
        return sent

    def bound(self, port: str) -> bool:
        """Whether the robot uses that port of the part now."""
        return self._ports is not None and port in self._ports

    # What a student's program reads.

    @property
    def state(self) -> JoinState:
        """Where the part stands; its `.value` is a word."""
        return self._joining.state

    @property
    def reason(self) -> str:
        """Why it is in that state, in words."""
        return self._joining.reason

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
    def slot(self) -> str:
        """The slot the part sits in, "" before it is active for the first time."""
        return self._slot

    @property
    def settings(self) -> Mapping[str, str]:
        """The slot's settings, as text; changes while the part runs. `setting` gives one with its type."""
        return self._settings.texts

    @property
    def stopped(self) -> bool:
        """Whether STOP was said and GO was not: no message reaches a function, and nothing should move."""
        return self._safety.stopped

    @property
    def busy_with(self) -> tuple[str, float] | None:
        """The function that runs at this moment and since when, by the loop's clock; None: none does."""
        return self._guard.running

    @property
    def counters(self) -> PartCounters:
        """What happened since the part began to run."""
        self._counters.beats = self._joining.beats
        self._counters.missed_beats = self._joining.missed_beats
        self._counters.handler_errors = self._guard.errors
        return self._counters

    # Running.

    def run(self, args: list[str] | None = None) -> None:
        """Run the part until Ctrl-C; reads `--link` and `--uid` from the command line, see `msbot.run`."""
        part_is_run(self)
        from msbot.part.run import run  # the facade is not needed by those who run on a loop of their own

        run(self, args=args)

    async def run_async(
        self,
        link: Link,
        *,
        settings: ClientSettings | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Run the part on the present loop until `end` (polite) or cancellation (without a word to the master).

        Args:
            link: the way to the master's agent; the part takes it over.
            settings: periods and limits of the client.
            epoch_ns: wall clock for time synchronisation, in ns since 1970.

        Raises:
            LinkDown: the link broke before it ever carried anything.
            ConfigError: the program or its robot is wrong in a way that running on cannot mend.
            LocalProtocolError: the part runs already.
        """
        if self._client is not None:
            raise LocalProtocolError(f"part {self.local_name} runs already")
        part_is_run(self)
        self._loop_thread = threading.get_ident()
        if self.uid is None:
            self.uid = self._random.randbytes(UID_OCTETS)
        self._joining = Joining(self.robot, PATIENT if link.info.shared_bus else QUICK)
        self._mistake = None
        self._configurations = 0
        self._settings.forget()
        # Not derived from the UID: two devices with one UID must be seen as two (they would take over each
        # other's session without a word).
        client = Client(
            link,
            key=self._random.randrange(1, 1 << 32),
            settings=settings,
            epoch_ns=epoch_ns,
            random=self._random,
        )
        claim = ClaimMessage(
            part_number=self.part_number,
            local_name=self.local_name,
            uid=self.uid,
            session_nonce=self._random.getrandbits(32),
        )
        membership = Membership(
            client,
            self._joining,
            claim,
            profile_once=link.info.shared_bus,
            prove=self._prove,
            changed=self._changed,
            configure=self._configure,
            noticed=self._noticed,
            obeyed_stop=lambda: self._safety.number,
        )
        client.on_topic = self._sample_received
        client.on_signal = self._signal_received
        self._client, self._membership = client, membership
        self._ports = Ports(client, membership.participant, membership.subscriber)
        membership.start()
        loop = asyncio.get_running_loop()
        told = [loop.call_later(after_s, self._tell_of_silence, link.info.name) for after_s in SILENCE_S]
        try:
            await client.run()
        finally:
            for timer in told:
                timer.cancel()
            membership.end("ended")
            self._client = self._ports = self._membership = None
        if self._mistake is not None:
            raise self._mistake

    def end(self) -> None:
        """End `run_async` politely: the session is deleted, the master knows at once."""
        if self._client is not None and self._membership is not None:
            self._membership.end("ended")
            self._client.close_soon()

    def _tell_of_silence(self, link: str) -> None:
        if words := silence_words(self._joining.state, link, self.local_name):
            _log.warning("%s", words)

    def _prove(self, nonce: bytes) -> bytes | None:
        if self.key is None or self.uid is None or self._client is None:
            return None
        return prove(
            self.key,
            nonce,
            self.uid,
            part_number=self.part_number,
            local_name=self.local_name,
            session_key=self._client.key,
        )

    def _changed(self, change: Changed) -> None:
        _log.info("%s is %s: %s", self.local_name, change.after.value, change.reason)
        assert self._ports is not None
        if change.after is JoinState.ACTIVE:
            self._tell("join")
            for timed in self._timed:
                timed.start(self._guard)
        elif change.before is JoinState.ACTIVE:
            for timed in self._timed:
                timed.cancel()
            # Whoever takes the part back says STOP again if it still holds.
            self._safety.leave()
        if change.after is JoinState.ENDED:
            self._tell("end")
        elif change.before is JoinState.ACTIVE:
            self._tell("lost")
        if change.after is JoinState.LOST:
            # The next agent hears of topics only from a part that has joined its robot.
            self._ports.unbind_all()

    def _configure(self, configuration: ConfigurationMessage) -> None:
        assert self._ports is not None
        self._configurations += 1
        self._slot = configuration.slot
        settings = [setting for setting in configuration.settings if setting.name != STOP_SETTING]
        self._safety.configure(self._settings.take(settings))
        for setting in configuration.settings:
            if setting.name == STOP_SETTING and setting.value.isdecimal():
                self._stop_said("it holds in the robot that the part has joined", int(setting.value))
        self._ports.bind(configuration.bindings)
        for port, listener in self._listeners.items():
            fault = self._ports.fault_of(port, listener.message_class.type_name, optional=listener.optional)
            if fault:
                self._guard.report(f"port {port!r}", fault)
        self._settings.tell()

    def _noticed(self, notice: Notice) -> None:
        match notice.kind:
            case NoticeKind.STOP:
                self._stop_said("said by the master", notice.number)
            case NoticeKind.GO:
                if self._safety.go(notice.number):
                    self._tell("go")
            case NoticeKind.IDENTIFY:
                _log.info("%s: somebody asks which part this is", self.local_name)
                self._tell("identify")
            case NoticeKind.PARTNER_LOST:
                self._partner_lost_at(notice)

    def _stop_said(self, reason: str, number: int | None = None) -> None:
        before = self._safety.number
        is_news = self._safety.stop(reason, number)
        if is_news:
            self._tell("stop")
        if self._membership is not None and self._safety.number not in (0, before):
            self._membership.beat_soon()

    def _partner_lost_at(self, notice: Notice) -> None:
        assert self._ports is not None
        port = self._ports.port_at(notice.binding)
        if port is None or notice.number != self._joining.configuration_version:
            return
        _log.info("%s: nobody sends to port %s any more", self.local_name, port)
        self._safety.enter(port)
        for function in self._partner_lost:
            self._guard.call(function, port)

    def _sample_received(self, object_id: int, _request_id: int, payload: bytes) -> None:
        assert self._membership is not None
        assert self._ports is not None
        if self._membership.take_sample(object_id, payload):
            return
        bound = self._ports.port_of(object_id)
        listener = self._listeners.get(bound.binding.port) if bound is not None else None
        if bound is None or listener is None or self._joining.state is not JoinState.ACTIVE:
            self._counters.dropped += 1
            return
        if listener.message_class.type_name != bound.binding.topic_type:
            self._counters.dropped += 1
            return
        try:
            message = listener.message_class.decode(payload)
        except RemoteProtocolError as error:
            self._counters.dropped += 1
            self._guard.report(
                f"port {bound.binding.port!r}", f"a message that cannot be read: {error}", kind="unreadable"
            )
            return
        if self._safety.stopped:
            self._counters.held += 1
            return
        self._counters.messages_in += 1
        self._guard.call(listener.function, message)

    def _signal_received(self, signal: Signal, _peer: Peer | None, reason: str, _now: float) -> None:
        if signal is Signal.STOP:
            self._stop_said(reason)

    def _mistaken(self, error: ConfigError) -> None:
        """A handler asked for a port that is not there, or with the wrong type."""
        if self._configurations > 1:
            # It worked with an earlier configuration: not the program is wrong, and the robot goes on.
            self._guard.report(str(error), "since the configuration has changed")
            return
        self._mistake = self._mistake or error
        self.end()


def _name(what: str, text: str) -> str:
    if not text or "\0" in text or len(text.encode()) > TEXT_OCTETS:
        raise ConfigError(f"the {what} {text!r} must have 1 to {TEXT_OCTETS} octets and no NUL")
    return text
