"""The queue of messages that wait for the link."""

from __future__ import annotations

from msbot_xrce.streams.settings import SessionCounters
from msbot_xrce.streams.waiting_messages import Outbox, StreamQueue


def test_messages_leave_in_the_order_in_which_they_were_booked() -> None:
    outbox = Outbox(8, SessionCounters())
    lane = StreamQueue("full")
    outbox.put(b"1")
    outbox.put_newest(b"2", lane)
    outbox.put(b"3")
    assert len(outbox) == 3
    assert outbox.pull(limit=2) == [b"1", b"2"]
    assert outbox.pull() == [b"3"]
    assert outbox.pull() == []
    assert outbox.pull(limit=0) == []


def test_a_full_lane_drops_its_oldest_and_leaves_the_others_alone() -> None:
    counters = SessionCounters()
    outbox = Outbox(2, counters)
    full, other = StreamQueue("full"), StreamQueue("other")
    outbox.put_newest(b"a", full)
    outbox.put_newest(b"x", other)
    outbox.put_newest(b"b", full)
    outbox.put(b"reliable")
    outbox.put_newest(b"c", full)
    assert counters.dropped == {"full": 1}
    assert outbox.pull() == [b"b", b"x", b"c", b"reliable"]


def test_only_waiting_messages_are_held() -> None:
    outbox = Outbox(2, SessionCounters())
    packet = b"packet" * 2
    outbox.put(packet)
    assert outbox.holds(packet)
    outbox.pull()
    assert not outbox.holds(packet)


def test_clear_forgets_lanes_too() -> None:
    outbox = Outbox(2, SessionCounters())
    lane = StreamQueue("full")
    outbox.put_newest(b"a", lane)
    outbox.put(b"b")
    outbox.clear()
    outbox.put_newest(b"c", lane)
    assert outbox.pull() == [b"c"]
