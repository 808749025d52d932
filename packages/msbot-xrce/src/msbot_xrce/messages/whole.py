"""Tells a whole message from one that lost its beginning or its end, for framings that cannot (the CAN framing of the
thesis' firmware has neither a length nor a checksum)."""

from __future__ import annotations

from typing import Final

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.ids import COOKIE, SESSION_NONE
from msbot_xrce.messages.message import CreateClient, located_submessages
from msbot_xrce.messages.submessage import HEADER_SIZE

HEADERLESS_ANSWER: Final = 12
"""Octets of a C client's answer to GET_INFO, which has no submessage header (seen on the wire)."""


def is_whole(packet: bytes) -> bool:
    """Whether the octets are exactly one message, without a client key in its header.

    Its submessages are all known, make sense and fill it to the last octet. This is never true of a message of up to 32
    KiB that lost its first 7 octets: the rest begins with the high half of a length, which is not a session id.
    """
    if len(packet) < 2 * HEADER_SIZE or packet[0] < SESSION_NONE:
        return False
    if len(packet) == HEADERLESS_ANSWER and not any(packet[6:]):
        return True
    end = HEADER_SIZE
    try:
        for submessage, end in located_submessages(packet, HEADER_SIZE):  # noqa: B007 - the last one counts
            if submessage is None or (isinstance(submessage, CreateClient) and submessage.cookie != COOKIE):
                return False
    except RemoteProtocolError:
        return False
    return (end + 3) & ~3 >= len(packet)
