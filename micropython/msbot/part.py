"""What a student imports: a part that joins its robot by itself, stays in it, and calls the student's functions.

The same methods as on a PC (docs/reference/part.md). All functions are called in one thread, one after the other.
"""

import random
import struct

from .errors import ConfigError, LocalProtocolError, RemoteProtocolError, say
from .membership import PARTICIPANT, PUBLISHER, SUBSCRIBER, ExpectedRobot, JoinState, Membership
from .message import Message, fields_of, type_name_of, value_of
from .xrce import BEST_EFFORT, RELIABLE, endpoint_blob, topic_blob

_NO_PORT = (("", "", "", True, True), 0, 0)  # (port, topic, type, subscribes, reliable), ids of topic and endpoint
_SLOW = 500
_REPORTS = 30
_PARTNER_LOST, _, _IDENTIFY, _STOP, _GO = range(1, 6)
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class Counters:
    """What happened to a part since it was made."""

    messages_in = messages_out = not_sent = dropped = refused = held = beats = missed_beats = handler_errors = 0


class _Every:
    def __init__(self, period, function):
        self.period = period  # ms
        self.function = function
        self.due_at = None


def _verb(when):
    """A decorator: call the function below at that time."""

    def remember(self, function):
        _check(function)
        self._when.setdefault(when, []).append(function)
        return function

    return remember


