"""What a part says of itself once it is active: its versions, if it has any, and where it runs with which MsBOT.

As lines of its log (`log_lines`), of kinds of their own. Imported for that moment.
"""

import struct

from micropython import const

from . import __version__
from .xrce import RELIABLE

_HARDWARE = const(4)
_SOFTWARE = const(5)
_HOME = const(6)
_PIECE = const(12)
_LONGEST = const(180)
_AGAIN = const(100)  # ms


def tell(membership, now):
    """Say it all; what there is no room for is said a little later."""
    part = membership.part
    texts = [(_HOME, "{} {}".format(part.home, __version__))]
    if part.software or part.hardware:
        texts = [(_SOFTWARE, part.software), (_HARDWARE, part.hardware)] + texts
    pieces = []
    for kind, text in texts:
        octets = text.encode()[:_LONGEST] or b" "
        for at in range(0, len(octets), _PIECE):
            last = 0x80 if at + _PIECE >= len(octets) else 0
            pieces.append((at // _PIECE | kind << 4 | last, octets[at : at + _PIECE]))
    _send(membership, pieces, now)


def _send(membership, pieces, now):
    while pieces:
        place, piece = pieces[0]
        if not membership._ask(struct.pack("<IB12s", membership._lease, place, piece), RELIABLE):
            _send_later(membership, pieces, now + _AGAIN)
            return
        pieces.pop(0)


def _send_later(membership, pieces, at):
    membership.part._pending.append((at, lambda: _send(membership, pieces, at)))
