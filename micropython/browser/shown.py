"""The last message of a port, as the page shows it: numbers with the digits that their type can tell."""

import struct

from msbot.errors import MsbotError
from msbot.message import Message, fields_of


def shown(message, message_class=None):
    """A message in words, `Level(percent=0.1)`; with `message_class` it is still octets."""
    try:
        return _words(message if message_class is None else message_class.decode(message))
    except MsbotError as error:
        return str(error)


def _words(message):
    kinds = fields_of(type(message))
    fields = ["{}={}".format(name, _value(kind, getattr(message, name))) for name, kind in kinds]
    return "{}({})".format(type(message).__name__, ", ".join(fields))


def _value(kind, value):
    if isinstance(value, Message):
        return _words(value)
    return _shortest(value) if kind == "f" and isinstance(value, float) else repr(value)


def _shortest(value):
    """The fewest digits that are this float32: 0.1, not the 0.10000000149011612 that it is read as."""
    octets = struct.pack("f", value)
    value = struct.unpack("f", octets)[0]
    for digits in range(1, 10):
        near = float("{:.{}g}".format(value, digits))
        if struct.pack("f", near) == octets:
            break
    return repr(near)  # inf and nan, too
