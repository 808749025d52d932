"""The part's end of a CAN bus: an address by the UID, packets in frames (docs/reference/can.md has every bit).

A controller is anything with four methods: `recv()` returns `(identifier, extended, octets)` or None, `send(identifier,
extended, octets)` says whether it accepted the frame, `pending()` how many have not left yet, `listen(*nodes)` sets
filters.
"""

import random
import struct
from binascii import crc32

from micropython import const

from .compact import compress, decompress
from .errors import RemoteProtocolError

_STOP = const(0x008)
_UP = const(0x100)
_DOWN = const(0x180)
_BEACON = const(0x700)
_JOIN = const(0x1E000000)
_ASSIGN = const(0x02000000)
_COMPRESSION = const(2)

_FIRST = const(0x80)
_LAST = const(0x40)
_COUNTER = const(0x3F)
_MTU = const(512)
_QUEUE = const(16)  # frames that may wait before there is no room for another packet
_FRAMES = const(32)  # received at a time, so that the part itself gets its turn

_BEACON_TIMEOUT = const(3500)
_MESSAGE_TIMEOUT = const(250)
_FIRST_PAUSE = const(10)
_LONGEST_PAUSE = const(800)

_STOP_WORDS = ("no reason given", "STOP was pressed", "a program called for it")


_CHECK = b"\x00/^q\xbc\x93\xe2\xcdWx\t&\xeb\xc4\xb5\x9a"  # the remainders of its 16 high half octets


def check_byte(message):
    """CRC-8/AUTOSAR of the message."""
    crc = 0xFF
    for octet in message:
        crc ^= octet
        crc = (crc << 4 & 0xFF) ^ _CHECK[crc >> 4]
        crc = (crc << 4 & 0xFF) ^ _CHECK[crc >> 4]
    return crc ^ 0xFF


def body_of(packet):
    """What the frames of a packet carry together."""
    return packet if len(packet) <= 7 else packet + bytes((check_byte(packet),))


def frame_of(body, at, counter):
    """The data field of the frame that begins at that octet of a body."""
    first, last = _FIRST if at == 0 else 0, _LAST if at + 7 >= len(body) else 0
    return bytes((counter & _COUNTER | first | last,)) + body[at : at + 7]


class Joiner:
    """Reassembles frames; never returns a partial or altered message."""

    def __init__(self, limit):
        self.dropped = 0
        self._limit = limit
        self._parts = None
        self._last = b""
        self._expected = -1
        self._at = 0

    def receive(self, data, now):
        """Take the data field of one frame; returns the message it completes, or None."""
        if not data or data == self._last:  # CAN's own rare repetition of a frame
            return None
        self._last = data
        header = data[0]
        skipped = header & _COUNTER != self._expected
        self._expected = header + 1 & _COUNTER
        if self._parts is not None and (skipped or header & _FIRST or now - self._at > _MESSAGE_TIMEOUT):
            self._parts = None
            self.dropped += 1
        if header & _FIRST:
            self._parts = bytearray()
        if self._parts is None:
            return None
        self._at = now
        self._parts += data[1:]
        if len(self._parts) > self._limit + 1:
            self._parts = None
            self.dropped += 1
        elif header & _LAST:
            message, self._parts = bytes(self._parts), None
            if header & _FIRST:
                return message or None
            if len(message) > 1 and check_byte(message[:-1]) == message[-1]:
                return message[:-1]
            self.dropped += 1
        return None


