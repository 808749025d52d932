"""Lists, texts of limited length and enums in messages; imported by programs that have some."""

import struct

from .errors import RemoteProtocolError
from .message import Kind, fits, read, write, zero
from .running import once


class IntEnum:
    """Base of an enum: a class with numbers. Its values are plain numbers here."""

    @staticmethod
    def kind_of(enum):
        """What a field of it holds."""
        return EnumKind(enum)


class EnumKind(Kind):
    """One of several numbers, each with a name."""

    def __init__(self, enum):
        named = [(value, name) for name, value in enum.__dict__.items() if name[:1] != "_" and isinstance(value, int)]
        named.sort()
        self.name = enum.__name__
        self.names = [name.lower() for _, name in named]
        self.numbers = [value for value, _ in named]

    def __call__(self):
        return self.numbers[0]

    def fits(self, value):
        """Whether it is one of the numbers."""
        return not isinstance(value, bool) and value in self.numbers

    def write(self, out, value):
        """Append it."""
        write(out, "I", value)

    def read(self, reader):
        """Read it."""
        value = reader.number("I")
        if value not in self.numbers:
            raise RemoteProtocolError("{} is no {}".format(value, self.name))
        return value

    def needs(self):
        """What it must be."""
        return "{} needs one of {}".format(self.name, ", ".join([name.upper() for name in self.names]))


class TextKind(Kind):
    """A text of limited length."""

    def __init__(self, count):
        self.count = count

    def __call__(self):
        return ""

    def fits(self, value):
        """Whether it is such a text."""
        return fits(str, value) and len(value.encode()) <= self.count

    def write(self, out, value):
        """Append it."""
        write(out, str, value)

    def read(self, reader):
        """Read it."""
        value = reader.text()
        if len(value.encode()) > self.count:
            raise RemoteProtocolError("a text of more than {} octets".format(self.count))
        return value

    def needs(self):
        """What it must be."""
        return "str needs a text without NUL characters, at most {} octets".format(self.count)


class ListKind(Kind):
    """A list, or bytes; `sign` is "" for any number of elements, "<=" for at most `count`, "=" for exactly so many."""

    def __init__(self, element, sign="", count=0, octets=False):
        if element in (int, float):
            raise once("words").no_size(element)
        make = getattr(element, "kind_of", None)
        self.element = make(element) if make else element
        self.sign = sign
        self.count = count
        self.octets = octets

    def __call__(self):
        size = self.count if self.sign == "=" else 0
        return bytes(size) if self.octets else [zero(self.element) for _ in range(size)]

    def _counts(self, size):
        return size == self.count if self.sign == "=" else size <= self.count or not self.sign

    def fits(self, value):
        """Whether it is such a list."""
        if not isinstance(value, bytes if self.octets else list) or not self._counts(len(value)):
            return False
        return self.octets or all([fits(self.element, one) for one in value])

    def write(self, out, value):
        """Append it."""
        if self.sign != "=":
            write(out, "I", len(value))
        if self.octets:
            out += value
        elif value and isinstance(self.element, str):
            out += bytes(-len(out) & (struct.calcsize(self.element) - 1))
            out += struct.pack("<{}{}".format(len(value), self.element), *value)
        else:
            for one in value:
                write(out, self.element, one)

    def read(self, reader):
        """Read it."""
        size = self.count if self.sign == "=" else reader.number("I")
        if not self._counts(size) or size > len(reader.octets) - reader.at:
            raise RemoteProtocolError("a list of {} elements".format(size))
        if self.octets:
            return bytes(reader.take(size))
        if not size or not isinstance(self.element, str):
            return [read(self.element, reader) for _ in range(size)]
        one = struct.calcsize(self.element)
        reader.at += -reader.at & (one - 1)
        return list(struct.unpack("<{}{}".format(size, self.element), reader.take(size * one)))

    def wrong_size(self, value):
        """How many there are, if that is what is wrong; else an empty text."""
        if self._counts(len(value) if isinstance(value, bytes if self.octets else list) else self.count):
            return ""
        bound = "exactly" if self.sign == "=" else "at most"
        return "must have {} {} {}; it has {}".format(
            bound, self.count, "bytes" if self.octets else "elements", len(value)
        )

    def needs(self):
        """What it must be."""
        bound = {"": "", "<=": " of at most {}".format(self.count), "=": " of exactly {}".format(self.count)}[self.sign]
        return "needs {}{}".format("bytes" if self.octets else "a list", bound)


def AtMost(length):
    """As on a PC."""
    return "<=", length


def Exactly(length):
    """As on a PC."""
    return "=", length


Octets = Exactly


class _List:
    def __getitem__(self, element):
        return ListKind(element)


class _Annotated:
    def __getitem__(self, item):
        base, (sign, count) = item
        if base is str:
            return TextKind(count)
        if base is bytes:
            return ListKind("B", sign, count, octets=True)
        return ListKind(base.element, sign, count)


List, Annotated = _List(), _Annotated()
