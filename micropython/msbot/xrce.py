"""One DDS-XRCE session with the master's agent, without I/O: it logs in, stays logged in, keeps its objects alive.

Theory of operation. The link passes packets to `packet`; `step` does what is due and sends packets while the link has
room. Samples go on two streams: 0x01 best effort, 0x80 reliable (numbered, kept until acknowledged, sent again when
reported missing). Objects and reads are requested again in every session. Sessions alternate between two ids, so no
late packet of the old one can be mistaken for one of the new. Times are milliseconds; request ids follow from the rest
of their message (docs/reference/can.md, "Request ids by rule").
"""

import struct

from micropython import const

BEST_EFFORT = const(0x01)
RELIABLE = const(0x80)
ENDLESS = const(0xFFFF)  # a read that never ends; 0 ends it, None = one sample

_INVENTORY = const(0x0017)

_CREATE = const(1)
_GET_INFO = const(2)
_DELETE = const(3)
_STATUS_AGENT = const(4)
_STATUS = const(5)
_INFO = const(6)
_WRITE_DATA = const(7)
_READ_DATA = const(8)
_DATA = const(9)
_ACKNACK = const(10)
_HEARTBEAT = const(11)
_FRAGMENT = const(13)

_WINDOW = const(16)
_WAITING = const(16)  # messages outside the reliable stream that may wait for the link; beyond, the oldest is dropped
_UNANSWERED = const(12)  # CREATEs at a time: a genuine agent loses statuses beyond 16 unacknowledged messages
_LARGEST = const(8192)  # octets held for early messages and pieces of large ones

# Between logins, until lost, until a HEARTBEAT, until a ping, for its answer, until a stall (docs/reference/part.md).
_QUICK = (500, 2000, 100, 2000, 200, 5000)
_PATIENT = (1000, 5000, 1000, 5000, 2000, 30000)

_CONNECTING = const(0)
_CONNECTED = const(1)
_LOST = const(2)
_CLOSING = const(3)
_CLOSED = const(4)


def submessage(kind, payload, flags=1):
    """A submessage, header in front."""
    return struct.pack("<BBH", kind, flags, len(payload)) + payload


def create_message(request_id, object_id, blob, parent):
    """CREATE in binary form, REUSE and REPLACE; the parent of a participant is its domain, 0."""
    kind = object_id & 15
    body = struct.pack(">HHBBH", request_id, object_id, kind, 3, 0) + struct.pack("<I", len(blob)) + blob
    body += bytes(-len(body) & 1 if kind == 1 else 0) + struct.pack(">H", parent)
    return submessage(_CREATE, body, 7)


def read_message(object_id, stream, control):
    """READ_DATA; `control` is the number of samples, None = without delivery control."""
    body = struct.pack(">HHBBBB", 0xC000 | object_id & 0x3FFF, object_id, stream, 0, 0, control is not None)
    return submessage(_READ_DATA, body if control is None else body + struct.pack("<HHHH", control, 0, 0, 0))


class _Object:
    def __init__(self, object_id, blob, parent):
        self.object_id = object_id
        self.blob = blob
        self.parent = parent
        self.asked = 0  # request id of its CREATE in this session
        self.reading = None  # (stream, control), while one is wanted
        self.read_asked = False


