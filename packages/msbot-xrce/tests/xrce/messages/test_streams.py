"""ACKNACK, HEARTBEAT, RESET, FRAGMENT."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import Acknack, Fragment, Heartbeat, Reset, Submessage, iter_submessages

U16 = st.integers(0, 0xFFFF)
OCTET = st.integers(0, 0xFF)


def one(octets: bytes) -> Submessage:
    (submessage,) = iter_submessages(octets, 0)
    return submessage


@given(U16, U16, OCTET, st.binary(max_size=100), st.booleans())
def test_round_trip(first: int, second: int, stream_id: int, piece: bytes, last: bool) -> None:
    submessages: list[Submessage] = [
        Acknack(first, second, stream_id),
        Heartbeat(first, second, stream_id),
        Fragment(piece, last),
        Reset(),
    ]
    for submessage in submessages:
        assert one(submessage.encode()) == submessage


@pytest.mark.parametrize("octets", ["0a010400 01000000", "0b010400 01000000"])
def test_payload_cut_short_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError):
        one(bytes.fromhex(octets))
