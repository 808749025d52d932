"""`ws:`: a part's way to its master through the page's server, where nothing but HTTP gets through.

A WebSocket (RFC 6455), one binary message for each packet; imported only if `msbot.json` names such a link.
"""

from binascii import b2a_base64
from random import getrandbits

from micropython import const

from .errors import say
from .links import Link

_PATH = "/api/link"
_MOST = const(1024)  # octets of a message, or of the answer to the first request
_AGAIN = const(2000)  # ms until the next try
_REFUSED_AGAIN = const(15000)  # the page has said no: somebody has to change something there
_CONNECT = const(5000)  # until the page has answered
_SILENT = const(45000)  # the page sends a ping every 20 s

_TEXT, _BINARY, _CLOSE, _PING, _PONG = 1, 2, 8, 9, 10


class WebSocketLink(Link):
    """Keeps one connection to a page's server.

    `connect()` returns a stream: `read()` gives octets, None (nothing yet) or b"" (it has ended), `write(octets)` how
    many it accepted; both, and `connect`, may raise OSError.
    """

    def __init__(self, connect, address, token):
        super().__init__(address)
        host, slash, path = address.partition("//")[2].partition("/")
        self._connect, self._token = connect, token
        self._host, self._path = host, slash + path if path else _PATH
        self._stream = None
        self._try_at = 0
        self._told = None  # the last thing that a person was told

    def branch(self, number):
        """A link for another part: a connection of its own."""
        return WebSocketLink(self._connect, self.name, self._token)

    def close(self):
        """Leave the page."""
        if self._stream is not None:
            self._rest += _frame(_CLOSE, b"\x03\xe8")
            self.step(0)
            self._drop()

    def has_room(self):
        """Whether the connection has accepted all that was sent; without one, packets are dropped."""
        return self._stream is None or not self._rest

    def send(self, packet, now):
        """Send a packet."""
        if self._is_open():
            self._rest += _frame(_BINARY, packet)
            self.step(now)

    def step(self, now):
        """Write what the connection has not accepted yet."""
        if self._stream is not None and self._rest:
            try:
                self._rest = self._rest[self._stream.write(self._rest) or 0 :]
            except OSError as error:
                self._lose(str(error), now)

    def due(self):
        """At once while something waits."""
        return 0 if self._stream is not None and self._rest else None

    def poll(self, now):
        """Connect if there is no connection; receive what came."""
        if self._stream is None:
            if now >= self._try_at:
                self._open(now)
            return
        try:
            octets = self._stream.read()
        except OSError as error:
            self._lose(str(error), now)
            return
        if octets is None:
            if now >= self._patient_until:
                self._lose("the page does not answer", now)
        elif not octets:
            self._lose("the connection with the page has ended", now)
        else:
            self._patient_until = now + _SILENT
            self._came += octets
            if self._is_open() or self._answered(now):
                while self._stream is not None and self._take(now):
                    pass

    def _is_open(self):
        return self._stream is not None and self._has_joined

    def _open(self, now):
        self._came = self._rest = self._pieces = b""
        self._kind = 0
        self._has_joined = False
        self._patient_until = now + _CONNECT
        try:
            self._stream = self._connect()
        except OSError as error:
            self._tell("the page at {} cannot be reached: {}".format(self._host, error))
            self._try_at = now + _AGAIN
            return
        lines = (
            "GET {} HTTP/1.1".format(self._path),
            "Host: " + self._host,
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Key: " + b2a_base64(_random(16)).decode().strip(),
            "Sec-WebSocket-Version: 13",
            "Authorization: Bearer " + self._token,
            "",
            "",
        )
        self._rest = "\r\n".join(lines).encode()
        self.step(now)

    def _answered(self, now):
        """The answer to the first request: whether the rest are frames."""
        head, end, rest = self._came.partition(b"\r\n\r\n")
        if not end:
            if len(head) > _MOST:
                self._refused("what answers at {} is no page of MsBOT", now)
            return False
        status = head.split(b" ", 2)[1:2]
        if status != [b"101"]:
            if status in ([b"401"], [b"403"]):
                self._refused("the page at {} does not let this part in: its token is wrong or void", now)
            else:
                self._refused("what answers at {} is no page of MsBOT", now)
            return False
        self._came, self._has_joined = rest, True
        self._told = None
        self._client.link_up(now)
        return True

    def _take(self, now):
        """The next frame, if all of it is there; whether it was."""
        came = self._came
        if len(came) < 2:
            return False
        size, at = came[1] & 0x7F, 2
        if size == 126 and len(came) >= 4:
            size, at = came[2] << 8 | came[3], 4
        elif size == 126:
            return False
        if size > _MOST or came[1] >= 127 or came[0] & 0x70:  # too long; or masked, as no server does
            self._lose("the page sends what makes no sense", now)
            return False
        if len(came) < at + size:
            return False
        content, self._came = came[at : at + size], came[at + size :]
        kind, is_last = came[0] & 0x0F, came[0] & 0x80
        if kind == _PING:
            self._rest += _frame(_PONG, content)
            self.step(now)
        elif kind == _CLOSE:
            self._closed(content, now)
        elif kind < _CLOSE:
            if kind:
                self._kind, self._pieces = kind, b""
            self._pieces += content
            if len(self._pieces) > _MOST:
                self._lose("the page sends what makes no sense", now)
            elif is_last:
                content, self._pieces = self._pieces, b""
                if self._kind == _BINARY:
                    self._client.packet(content, now)
                elif self._kind == _TEXT:
                    say("error", "the page says: " + _words(content))
        return True

    def _closed(self, content, now):
        code = content[0] << 8 | content[1] if len(content) >= 2 else 1005
        if 4400 <= code < 4500:
            self._refused("the page at {} says: " + _words(content[2:]).replace("{", "(").replace("}", ")"), now)
        else:
            self._lose("the connection with the page has ended", now)

    def _refused(self, words, now):
        words = words.format(self._host)
        self._tell(words)
        self._lose(words, now)
        self._try_at = now + _REFUSED_AGAIN

    def _lose(self, reason, now):
        was_open = self._is_open()
        self._drop()
        self._try_at = now + _AGAIN
        if was_open:
            self._client.link_down(reason, now)
        elif self._told is None:
            self._tell("the page at {} cannot be reached: {}".format(self._host, reason))

    def _drop(self):
        stream, self._stream = self._stream, None
        try:
            stream.close()
        except OSError:  # it is gone already
            pass

    def _tell(self, words):
        if words != self._told:
            self._told = words
            say("error", words)


