"""How a stock C client reads a message: by content, not by length, with one cursor and one offset for alignment.

Facts, not code, of clients 2.0.0 to 3.0.1:

* Each submessage is read by its known layout, and the next one begins at the next multiple of 4 of the *offset*. The
  length in the header is used for DATA and FRAGMENT alone, and has 16 bits.
* After a DATA for a requester the cursor moves by the length twice, and the offset once: what follows is skipped or
  misread, though the message is acknowledged.
* After a DATA for an object of any other kind than reader, requester and replier, nobody is called.
* A kind that it does not know, and a FRAGMENT that is not stored as one, are not skipped: their contents are read as
  headers.
* Requests are awaited one by one: `uxr_run_session_until_all_status` takes whole messages, so of two STATUS in one
  message, an application that awaits the first before the second never sees the second.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from msbot_xrce.messages import ObjectKind

GET_INFO, STATUS_AGENT, STATUS, INFO, DATA = 2, 4, 5, 6, 9
ACKNACK, HEARTBEAT, FRAGMENT, TIMESTAMP_REPLY = 10, 11, 13, 15
KNOWN = frozenset((GET_INFO, STATUS_AGENT, STATUS, INFO, DATA, ACKNACK, HEARTBEAT, TIMESTAMP_REPLY))
LAST_PIECE = 0x02
LONGEST = 0xFFFF
"""Octets of the largest submessage: its length has 16 bits."""

_READER, _REQUESTER, _REPLIER = ObjectKind.DATAREADER, ObjectKind.REQUESTER, ObjectKind.REPLIER
_SIZES = {GET_INFO: 8, STATUS_AGENT: 11, STATUS: 6, INFO: 28, ACKNACK: 5, HEARTBEAT: 5, TIMESTAMP_REPLY: 24}
"""How far it reads into each kind that has a fixed layout, as an agent sends it."""


@dataclass(frozen=True, slots=True)
class Taken:
    """One submessage, as the client understood it, or as it was meant."""

    kind: int
    contents: bytes
    """Without the header; of a DATA the ids and what its callback is given."""

    @property
    def request_id(self) -> int:
        """Of a STATUS or DATA."""
        return int.from_bytes(self.contents[:2], "big")

    @property
    def object_id(self) -> int:
        """Of a STATUS or DATA."""
        return int.from_bytes(self.contents[2:4], "big")

    def __str__(self) -> str:
        return f"kind {self.kind} [{self.contents[:16].hex()}{'...' if len(self.contents) > 16 else ''}]"


def as_stock_client(submessages: bytes) -> list[Taken]:
    """What a stock client takes out of a message whose header was cut off (or out of joined pieces)."""
    taken: list[Taken] = []
    at = offset = 0
    size = len(submessages)
    while True:
        at, offset = at + (-offset & 3), offset + (-offset & 3)
        if size - at < 4:
            return taken
        kind, _, length = struct.unpack_from("<BBH", submessages, at)
        at, offset = at + 4, offset + 4
        if kind == DATA:
            ids = submessages[at : at + 4]
            at, offset = at + 4, offset + 4
            length = (length - 4) & 0xFFFF
            if len(ids) == 4 and ids[3] & 0x0F in (_READER, _REQUESTER, _REPLIER):
                taken.append(Taken(DATA, ids + submessages[at : at + length]))
            if len(ids) == 4 and ids[3] & 0x0F == _REQUESTER:
                at += length
            step = min(length, max(0, size - at))
            at, offset = at + step, offset + step
        elif kind in _SIZES:
            step = min(_SIZES[kind], size - at)
            taken.append(Taken(kind, submessages[at : at + step]))
            at, offset = at + step, offset + step


def as_meant(submessages: bytes) -> list[Taken]:
    """What an agent put into a message, by the lengths in it; 0 in a DATA means to the end."""
    meant: list[Taken] = []
    at = 0
    while at + 4 <= len(submessages):
        kind, _, length = struct.unpack_from("<BBH", submessages, at)
        end = at + 4 + length if length or kind != DATA else len(submessages)
        meant.append(Taken(kind, submessages[at + 4 : end]))
        at = end + (-end & 3)
    return meant


def complaints(submessages: bytes) -> list[str]:
    """What a stock client could not read of a message (or joined pieces) with such contents, in words."""
    meant = as_meant(submessages)
    found = [f"kind {one.kind}: no stock client knows it, nor skips it" for one in meant if one.kind not in KNOWN]
    found += [
        f"DATA of {len(one.contents)} bytes: it counts to {LONGEST}" for one in meant if len(one.contents) > LONGEST
    ]
    if sum(one.kind == STATUS for one in meant) > 1:
        found.append("two STATUS in one message: a client that awaits them one by one loses the second")
    elif len(meant) > 1 and any(one.kind == STATUS for one in meant):
        found.append("a STATUS beside something that answers another request: it may be awaited one by one")
    if not found and as_stock_client(submessages) != meant:
        read = ", ".join(map(str, as_stock_client(submessages)))
        found.append(f"sent: {', '.join(map(str, meant))}; a stock client reads: {read or 'nothing'}")
    return found
