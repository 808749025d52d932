"""Runs inside the MicroPython VM of a page: one program, one part; the page supplies time and packets.

`answer(line)` takes one request as JSON and returns the answer as JSON:

    {"do": "start", "program": TEXT, "name": "x.py", "uid": HEX, "now": MS, "live": BOOL}
    {"do": "step", "now": MS, "in": [HEX...], "room": OCTETS, "link": "up" or a reason, where it has changed}
    {"do": "end", "now": MS}
    {"do": "device", "values": {...}}
    {"do": "hold", "on": BOOL, "now": MS}
    {"do": "look"}

Answers have `out` (packets), `due` (MS, null = over) and `state`. Output of the program and the part goes at once to
`tell(kind, text, line)`, which home.js puts here, so even a program stuck in a function can print.
"""

import io
import json
import sys
import time

import device
from msbot.annotations import with_fields
from msbot.links import PacketLink
from msbot.message import type_name_of
from shown import shown

import msbot

_parts = []
_name = ""
_pipe = None
_held = False
_WAYS = ("out", "in", "serve", "call")  # by the direction of a binding
_last = {}  # port -> (when, message, or octets and class)


class _Runs(BaseException):
    """Leaves the program at `part.run()`, which otherwise returns only when the part has ended."""


class Pipe:
    """Packets between the link and the page."""

    def __init__(self):
        self.incoming = []
        self.outgoing = []
        self.room = 0
        self.is_up = True

    def read(self):
        return self.incoming.pop(0) if self.incoming else None

    def write(self, packet):
        if not self.is_up:
            return True  # no link yet: drop it; the login is repeated once there is one
        if self.room <= 0:
            return False
        self.room -= len(packet)
        self.outgoing.append(packet.hex())
        return True


def _say(kind, text):
    line = 0
    if kind == "error" and text.startswith(_name + ":"):
        digits = text[len(_name) + 1 :].split(" ")[0]
        line = int(digits) if digits.isdigit() else 0
    tell(kind, text, line)  # noqa: F821 - home.js


def _print(*values, **options):
    text = options.get("sep", " ").join([str(value) for value in values])
    tell("print", text, 0)  # noqa: F821


def _input(*_):
    raise msbot.ConfigError("nobody can answer input() here: the values come from ports and settings")


def _where(error):
    """The innermost line of the program itself in a traceback, and the error."""
    story = io.StringIO()
    sys.print_exception(error, story)
    lines = [line for line in story.getvalue().split("\n") if line]
    found = 0
    for line in lines:
        if line.startswith('  File "' + _name + '", line '):
            number = line[len(_name) + 16 :].split(",")[0]
            found = int(number) if number.isdigit() else found
    return found, lines[-1]


def _start(request):
    global _name, _pipe  # noqa: PLW0603 - one program per VM

    _name = request["name"]
    _pipe = Pipe()
    _pipe.is_up = not request["live"]
    msbot.listen(_say)

    def host(part):
        _parts.append(part)
        part.uid = part.uid or bytes.fromhex(request["uid"])
        part.home = "web"
        if request["live"]:
            part.clock = time.ticks_ms
            _watch(part)
        part.begin(PacketLink(_pipe, "page"), request["now"])
        raise _Runs

    msbot.use_host(host)
    try:
        program = compile(with_fields(request["program"]), _name, "exec")
        exec(program, {"__name__": "__main__", "print": _print, "input": _input})
        if not _parts:
            _say("info", "the program has come to its end; it runs no part")
    except _Runs:
        pass
    except msbot.MsbotError as error:
        tell("error", str(error), _where(error)[0])  # noqa: F821
    except SystemExit:
        _say("info", "the program has ended itself")
    except BaseException as error:
        line, what = _where(error)
        place = f"{_name}:{line}: " if line else ""
        tell("error", place + what, line)  # noqa: F821


def _watch(part):
    """Keep the last message of every port for the page."""
    publish, received = part.publish, part.sample_received

    def publish_watched(port, message):
        sent = publish(port, message)
        _last[port] = (time.ticks_ms(), message, None)
        return sent

    def received_watched(object_id, octets, now):
        if _held:
            return
        for binding, _, reader_id in part._ports.values():
            if reader_id == object_id and binding[0] in part._listeners:
                _last[binding[0]] = (time.ticks_ms(), octets, part._listeners[binding[0]][0])
        received(object_id, octets, now)

    part.publish, part.sample_received = publish_watched, received_watched


def _hold(request):
    """A teacher holds the program: it enters its safe state, and none of its functions is called by time or sample."""
    global _held

    if not _parts or _held is request["on"]:
        return
    part, _held = _parts[0], request["on"]
    if _held:
        part._enter_safe_state()
    elif part.state is msbot.JoinState.ACTIVE:
        part.start_timers(request["now"])


def _step(request):
    _pipe.incoming += [bytes.fromhex(octets) for octets in request["in"]]
    _pipe.room = request["room"]
    if not _parts:
        return None
    part, link = _parts[0], request.get("link")
    if link:
        _pipe.is_up = link == "up"
    if link == "up":
        part._client.link_up(request["now"])
    elif link:
        part._client.link_down(link, request["now"])
    if _held:
        part.stop_timers()
    return part.step(request["now"])


def _look():
    """The state that the page shows beside the program."""
    if not _parts:
        return {}
    part = _parts[0]
    ports = []
    for port in part._places:
        if port in part._ports:
            _, topic, carries, direction, _ = part._ports[port][0]
            last = _last.get(port)
            age = None if last is None else time.ticks_diff(time.ticks_ms(), last[0])
            words = "" if last is None else shown(last[1], last[2])[:200]
            ports.append([port, _WAYS[direction], carries, topic, age, words])
    bound = {port[0] for port in ports}
    idle = [[port, "in", type_name_of(kind[0]), "", None, ""] for port, kind in part._listeners.items()]
    for what, port, kind, reply in part.declared:
        if what == "publish":
            idle.append([port, "out", type_name_of(kind), "", None, ""])
        elif what != "setting" and what != "subscribe":
            idle.append([port, what, type_name_of(kind) + " -> " + type_name_of(reply), "", None, ""])
    return {
        "number": part.part_number,
        "describes": part.describes,
        "state": part.state.value,
        "reason": part.reason,
        "slot": part.slot,
        "stopped": part.stopped,
        "not_sent": part.counters.not_sent,
        "ports": ports + [port for port in idle if port[0] not in bound],
        "settings": sorted(part.settings.items()),
    }


def answer(line):
    request = json.loads(line)
    do, due = request["do"], None
    if do == "start":
        _start(request)
        due = request["now"] if _parts else None
    elif do == "step":
        due = _step(request)
    elif do == "end" and _parts:
        _parts[0]._now = request["now"]
        _parts[0].end()
        due = request["now"]
    elif do == "hold":
        _hold(request)
        due = request["now"]
    elif do == "device":
        device.values.update(request["values"])
    elif do == "look":
        return json.dumps(_look())
    out, acts = ([] if _pipe is None else _pipe.outgoing), device.acts[:]
    if _pipe is not None:
        _pipe.outgoing = []
    device.acts.clear()
    state = (_parts[0].state.value, _parts[0].reason) if _parts else ("never", "it has not run a part")
    return json.dumps({"out": out, "acts": acts, "due": due, "state": state})
