"""Requests to other parts, and those that this part serves; imported by parts that do either (`msbot.part.calls`).

A call ends with its reply, its timeout, or the loss of what it needs, whichever comes first. A reply begins with one
octet: 0, then the message; or why there is none, then a sentence.
"""

from micropython import const

from .errors import CallError, ConfigError, LocalProtocolError, RemoteProtocolError
from .message import Message, type_name_of
from .running import once
from .xrce import RELIABLE

_MOST = const(16)
_LONGEST = const(3600)  # s
_SENTENCE = const(180)  # octets
_IDENTITY = const(24)  # octets before each request, and before its reply
_STOPPED = const(1)
_FAILED = const(3)
_UNREADABLE = const(4)
_NOT_SERVED = const(5)
_REFUSED = const(6)


class Services:
    """The calls that one part makes, and the requests that it serves."""

    def __init__(self, part):
        self._part = part
        self._calls = {}  # port -> classes of request and reply
        self._servers = {}  # port -> these, and the function
        self._open = {}  # number of the request -> port, ms of its end, seconds, what to call

    # Called by a student's program.

    def calls(self, port, request=None, reply=None):
        """Declare that the part sends such requests out of that port, and gets such replies."""
        _check_classes("part.calls", port, request, reply)
        if self._calls.get(port) != (request, reply):
            self._check_one_use(port)
            self._calls[port] = (request, reply)
            self._part.declared.append(("call", port, request, reply))

    def serves(self, port, request=None, reply=None, optional=False):
        """Call the function below with each request at the port, and send back the message that it returns.

        Without `optional` the part reports it when the robot does not use the port.
        """
        _check_classes("@part.serves", port, request, reply)

        def remember(function):
            if not callable(function):
                raise ConfigError("a handler must be a function, not {!r}".format(function))
            self._check_one_use(port)
            self._servers[port] = (request, reply, function, optional)
            self._part.declared.append(("serve", port, request, reply))
            return function

        return remember

    def call(self, port, request, timeout, on_reply):
        """Send a request; `on_reply(reply, error)` is called once: with the reply and "", or with None and why."""
        part = self._part
        exchange = self._calls.get(port)
        is_in_time = isinstance(timeout, (int, float)) and 0 < timeout <= _LONGEST
        if exchange is None or type(request) is not exchange[0] or not is_in_time or not callable(on_reply):
            raise ConfigError(once("service_words").wrong_call(port, request, exchange, timeout, on_reply))
        if part.state.value != "active":
            raise LocalProtocolError(once("words").not_active(part, "call"))
        bound = part._ports.get(port)
        fault = self._fault(port, 3, exchange)
        if bound is None or fault or len(self._open) >= _MOST:
            raise CallError(once("service_words").no_call(part, port, bound, fault, _MOST))
        object_id = bound[2]
        octets = part._membership.seal(object_id, request.encode())
        if not part._client.write(object_id, octets, RELIABLE):
            raise CallError("call of {}: there is no room on the way to the robot now: call again later".format(port))
        self._open[part._client.written] = (port, part._now + int(timeout * 1000 + 0.5), timeout, on_reply)

    # Called by the part.

    def check(self):
        """A configuration has come: say what is wrong with the ports, and end calls that have lost their wire."""
        part = self._part
        for of, direction in ((self._servers, 2), (self._calls, 3)):
            for port in sorted(of):
                declared = of[port]
                fault = self._fault(port, direction, declared)
                if not fault and direction == 2 and port not in part._ports and not declared[3]:
                    once("service_words").tell_uncalled(part, port, declared)
                elif fault:
                    part.report("port {!r}".format(port), fault)
        for port in self._calls:
            if port not in part._ports:
                self._end("the robot has taken its wire away", port)

    def received(self, object_id, octets):
        """A request or a reply has come; what came before it tells which one it belongs to."""
        if object_id & 15 == 7 and len(octets) >= 4:
            self._replied(octets[0] << 8 | octets[1], octets[4:])
        else:
            self._requested(object_id, octets[:_IDENTITY], octets[_IDENTITY:])

    def inactive(self, state, reason):
        """The part is not active any more: all open calls end."""
        self._end("the part is {}, not active any more ({})".format(state, reason))

    def partner_lost(self, port):
        """Nobody serves any more what a port calls."""
        self._end("the part that served it has left, or is held: `msbot parts` shows who is there", port)

    def _end(self, why, port=None):
        for number, call in list(self._open.items()):
            if port in (None, call[0]):
                self._close(number, None, why)

    def step(self, now):
        """End the calls that have waited long enough."""
        for number, call in list(self._open.items()):
            if now >= call[1]:
                self._close(number, None, once("service_words").too_late(call[2]))

    def times(self):
        """When `step` must be called."""
        return [call[1] for call in self._open.values()]

    def _replied(self, number, octets):
        call = self._open.get(number)
        if call is None:
            self._part.counters.dropped += 1
            return
        reply = None
        if octets[:1] == b"\0" and self._part.stopped:
            octets = b"\1"  # nothing that was said before STOP moves anything
        if octets[:1] == b"\0":
            message_class = self._calls[call[0]][1]
            try:
                reply, why = message_class.decode(octets[1:]), ""
            except RemoteProtocolError as error:
                why = "the reply cannot be read as {}: {}".format(message_class.__name__, error)
        else:
            why = once("service_words").refusal(octets)
        self._close(number, reply, why)

    def _close(self, number, reply, why):
        call = self._open.pop(number, None)
        if call:  # else a function that was just called has ended the part, and so all calls
            self._part._call(call[3], reply, why and "call of {}: {}".format(call[0], why))

    def _requested(self, object_id, identity, octets):
        part = self._part
        port = None
        for name, bound in part._ports.items():
            if bound[2] == object_id:
                port = name
        if port is None or len(identity) < _IDENTITY or part.state.value != "active":
            part.counters.dropped += 1
            return
        server = self._servers.get(port)
        if server is None or self._fault(port, 2, server):
            self._answer(object_id, identity, _NOT_SERVED)
        elif part.stopped:
            part.counters.held += 1
            self._answer(object_id, identity, _STOPPED)
        else:
            try:
                request = server[0].decode(octets)
            except RemoteProtocolError as error:
                self._answer(object_id, identity, _UNREADABLE, str(error))
                return
            part.counters.messages_in += 1
            part._call(server[2], request, reply=lambda *done: self._served(object_id, identity, port, server, *done))

    def _served(self, object_id, identity, port, server, made, error):
        reply = server[1]
        if isinstance(error, CallError):
            self._answer(object_id, identity, _REFUSED, str(error))
        elif error:
            self._answer(object_id, identity, _FAILED, "{}: {}".format(type(error).__name__, error))
        elif type(made) is reply:
            self._answer(object_id, identity, 0, made.encode())
        else:
            shown = repr(made)[:60]
            self._answer(object_id, identity, _FAILED, "it returned {}, not a {}".format(shown, reply.__name__))
            words = "returned {}: below @part.serves({!r}, ...) return {}(...)".format(shown, port, reply.__name__)
            self._part.report(server[2].__name__, words)

    def _answer(self, object_id, identity, status, body=b""):
        part = self._part
        if isinstance(body, str):
            body = body.encode()[:_SENTENCE]
        octets = part._membership.seal(object_id, identity + bytes((status,)) + body)
        sent = part._client.write(object_id, octets, RELIABLE)
        part.counters.messages_out += sent
        part.counters.not_sent += not sent

    def _fault(self, port, direction, declared):
        """Why a port does not do what the program wants; "": it does, or the robot does not use it."""
        bound = self._part._ports.get(port)
        name = type_name_of(declared[0]) + " -> " + type_name_of(declared[1])
        if bound is None or (bound[0][3] == direction and bound[0][2] == name):
            return ""
        return once("service_words").fault(bound[0], direction, name)

    def _check_one_use(self, port):
        part = self._part
        for used, words in ((part._listeners, "on"), (self._servers, "serves"), (self._calls, "calls")):
            if port in used:
                raise ConfigError("port {!r} is in part.{}(...) already: one port is for one thing".format(port, words))


def _check_classes(verb, port, *classes):
    if callable(port):
        words = '@part.serves above {} needs port and messages: @part.serves("in", Number, Number)'
        raise ConfigError(words.format(port.__name__))
    for given in classes:
        if not (isinstance(given, type) and issubclass(given, Message)):
            what = "" if given is None else ", not {!r}".format(given)
            words = "{}({!r}, ...) needs the classes of request and reply{}: ({!r}, Number, Text)"
            raise ConfigError(words.format(verb, port, what, port))
