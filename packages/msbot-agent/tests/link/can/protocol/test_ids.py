"""Identifiers and layouts of the joining frames, byte by byte."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import Frame, check_frame
from msbot_agent.link.can.protocol.ids import (
    EPOCHS,
    NOBODY,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    check_uid,
    is_joining,
    join_frame,
    question_frame,
    read_assign,
    read_beacon,
    read_join,
    read_question,
    read_stop,
    stop_frame,
    stop_words,
    uid_hash,
)
from msbot_xrce.errors import ConfigError, LocalProtocolError

IDS = CanIds()
UID = bytes.fromhex("0102030405060708")

any_frame = st.builds(
    Frame,
    st.integers(0, (1 << 29) - 1),
    st.binary(max_size=64),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


def test_join_on_the_wire() -> None:
    frame = join_frame(UID, 3, IDS)
    # CRC-32 of 01..08 is 3fca88c5; its low 22 bits are 0a88c5; caps 3 stand at bits 22 and 23.
    assert frame == Frame(0x1E000000 | 3 << 22 | 0x0A88C5, UID, extended=True)
    assert read_join(frame, IDS) == (UID, 3)


def test_every_epoch_that_a_master_draws_fits_into_an_assign_and_a_beacon() -> None:
    last = EPOCHS - 1
    assert read_assign(assign_frame(Assign(UID, 120, last, 3), IDS), IDS) == Assign(UID, 120, last, 3)
    assert assign_frame(Assign(UID, 120, last, 3), IDS).can_id & ~0xFFFFFF == IDS.assign
    assert read_beacon(beacon_frame(Beacon(0, last, 0), IDS), IDS) == Beacon(0, last, 0)


def test_assign_on_the_wire() -> None:
    frame = assign_frame(Assign(UID, 120, 0x3FFF, 1), IDS)
    assert frame == Frame(0x02000000 + (0x3FFF << 10) + (1 << 8) + 120, UID, extended=True)
    assert read_assign(frame, IDS) == Assign(UID, 120, 0x3FFF, 1)


def test_beacon_on_the_wire() -> None:
    frame = beacon_frame(Beacon(1, 0x1234, 0xAABBCCDD), IDS)
    assert frame == Frame(0x700, bytes.fromhex("01 01 3412 ddccbbaa"))
    assert read_beacon(frame, IDS) == Beacon(1, 0x1234, 0xAABBCCDD)


def test_stop_on_the_wire() -> None:
    assert stop_frame(1, IDS) == Frame(0x008, b"\x01")
    assert read_stop(stop_frame(7, IDS), IDS) == 7
    assert read_stop(Frame(0x008), IDS) == 0
    assert read_stop(Frame(0x009, b"\x01"), IDS) is None
    assert read_stop(Frame(0x008, b"\x01", extended=True), IDS) is None
    assert (stop_words(1), stop_words(99)) == ("STOP was pressed", "reason 99")


@given(
    st.binary(min_size=8, max_size=8).filter(lambda uid: uid != NOBODY),
    st.integers(0, 3),
    st.integers(0, 120),
    st.integers(0, (1 << 14) - 1),
)
def test_layouts_both_ways(uid: bytes, bits: int, node_id: int, epoch: int) -> None:
    join, assign = join_frame(uid, bits, IDS), assign_frame(Assign(uid, node_id, epoch, bits), IDS)
    assert read_join(join, IDS) == (uid, bits)
    assert read_assign(assign, IDS) == Assign(uid, node_id, epoch, bits)
    for frame in (join, assign, beacon_frame(Beacon(bits, epoch, node_id), IDS)):
        check_frame(frame)
        assert is_joining(frame, IDS)


@given(any_frame)
def test_arbitrary_frames_are_read_without_raising(frame: Frame) -> None:
    for result in (read_join(frame, IDS), read_assign(frame, IDS), read_beacon(frame, IDS), read_stop(frame, IDS)):
        assert result is None or not (frame.error or frame.remote or frame.fd)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x1E000000 | uid_hash(UID), UID),
        Frame(0x1E000000 | uid_hash(UID), UID[:7], extended=True),
        Frame(0x1E000000 | uid_hash(UID) ^ 1, UID, extended=True),
        Frame(0x1E000000 | uid_hash(NOBODY), NOBODY, extended=True),
        Frame(0x1D000000 | uid_hash(UID), UID, extended=True),
    ],
)
def test_frames_that_only_look_like_a_join(frame: Frame) -> None:
    assert read_join(frame, IDS) is None


def test_other_versions_and_impossible_addresses_are_not_ours() -> None:
    assert read_beacon(Frame(0x700, bytes.fromhex("02 01 3412 ddccbbaa")), IDS) is None
    assert read_assign(Frame(0x02000000 + 121, UID, extended=True), IDS) is None
    assert not is_joining(Frame(0x1D000000, UID, extended=True), IDS)
    assert not is_joining(Frame(0x701, UID), IDS)


def test_bases_can_be_moved_but_not_onto_each_other() -> None:
    moved = CanIds(stop=1, up=0x400, down=0x500, beacon=0x600, join=0x0B000000, assign=0x0A000000)
    assert read_join(join_frame(UID, 0, moved), moved) == (UID, 0)
    assert read_join(join_frame(UID, 0, IDS), moved) is None
    bases: tuple[dict[str, int], ...] = (
        {"up": 0x130},
        {"beacon": 0x101},
        {"down": 0x7F0},
        {"join": 0x02000000},
        {"assign": 0x1F000000},
        {"assign": 0x02000001},
        {"join": 0x20000000},
        {"assign": -0x01000000},
    )
    for bad in bases:
        with pytest.raises(ConfigError, match="identifier bases"):
            CanIds(**bad)


def test_bases_may_be_as_close_as_their_identifiers_allow() -> None:
    close = CanIds(stop=0, beacon=1, up=1, down=1 + 120, assign=0, join=0x1F000000)
    assert (close.up, close.down) == (1, 121)
    with pytest.raises(ConfigError, match="identifier bases"):
        CanIds(stop=0, beacon=1, up=1, down=120)


@pytest.mark.parametrize(
    ("stop", "is_free"),
    [
        (0x0FF, True),
        (0x100, True),
        (0x101, False),
        (0x178, False),
        (0x179, True),
        (0x6FF, True),
        (0x700, False),
        (0x7FF, True),
        (0x800, False),
        (-1, False),
    ],
)
def test_up_and_down_take_the_120_identifiers_above_their_bases(stop: int, is_free: bool) -> None:
    if is_free:
        assert CanIds(stop=stop).stop == stop
    else:
        with pytest.raises(ConfigError, match="identifier bases"):
            CanIds(stop=stop)


@pytest.mark.parametrize("uid", [b"", b"1234567", b"123456789", NOBODY])
def test_a_uid_has_eight_bytes_not_all_zero(uid: bytes) -> None:
    with pytest.raises(LocalProtocolError):
        check_uid(uid)
    assert check_uid(UID) == UID


@pytest.mark.parametrize("kind", ["remote", "error", "fd"])
def test_a_frame_of_joining_or_stop_is_a_plain_data_frame(kind: str) -> None:
    ids = CanIds()
    for made, read in (
        (join_frame(UID, 1, ids), read_join),
        (assign_frame(Assign(UID, 5, 6, 0), ids), read_assign),
        (beacon_frame(Beacon(5, 6, 7), ids), read_beacon),
        (question_frame(9, ids), read_question),
        (stop_frame(1, ids), read_stop),
    ):
        assert read(made, ids) is not None
        changed = replace(made, remote=kind == "remote", error=kind == "error", fd=kind == "fd")
        assert read(changed, ids) is None