class Part:
    """One part of a robot: a part number, ports, and functions that are called when something happens."""

    def __init__(self, part_number, *, local_name=None, robot="*", uid=None, board=None, key=None, describes=False):
        self.part_number = _name("part number", part_number)
        self.local_name = _name("local name", part_number if local_name is None else local_name)
        self.robot = robot if isinstance(robot, ExpectedRobot) else ExpectedRobot(robot)
        if uid is not None and len(uid) != 8:
            raise ConfigError("a UID has 8 octets, not {}".format(len(uid)))
        self.uid = uid
        self.key = None
        if key is not None:
            from .keys import parse_key

            self.key = parse_key(key)
        self.nature = 0  # what is behind its ports: 1 = hardware, 2 = a model of it; the robot shows it
        self.describes = describes is not False
        self.called = describes if isinstance(describes, str) else self.local_name
        self.declared = []  # what it says of itself: ("publish", port, class, None), ("setting", name, kind, ...), ...
        self.slot = ""
        self.settings = {}
        self.stopped = False
        self.counters = Counters()
        self.clock = None  # ms; set by the runner of the part, to find functions that are slow
        self._board = board
        self._timed = []
        self._listeners = {}
        self._when = {}
        self._followers = []
        self._defaults = {}
        self._told = {}
        self._safe = {}
        self._reported = set()
        self._ports = {}
        self._places = []
        self._configurations = 0
        self.obeys = 0  # the number of the master's STOP for which every port has its safe value; every beat carries it
        self._is_safe = False
        self._heard = self._over = self._ends_with = 0  # numbers of STOPs
        self._now = 0
        self._client = self._membership = None

    # Called by a student's program.

    def every(self, period, *, default=None):
        """Call the function below every `period` seconds while the part is active; a text names a setting."""
        if not isinstance(period, str) and not period > 0:
            raise ConfigError("every({}): the period must be more than 0 seconds".format(period))

        def remember(function):
            _check(function)
            timed = _Every(1000 if isinstance(period, str) else _ms(period), function)
            self._timed.append(timed)
            if isinstance(period, str):
                self._declare(period, float, default, 0.001, None, "s")
                self._followers.append((period, float, lambda seconds: self._pace(timed, period, seconds)))
            return function

        return remember

    def on(self, port, message_class, *, optional=False, safe=None):
        """Call the function below with each message that arrives at the port."""
        if not (isinstance(message_class, type) and issubclass(message_class, Message)):
            words = "@part.on({!r}, ...) needs the class of the message, not {!r}: on({!r}, HelloWorld)"
            raise ConfigError(words.format(port, message_class, port))
        if port in self._listeners:
            raise ConfigError("port {!r} has a function already: one function per port".format(port))

        def remember(function):
            _check(function)
            self._listeners[port] = (message_class, function, optional)
            self.declared.append(("subscribe", port, message_class, safe))
            return function

        return remember

    def publishes(self, port, message_class):
        """Declare that the part publishes such messages at that port; a part that describes itself must."""
        self.declared.append(("publish", port, message_class, None))

    def on_setting(self, name, kind=str, *, default=None, least=None, most=None, unit=""):
        """Call the function below with the setting's value, before `on_join`, and whenever it changes."""
        _check_kind(name, kind)

        def remember(function):
            _check(function)
            self._declare(name, kind, default, least, most, unit)
            self._followers.append((name, kind, function))
            return function

        return remember

    on_join = _verb("join")  # whenever the part has become active
    on_lost = _verb("lost")  # whenever it stops being active without ending; see `reason`
    on_end = _verb("end")  # once when it ends
    on_stop = _verb("stop")  # on STOP, after every port has its safe value
    on_go = _verb("go")  # on GO: messages reach the part's functions again
    on_identify = _verb("identify")  # when somebody asks which part this is
    safe_state = _verb("safe")  # when nothing controls the part any more
    on_partner_lost = _verb("partner")  # with the name of a port whose senders have all gone

    def publish(self, port, message):
        """Send a message out of a port; False when there was no room for it."""
        if self.state is not JoinState.ACTIVE:
            if self._client is None:
                raise LocalProtocolError("the part does not run: publish in a function below @part.every or @part.on")
            words = "the part is {}, not active ({}): publish after on_join"
            raise LocalProtocolError(words.format(self.state.value, self.reason))
        binding, _, object_id = self._ports.get(port, _NO_PORT)
        if port not in self._ports and ("publish", port, type(message), None) in self.declared:
            return False  # not wired in this robot (yet): nobody listens
        if binding[3]:
            raise ConfigError("there is no port {!r} to publish on; {}".format(port, self._bound_words()))
        if not isinstance(message, Message):
            raise ConfigError("port {!r} publishes messages, not {}".format(port, type(message).__name__))
        if type_name_of(type(message)) != binding[2]:
            words = "port {!r} carries {}, not {}"
            raise ConfigError(words.format(port, binding[2], type_name_of(type(message))))
        octets = self._membership.seal(object_id, message.encode())
        sent = self._client.write(object_id, octets, _stream(binding))
        self.counters.messages_out += sent
        self.counters.not_sent += not sent
        return sent

    def bound(self, port):
        """Whether the robot uses that port of the part now."""
        return port in self._ports

    def setting(self, name, kind=str, default=None):
        """The value of a setting; a missing one without a default is an error."""
        _check_kind(name, kind)
        text = self.settings.get(name)
        if text is not None:
            return _read(name, text, kind)
        if default is not None:
            return default
        known = ", ".join(sorted(self.settings)) or "none"
        raise ConfigError("there is no setting {!r} in this robot; it sets: {}".format(name, known))

    @property
    def state(self):
        """The state of the part; its `.value` is a word."""
        return self._membership.state if self._membership else JoinState.LOOKING

    @property
    def reason(self):
        """Why it is in that state, in words."""
        return self._membership.reason if self._membership else "looking for an agent"

    @property
    def board(self):
        """The GPIO board the part was made with."""
        if self._board is None:
            words = "part {} has no board: make it with Part(..., board=SimGpio())"
            raise ConfigError(words.format(self.local_name))
        return self._board

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
        if self.uid is None:
            self.uid = struct.pack("<II", random.getrandbits(32), random.getrandbits(32))
        self._membership = Membership(self, link)
        if self.describes:
            from .running import once

            self._membership.description = once("description").describe(self)
        self._client = self._membership.client
        link.begin(self, self._client, now)
        self._client.start(now)

    def step(self, now):
        """Receive, do what is due, send; returns when to call it again, None = the part has ended."""
        self._now = now
        link = self._client.link
        link.poll(now)
        for timed in self._timed:
            if timed.due_at is not None and now >= timed.due_at:
                timed.due_at += ((now - timed.due_at) // timed.period + 1) * timed.period
                self._call(timed.function)
        self._membership.step(now)
        self._client.step(now)
        link.step(now)
        if self._client.is_closed():
            return None
        times = [timed.due_at for timed in self._timed]
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
            words = "a message that cannot be read: {}".format(error)
            self._report("port {!r}".format(name), words, "unreadable")
            return
        if self.stopped:
            self.counters.held += 1
            return
        self.counters.messages_in += 1
        self._call(listener[1], message)

    def changed(self, before, state, reason, now):
        """The state of the membership has changed."""
        word = state.value
        if state is JoinState.REFUSED:
            from .words import told_state

            word = told_state(word, reason)
        say("info", "{} is {}: {}".format(self.local_name, word, reason))
        if state is JoinState.ACTIVE:
            self._tell("join")
            for timed in self._timed:
                timed.due_at = now
        elif before is JoinState.ACTIVE:
            for timed in self._timed:
                timed.due_at = None
            self._enter_safe_state()
            self.stopped = False  # the master that takes the part back repeats STOP if it still holds
            self.obeys = self._heard = self._over = self._ends_with = 0
        if state is JoinState.ENDED:
            self._tell("end")
        elif before is JoinState.ACTIVE:
            self._tell("lost")
        if state is JoinState.LOST:
            self._bind([])  # the next agent learns of topics only once the part has joined its robot

    def configure(self, slot, bindings, settings, now):
        """A configuration has arrived: settings, safe values, ports."""
        self._configurations += 1
        self.slot = slot
        safe = {}
        self.settings = {}
        for name, text in settings:
            port, mark, field = name.partition(".safe.")
            if mark:
                safe.setdefault(port, {})[field] = text
            elif name != ".stop":
                self.settings[name] = text
        self._safe = {}
        for port, fields in safe.items():
            if port in self._listeners:
                self._make_safe(port, fields)
        number = dict(settings).get(".stop", "")
        if number.isdigit():
            self.stop_said("it holds in the robot that the part has joined", now, int(number))
        self._bind(bindings)
        for port, (message_class, _, optional) in self._listeners.items():
            bound = self._ports.get(port)
            name = type_name_of(message_class)
            if not bound:
                if not optional:
                    self._report("port {!r}".format(port), "nothing will come in; " + self._bound_words())
            elif bound[0][2] != name:
                words = "carries {}, but its function expects {}".format(bound[0][2], name)
                self._report("port {!r}".format(port), words)
        self._tell_settings()

    def noticed(self, kind, number, place, now):
        """The inventory has sent an unsolicited message."""
        if kind == _STOP:
            self.stop_said("said by the master", now, number)
        elif kind == _GO:
            self._heard, self._over = max(self._heard, number), max(self._over, number)
            if self.stopped and number >= self._ends_with:
                self.stopped = False
                self.obeys = 0
                say("info", "GO: STOP is over")
                self._tell("go")
        elif kind == _IDENTIFY:
            say("info", "{}: somebody asks which part this is".format(self.local_name))
            self._tell("identify")
        elif kind == _PARTNER_LOST and number == self._membership.version and place < len(self._places):
            port = self._places[place]
            say("info", "{}: nobody sends to port {} any more".format(self.local_name, port))
            self._enter_safe_state(port)
            self._tell("partner", port)

    def stop_said(self, reason, now, number=None):
        """STOP: go to the safe state and stay there until GO; the rules are `msbot.part.safe_state`'s."""
        if number is None:
            self._ends_with = self._heard + 1  # sent on the bus, without a number
        elif number <= self._over:
            return
        else:
            self._heard = self._ends_with = max(self._heard, number)
        before, is_news = self.obeys, not self.stopped
        self.stopped = True
        if is_news:
            say("info", "STOP: " + reason)
            self._is_safe = False
        if not self._is_safe:  # what failed is retried whenever STOP is repeated
            self._is_safe = self._enter_safe_state()
        self.obeys = self._heard if self._is_safe and self._heard >= self._ends_with else 0
        if is_news:
            self._tell("stop")
        if self.obeys not in (0, before):
            self._membership.beat_soon(now)

    # Ports.

    def _bind(self, bindings):
        client = self._client
        self._places = [binding[0] for binding in bindings]
        wanted = {binding[0]: binding for binding in bindings}
        for port, (binding, topic_id, object_id) in list(self._ports.items()):
            if wanted.get(port) != binding:
                del self._ports[port]
                client.delete(object_id)
                client.delete(topic_id)
        for binding in bindings:
            port, topic, topic_type, subscribes, reliable = binding
            if port in self._ports:
                continue
            topic_id = client.free_id(2)
            client.create(topic_id, topic_blob(topic, topic_type), PARTICIPANT)
            if subscribes:
                object_id = client.free_id(6)
                client.create(object_id, endpoint_blob(topic_id, reliable, b"\0\0"), SUBSCRIBER)
            else:
                if not client.find(PUBLISHER):
                    client.create(PUBLISHER, b"\0\0", PARTICIPANT)
                object_id = client.free_id(5)
                client.create(object_id, endpoint_blob(topic_id, reliable, b"\0"), PUBLISHER)
            self._ports[port] = (binding, topic_id, object_id)
            if subscribes:
                client.read(object_id, _stream(binding))
        if not bindings and client.find(PUBLISHER):
            client.delete(PUBLISHER)

    def _bound_words(self):
        from .words import bound

        return bound([self._ports[port][0] for port in self._places if port in self._ports])

    # Settings and the safe state.

    def _tell_settings(self):
        told, self._told = self._told, {}
        for name, kind, function in self._followers:
            text = self._told[name] = self.settings.get(name, self._defaults.get(name))
            if text is None:
                self._report("setting {!r}".format(name), "this robot does not set it", "absent")
            elif told.get(name) != text:
                try:
                    value = _read(name, text, kind)
                except ConfigError as error:
                    self._report("setting {!r}".format(name), str(error))
                else:
                    self._call(function, value)

    def _declare(self, name, kind, default, least, most, unit):
        if default is None and not self.describes:
            return
        if default is None:
            words = "setting {!r} needs a default, because the part describes itself: for example "
            words += "on_setting({!r}, float, default=1.0) or every({!r}, default=1.0)"
            raise ConfigError(words.format(name, name, name))
        default = kind(default)
        self._defaults[name] = str(default).lower() if kind is bool else str(default)
        self.declared.append(("setting", name, kind, (default, least, most, unit)))

    def _pace(self, timed, name, seconds):
        if not seconds >= 0.001:
            words = "{} s is not a period; {} s stays".format(seconds, timed.period / 1000)
            self._report("setting {!r}".format(name), words)
        elif _ms(seconds) != timed.period:
            timed.period = _ms(seconds)
            if timed.due_at is not None:
                timed.due_at = self._now

    def _make_safe(self, port, fields):
        message_class = self._listeners[port][0]
        kinds = {name: kind for name, kind, _ in fields_of(message_class)}
        try:
            values = {}
            for name, text in fields.items():
                if name not in kinds:
                    raise ConfigError("{} has no simple field {!r}".format(message_class.__name__, name))
                values[name] = value_of(kinds[name], text)
            self._safe[port] = message_class(**values)
        except (ConfigError, LocalProtocolError, ValueError, KeyError) as error:
            self._report("safe value of port {!r}".format(port), "cannot be used: {}".format(error))

    def _enter_safe_state(self, port=None):
        """Enter it; False: a function ended with an error, so the part may not be safe."""
        errors = self.counters.handler_errors
        for name, message in self._safe.items():
            if port in (None, name):
                self._call(self._listeners[name][1], message)
        self._tell("safe")
        return errors == self.counters.handler_errors

    # The student's functions.

    def _tell(self, when, *arguments):
        for function in self._when.get(when, ()):
            self._call(function, *arguments)

    def _call(self, function, *arguments):
        began_at = self.clock() if self.clock else 0
        try:
            function(*arguments)
        except Exception as error:  # a mistake in a function must not end the part
            self.counters.handler_errors += 1
            from .words import place

            where = place(error) or function.__name__
            if isinstance(error, ConfigError):
                self._mistaken("{}: {}".format(where, error))
            else:
                kind = type(error).__name__
                self._report(where, "{}: {} (said once, counted from now on)".format(kind, error), kind)
        took = self.clock() - began_at if self.clock else 0
        if took > _SLOW:
            words = "took {:.1f} s, and the part cannot beat meanwhile: keep it below {} s"
            self._report(function.__name__, words.format(took / 1000, _SLOW / 1000), "slow")

    def _mistaken(self, sentence):
        if self._configurations > 1:  # it worked with an earlier one: the program is not to blame
            self._report(sentence, "since the configuration has changed")
        else:
            self.end()
            say("error", sentence)

    def _report(self, where, what, kind=""):
        """Report something once for each place and kind."""
        if (where, kind or what) not in self._reported and len(self._reported) < _REPORTS:
            self._reported.add((where, kind or what))
            say("error", "{}: {}".format(where, what))


def _ms(seconds):
    return max(1, int(seconds * 1000 + 0.5))


def _stream(binding):
    return RELIABLE if binding[4] else BEST_EFFORT


def _name(what, text):
    size = len(text.encode())
    if not text or size > 254 or "\0" in text:
        raise ConfigError("the {} must have 1 to 254 octets, not {}".format(what, size))
    return text


def _check(function):
    if not callable(function):
        raise ConfigError("a handler must be a function, not {!r}".format(function))


def _check_kind(name, kind):
    if kind not in _WORDS:
        raise ConfigError("setting {!r} can be read as bool, int, float or str, not as {!r}".format(name, kind))


def _read(name, text, kind):
    try:
        return {"true": True, "false": False}[text] if kind is bool else kind(text)
    except (ValueError, KeyError):
        raise ConfigError("setting {!r} is {!r}, which is not {}".format(name, text, _WORDS[kind])) from None
