"""What both ends of header compression know in advance: the DEFLATE dictionary, and messages that never change.

Part of the wire format: both ends must have the same octets, so the CRC-32 of the dictionary is given here and in
docs/reference/can.md, and another dictionary would need a capability bit of its own. It holds only what every robot
says, nothing specific to one of them: a part's first message (`msbot.part.Membership`), and the messages that create
and read ports.
"""

from __future__ import annotations

from typing import Final

from msbot_xrce.messages.data import DeliveryControl, ReadData
from msbot_xrce.messages.envelope import append_submessage
from msbot_xrce.messages.ids import (
    OBJECT_AGENT,
    OBJECT_CLIENT,
    REQUEST_LOGOUT,
    REQUEST_NONE,
    REQUEST_PING,
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    read_request_id,
)
from msbot_xrce.messages.message import Submessage
from msbot_xrce.messages.objects import Create, Delete, ObjectVariant, StatusReply
from msbot_xrce.messages.session import GetInfo, Info, StatusAgent
from msbot_xrce.messages.streams import Reset
from msbot_xrce.objects.binary import (
    participant_variant,
    publisher_variant,
    reader_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)

CHECK: Final = 0xE99DCCC5
"""CRC-32 of the dictionary."""

_PARTICIPANT = 0x0011
_SERVICE = requester_variant(
    "msbot_inventory",
    "msbot_inventory_request",
    "msbot_inventory_reply",
    "msbot_inventory_Request",
    "msbot_inventory_Reply",
    _PARTICIPANT,
)
_MASK_CONFIGURATION = 1
_MASK_ACTIVITY = 2


def _create(request_id: int, object_id: int, variant: ObjectVariant) -> Create:
    return Create(request_id, object_id, variant, reuse=True, replace=True)


def _read(object_id: int, stream_id: int) -> ReadData:
    return ReadData(read_request_id(object_id), object_id, stream_id, DeliveryControl())


_SET_UP: tuple[Submessage, ...] = (
    _create(10, 0x0011, participant_variant("")),
    _create(11, 0x0014, subscriber_variant(_PARTICIPANT)),
    _create(12, 0x0012, topic_variant("msbot_masterTopic", "msbot_master", _PARTICIPANT)),
    _create(13, 0x0016, reader_variant(0x0012, 0x0014)),
    _create(14, 0x0017, _SERVICE),
    _read(0x0016, STREAM_RELIABLE),
    _read(0x0017, STREAM_RELIABLE),
)
_PORTS: tuple[Submessage, ...] = (
    _create(15, 0x0022, topic_variant("/", "", _PARTICIPANT)),
    _create(16, 0x0013, publisher_variant(_PARTICIPANT)),
    _create(17, 0x0015, writer_variant(0x0022, 0x0013)),
    _create(18, 0x0032, topic_variant("/", "", _PARTICIPANT)),
    _create(19, 0x0026, reader_variant(0x0032, 0x0014)),
    _read(0x0017, STREAM_BEST_EFFORT),
    _read(0x0026, STREAM_RELIABLE),
)


def _join(submessages: tuple[Submessage, ...]) -> bytes:
    body = b""
    for submessage in submessages:
        body = append_submessage(body, submessage.encode())
    return body + bytes(-len(body) & 3)


DICTIONARY: Final = _join(_SET_UP) + _join(_PORTS)
"""504 octets."""

FIXED: Final = tuple(
    submessage.encode()
    for submessage in (
        StatusAgent(0),
        GetInfo(REQUEST_PING, OBJECT_AGENT, _MASK_ACTIVITY),
        Info(REQUEST_PING, OBJECT_AGENT, implementation_status=0),
        Info(REQUEST_PING, OBJECT_AGENT, implementation_status=1),
        GetInfo(REQUEST_NONE, OBJECT_CLIENT, _MASK_CONFIGURATION),
        Info(REQUEST_NONE, OBJECT_CLIENT, has_agent=False, availability=None),
        Delete(REQUEST_LOGOUT, OBJECT_CLIENT),
        StatusReply(REQUEST_LOGOUT, OBJECT_CLIENT, 0),
        Reset(),
    )
)
"""Messages outside streams that are always the same, without their header, by number."""