class Client:
    """The session; its owner has the methods `connected`, `lost`, `closed`, `topic_received`, `reply_received` and
    `service_received`."""

    def __init__(self, link, key, owner):
        self.link = link
        self.key = key
        self.owner = owner
        self.dropped = 0
        self.written = 0  # id of the latest WRITE_DATA, which its reply names
        self._state = _CONNECTING
        self._times = _PATIENT if link.shared else _QUICK
        self._room = (link.mtu - 4 & ~3) - 4  # the largest body of a message
        self._objects = []
        self._numbers = {}
        self._turn = self._logins = self._session = 0
        self._request_id = 9
        self._lost_at = self._close_at = None
        self._begin(0)

    # The session.

    def start(self, now):
        """Log in."""
        self._lost_at = now + self._times[1]
        self._login(now)

    def link_up(self, now):
        """The link carries packets (again)."""
        if self._state in (_CONNECTING, _LOST):
            self._login(now)

    def link_down(self, reason, now):
        """The link carries nothing any more."""
        if self._state == _CONNECTED:
            self.lose(reason, now)

    def lose(self, reason, now):
        """Give the session up and open another one."""
        self._lost_at = None
        self._state = _LOST
        self._login(now)
        self.owner.lost(reason, now)

    def check(self, now):
        """Suspect that the agent is gone: ask it now."""
        if self._state == _CONNECTED and self._pings == 0:
            self._ping_at = now

    def close(self, now):
        """End politely: send what waits, then delete the session."""
        if self._state == _CONNECTED:
            self._state = _CLOSING
            self._advance()
            self._answer(_DELETE, b"\0\2\xff\xfe")
            self._close_at = now + 1000
        elif self._state != _CLOSING:
            self._closed(now)

    def is_heard(self):
        """Whether the agent has acknowledged everything that was said reliably."""
        return not (self._waiting or self._unacked)

    def is_closed(self):
        """Whether it was ended."""
        return self._state == _CLOSED

    def _closed(self, now):
        self._state = _CLOSED
        self._begin(now)
        self.owner.closed(now)

    def _login(self, now):
        self._begin(now)
        self._session = 0x81 + (self._logins & 1)
        self._tries = self._answers = 0
        self._login_at = now

    def _begin(self, now):
        """Restart all streams; nothing has been requested yet."""
        self._turn += 1
        self._out = []  # messages for the link
        self._waiting = []  # bodies for the reliable stream
        self._unacked = {}
        self._resent = []
        self._creating = []
        self._first = self._next = self._pings = 0
        self._in_doubt = False  # whether the agent may have restarted the streams
        self._best_effort = 0xFFFF
        self._beat_at = self._login_at = self._ping_at = None
        self._progress_at = now
        self._begin_input()
        for thing in self._objects:
            thing.asked = 0
            thing.read_asked = False

    def _begin_input(self):
        self._newest = self._handled = self._announced = 0xFFFF
        self._held = {}
        self._pieces = b""
        self._kept = 0

    # Objects and data.

    def create(self, object_id, blob=b"\0\0", parent=0):
        """Create an object, in this session and in every later one."""
        self._objects.append(_Object(object_id, blob, parent))

    def delete(self, object_id):
        """Delete it, here and in later sessions."""
        thing = self.find(object_id)
        self._objects.remove(thing)
        if thing.asked and self._state == _CONNECTED:
            self._ask(submessage(_DELETE, struct.pack(">HH", self._request(), object_id)))

    def find(self, object_id):
        """The object with that id, or None; its `reading` is the stream and the control of the requested read."""
        for thing in self._objects:
            if thing.object_id == object_id:
                return thing
        return None

    def free_id(self, kind):
        """An unused object id of that kind, so that late messages for an old object find no object."""
        number = self._numbers[kind] = self._numbers.get(kind, 0) % 0xFFE + 1
        object_id = number << 4 | kind
        return self.free_id(kind) if self.find(object_id) else object_id

    def read(self, object_id, stream=RELIABLE, control=ENDLESS):
        """Request samples on that stream; replaces an earlier read."""
        thing = self.find(object_id)
        thing.reading = (stream, control)
        thing.read_asked = False

    def write(self, object_id, payload, stream):
        """Send a sample or a request; False when there is no room for it (or no session)."""
        if self._state != _CONNECTED:
            return False
        self._book()
        self._advance()
        number = self._next if stream == RELIABLE else self._best_effort + 1 & 0xFFFF
        request_id = (0xA000 if stream == RELIABLE else 0x8000) | number & 0x1FFF
        body = submessage(_WRITE_DATA, struct.pack(">HH", request_id, object_id) + payload)
        self.written = request_id
        if not self.find(object_id).asked:
            return False
        if stream != RELIABLE:
            if len(body) <= self._room:
                self._best_effort = number
                self._put(self._message(stream, number, body))
            return len(body) <= self._room
        if self._waiting or len(self._unacked) >= _WINDOW:
            return False
        step = self._room - 4
        if len(body) <= self._room:
            self._waiting.append(body)
        else:
            for at in range(0, len(body), step):
                self._waiting.append(submessage(_FRAGMENT, body[at : at + step], 3 if at + step >= len(body) else 1))
        self._advance()
        return True

    def _request(self):
        self._request_id = self._request_id + 1 if self._request_id < 0x7FFF else 10
        return self._request_id

    def _ask(self, body):
        if self._waiting and self._waiting[-1][0] != _FRAGMENT:
            joined = self._waiting[-1] + bytes(-len(self._waiting[-1]) & 3) + body
            if len(joined) <= self._room:
                self._waiting[-1] = joined
                return
        self._waiting.append(body)

    def _book(self):
        """Request the objects, parents first, and the reads."""
        for thing in self._objects:
            if not thing.asked and len(self._creating) < _UNANSWERED:
                thing.asked = self._request()
                self._creating.append(thing.asked)
                self._ask(create_message(thing.asked, thing.object_id, thing.blob, thing.parent))
        for thing in self._objects:
            if thing.reading and thing.asked and not thing.read_asked:
                thing.read_asked = True
                self._ask(read_message(thing.object_id, *thing.reading))

    def _message(self, stream, number, body):
        return struct.pack("<BBH", self._session, stream, number) + body + bytes(-len(body) & 3 if stream else 0)

    def _answer(self, kind, payload):
        self._put(self._message(0, 0, submessage(kind, payload)))

    def _put(self, packet):
        others = [waits for waits in self._out if waits[1] != RELIABLE]
        if len(others) >= _WAITING:
            self._out.remove(others[0])
            self.dropped += 1
        self._out.append(packet)

    def _advance(self):
        while self._waiting and len(self._unacked) < _WINDOW:
            packet = self._message(RELIABLE, self._next, self._waiting.pop(0))
            self._unacked[self._next] = packet
            self._next = self._next + 1 & 0xFFFF
            self._out.append(packet)

    # What is due.

    def step(self, now):
        """Do what is due, and send what the link has room for."""
        login, _, heartbeat, _, ping, stall = self._times
        if self._state == _CLOSING and now >= self._close_at:
            self._closed(now)
        if self._state == _CLOSED:
            return
        if self._lost_at is not None and now >= self._lost_at:
            self._lost_at = None
            self._state = _LOST
            self.owner.lost("no agent answers on " + self.link.name, now)
        if self._ping_at is not None and now >= self._ping_at:
            if self._pings == 3:
                self.lose("the agent does not answer any more", now)
            else:
                self._pings += 1
                self._ping_at = now + ping
                self._answer(_GET_INFO, b"\0\x0a\xff\xfd\2\0\0\0")
        if not (self._creating or self._unacked):
            self._progress_at = now
        elif now >= self._progress_at + stall:
            self.lose("the agent takes nothing any more", now)
        if self._login_at is not None and now >= self._login_at:
            self._login_at = now + login
            if not self._out:  # otherwise the link has not even taken the last one
                self._tries += 1
                message = b"\x80\0\0\0\0\1\x10\0XRCE\1\0\1\x0f" + struct.pack(">IBB", self.key, self._session, 0)
                self._put(message + struct.pack("<H", self.link.mtu - 4))
        if self._beat_at is not None and now >= self._beat_at and not self._out:
            self._beat_at = None
            self._resent = []
            first = 0 if self._in_doubt else self._first
            self._answer(_HEARTBEAT, struct.pack("<HHB", first, self._next - 1 & 0xFFFF, RELIABLE))
        if self._state == _CONNECTED:
            self._book()
            self._advance()
        while self._out and self.link.has_room():
            self.link.send(self._out.pop(0), now)
        if (self._unacked or self._in_doubt) and not self._out and self._beat_at is None:
            self._beat_at = now + heartbeat

    def due(self):
        """When `step` must be called: times, or None."""
        stall_at = self._progress_at + self._times[5] if self._creating or self._unacked else None
        return self._login_at, self._lost_at, self._beat_at, self._ping_at, self._close_at, stall_at

    # What comes in.

    def packet(self, packet, now):
        """Take one packet of the agent."""
        outside = packet[1:2] == b"\0" and packet[0] in (0x80, self._session)
        inside = packet[:1] == bytes((self._session,)) and self._state in (_CONNECTED, _CLOSING)
        if len(packet) < 8 or not (inside or outside):
            self.dropped += 1
            return
        if self._ping_at is not None:
            self._pings = 0
            self._ping_at = now + self._times[3]
        stream, number = packet[1], packet[2] | packet[3] << 8
        if stream == BEST_EFFORT:
            if not 0 < (number - self._newest & 0xFFFF) < 0x8000:
                return
            self._newest = number
        if stream == RELIABLE:
            self._take_reliable(number, packet, now)
        else:
            self._process(packet, 4, stream, now)

    def _take_reliable(self, number, packet, now):
        ahead = number - self._handled & 0xFFFF
        has_room = ahead == 1 or self._kept + len(packet) <= _LARGEST
        if 0 < ahead <= _WINDOW and number not in self._held and has_room:
            self._held[number] = packet
            self._kept += len(packet)
            self._announce(number)
        self._take_held(now)

    def _announce(self, number):
        """Note the newest number known to exist: numbers missing before it are reported."""
        if 0 < (number - self._announced & 0xFFFF) < 0x8000:
            self._announced = number

    def _take_held(self, now):
        """Process the next messages in order, and acknowledge: what was handled and what is missing."""
        turn = self._turn
        while self._handled + 1 & 0xFFFF in self._held:
            self._handled = self._handled + 1 & 0xFFFF
            packet = self._held.pop(self._handled)
            self._kept -= len(packet)
            self._process(packet, 4, RELIABLE, now)
            if turn != self._turn:
                return
        first = self._handled + 1 & 0xFFFF
        bitmap = 0
        for index in range(min(self._announced - self._handled & 0xFFFF, 16)):
            if (first + index) & 0xFFFF not in self._held:
                bitmap |= 1 << index
        self._answer(_ACKNACK, struct.pack("<HBBB", first, bitmap >> 8, bitmap & 0xFF, RELIABLE))

    def _process(self, packet, at, stream, now):
        size, turn = len(packet), self._turn
        while at + 4 <= size and turn == self._turn:
            kind, flags, length = struct.unpack("<BBH", packet[at : at + 4])
            at += 4
            end = size if kind == _DATA and length == 0 else at + length
            if end > size:
                self.dropped += 1
                return
            self._take(kind, flags, packet[at:end], stream, now)
            at = end + 3 & ~3

    def _take(self, kind, flags, body, stream, now):
        size = len(body)
        if kind == _DATA and size >= 4 and not flags & 0x0E:
            object_id = body[2] << 8 | body[3]
            if object_id & 15 == 6:
                self.owner.topic_received(object_id, body[4:], now)
            elif object_id == _INVENTORY and size >= 8:  # a reply, after the ids of its request
                self.owner.reply_received(body[8:], now)
            elif size >= 8:
                self.owner.service_received(object_id, body[4:])
        elif kind == _STATUS and size >= 6:
            request_id = body[0] << 8 | body[1]
            if stream == 0 and request_id == 2 and self._state == _CLOSING:
                self._closed(now)
            elif stream and request_id in self._creating:
                self._creating.remove(request_id)
                self._progress_at = now
        elif kind == _ACKNACK and size >= 5 and body[4] == RELIABLE:
            self._take_acknack(body[0] | body[1] << 8, body[2] << 8 | body[3], now)
        elif kind == _HEARTBEAT and size >= 5 and body[4] == RELIABLE and stream == 0:
            # The agent keeps all that is not acknowledged, so nothing before its first number is still missing.
            self._announce(body[2] | body[3] << 8)
            self._take_held(now)
        elif kind == _FRAGMENT and stream == RELIABLE:
            self._take_piece(body, flags & 2, now)
        elif kind == _STATUS_AGENT and size and stream == 0:
            self._take_login_answer(body[0], now)
        elif kind == _INFO and size >= 6 and body[:2] == b"\0\x0a":
            if body[5] != 1 and self._state == _CONNECTED:
                self.lose("the agent does not know this session any more", now)
        elif kind == _GET_INFO and size >= 8 and self._state == _CONNECTED:
            self._answer(_INFO, body[:4] + bytes(4))
        else:
            self.dropped += 1

    def _take_login_answer(self, status, now):
        if self._state in (_CONNECTING, _LOST):
            self._lost_at = None
            if status & 0x80:
                self._state = _LOST
                self._login_at = now + 1000
                self.owner.lost("the agent refused the session: status 0x{:02X}".format(status), now)
                return
            self._begin(now)
            self._state = _CONNECTED
            self._answers = 1
            self._logins += 1
            self._request_id = 9
            self._ping_at = now + self._times[3]
            self.owner.connected(now)
        elif self._state == _CONNECTED and not status & 0x80:
            # Every login that reaches the agent restarts its streams, so its next messages are numbered from 0 again.
            # Once something was taken, this may as well be a copy of the first answer: the agent is asked.
            taken = self._first or self._handled != 0xFFFF
            if self._answers < self._tries and not (self._next and taken):
                self._begin_input()
            self._answers += 1
            if self._next:
                self._in_doubt = True
                self._beat_at = now

    def _take_acknack(self, first, bitmap, now):
        if self._in_doubt and (first or self._first):
            self._in_doubt = False
            if not first:
                self.lose("the agent has started the session over: a late login has reached it", now)
                return
        progress = first - self._first & 0xFFFF
        if progress > len(self._unacked):
            self.dropped += 1
            return
        for _ in range(progress):
            packet = self._unacked.pop(self._first)
            if packet in self._out:
                self._out.remove(packet)
            self._first = self._first + 1 & 0xFFFF
            self._beat_at = None
            self._progress_at = now
        for index in range(16):
            packet = self._unacked.get(first + index & 0xFFFF)
            # Once until the next HEARTBEAT: a gap is reported with every message that comes after it.
            if bitmap >> index & 1 and packet and packet not in self._resent:
                self._resent.append(packet)
                if packet not in self._out:
                    self._out.append(packet)

    def _take_piece(self, piece, is_last, now):
        if self._pieces is not None and len(self._pieces) + self._kept + len(piece) <= _LARGEST:
            self._pieces += piece
        else:
            self._pieces = None  # too large: forgotten up to its last piece
            self.dropped += 1
        if is_last:
            whole, self._pieces = self._pieces, b""
            if whole:
                self._process(whole, 0, RELIABLE | 1 << 8, now)  # not a real stream: pieces cannot contain pieces
