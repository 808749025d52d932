"""The picture of a frame in the docs: drawn from the bits, and the same as the one that is committed."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from msbot_agent.link.can.protocol.bits import wire_bits
from msbot_agent.link.can.protocol.notation import parse_frame
from tests import ROOT
from tools.can_picture import heartbeat, picture, rows_of

SVG = "{http://www.w3.org/2000/svg}"


def test_the_committed_picture_is_what_is_drawn() -> None:
    assert (ROOT / "docs/explain/can_frame.svg").read_text() == picture(), "make docs draws it again"


def test_it_shows_every_bit_of_a_heartbeat_and_marks_the_stuff_bits() -> None:
    assert heartbeat() == parse_frame("101#C010E803A3D81173")
    bits = wire_bits(heartbeat())
    shown = [text for text in ET.fromstring(picture()).iter(f"{SVG}text") if "bit" in text.get("class", "").split()]
    assert [int(text.text or "") for text in shown] == [bit.level for bit in bits]
    assert ["stuff-text" in text.get("class", "") for text in shown] == [bit.stuff for bit in bits]


def test_the_rows_have_every_bit_once_and_every_field_its_name() -> None:
    rows = rows_of(wire_bits(heartbeat()))
    assert [bit for row in rows for span in row for bit in span.bits] == wire_bits(heartbeat())
    names = [re.sub(r" .*", "", span.name) for row in rows for span in row]
    assert names == ["SOF", "ID", "RTR", "IDE", "r0", "DLC", *["DATA"] * 4, "CRC", "CRC", "ACK", "ACK", "EOF", "pause"]
