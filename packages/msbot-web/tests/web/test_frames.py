"""The frames behind the bus page: exact counters, the newest rows, and what each says."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.ids import NODES, Beacon, CanIds, beacon_frame, stop_frame
from msbot_web.frame_ring import KEPT, FrameRing

IDS = CanIds()
BEACON = beacon_frame(Beacon(0, 5, 0xC0FFEE), IDS)
RATE = 2_000


def filled(count: int) -> FrameRing:
    ring = FrameRing()
    for number in range(count):
        ring.tap(number / RATE, "bus", Frame(0x400 + number % 16, bytes((number % 256,))))
    return ring


def test_ten_seconds_of_2000_frames_a_second_are_counted_exactly_and_the_newest_are_kept() -> None:
    ring = filled(10 * RATE)
    assert ring.total == 10 * RATE
    rows = ring.rows(limit=KEPT + 1000)
    assert [row.number for row in rows] == list(range(ring.total - KEPT + 1, ring.total + 1))
    assert rows[-1].at == (ring.total - 1) / RATE


def test_a_page_that_looks_twice_a_second_misses_no_frame_of_2000_a_second() -> None:
    ring, seen, newest = FrameRing(), [], 0
    for number in range(5 * RATE):
        ring.tap(number / RATE, "bus", BEACON)
        if number % (RATE // 2) == RATE // 2 - 1:
            rows = ring.rows(after=newest, limit=KEPT)
            newest = rows[-1].number
            seen += [row.number for row in rows]
    assert seen == list(range(1, 5 * RATE + 1))


def test_rows_after_a_number_are_the_newest_oldest_first() -> None:
    ring = filled(10)
    assert [row.number for row in ring.rows(after=4)] == [5, 6, 7, 8, 9, 10]
    assert [row.number for row in ring.rows(after=4, limit=2)] == [9, 10]
    assert ring.rows(after=10) == ring.rows(after=99) == ring.rows(limit=0) == []
    assert FrameRing().rows() == []


def test_a_row_is_found_by_its_number_until_it_leaves() -> None:
    ring = filled(KEPT + 5)
    assert ring.row(5) is None
    assert ring.row(0) is None
    first, last = ring.row(6), ring.row(KEPT + 5)
    assert first is not None
    assert last is not None
    assert (first.number, last.number) == (6, KEPT + 5)
    assert ring.row(KEPT + 6) is None


def test_a_row_says_who_sent_what() -> None:
    ring = FrameRing()
    ring.tap(1.5, "master", BEACON)
    ring.tap(1.6, "BB", Frame(IDS.up + 3, b"\x80\x01"))
    ring.tap(1.7, "master", Frame(IDS.down + 3, b"\x80\x01"))
    ring.tap(1.8, "stranger", stop_frame(1, IDS))
    beacon, up, down, stop = ring.rows()
    assert (beacon.at, beacon.sender, beacon.node, beacon.words[0]) == (
        1.5,
        "master",
        0,
        "BEACON: robot 00c0ffee, epoch 5",
    )
    assert (up.node, down.node, stop.node) == (3, 3, 0)
    assert stop.words == ("STOP: STOP was pressed",)


def test_other_identifiers_are_nobodys_node() -> None:
    ring = FrameRing(CanIds(up=0x200, down=0x280))
    for frame in (Frame(0x103), Frame(0x200), Frame(0x200 + NODES + 1), Frame(0x203, extended=True), Frame(0x203)):
        ring.tap(0.0, "x", frame)
    assert [row.node for row in ring.rows()] == [0, 0, 0, 0, 3]


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=60), st.integers(1, 70))
def test_any_frames_in_any_order_of_looking_are_numbered_without_gaps(
    frames: list[tuple[int, bytes]], look_after: int
) -> None:
    ring = FrameRing()
    for number, (can_id, data) in enumerate(frames, 1):
        ring.tap(number / 1000, "x", Frame(can_id, data))
        if number % look_after == 0:
            found = ring.row(number)
            assert found is not None
            assert found.number == number
    assert [row.number for row in ring.rows(limit=100)] == list(range(1, len(frames) + 1))
    assert all(row.words for row in ring.rows(limit=100))
