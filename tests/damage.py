"""What a reader is fed to see whether it reads or refuses: octets that were once right.

Random octets alone are refused nearly always; a test that only looks at what was read would then look at nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError

_T = TypeVar("_T")


@st.composite
def damaged(draw: st.DrawFn, whole: st.SearchStrategy[bytes]) -> bytes:
    """Something right with up to three octets changed, and now and then a part of its end missing or more behind it."""
    octets = bytearray(draw(whole))
    for place in draw(st.lists(st.integers(0, max(0, len(octets) - 1)), max_size=3 if octets else 0)):
        octets[place] = draw(st.integers(0, 255))
    match draw(st.integers(0, 5)):
        case 0:
            del octets[draw(st.integers(0, len(octets))) :]
        case 1:
            octets += draw(st.binary(max_size=8))
    return bytes(octets)


def read_or_refused(read: Callable[[bytes], _T], octets: bytes) -> _T | None:
    """What was read; None: it was refused, as a fault of the other side, and in words."""
    try:
        return read(octets)
    except RemoteProtocolError as error:
        words = str(error)
    assert words
    return None