class CanLink:
    """A link over one controller."""

    shared = True
    mtu = _MTU

    def __init__(self, bus, name="CAN"):
        self.name = name
        self.node = 0  # our address, 1 to 120; 0 = none
        self.dropped = 0
        self._bus = bus
        self._epoch = self._heard_epoch = -1
        self._robot = None
        self._pause = _FIRST_PAUSE
        self._join_at = self._deadline = None
        self._more = False  # frames may wait in the controller
        self._leaving = False  # a JOIN is on its way out of the controller
        self._refused = False
        self._counter = 0
        self._joiner = None
        self._short = False
        self._empty()

    def branch(self, _number):
        """A link for another part over the same controller, with an address of its own."""
        from .trunk import BusTrunk

        if not isinstance(self._bus, BusTrunk.Branch):
            self._bus = BusTrunk(self._bus).branch()
            self._bus.node = self.node
        return CanLink(self._bus.trunk.branch(), self.name)

    def close(self):
        """Leave the controller to the others."""
        self._bus.close()

    def begin(self, part, client, now):
        """Ask for an address."""
        self._part = part
        self._client = client
        self._hash = crc32(part.uid) & 0x3FFFFF
        self._bus.listen(0)
        self._join(now)

    def has_room(self):
        """Whether another packet is accepted now."""
        return bool(self.node) and self._frames < _QUEUE

    def send(self, packet, now):
        """Queue a packet; its frames are made when the controller takes them."""
        self._queue.append(body_of(compress(packet) if self._short else packet))
        self._frames += (len(self._queue[-1]) + 6) // 7

    def poll(self, now):
        """Receive the frames from the controller."""
        for _ in range(_FRAMES):
            frame = self._bus.recv()
            self._more = frame is not None
            if not self._more:
                return
            self._take(frame[0], frame[1], frame[2], now)

    def step(self, now):
        """Do what is due, and hand frames to the controller."""
        if self._deadline is not None and now >= self._deadline:
            self._lose("no beacon of the master for 3.5 s", now)
        if self._leaving and not self._bus.pending():
            self._leaving = False
            self._join_at = now + self._pause * (192 + random.getrandbits(7)) // 256  # +- 25 %
            self._pause = min(2 * self._pause, _LONGEST_PAUSE)
        if self._join_at is not None and now >= self._join_at:
            identifier = _JOIN | _COMPRESSION << 22 | self._hash
            if self._bus.send(identifier, True, self._part.uid):
                self._join_at = None
                self._leaving = True
        while self._queue:
            if not self._bus.send(_UP + self.node, False, frame_of(self._queue[0], self._sent, self._counter)):
                break
            self._counter += 1
            self._frames -= 1
            self._sent += 7
            if self._sent >= len(self._queue[0]):
                self._queue.pop(0)
                self._sent = 0

    def due(self):
        """When `step` must be called, or None; a time in the past while there is something to do."""
        if self._queue or self._leaving or self._more:
            return 0
        times = [at for at in (self._join_at, self._deadline) if at is not None]
        return min(times, default=None)

    def _take(self, identifier, extended, data, now):
        if not extended and self.node and identifier == _DOWN + self.node:
            message = self._joiner.receive(bytes(data), now)
            if message is not None:
                self._deliver(message, now)
        elif extended:
            if identifier & 0x1F000000 == _ASSIGN and len(data) == 8:
                self._hear_assign(identifier, bytes(data), now)
        elif identifier == _BEACON and len(data) == 8 and data[0] == 1:
            _, _, epoch, robot = struct.unpack("<BBHI", bytes(data))
            self._hear_beacon(epoch & 0x3FFF, robot, now)
        elif identifier == _STOP:
            reason = data[0] if data else 0
            words = _STOP_WORDS[reason] if reason < len(_STOP_WORDS) else "reason {}".format(reason)
            self._part.stop_said(words, now)

    def _deliver(self, message, now):
        if self._short:
            try:
                message = decompress(message)
            except RemoteProtocolError:
                self.dropped += 1
                return
        self._client.packet(message, now)

    def _hear_beacon(self, epoch, robot, now):
        news = epoch != self._heard_epoch
        self._heard_epoch = epoch
        if self.node:
            self._deadline = now + _BEACON_TIMEOUT
            known, self._robot = self._robot, robot
            if epoch != self._epoch:
                self._lose("the master has restarted", now)
            elif known not in (None, robot):
                self._lose("the robot's profile has changed", now)
        elif news and not self._leaving and self._join_at is not None and self._join_at - now > _FIRST_PAUSE * 5 // 4:
            self._join(now)

    def _hear_assign(self, identifier, uid, now):
        node = identifier & 0xFF
        if uid != self._part.uid:
            if self.node and node == self.node:
                self._lose("the master has given the address to another part", now)
        elif not self.node and node == 0:
            self._pause = _LONGEST_PAUSE
            if not self._refused:
                self._refused = True
                self._client.link_down("the master has no free address: all 120 are held by live parts", now)
        elif not self.node and node <= 120:
            self.node = node
            self._epoch = identifier >> 10 & 0x3FFF
            self._short = bool(identifier >> 8 & _COMPRESSION)
            self._robot = self._join_at = None
            self._leaving = self._refused = False
            self._deadline = now + _BEACON_TIMEOUT
            self._empty()
            self._counter = 0
            self._joiner = Joiner(_MTU + 1)
            self._bus.listen(node)
            self._client.link_up(now)

    def _lose(self, reason, now):
        self._join(now)
        self._client.link_down(reason, now)

    def _join(self, now):
        self.node = 0
        self._empty()
        self._deadline = None
        self._pause = _FIRST_PAUSE
        self._join_at = now

    def _empty(self):
        self._queue = []  # of what packets carry
        self._sent = 0  # octets of its first
        self._frames = 0  # still to send
