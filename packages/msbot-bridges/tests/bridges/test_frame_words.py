"""Frames of other worlds, as `msbot bus dump` and the page Bus say them."""

from __future__ import annotations

import pytest

from msbot.cli.bus.foreign_frames import foreign_words
from msbot.cli.bus.frame_words import listener_for
from msbot.cli.bus.load import WhoSays
from msbot_agent.link.can.protocol import Frame


@pytest.mark.parametrize(
    ("can_id", "data", "words"),
    [
        (0x000, "0105", "CANopen NMT: start, node 5"),
        (0x000, "8000", "CANopen NMT: enter PRE-OPERATIONAL, all nodes"),
        (0x080, "", "CANopen SYNC"),
        (0x085, "1032050000000000", "CANopen node 5: emergency 0x3210: over-voltage of the DC link (error register: "),
        (0x085, "0000000000000000", "CANopen node 5: error reset"),
        (0x285, "00", "CANopen TPDO 2 of node 5"),
        (0x605, "4018100100000000", "CANopen SDO request to node 5: reads 0x1018:01"),
        (0x585, "4318100177000000", "CANopen SDO answer of node 5: has read 0x1018:01"),
        (0x585, "8000200000000206", "CANopen SDO answer of node 5: abort 0x2000:00 (0x06020000)"),
        (0x705, "7F", "CANopen heartbeat of node 5: PRE-OPERATIONAL"),
        (0x7E5, "5100000000800000", "CANopen LSS request: fastscan"),
        (0x7E4, "4F00000000000000", "CANopen LSS answer: it is me"),
        (0x7E5, "04", "foreign"),
    ],
)
def test_frames_of_canopen(can_id: int, data: str, words: str) -> None:
    told = listener_for(None, legacy=False).explain_frame(Frame(can_id, bytes.fromhex(data)), 0.0)
    assert told.protocol[0].startswith(words)


@pytest.mark.parametrize(
    ("can_id", "data", "words"),
    [
        (0x1001552A, "00000000000000C0", "DroneCAN node 42: NodeStatus"),
        (0x0803F22A, "0102030405060780", "DroneCAN node 42: actuator.ArrayCommand, begins"),
        (0x1E01AAFE, "C0", "DroneCAN node 126 to node 42: request GetNodeInfo"),
        (0x1E017EAA, "0102030405060720", "DroneCAN node 42 to node 126: answer GetNodeInfo, goes on"),
        (0x1E017EAA, "", "foreign"),
    ],
)
def test_frames_of_dronecan(can_id: int, data: str, words: str) -> None:
    frame = Frame(can_id, bytes.fromhex(data), extended=True)
    told = listener_for(None, legacy=False).explain_frame(frame, 0.0)
    assert told.protocol == (words,)


@pytest.mark.parametrize(
    ("can_id", "data", "words"),
    [
        (0x107D552B, "00000000000000E0", "Cyphal node 43: Heartbeat"),
        (0x1068002B, "00000000000000A0", "Cyphal node 43: subject 2048, begins"),
        (0x1068002B, "00000040", "Cyphal node 43: subject 2048, ends"),
        (0x197FE642, "010203040506E0", "Cyphal, a node without id: pnp.NodeIDAllocationData.1"),
        (0x136B95FD, "E0", "Cyphal node 125 to node 43: request GetInfo"),
        (0x126BBEAB, "0102030405060700", "Cyphal node 43 to node 125: answer GetInfo, goes on"),
    ],
)
def test_frames_of_cyphal(can_id: int, data: str, words: str) -> None:
    frame = Frame(can_id, bytes.fromhex(data), extended=True)
    told = listener_for(None, legacy=False).explain_frame(frame, 0.0)
    assert told.protocol == (words,)


def test_mistakes_on_the_bus_are_no_frames_of_another_world() -> None:
    told = listener_for(None, legacy=False).explain_frame(Frame(0x008, b""), 0.0)
    assert "STOP" in told.protocol[0]


def test_the_load_of_a_bus_names_others_where_no_master_of_msbot_is() -> None:
    who = WhoSays(foreign_words())
    report, heartbeat = Frame(0x185, b"\0"), Frame(0x705, b"\x05")
    status = Frame(0x1001552A, bytes.fromhex("00000000000000C0"), extended=True)
    who.hear(report)
    assert who.name(report) == "master to node 5"
    for frame in (heartbeat, status):
        who.hear(frame)
    assert [who.name(one) for one in (report, heartbeat, status)] == [
        "CANopen TPDO 1 of node 5",
        "CANopen heartbeat of node 5",
        "DroneCAN node 42: NodeStatus",
    ]
    who.hear(Frame(0x700, b"\1"))  # BEACON
    assert who.name(report) == "master to node 5"
