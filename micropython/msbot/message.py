"""Messages: a class with fields becomes CDR. The standard ones are in `standards`.

MicroPython throws annotations away, so a class of your own must be loaded through `msbot.start` (see `annotations`).
"""

import struct

from .cdr import Reader, put, put_text
from .errors import LocalProtocolError, RemoteProtocolError
from .running import once

# A type on the wire is a code of `struct`, or str, bool, bytes, a Message class, or a Kind (`lists`).
uint8, uint16, uint32, uint64 = "BHIQ"
int8, int16, int32, int64 = "bhiq"
float32, float64 = "fd"


class Kind:
    """Base of what a field holds besides: lists, bounded texts, enums."""


class _Field:
    made = 0

    def __init__(self, kind, default):
        _Field.made += 1
        self.place = _Field.made  # MicroPython's class dictionaries have no order
        self.kind = kind
        self.default = default


def field(kind, default=None):
    """One field of a message class; without a default it is zero."""
    make = getattr(kind, "kind_of", None)  # an enum
    if kind in (int, float):
        raise once("words").no_size(kind)
    return _Field(make(kind) if make else kind, default)


def zero(kind):
    """The value of a field that was not set."""
    if isinstance(kind, str):
        return 0.0 if kind in "fd" else 0
    return kind()


def fields_of(message_class):
    """The fields `(name, kind)` of a message class in the order of the wire; its `_defaults` are those that differ."""
    found = message_class.__dict__.get("_fields")
    if found is None:
        own = [
            (value.place, name, value) for name, value in message_class.__dict__.items() if isinstance(value, _Field)
        ]
        own.sort(key=lambda item: item[0])
        found = [item for base in message_class.__bases__ if base not in (object, Message) for item in fields_of(base)]
        found += [(name, value.kind) for _, name, value in own]
        if not found:
            words = "class {} has no fields: MicroPython forgets annotations; start the file with msbot.start"
            raise LocalProtocolError(words.format(message_class.__name__))
        message_class._fields = tuple(found)
        message_class._defaults = dict(message_class._defaults)
        for _, name, value in own:
            delattr(message_class, name)  # each takes some 80 octets
            message_class._defaults.pop(name, None)
            if value.default is not None:
                message_class._defaults[name] = value.default
    return found


def type_name_of(message_class):
    """Its name in the data space."""
    return message_class.__dict__.get("type_name", message_class.__name__)


class Message:  # noqa: PLW1641 - it can change, and has no hash
    """Base of everything that travels on a topic."""

    _defaults = {}  # noqa: RUF012 - never changed: a class with fields has its own

    def __init__(self, **values):
        for name, kind in fields_of(type(self)):
            if name not in values:
                default = self._defaults.get(name)
                values[name] = zero(kind) if default is None else default[:] if isinstance(default, list) else default
            setattr(self, name, values.pop(name))
        for name in values:
            raise TypeError("{} has no field {!r}".format(type(self).__name__, name))
        self._check()

    def __eq__(self, other):
        return type(other) is type(self) and all(
            getattr(self, name) == getattr(other, name) for name, _ in fields_of(type(self))
        )

    def __repr__(self):
        inside = ", ".join("{}={!r}".format(name, getattr(self, name)) for name, _ in fields_of(type(self)))
        return "{}({})".format(type(self).__name__, inside)

    def _check(self):
        for name, kind in fields_of(type(self)):
            value = getattr(self, name)
            if not fits(kind, value):
                raise LocalProtocolError(once("words").misfit(type(self).__name__, name, kind, value))

    def encode(self):
        """The message as octets."""
        out = bytearray()
        self._write(out)
        return bytes(out)

    def _write(self, out):
        self._check()  # again: a field can be set to anything
        for name, kind in fields_of(type(self)):
            write(out, kind, getattr(self, name))

    @classmethod
    def decode(cls, octets):
        """The message in the octets; up to 3 octets of padding may follow it."""
        reader = Reader(octets)
        message = read(cls, reader)
        if len(octets) - reader.at > 3:
            words = "{} bytes left over after {}: is it another type?"
            raise RemoteProtocolError(words.format(len(octets) - reader.at, type_name_of(cls)))
        return message


def write(out, kind, value):
    """Append a value of that kind."""
    if isinstance(kind, str):
        put(out, kind, value)
    elif kind is bool:
        out.append(value)
    elif kind is str:
        put_text(out, value)
    elif kind is bytes:
        put(out, "I", len(value))
        out += value
    elif isinstance(kind, Kind):
        kind.write(out, value)
    else:
        value._write(out)


def read(kind, reader):
    """A value of that kind."""
    if isinstance(kind, str):
        return reader.number(kind)
    if kind is bool:
        value = reader.take(1)[0]
        if value > 1:
            raise RemoteProtocolError("a boolean that is {}".format(value))
        return value == 1
    if kind is str:
        return reader.text()
    if kind is bytes:
        return reader.take(reader.number("I"))
    if isinstance(kind, Kind):
        return kind.read(reader)
    return kind(**{name: read(inner, reader) for name, inner in fields_of(kind)})


def limits(code):
    """The least and the greatest whole number of a code."""
    bits = 8 * struct.calcsize(code)
    return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if code in "bhiq" else (0, (1 << bits) - 1)


def fits(kind, value):
    """Whether a field of that kind can hold the value."""
    if isinstance(kind, Kind):
        return kind.fits(value)
    if not isinstance(kind, str):
        return isinstance(value, kind) and (kind is not str or "\0" not in value)
    if not isinstance(value, int) or isinstance(value, bool):
        return kind in "fd" and isinstance(value, float)
    low, high = (value, value) if kind in "fd" else limits(kind)
    return low <= value <= high
