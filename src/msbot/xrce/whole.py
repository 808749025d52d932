"""Tells a whole message from one that lost its beginning, or its end, on a way that cannot tell (the CAN framing of
the thesis' firmware has neither a length nor a checksum)."""

from __future__ import annotations

from struct import Struct
from typing import Final

from msbot.errors import RemoteProtocolError
from msbot.xrce.ids import COOKIE, SESSION_NONE, SubmessageId
from msbot.xrce.messages import CreateClient, iter_submessages
from msbot.xrce.submessage import HEADER_SIZE

HEADERLESS_ANSWER: Final = 12
"""Octets of a C client's answer to GET_INFO, which has no submessage header (seen on the wire)."""

_SUBMESSAGE: Final = Struct("<BBH")
_KNOWN: Final = frozenset(int(known) for known in SubmessageId)
_TO_THE_END: Final = (SubmessageId.WRITE_DATA, SubmessageId.DATA)


def is_whole(packet: bytes) -> bool:
    """Whether the octets are one message without a client key in its header, and nothing but that.

    Its submessages are all known, make sense and fill it to the last octet. Of a message up to 32 KiB without its
    first 7 octets this is never true: what is left begins with the high half of a length, which is no session id.
    """
    if len(packet) < 2 * HEADER_SIZE or packet[0] < SESSION_NONE:
        return False
    if len(packet) == HEADERLESS_ANSWER and not any(packet[6:]):
        return True
    try:
        for _ in iter_submessages(packet, HEADER_SIZE):
            pass
        return _fills(packet)
    except RemoteProtocolError:
        return False


def _fills(packet: bytes) -> bool:
    size, offset = len(packet), HEADER_SIZE
    while offset + HEADER_SIZE <= size:
        submessage_id, flags, length = _SUBMESSAGE.unpack_from(packet, offset)
        start = offset + HEADER_SIZE
        if submessage_id not in _KNOWN:
            return False
        if submessage_id == SubmessageId.CREATE_CLIENT:
            client, end = CreateClient.decode_by_content(packet, start, size, flags)
            if client.cookie != COOKIE:
                return False
        else:
            end = size if length == 0 and submessage_id in _TO_THE_END else start + length
        offset = (end + 3) & ~3
    return offset >= size
