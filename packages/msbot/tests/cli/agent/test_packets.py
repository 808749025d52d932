from __future__ import annotations

from datetime import datetime

from msbot_agent.cli.agent.serving import packet_tap, packet_text
from msbot_agent.link.net import UdpServerLink

AT = datetime(2026, 1, 2, 3, 4, 5, 678_900)
PING = bytes.fromhex("80000000 02010800 000afffd 02000000")


def test_a_packet_is_shown_with_time_address_octets_and_meaning() -> None:
    assert packet_text(AT, "in", "127.0.0.1:40123", PING).splitlines() == [
        "03:04:05.678900 from 127.0.0.1:40123: 16 bytes",
        "    80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00",
        "    no session",
        "    GET_INFO about the agent, request 10",
    ]


def test_a_long_packet_takes_several_lines_and_junk_is_shown_too() -> None:
    lines = packet_text(AT, "out", "CAN node 7", bytes(70)).splitlines()
    assert lines[0] == "03:04:05.678900 to CAN node 7: 70 bytes"
    assert [len(line.split()) for line in lines[1:4]] == [32, 32, 6]
    assert packet_text(AT, "out", "x", b"?").splitlines()[2].startswith("    not a message")


def test_the_tap_says_every_packet() -> None:
    said: list[str] = []
    tap = packet_tap(UdpServerLink("127.0.0.1", 1), said.append)
    tap(0.0, "in", ("127.0.0.1", 5), PING)
    tap(0.0, "out", ("127.0.0.1", 5), PING)
    assert ["from 127.0.0.1:5" in said[0], "to 127.0.0.1:5" in said[1]] == [True, True]
