"""Links without a bus: bytes in serial frames (UART, any byte pipe), packets as they are (any packet pipe), UDP.

A link has `shared`, `mtu`, `name` and the methods `begin`, `poll`, `has_room`, `send`, `step`, `due`, like `CanLink`.
"""

from micropython import const

_MTU = const(512)
_AGENT = const(0)
_PACKETS = const(16)  # read at a time, so that the part itself gets its turn


def crc16(octets):
    """CRC-16/ARC."""
    crc = 0
    for octet in octets:
        crc ^= octet
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def encode_frame(packet, source):
    """A serial frame from that address to the agent (docs/reference/links.md)."""
    size, crc = len(packet), crc16(packet)
    body = bytes((source, _AGENT, size & 0xFF, size >> 8)) + packet + bytes((crc & 0xFF, crc >> 8))
    return b"\x7e" + body.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")


class Link:
    """What the links of this file share: packets to one agent, never over a shared medium."""

    shared = False
    mtu = _MTU

    def __init__(self, name):
        self.name = name
        self.dropped = 0

    def begin(self, part, client, now):
        """Start to serve the part's session."""
        self._client = client

    def step(self, now):
        """Nothing is due."""

    def due(self):
        """Never."""


class SerialLink(Link):
    """Serial frames over a stream with `read()` (octets or None) and `write(octets)` (returns how many it accepted)."""

    def __init__(self, stream, name="serial", address=1):
        super().__init__(name)
        self._stream = stream
        self._address = address
        self._rest = b""
        self._frame = None  # the octets of a frame so far, not yet unescaped

    def branch(self, number):
        """A link for another part over the same line, at the next address but `number`."""
        from .trunk import StreamTrunk

        if not isinstance(self._stream, StreamTrunk.Branch):
            self._stream = StreamTrunk(self._stream).branch()
        return SerialLink(self._stream.trunk.branch(), self.name, self._address + number)

    def close(self):
        """Leave the line to the others."""
        self._stream.close()

    def has_room(self):
        """Whether the stream has accepted all that was sent."""
        return not self._rest

    def send(self, packet, now):
        """Send a packet."""
        self._rest = encode_frame(packet, self._address)
        self.step(now)

    def step(self, now):
        """Write what the stream has not accepted yet."""
        if self._rest:
            self._rest = self._rest[self._stream.write(self._rest) or 0 :]

    def due(self):
        """At once while something waits."""
        return 0 if self._rest else None

    def poll(self, now):
        """Receive what came."""
        octets = self._stream.read()
        if not octets:
            return
        pieces = octets.split(b"\x7e")
        if self._frame is not None:
            self._take(self._frame + pieces[0], now)
        for piece in pieces[1:]:
            self._take(piece, now)

    def _take(self, frame, now):
        self._frame = frame
        if frame[-1:] == b"\x7d":
            return
        parts = frame.split(b"\x7d")
        plain = parts[0]
        for part in parts[1:]:
            plain += bytes((part[0] ^ 0x20,)) + part[1:] if part else b""
        if len(plain) < 4:
            return
        size = plain[2] | plain[3] << 8
        if plain[1] != self._address or size > _MTU:
            self._frame = None
        elif len(plain) >= size + 6:
            self._frame = None
            packet = plain[4 : 4 + size]
            if crc16(packet) == plain[4 + size] | plain[5 + size] << 8:
                self._client.packet(packet, now)
            else:
                self.dropped += 1


class PacketLink(Link):
    """Whole packets: `read()` returns one or None, `write(packet)` says whether it was accepted."""

    def __init__(self, pipe, name="pipe"):
        super().__init__(name)
        self._pipe = pipe
        self._waiting = None
        self._more = False  # packets may wait in the pipe

    def branch(self, number):
        """A link for another part to the same agent."""
        return PacketLink(self._pipe.again(), self.name)

    def close(self):
        """Forget the pipe."""
        self._pipe.close()

    def has_room(self):
        """Whether the pipe has accepted the last packet."""
        self.step(0)
        return self._waiting is None

    def send(self, packet, now):
        """Send a packet."""
        self._waiting = packet
        self.step(now)

    def step(self, now):
        """Write what the pipe has not accepted yet."""
        if self._waiting is not None and self._pipe.write(self._waiting):
            self._waiting = None

    def due(self):
        """At once while something waits."""
        return 0 if self._more or self._waiting is not None else None

    def poll(self, now):
        """Receive what came."""
        for _ in range(_PACKETS):
            packet = self._pipe.read()
            self._more = packet is not None
            if not self._more:
                return
            self._client.packet(packet, now)


class UdpPipe:
    """Packets as datagrams to one address."""

    def __init__(self, host, port):
        import socket

        self._agent = (host, port)
        address = socket.getaddrinfo(host, port)[0][-1]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(address)

    def again(self):
        """Another one to the same address."""
        return UdpPipe(*self._agent)

    def close(self):
        """Free the socket."""
        self._socket.close()

    def read(self):
        """A datagram, or None."""
        try:
            return self._socket.recv(_MTU)
        except OSError:  # nothing has come, or there is no peer yet
            return None

    def write(self, packet):
        """Send one; if the network does not accept it now, it is lost, as any datagram may be."""
        try:
            self._socket.send(packet)
        except OSError:
            return False
        return True
