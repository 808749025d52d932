"""Classic CDR, little endian: each number at a multiple of its own size, texts with their length and a NUL."""

import struct

from .errors import RemoteProtocolError


def put(out, code, value):
    """Append a number, aligned; `code` is that of `struct`."""
    out += bytes(-len(out) & (struct.calcsize(code) - 1))
    out += struct.pack("<" + code, value)


def put_text(out, text):
    """Append a text."""
    octets = text.encode()
    put(out, "I", len(octets) + 1)
    out += octets
    out.append(0)


class Reader:
    """Reads values one after the other; missing octets raise RemoteProtocolError."""

    def __init__(self, octets):
        self.octets = octets
        self.at = 0

    def take(self, size):
        """That many octets as they are."""
        end = self.at + size
        if end > len(self.octets):
            raise RemoteProtocolError("{} bytes where {} are needed".format(len(self.octets), end))
        octets = self.octets[self.at : end]
        self.at = end
        return octets

    def number(self, code):
        """A number, aligned."""
        size = struct.calcsize(code)
        self.at += -self.at & (size - 1)
        return struct.unpack("<" + code, self.take(size))[0]

    def text(self):
        """A text."""
        octets = self.take(self.number("I"))
        if not octets or octets[-1] or 0 in octets[:-1]:
            raise RemoteProtocolError("a text without the NUL that ends it")
        try:
            return str(octets[:-1], "utf-8")
        except ValueError:  # includes UnicodeError
            raise RemoteProtocolError("a text that is not UTF-8") from None
