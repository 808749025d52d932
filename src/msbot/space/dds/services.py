"""Requests and replies over DDS in the manner of ROS 2 with Cyclone DDS (rmw_cyclonedds).

16 octets precede the body: 8 that identify the requester, and 8 with the number of its request, little endian; a reply
repeats them. Topics are `rq/<service>Request` and `rr/<service>Reply`. Other services stay in this process: Fast DDS
addresses a reply beside the payload, which Cyclone DDS cannot express.
"""

from __future__ import annotations

from hashlib import blake2b
from struct import Struct

from msbot.space.contract import Guid

HEADER_SIZE = 16
_HEADER = Struct("<8sq")
_WITHOUT_HEADER = (b"\x01\x01", b"\x01\x0f")
"""How GUIDs of Connext and Fast DDS begin (vendor ids of DDSI-RTPS): nothing precedes the body of their requests."""
_ELSEWHERE = b"\0\0\0\0elsw"
"""Second half of the GUID of a requester in another program, of which only 8 octets are known."""


def reply_topic(request_topic: str) -> str:
    """The topic on which a request is answered."""
    return f"rr/{request_topic.removeprefix('rq/').removesuffix('Request')}Reply"


def request_topic(replies: str) -> str:
    """The topic of the requests that are answered on that one."""
    return f"rq/{replies.removeprefix('rr/').removesuffix('Reply')}Request"


def short(guid: Guid) -> bytes:
    """The 8 octets that identify one of our requesters."""
    return blake2b(guid, digest_size=8).digest()


def with_header(requester: bytes, number: int, body: bytes) -> bytes:
    """A request or reply as it is in DDS."""
    return _HEADER.pack(requester, number) + body


def split(octets: bytes) -> tuple[bytes, int, bytes] | None:
    """Requester, number and body of a request or reply from DDS; None when it is too short."""
    if len(octets) < HEADER_SIZE:
        return None
    requester, number = _HEADER.unpack_from(octets)
    return requester, number, octets[HEADER_SIZE:]


def has_header(writer: Guid) -> bool:
    """Whether requests from that writer in another program have the header in front."""
    return not writer.startswith(_WITHOUT_HEADER)


def foreign(requester: bytes) -> Guid:
    """A GUID for a requester in another program."""
    return requester + _ELSEWHERE


def is_foreign(guid: Guid) -> bool:
    """Whether a GUID is one that `foreign` made."""
    return guid[8:] == _ELSEWHERE
