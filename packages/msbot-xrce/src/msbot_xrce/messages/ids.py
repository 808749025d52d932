"""The numbers of DDS-XRCE: kinds, statuses, formats, and the identifiers, which are octets on the wire and ints here.

Object ids, request ids and client keys are octet arrays (XRCE 1.0 §8.2.1), never byte-swapped; they are kept as the
big-endian number of their octets: key `aa bb cc dd` is 0xAABBCCDD, object `00 15` is 0x0015.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum

COOKIE = b"XRCE"
"""First octets of a CREATE_CLIENT and of a STATUS_AGENT (XRCE 1.0 §7.8.2)."""
VERSION = b"\x01\x00"
"""Protocol version 1.0."""
VENDOR = b"\x01\x0f"
"""Vendor id of eProsima, whose dialect this is (the thesis builds on its client and agent)."""

SESSION_NONE_KEYED = 0x00
"""No session yet; the client key follows in the header."""
SESSION_NONE = 0x80
"""No session yet, no key in the header; ids from this one up never have the key in the header."""
SESSION_DEFAULT = 0x81
"""The session id that all stock clients ask for."""

STREAM_NONE = 0x00
"""No sequence numbers, no order, no acknowledgement."""
STREAM_BEST_EFFORT = 0x01
"""The first best-effort stream; they go up to 0x7F."""
STREAM_RELIABLE = 0x80
"""The first reliable stream; they go up to 0xFF."""

OBJECT_INVALID = 0x0000
OBJECT_AGENT = 0xFFFD
OBJECT_CLIENT = 0xFFFE
OBJECT_SESSION = 0xFFFF

REQUEST_NONE = 0
REQUEST_LOGIN = 1
REQUEST_LOGOUT = 2
REQUEST_DISCOVERY = 9
REQUEST_PING = 10
FIRST_REQUEST = 10
"""Clients count their requests from here, and start here again after 65535 (seen on the wire)."""
FIRST_RULED_REQUEST = 0x8000
"""Request ids from this one up follow from the rest of their message, for clients that use `write_request_id`."""


class LoginProperty(StrEnum):
    """Names of what a login says of its client; an agent ignores those it does not know. "1" means yes."""

    HARD_LIVELINESS = "uxr_hl"
    """Milliseconds of silence after which the client is given up (seen on the wire)."""
    SHARED_MEMORY = "uxr_sm"
    """The client does not want its own samples back (seen on the wire)."""
    ASKS_AGAIN = "msbot_asks_again"
    """MsBOT's own: the client asks again. When refused for lack of resources, it reads the implementation octet in
    STATUS_AGENT as the tenths of a second to wait."""
    NUMBER = "msbot_login"
    """MsBOT's own: up to 8 letters and digits that tell this login from the client's others, also those before a
    restart, so that the agent knows a copy for one."""


class SubmessageId(IntEnum):
    """What a submessage is (XRCE 1.0 §8.3.5)."""

    CREATE_CLIENT = 0x00
    CREATE = 0x01
    GET_INFO = 0x02
    DELETE = 0x03
    STATUS_AGENT = 0x04
    STATUS = 0x05
    INFO = 0x06
    WRITE_DATA = 0x07
    READ_DATA = 0x08
    DATA = 0x09
    ACKNACK = 0x0A
    HEARTBEAT = 0x0B
    RESET = 0x0C
    FRAGMENT = 0x0D
    TIMESTAMP = 0x0E
    TIMESTAMP_REPLY = 0x0F


class ObjectKind(IntEnum):
    """What an object is: the low four bits of its id (XRCE 1.0 §7.7.1; 7 and 8 are eProsima's)."""

    PARTICIPANT = 0x1
    TOPIC = 0x2
    PUBLISHER = 0x3
    SUBSCRIBER = 0x4
    DATAWRITER = 0x5
    DATAREADER = 0x6
    REQUESTER = 0x7
    REPLIER = 0x8
    TYPE = 0xA
    QOSPROFILE = 0xB
    APPLICATION = 0xC
    AGENT = 0xD
    CLIENT = 0xE
    OTHER = 0xF


class Format(IntEnum):
    """How a CREATE describes the object (XRCE 1.0 §7.7.2)."""

    REFERENCE = 0x01
    XML = 0x02
    BINARY = 0x03


class Status(IntEnum):
    """How a request ended (XRCE 1.0 §7.7.8)."""

    OK = 0x00
    OK_MATCHED = 0x01
    ERR_DDS_ERROR = 0x80
    ERR_MISMATCH = 0x81
    ERR_ALREADY_EXISTS = 0x82
    ERR_DENIED = 0x83
    ERR_UNKNOWN_REFERENCE = 0x84
    ERR_INVALID_DATA = 0x85
    ERR_INCOMPATIBLE = 0x86
    ERR_RESOURCES = 0x87

    @property
    def describe(self) -> str:
        """The status for a person."""
        return _STATUS_WORDS[self]


_STATUS_WORDS = {
    Status.OK: "OK",
    Status.OK_MATCHED: "OK, an equal object exists already",
    Status.ERR_DDS_ERROR: "the data space refused it (wrong XML, unknown topic or profile)",
    Status.ERR_MISMATCH: "a different object has this id",
    Status.ERR_ALREADY_EXISTS: "an object has this id already",
    Status.ERR_DENIED: "denied",
    Status.ERR_UNKNOWN_REFERENCE: "no such object, or its parent does not exist",
    Status.ERR_INVALID_DATA: "the request makes no sense (wrong cookie, client key 0, MTU too small)",
    Status.ERR_INCOMPATIBLE: "another major version of the protocol",
    Status.ERR_RESOURCES: "the agent has no room for more",
}


def status_words(status: int) -> str:
    """Any status octet for a person, unknown ones too."""
    words = _STATUS_BY_OCTET.get(status)
    return f"unknown status 0x{status:02X}" if words is None else words


_STATUS_BY_OCTET = {int(status): words for status, words in _STATUS_WORDS.items()}


def make_object_id(number: int, kind: int) -> int:
    """The object id of the `number`-th object (0 to 0xFFF) of that kind: number 1 of kind 5 is 0x0015."""
    return number << 4 | kind


def write_request_id(stream_id: int, sequence_nr: int) -> int:
    """The request id by rule of a WRITE_DATA, the first of message `sequence_nr` on stream 0x01 or 0x80.

    0x8000 to 0x9FFF and 0xA000 to 0xBFFF: unique among 8192 messages of each stream.
    """
    return (0xA000 if stream_id >= STREAM_RELIABLE else 0x8000) | sequence_nr & 0x1FFF


def read_request_id(object_id: int) -> int:
    """The request id by rule of a READ_DATA, and with it of all DATA that answer it: 0xC000 to 0xFFFF."""
    return 0xC000 | object_id & 0x3FFF


KIND_MASK = 0x0F
"""The bits of an object id that are its kind."""


def kind_of(object_id: int) -> int:
    """The kind of an object: the low four bits of its id; it may be a kind that nobody defined."""
    return object_id & KIND_MASK
