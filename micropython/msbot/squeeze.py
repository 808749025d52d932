"""What header compression on CAN needs seldom: DEFLATE with the dictionary that both ends have (docs/reference/can.md).

Imported for a part's first message and for configurations, and forgotten again.
"""

import struct
from deflate import RAW, DeflateIO
from io import BytesIO

from micropython import const

from .errors import RemoteProtocolError
from .objects import endpoint_blob, service_blob, topic_blob
from .running import forget
from .xrce import BEST_EFFORT, ENDLESS, RELIABLE, create_message, read_message

forget("objects")

_LARGEST = const(1024)  # octets that may come out: more than our MTU and its form need


def _join(bodies):
    out = bytearray()
    for body in bodies:
        out += body + bytes(-len(body) & 3)
    return bytes(out)


_OBJECTS = _join(
    (
        create_message(10, 0x11, b"\0\0", 0),
        create_message(11, 0x14, b"\0\0", 0x11),
        create_message(12, 0x12, topic_blob("msbot_masterTopic", "msbot_master"), 0x11),
        create_message(13, 0x16, endpoint_blob(0x12, True, b"\0\0"), 0x14),
        create_message(14, 0x17, service_blob("msbot_inventory"), 0x11),
    )
)
_PORTS = _join(
    (
        create_message(15, 0x22, topic_blob("/", ""), 0x11),
        create_message(16, 0x13, b"\0\0", 0x11),
        create_message(17, 0x15, endpoint_blob(0x22, True, b"\0"), 0x13),
        create_message(18, 0x32, topic_blob("/", ""), 0x11),
        create_message(19, 0x26, endpoint_blob(0x32, True, b"\0\0"), 0x14),
    )
)
_READS = [read_message(*read) for read in ((0x16, RELIABLE, ENDLESS), (0x17, RELIABLE, ENDLESS))]
_MORE_READS = [read_message(*read) for read in ((0x17, BEST_EFFORT, ENDLESS), (0x26, RELIABLE, ENDLESS))]
DICTIONARY = _OBJECTS + _join(_READS) + _PORTS + _join(_MORE_READS)
"""What every robot says (504 octets); both ends must have the same."""

FIRST = b"\0\0" + _OBJECTS + read_message(0x16, RELIABLE, None) + _READS[1]
"""A part's first message on a shared bus, after the code of its form; and its deflated form, by that code (session
id)."""
del _OBJECTS, _PORTS, _READS, _MORE_READS
_SQUEEZED = {0x39: b"_\xb3\x84:m4\xeaqD=\x07,\xea\xb1F9\x00", 0x79: b"_\xab\x84:m4\xeaqD=\x07,\xea\xb1F9\x00"}


def first(packet, code):
    """The short form of a message that is as long as a part's first; it is deflated if it is that."""
    return _SQUEEZED.get(code) if packet[2:] == FIRST else bytes((code,)) + packet[2:]


def inflate(data):
    """Undo DEFLATE: the dictionary goes in front as a block of its own, and is cut off the result."""
    size = len(DICTIONARY)
    stored = struct.pack("<BHH", 0, size, size ^ 0xFFFF) + DICTIONARY
    try:
        out = DeflateIO(BytesIO(stored + data), RAW, 11).read(size + _LARGEST + 1)
    except (OSError, EOFError, ValueError):
        raise RemoteProtocolError("compressed message: DEFLATE cannot read it") from None
    if len(out) > size + _LARGEST:
        raise RemoteProtocolError("compressed message: it is too long")
    return out[size:]
