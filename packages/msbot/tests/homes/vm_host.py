"""Runs inside a MicroPython VM (or under CPython, as its double): one program, one link, the time as it is told.

`answer(line)` takes one request as JSON and gives the answer as JSON:

    {"do": "start", "program": TEXT, "name": "x.py", "link": "can"|"serial"|"pipe"|"ws", "uid": HEX, "now": MS}
    {"do": "step", "now": MS, "in": [...], "room": FRAMES, "pending": FRAMES}
    {"do": "collect"}, then {"do": "memory"}

Answers have `out` (frames as [identifier, extended, HEX], octets or packets as HEX), `said` (pairs of kind and text:
print, info, error), `due` (MS, null = over), `state`. Nothing here is part of MsBOT's package.
"""

import gc
import json

said = []
_parts = []
_wire = None


class Wire:
    """A controller (recv, send, pending, listen), a byte stream or a packet pipe (read, write), by what is asked."""

    def __init__(self, is_stream):
        self.is_stream = is_stream
        self.incoming = []
        self.outgoing = []
        self.room = self.waiting = 0

    def recv(self):
        return self.incoming.pop(0) if self.incoming else None

    def read(self):
        if self.is_stream:
            octets, self.incoming = b"".join(self.incoming), []
            return octets or None
        return self.recv()

    def send(self, identifier, extended, octets):
        if not self.room:
            return False
        self.room -= 1
        self.waiting += 1
        self.outgoing.append((identifier, extended, octets.hex()))
        return True

    def write(self, octets):
        self.outgoing.append(octets.hex())
        return len(octets)

    def pending(self):
        return self.waiting

    def listen(self, *nodes):
        pass


def _say(kind, text):
    said.append((kind, text))


def _print(*values, **options):
    said.append(("print", options.get("sep", " ").join([str(value) for value in values])))


def _make_link(kind, wire):
    if kind == "can":
        from msbot.can import CanLink

        return CanLink(wire)
    if kind == "ws":
        from msbot.websocket import WebSocketLink

        return WebSocketLink(lambda: wire, "ws://127.0.0.1:8080", "a token")
    from msbot.links import PacketLink, SerialLink

    return SerialLink(wire) if kind == "serial" else PacketLink(wire)


def _start(request):
    global _wire

    import msbot
    from msbot.running import once

    msbot.listen(_say)
    _wire = Wire(request["link"] in ("serial", "ws"))

    def host(part):
        _parts.append(part)
        part.uid = part.uid or bytes.fromhex(request["uid"])
        part.begin(_make_link(request["link"], _wire), request["now"])

    msbot.use_host(host)
    program = compile(once("annotations").with_fields(request["program"]), request["name"], "exec")
    try:
        # `__builtins__`: the double's way to find this package under the name that programs know.
        exec(program, {"__name__": "__main__", "print": _print, "__builtins__": globals().get("__builtins__")})
    except msbot.MsbotError as error:
        _say("error", str(error))


def _step(request):
    for came in request["in"]:
        if isinstance(came, list):
            _wire.incoming.append((came[0], came[1], bytes.fromhex(came[2])))
        else:
            _wire.incoming.append(bytes.fromhex(came))
    _wire.room, _wire.waiting = request["room"], request["pending"]
    due = None
    if _parts:
        due = _parts[0].step(request["now"])
        out, _wire.outgoing = _wire.outgoing, []
    return due, out


def answer(line):
    global said

    request = json.loads(line)
    due, out = None, []
    if request["do"] == "start":
        _start(request)
        due = request["now"] if _parts else None
    elif request["do"] == "step":
        due, out = _step(request)
    elif request["do"] == "memory":
        return json.dumps({"octets": gc.mem_alloc()})
    elif request["do"] == "collect":
        gc.collect()  # this VM collects when the call is over
    told, said = said, []
    state = (_parts[0].state.value, _parts[0].reason) if _parts else ("never", "it has not run a part")
    return json.dumps({"out": out, "said": told, "due": due, "state": state})
