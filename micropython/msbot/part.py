"""What a student imports: a part that joins its robot by itself, stays in it, and calls the student's functions.

The same methods as on a PC (docs/reference/part.md). All functions are called in one thread, one after the other.
"""

import random
import struct

from micropython import const

from .errors import CallError, ConfigError, LocalProtocolError, RemoteProtocolError, say
from .membership import ExpectedRobot, JoinState, Membership
from .message import Message, type_name_of
from .running import forget, load, once
from .xrce import BEST_EFFORT, RELIABLE

_NO_PORT = (("", "", "", True, True), 0, 0)  # (port, topic, type, subscribes, reliable), ids of topic and endpoint
_SLOW = const(500)
_REPORTS = const(30)
KINDS = (bool, int, float, str)  # of settings
_PARTNER_LOST = const(1)
_IDENTIFY = const(3)
_STOP = const(4)
_GO = const(5)
_MOST_DELAYED = const(100)
_NEVER = const(0x3FFFFFFF)  # no GO has that number


def _waits():
    yield


_STEPS = type(_waits())  # what a function gives that waits: `yield 1.0`


class Counters:
    """What happened to a part since it was made."""

    messages_in = messages_out = not_sent = dropped = refused = held = beats = missed_beats = handler_errors = 0


class Timed:
    """A function that is called every so often."""

    def __init__(self, period, function):
        self.period = period  # ms
        self.function = function
        self.due_at = None


