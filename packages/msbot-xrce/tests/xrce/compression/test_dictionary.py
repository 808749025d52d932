"""The dictionary of header compression is part of the wire format."""

from __future__ import annotations

from zlib import crc32

from msbot.part.join import pnp_messages
from msbot_xrce.compression import CHECK, DICTIONARY, FIXED
from msbot_xrce.messages.message import iter_submessages
from tests import ROOT

PAGE = (ROOT / "docs/reference/can.md").read_text()


def test_it_never_changes() -> None:
    assert crc32(DICTIONARY) == CHECK == 0xE99DCCC5
    assert (len(DICTIONARY), len(FIXED)) == (504, 9)
    assert f"CRC-32 `{CHECK:08X}`" in PAGE


def test_it_consists_of_submessages() -> None:
    assert len(list(iter_submessages(DICTIONARY, 0))) == 14
    for body in FIXED:
        assert len(list(iter_submessages(body, 0))) == 1


def test_it_names_what_every_robot_has() -> None:
    names = (
        pnp_messages.PROFILE_TOPIC,
        pnp_messages.PROFILE_TYPE,
        pnp_messages.INVENTORY_SERVICE,
        pnp_messages.INVENTORY_REQUEST_TYPE,
        pnp_messages.INVENTORY_REPLY_TYPE,
        pnp_messages.INVENTORY_REQUEST_TOPIC,
        pnp_messages.INVENTORY_REPLY_TOPIC,
    )
    for name in names:
        assert (len(name) + 1).to_bytes(4, "little") + name.encode() + b"\0" in DICTIONARY
