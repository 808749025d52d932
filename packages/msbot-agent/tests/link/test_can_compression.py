"""Header compression on the CAN link: the figures of docs/reference/can.md are those of the code."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import pytest

from msbot.part.join.pnp_messages import ProfileMessage
from msbot_agent.link.can.protocol import Frame, frame_bits
from msbot_agent.link.can.protocol.frames import split
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_xrce import compress, decompress
from msbot_xrce.compression import DICTIONARY
from tests import ROOT

PAGE = (ROOT / "docs/reference/can.md").read_text()
SECTION = PAGE.partition("## Header compression\n")[2].partition("\n## ")[0]

# 5 CREATE as in the dictionary; READ_DATA of the profile, one sample; endless READ_DATA of the inventory's answers.
FIRST_MESSAGE = "81800000" + DICTIONARY[:284].hex() + "08010800c016001680000000" + DICTIONARY[304:324].hex()
PROFILE = ProfileMessage(
    index=1,
    message="MSBOT_MASTER",
    name="MSBOT_V1",
    id="X100Y100Z100",
    dof="8-4-2021",
    make="MASSEY_ENGINEERING_DEP",
).encode()
NOISE = Random(4).randbytes(406).hex()


@dataclass(frozen=True)
class Row:
    """One line of the table of costs."""

    name: str
    up: bool
    """From the part to the master."""
    packet: str
    """Hexadecimal."""

    @property
    def octets(self) -> bytes:
        return bytes.fromhex(self.packet)


ROWS = (
    Row("CREATE_CLIENT", True, "8000000000011000585243450100010f3b80883d81007405"),
    Row("STATUS_AGENT: OK", False, "8100000004010b000000585243450100010f00"),
    Row("the first message of a part (5 CREATE, 2 READ_DATA)", True, FIRST_MESSAGE),
    Row("STATUS: OK", False, "8180000005010600000a00110000"),
    Row("ACKNACK, nothing missing", True, "810000000a0105000700000080"),
    Row("ACKNACK, some missing", True, "810000000a0105000700001580"),
    Row("HEARTBEAT, one message", False, "810000000b0105000700070080"),
    Row("HEARTBEAT, several", False, "810000000b01050007000b0080"),
    Row("the profile of the thesis (DATA, reliable, 103 bytes)", False, "8180050009016b00c0160016" + PROFILE.hex()),
    Row("claim (WRITE_DATA, reliable, 40 bytes)", True,
        "8180010007012c00a00100170500000041424344000000000b000000414243442d6c6f63616c00df6af1d8303e61cd002e2c439e"),
    Row("verdict (DATA, reliable, 4 + 12 bytes)", False, "8180060009011400c0170017a0010017a3d8117301000000e8030000"),
    Row("beat (WRITE_DATA, best effort, 4 bytes)", True, "810105000701080080050017a3d81173"),
    Row("answer to a beat (DATA, best effort, 4 + 4 bytes)", False, "8101050009010c00c01700178005001701000000"),
    Row("sample of 4 bytes, best effort, WRITE_DATA", True, "8101090107010800810900150000803f"),
    Row("sample of 4 bytes, best effort, DATA", False, "8101090109010800c02600260000803f"),
    Row("sample of 4 bytes, reliable, WRITE_DATA", True, "8180090107010800a10900150000803f"),
    Row("sample of 4 bytes, reliable, DATA", False, "8180090109010800c02600260000803f"),
    Row("sample of 8 bytes, best effort, WRITE_DATA", True, "8101090107010c00810900151f85eb51b81e0940"),
    Row("sample of 4 bytes, best effort, ids of a stock client", True, "8101090107010800011e00150000803f"),
    Row("READ_DATA, alone", True, "8180070008011000c017001701000001ffff000000000000"),
    Row("DELETE, alone", True, "8180080003010400001b0026"),
    Row("ping (GET_INFO)", True, "8100000002010800000afffd02000000"),
    Row("answer to a ping (INFO)", False,
        "8100000006011c00000afffd0001010d585243450100010f00010d000100000000000000"),
    Row("TIMESTAMP", True, "810000000e010800163e016ba3948a32"),
    Row("TIMESTAMP_REPLY", False, "810000000f011800163e016bee558b32163e016bfa538b32163e016ba3948a32"),
    Row("a message of 418 bytes, noise (DATA, best effort)", False, "81010a0109019a01c0260026" + NOISE),
)  # fmt: skip


def cost(content: bytes, *, up: bool) -> tuple[int, int, int]:
    """Octets, classic frames and bits on the wire of a message of or to node 1."""
    ids = CanIds()
    frames = [Frame((ids.up if up else ids.down) + 1, data) for data in split(content, 0, False)]
    return len(content), len(frames), sum(frame_bits(frame).nominal_bits for frame in frames)


def line(row: Row) -> str:
    before, after = cost(row.octets, up=row.up), cost(compress(row.octets), up=row.up)
    return f"| {row.name} | {' | '.join(map(str, before))} | {' | '.join(map(str, after))} |"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_messages_are_restored(row: Row) -> None:
    assert decompress(compress(row.octets)) == row.octets


def test_the_page_shows_what_a_message_costs() -> None:
    table = (
        SECTION.partition("Cost on classic CAN")[2].partition("|---|---|---|---|---|---|---|\n")[2].partition("\n\n")[0]
    )
    shown = table.splitlines()
    assert len(shown) > 5
    assert [row for row in shown if row not in map(line, ROWS)] == []


if __name__ == "__main__":
    print("\n".join(map(line, ROWS)))