class Part:
    """One part of a robot: a part number, ports, and functions that are called when something happens."""

    def __init__(self, part_number, *, local_name=None, robot="*", uid=None, board=None, key=None, describes=False):
        self.part_number = part_number
        self.local_name = part_number if local_name is None else local_name
        load("declaring").check_names(self)
        self.robot = robot if isinstance(robot, ExpectedRobot) else ExpectedRobot(robot)
        if uid is not None and len(uid) != 8:
            raise ConfigError("a UID has 8 bytes, not {}".format(len(uid)))
        self.uid = uid
        self.key = None
        if key is not None:
            self.key = once("keys").parse_key(key)
        self.nature = 0  # what is behind its ports: 1 = hardware, 2 = a model of it; the robot shows it
        self.describes = describes is not False
        self.called = describes if isinstance(describes, str) else self.local_name
        self.declared = []  # what it says of itself: ("publish", port, class, None), ("setting", name, kind, ...), ...
        self.slot = ""
        self.settings = {}
        self.stopped = False
        self.out_of_range = 0
        self.counters = Counters()
        self.clock = None  # ms; set by the runner of the part, to find functions that are slow
        if board is not None:
            self.board = board
        self._timed = []
        self._delayed = []  # (ms, function): called once, so long after the part has become active
        self._pending = []  # (due, function)
        self._listeners = {}
        self._when = {}
        self._followers = []
        self._defaults = {}
        self._told = {}
        self._safe = {}
        self._reported = set()
        self._ports = {}
        self._places = []
        self.told_types = {}  # port -> (its place, its binding, class): of whose messages the robot has been told
        self.configurations = 0
        # STOP, by the rules of `msbot.part.safe_state`; its names are these.
        self._is_safe = self._is_held = self._is_masters = self._is_asked = False
        self._heard = self._over = self._ends_with = self._stop = 0  # numbers of STOPs
        self._known = None
        self._now = 0
        self.services = None  # calls and requests, if the program or its robot has any
        self._waiting = None  # functions that wait, if the program has any
        self._client = self._membership = None

    # Called by a student's program.

    def __getattr__(self, name):
        """`every`, `on`, `on_join` and so on: they are forgotten when the part begins; and `log`."""
        return load("log_lines" if name == "log" else "declaring").verb(self, name)

    def publish(self, port, message):
        """Send a message out of a port; False when there was no room for it."""
        if self.state is not JoinState.ACTIVE:
            raise LocalProtocolError(once("words").not_active(self))
        binding, _, object_id = self._ports.get(port, _NO_PORT)
        if port not in self._ports and ("publish", port, type(message), None) in self.declared:
            return False  # not wired in this robot (yet): nobody listens
        if binding[3] or not isinstance(message, Message) or type_name_of(type(message)) != binding[2]:
            raise ConfigError(once("words").not_for_port(self, port, binding, message))
        if port not in self.told_types:
            once("type_hash").tell_port(self, port, type(message))
        octets = self._membership.seal(object_id, message.encode())
        sent = self._client.write(object_id, octets, stream_of(binding))
        self.counters.messages_out += sent
        self.counters.not_sent += not sent
        return sent

    def call(self, port, request, *, timeout=1.0, on_reply=None):
        """Send a request out of a port; `on_reply(reply, error)` is called once, as on a PC."""
        self.use_services().call(port, request, timeout, on_reply)

    def use_services(self):
        """What calls and serves, imported when it is needed."""
        if self.services is None:
            self.services = load("services").Services(self)
        return self.services

    def after(self, seconds, function=None):
        """Call a function once, so many seconds from now; said before the part runs, after it becomes active."""
        if function is None:
            return lambda function: self.after(seconds, function)
        if not seconds >= 0 or not callable(function):
            load("declaring").check_after(seconds, function)
        delay = int(seconds * 1000 + 0.5)
        waiting = self._pending if self._client else self._delayed
        if len(waiting) >= _MOST_DELAYED:
            raise LocalProtocolError(once("words").too_many_delayed(_MOST_DELAYED))
        if not self._client:
            waiting.append((delay, function))
        elif self.state is JoinState.ACTIVE:
            waiting.append((self._now + delay, function))
        else:
            raise LocalProtocolError(once("words").not_active(self, "call after()"))
        return function

    def say_stop(self):
        """Say STOP to the whole robot."""
        self.stop_said("said at this part", self._now)
        if self._membership:
            self._membership.beat_soon(self._now)

    def hold_stop(self, is_pressed):
        """Tell how a STOP button stands; pressed, it says STOP, and nobody can say GO until it is released."""
        news, self._is_held = is_pressed is not self._is_held, is_pressed
        if is_pressed and not self.stopped:
            self.say_stop()
        elif news and self.stopped:
            self._membership.beat_soon(self._now)

    def start(self, function):
        """Call a function that waits (`yield 1.0`), unless it is waiting already."""
        if self._client is None:
            raise LocalProtocolError(once("words").cannot_start(function))
        self._call(function)

    def bound(self, port):
        """Whether the robot uses that port of the part now."""
        return port in self._ports

    def setting(self, name, kind=str, default=None):
        """The value of a setting; a missing one without a default is an error."""
        if kind not in KINDS:
            load("declaring").check_kind(name, kind)
        text = self.settings.get(name)
        if text is not None:
            return read_setting(name, text, kind)
        if default is not None:
            return default
        raise ConfigError(once("words").no_setting(self, name))

    @property
    def state(self):
        """The state of the part; its `.value` is a word."""
        return self._membership.state if self._membership else JoinState.LOOKING

    @property
    def reason(self):
        """Why it is in that state, in words."""
        return self._membership.reason if self._membership else "looking for an agent"

    def run(self):
        """Run the part until it ends; the last line of a program."""
        from .running import run

        run(self)

    def end(self):
        """End the part politely: the master knows at once."""
        if self._membership:
            self._membership.closed(self._now)
            self._client.close(self._now)

    # Called by the runner of the part (`running`, or a browser).

    def begin(self, link, now):
        """Begin to join over a link that nothing else uses."""
        self._now = now
        forget("declaring")
        if self.uid is None:
            self.uid = struct.pack("<II", random.getrandbits(32), random.getrandbits(32))
        self._membership = Membership(self, link)
        if self.describes:
            self._membership.description = once("description").describe(self)
        self._client = self._membership.client
        link.begin(self, self._client, now)
        self._client.start(now)

    def step(self, now):
        """Receive, do what is due, send; returns when to call it again, None = the part has ended."""
        self._now = now
        if self._client is None:  # it could not begin, and the error has said why
            return None
        link = self._client.link
        link.poll(now)
        for timed in self._timed:
            if timed.due_at is not None and now >= timed.due_at:
                timed.due_at += ((now - timed.due_at) // timed.period + 1) * timed.period
                self._call(timed.function)
        if self._pending:
            for one in sorted([one for one in self._pending if now >= one[0]], key=lambda one: one[0]):
                if one in self._pending:  # what was called before may have ended the part
                    self._pending.remove(one)
                    self._call(one[1])
        if self._waiting:
            for one in self._waiting.due(now):
                self._call(one.function, waiting=one)
        if self.services:
            self.services.step(now)
        self._membership.step(now)
        self._client.step(now)
        link.step(now)
        if self._client.is_closed():
            return None
        times = [timed.due_at for timed in self._timed]
        times += [due for due, _ in self._pending]
        if self._waiting:
            times += self._waiting.times()
        if self.services:
            times += self.services.times()
        times += self._membership.due() + self._client.due() + (link.due(),)
        return max(now + 1, min([time for time in times if time is not None], default=now + 1000))

    # Called by the membership.

    def sample_received(self, object_id, octets, now):
        """A sample for a port has come."""
        name, listener, carries = "", None, ""
        for binding, _, reader_id in self._ports.values():
            if reader_id == object_id:
                name, carries = binding[0], binding[2]
                listener = self._listeners.get(name)
        if listener is None or self.state is not JoinState.ACTIVE or type_name_of(listener[0]) != carries:
            self.counters.dropped += 1
            return
        try:
            message = listener[0].decode(octets)
        except RemoteProtocolError as error:
            self.counters.dropped += 1
            once("words").unreadable(self, name, error)
            return
        if self.stopped:
            self.counters.held += 1
            return
        self.counters.messages_in += 1
        self._call(listener[1], message)

    def changed(self, before, state, reason, now):
        """The state of the membership has changed."""
        word, hint = state.value, ""
        if state is JoinState.REFUSED:
            word, hint = once("words").told_state(word, reason, self.describes)
        told = "has ended" if state is JoinState.ENDED else "is {}: {}{}".format(word, reason, hint)
        say("info", "{} {}".format(self.local_name, told))
        if self._waiting and JoinState.ACTIVE in (before, state):
            self._waiting.end_all()
        if state is JoinState.ACTIVE:
            self._tell("join")
            self.start_timers(now)
        elif before is JoinState.ACTIVE:
            self.stop_timers()
            if self.services:
                self.services.inactive(word, reason)
            self._is_safe = self._enter_safe_state()
        if state is JoinState.CONFIGURING:
            self.told_types = {}
            self._is_asked = self.stopped and self._is_masters
            if self.stopped:
                self._membership.beat_soon(now)
        elif state is JoinState.ENDED:
            self._end_stop()
        elif state in (JoinState.LOST, JoinState.WRONG_ROBOT, JoinState.RECOGNISING) or (
            state is JoinState.CLAIMING and before is not JoinState.RECOGNISING
        ):
            self._change_master()
        if state is JoinState.CLAIMING:
            known, self._known = self._known, self._membership.robot
            if self._stop and known not in (None, self._known):
                self._end_stop("STOP was said in another robot")
        if state is JoinState.ENDED:
            self._tell("end")
        elif before is JoinState.ACTIVE:
            self._tell("lost")
        if state is JoinState.LOST:
            if self._places:  # the next agent learns of topics only once the part has joined its robot
                once("configuring").bind(self, [])

    def start_timers(self, now):
        """Call from now on what is called by time."""
        for timed in self._timed:
            timed.due_at = now
        self._pending += [(now + delay, function) for delay, function in self._delayed]

    def stop_timers(self):
        """Call nothing by time any more."""
        for timed in self._timed:
            timed.due_at = None
        self._pending.clear()

    def configure(self, slot, bindings, settings, now):
        """A configuration has arrived: settings, safe values, ports."""
        self.configurations += 1
        once("configuring").configure(self, slot, bindings, settings, now)

    def noticed(self, kind, number, place, now):
        """The inventory has sent an unsolicited message."""
        if kind == _STOP:
            self.stop_said("said by the master", now, number)
        elif kind == _GO:
            self._heard, self._over = max(self._heard, number), max(self._over, number)
            if self.stopped and number >= self._ends_with:
                self._end_stop("STOP is over")
        elif kind == _IDENTIFY:
            once("words").identify(self)
            self._tell("identify")
        elif kind == _PARTNER_LOST and number == self._membership.version and place < len(self._places):
            port = self._places[place]
            if self.services:
                self.services.partner_lost(port)
            self._enter_safe_state(port)
            once("words").partner(self, port)  # afterwards: memory may be short
            self._tell("partner", port)

    def stop_said(self, reason, now, number=None):
        """STOP: go to the safe state and stay there until GO; the rules are `msbot.part.safe_state`'s."""
        before, is_news = self.obeys, not self.stopped
        if number is None:  # said on the bus, or here
            self._is_masters = self.state not in (JoinState.LOOKING, JoinState.LOST, JoinState.WRONG_ROBOT)
            self._stop, self._ends_with = 0, self._heard + 1 if self._is_masters else _NEVER
        elif number <= self._over:
            return
        else:
            self._heard = self._stop = self._ends_with = max(self._heard, number)
            self._is_masters = True
        self.stopped = True
        self._is_asked = False
        if is_news:
            say("info", "STOP: " + reason)
            self._is_safe = False
            if self._waiting:
                self._waiting.hold(True)
        if not self._is_safe:  # what failed is retried whenever STOP is repeated
            self._is_safe = self._enter_safe_state()
        if is_news:
            self._tell("stop")
        if self.obeys not in (0, before):
            self._membership.beat_soon(now)

    def no_stop_holds(self):
        """The configuration names no STOP: one that its master knew of is over."""
        if self.stopped and self._is_asked:
            self._end_stop("no STOP holds in the robot that the part has joined")

    @property
    def obeys(self):
        """The number of the master's STOP for which every port has its safe value."""
        return self._stop if self.stopped and self._is_safe else 0

    def stop_in_beats(self):
        """What beats say of STOP, one after the other; none: nothing."""
        if not self.stopped:
            return ()
        number = self.obeys
        waits = number or self._is_asked or (self._is_masters and self._stop)
        return ((number,) if number else ()) + (() if waits and not self._is_held else (0,))

    def _change_master(self):
        if not self._stop:
            self._ends_with = _NEVER
        self._heard = self._over = 0
        self._is_masters = self._is_asked = False

    def _end_stop(self, words=None):
        is_news, self.stopped = self.stopped, False
        if self._waiting:
            self._waiting.hold(False)
        self._is_masters = self._is_asked = False
        self._stop = self._ends_with = 0
        if is_news and words:
            say("info", "GO: " + words)
            self._tell("go")
            if self._is_held:
                self.say_stop()

    def _bound_words(self):
        return once("words").bound([self._ports[port][0] for port in self._places if port in self._ports])

    def _enter_safe_state(self, port=None):
        """Enter it; False: a function ended with an error, so the part may not be safe."""
        errors = self.counters.handler_errors
        for name, message in self._safe.items():
            if port in (None, name):
                if self._waiting:
                    self._waiting.end_of(self._listeners[name][1])  # it begins anew: a safe value is not skipped
                self._call(self._listeners[name][1], message)
        self._tell("safe")
        return errors == self.counters.handler_errors

    # The student's functions.

    def _tell(self, when, *arguments):
        for function in self._when.get(when, ()):
            self._call(function, *arguments)

    def _call(self, function, *arguments, waiting=None, reply=None):
        began_at = self.clock() if self.clock else 0
        try:
            if waiting:
                self._waiting.go_on(waiting, self._now)
            else:
                made = function(*arguments)
                if reply:
                    reply(made, None)
                elif type(made) is _STEPS:
                    self._wait(function, made)
        except Exception as error:  # a mistake in a function must not end the part
            if reply:
                reply(None, error)
            if not (reply and isinstance(error, CallError)):  # that is no mistake: it refuses the request
                self.counters.handler_errors += 1
                once("words").failed(self, function, error)
        took = self.clock() - began_at if self.clock else 0
        if took > _SLOW:
            self.report(function.__name__, once("words").slow(took, _SLOW), "slow")

    def _wait(self, function, steps):
        if self._waiting is None:
            self._waiting = load("waiting").WaitingFunctions()
        self._waiting.begin(function, steps, self._now)

    def report(self, where, what, kind=""):
        """Report something once for each place and kind."""
        if (where, kind or what) not in self._reported and len(self._reported) < _REPORTS:
            self._reported.add((where, kind or what))
            say("error", "{}: {}".format(where, what))


def stream_of(binding):
    """The stream of a port's samples."""
    return RELIABLE if binding[4] else BEST_EFFORT


def read_setting(name, text, kind):
    """The value of a setting's text."""
    try:
        return {"true": True, "false": False}[text] if kind is bool else kind(text)
    except (ValueError, KeyError):
        raise ConfigError(once("words").no_value(name, text, kind)) from None
