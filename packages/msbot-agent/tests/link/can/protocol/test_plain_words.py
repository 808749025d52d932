"""Frames in words for people: a table of every kind, and which identifiers are a node's."""

from __future__ import annotations

import pytest

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import (
    NOBODY,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    join_frame,
    question_frame,
    stop_frame,
)
from msbot_agent.link.can.protocol.notation import frame_sentence, node_of

IDS = CanIds()
UID = bytes(range(1, 9))


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (Frame(0x40, bytes(8), error=True), "the bus reports a fault"),
        (stop_frame(1, IDS), "STOP: every part goes to its safe state"),
        (join_frame(UID, 0, IDS), "a part asks for an address"),
        (assign_frame(Assign(NOBODY, 7, 5, 0), IDS), "node 7 must ask for an address again"),
        (assign_frame(Assign(UID, 0, 5, 0), IDS), "the master has no address left for a part"),
        (assign_frame(Assign(UID, 1, 5, 0), IDS), "the master makes a part node 1"),
        (beacon_frame(Beacon(0, 5, 7), IDS), "the master says that it is there"),
        (question_frame(7, IDS), "a master starts and asks whether there is another one"),
        (Frame(0x7FF), "something else that uses this bus"),
    ],
)
def test_what_each_kind_of_frame_is(frame: Frame, words: str) -> None:
    assert str(frame_sentence(frame, IDS)) == words


def test_the_120_identifiers_above_each_base_are_the_nodes() -> None:
    for can_id in range(0x800):
        ways = {can_id - base: base == IDS.up for base in (IDS.up, IDS.down) if 1 <= can_id - base <= 120}
        expected = next(iter(ways.items()), None)
        assert node_of(Frame(can_id), IDS) == expected
        assert node_of(Frame(can_id, extended=True), IDS) is None
        assert node_of(Frame(can_id, remote=True), IDS) is None
        assert node_of(Frame(can_id, error=True), IDS) is None
