"""What a part says of itself once it is active: its versions, if it has any, and where it runs with which MsBOT.

As lines of its log (`log_lines`), of kinds of their own. Imported for that moment.
"""

import struct

from micropython import const

from . import __version__
from .cdr import put_text
from .running import once
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
    if part.nature:
        membership._ask(struct.pack("<IB", membership._lease, part.nature), RELIABLE)
    said = [part.__dict__.get(name, default(name)) for name in ("software", "hardware", "home")]
    texts = [(_SOFTWARE, said[0]), (_HARDWARE, said[1])] if said[0] or said[1] else []
    texts.append((_HOME, "{} {}".format(said[2], __version__)))
    pieces = []
    for kind, text in texts:
        octets = text.encode()[:_LONGEST] or b" "
        for at in range(0, len(octets), _PIECE):
            last = 0x80 if at + _PIECE >= len(octets) else 0
            pieces.append((at // _PIECE | kind << 4 | last, octets[at : at + _PIECE]))
    _send(membership, pieces, now)


def default(name):
    """What a part says that has not been told."""
    return "MPy" if name == "home" else ""


def describe(membership):
    """The robot asks what the part is: it has not been let in, or a person adopts it anew."""
    if membership.description and membership.state.value in ("claiming", "refused", "configuring", "active"):
        if not membership._lease:
            once("words").tell_described()
        said = bytearray()
        put_text(said, membership.description)
        membership._ask(bytes(said), RELIABLE)


def _send(membership, pieces, now):
    while pieces:
        place, piece = pieces[0]
        if not membership._ask(struct.pack("<IB12s", membership._lease, place, piece), RELIABLE):
            _send_later(membership, pieces, now + _AGAIN)
            return
        pieces.pop(0)


def _send_later(membership, pieces, at):
    membership.part._pending.append((at, lambda: _send(membership, pieces, at)))
