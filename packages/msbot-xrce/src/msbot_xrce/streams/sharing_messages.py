"""What may share a message, so that a stock C client takes all of it.

A stock client (2.0.0 to 3.0.1) takes a whole message before its application sees any of it, and has two manners that
bound what an agent may put into one (both seen on the wire):

* After a DATA for a requester it moves on by twice the length. Whatever follows is skipped or misread, and acknowledged
  all the same. So such a DATA ends its message.
* Applications await the answers to their requests one by one. While one awaits the first STATUS, a second one in the
  same message goes by unseen, and is then awaited in vain: that is how `rmw_microxrcedds` ends a publisher. So a STATUS
  has a message of its own, and where messages are lost or overtaken, nothing follows it before the client has it.
"""

from __future__ import annotations

from msbot_xrce.messages.ids import KIND_MASK, ObjectKind, SubmessageId

PACKED_MAX = 1400
"""Octets of the largest message that is made of several submessages: one frame on Ethernet and Wi-Fi, headers included.
Beyond, a datagram would go in several, and be lost with any of them."""
PADDING = (b"", bytes(3), bytes(2), bytes(1))
"""What fills a message up to a multiple of 4, by what is over."""

# Plain ints: comparing with a member of an IntEnum costs several times as much, for every sample.
_DATA = SubmessageId.DATA.value
_STATUS = SubmessageId.STATUS.value
_REQUESTER = ObjectKind.REQUESTER.value
_OBJECT = 7
"""Where the last octet of the object id is, in a DATA with its header."""


def stands_alone(body: bytes) -> bool:
    """Whether the submessage must not follow another one."""
    return body[0] == _STATUS


def takes_nothing_more(body: bytes) -> bool:
    """Whether nothing may follow the submessage."""
    kind = body[0]
    return kind == _STATUS or (kind == _DATA and body[_OBJECT] & KIND_MASK == _REQUESTER)
