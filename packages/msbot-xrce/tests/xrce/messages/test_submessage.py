"""The 4 octets in front of a payload."""

from __future__ import annotations

import pytest

from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages import Fragment
from msbot_xrce.messages.submessage import frame


def test_length_is_little_endian() -> None:
    assert frame(0x0D, bytes(0x0102), 0x03)[:4] == bytes.fromhex("0d030201")


def test_payload_of_64_kib_does_not_fit() -> None:
    assert len(Fragment(bytes(0xFFFF)).encode()) == 0xFFFF + 4
    with pytest.raises(LocalProtocolError, match="FRAGMENT of 65536 bytes"):
        Fragment(bytes(0x10000)).encode()