class TcpStream:
    """A TCP connection that nobody waits for."""

    def __init__(self, host, port):
        import socket

        address = socket.getaddrinfo(host, port)[0][-1]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect(address)
        except OSError as error:
            if error.args[0] not in _NOT_YET:
                self._socket.close()
                raise

    def read(self):
        """What came, None while nothing does, b"" at the end."""
        try:
            return self._socket.recv(_MOST)
        except OSError as error:
            if error.args[0] in _NOT_YET:
                return None
            raise

    def write(self, octets):
        """How many it accepted."""
        try:
            return self._socket.send(octets)
        except OSError as error:
            if error.args[0] in _NOT_YET:
                return 0
            raise

    def close(self):
        """End it."""
        self._socket.close()


# EAGAIN, ENOTCONN, EINPROGRESS; the last two as lwIP, Linux and BSD number them.
_NOT_YET = (11, 35, 36, 57, 107, 115, 119, 128)


def _random(count):
    return bytes([getrandbits(8) for _ in range(count)])


def _frame(kind, content):
    """A frame as clients send them: whole, and masked."""
    mask, size = _random(4), len(content)
    head = bytes((0x80 | kind, 0x80 | size)) if size < 126 else bytes((0x80 | kind, 0xFE, size >> 8, size & 0xFF))
    return head + mask + bytes([octet ^ mask[at & 3] for at, octet in enumerate(content)])


def _words(octets):
    """A sentence from outside, as one short line."""
    text = bytes([octet for octet in octets[:200] if octet > 31]) if octets else b""
    try:
        return text.decode()
    except (UnicodeError, ValueError):
        return "(unreadable)"
