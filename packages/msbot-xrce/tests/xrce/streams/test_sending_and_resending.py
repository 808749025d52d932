"""The sending half of the streams."""

from __future__ import annotations

import pytest

from msbot_xrce.messages.submessage import Envelope
from msbot_xrce.streams.round_trip import RoundTrip
from msbot_xrce.streams.sending_and_resending import STALE_ACKNACK, ReliableOutput
from msbot_xrce.streams.sending_best_effort import QUEUE_FULL, TOO_LARGE, BestEffortOutput
from msbot_xrce.streams.settings import Memory, SessionCounters
from msbot_xrce.streams.waiting_messages import Outbox


class Rig:
    """One reliable stream, with 4-byte headers and room for 20 bytes of body."""

    def __init__(self, *, window: int = 4, mtu: int = 24, pool: Memory | None = None) -> None:
        self.counters = SessionCounters()
        self.outbox = Outbox(8, self.counters)
        self.round_trip = RoundTrip()
        envelope = Envelope(0x81, 1, mtu, pads=False)
        self.pool = pool or Memory(1000)
        self.stream = ReliableOutput(
            0x80, envelope, self.outbox, self.counters, window=window, round_trip=self.round_trip, pool=self.pool
        )

    def pull(self, now: float = 0.0) -> list[int]:
        """Let the link take everything; the sequence numbers."""
        packets = self.stream.pull_missed(now) + self.outbox.pull()
        self.stream.link_drained(now, 0.2, 0.005)
        return [packet[2] | packet[3] << 8 for packet in packets]

    def send(self, count: int) -> None:
        """Book small messages."""
        for _ in range(count):
            self.stream.send(b"body")


def test_a_pool_that_is_used_up_exactly_is_full() -> None:
    pool = Memory(48)
    hog, other = Rig(pool=pool), Rig(pool=pool)
    assert hog.stream.offer(bytes(20))
    assert hog.stream.has_room()
    assert hog.stream.offer(bytes(20))
    assert pool.used == pool.limit
    assert (hog.stream.has_room(), other.stream.has_room()) == (False, True)


def test_when_the_pool_is_full_each_stream_goes_on_with_one_message_at_a_time() -> None:
    pool = Memory(100)
    hog, other = Rig(pool=pool, window=16), Rig(pool=pool)
    while hog.stream.offer(bytes(20)):
        pass
    assert (hog.stream.unacked, pool.used) == (5, 120)
    assert other.stream.offer(b"1234")
    assert not other.stream.has_room()
    assert not other.stream.offer(b"5678")
    other.pull()
    assert other.stream.acknowledge(1, 0, 0.1)
    assert other.stream.has_room()
    assert other.stream.offer(b"5678")
    assert not other.stream.offer(b"")
    assert hog.stream.acknowledge(2, 0, 0.1)
    assert pool.used == 3 * 24 + 8
    assert other.stream.offer(b"")
    for rig in (hog, other):
        rig.stream.release()
    assert pool.used == 0


def test_a_large_message_counts_as_it_waits_and_is_cut_piece_by_piece_in_a_full_pool() -> None:
    rig = Rig(pool=Memory(60))
    assert rig.stream.offer(bytes(100))
    pieces = 0
    while rig.stream.unacked:
        assert rig.stream.unacked <= 3
        assert rig.pool.used <= 100 + 60 + 24
        numbers = rig.pull()
        pieces += len(numbers)
        rig.stream.acknowledge((numbers[-1] + 1) & 0xFFFF, 0, 0.1)
    assert pieces == 7
    assert rig.pool.used == 0


def test_best_effort_numbers_from_0_and_drops_what_does_not_fit() -> None:
    counters = SessionCounters()
    outbox = Outbox(8, counters)
    stream = BestEffortOutput(1, Envelope(0x81, 1, 24, pads=False), outbox, counters)
    stream.send(b"a")
    stream.send(bytes(21))
    stream.send(bytes(20))
    assert outbox.pull() == [bytes.fromhex("81010000") + b"a", bytes.fromhex("81010100") + bytes(20)]
    assert counters.dropped == {TOO_LARGE: 1}


def test_best_effort_packs_a_turn_into_as_few_messages_as_it_fits() -> None:
    counters = SessionCounters()
    outbox = Outbox(8, counters)
    stream = BestEffortOutput(1, Envelope(0x81, 1, 24, pads=False), outbox, counters)
    stream.flush()
    stream.pack(b"12345")
    stream.pack(b"678")
    stream.pack(bytes(12))
    assert outbox.pull() == [bytes.fromhex("81010000") + b"12345\0\0\x00678"]
    stream.flush()
    assert outbox.pull() == [bytes.fromhex("81010100") + bytes(12)]


def test_best_effort_keeps_the_newest_while_the_link_is_busy() -> None:
    counters = SessionCounters()
    outbox = Outbox(2, counters)
    stream = BestEffortOutput(1, Envelope(0x81, 1, 24, pads=False), outbox, counters)
    for body in (b"a", b"b", b"c"):
        stream.send(body)
    assert [packet[4:] for packet in outbox.pull()] == [b"b", b"c"]
    assert counters.dropped == {QUEUE_FULL: 1}


def test_the_window_limits_what_is_unacknowledged() -> None:
    rig = Rig(window=4)
    rig.send(6)
    assert not rig.stream.has_room()
    assert (rig.stream.unacked, rig.stream.waiting) == (4, 2)
    assert rig.pull() == [0, 1, 2, 3]
    assert rig.stream.acknowledge(1, 0, 0.1)
    assert rig.pull() == [4]
    assert rig.stream.acknowledge(5, 0, 0.2)
    assert rig.pull() == [5]
    assert rig.stream.has_room()


@pytest.mark.parametrize("first", [7, 100, 65535, 40_000])
def test_acknacks_outside_of_what_was_sent_are_ignored(first: int) -> None:
    rig = Rig(window=16)
    rig.send(6)
    rig.pull()
    assert not rig.stream.acknowledge(first, 0xFFFF, 0.1)
    assert rig.stream.unacked == 6
    assert rig.pull() == []
    assert rig.counters.dropped == {STALE_ACKNACK: 1}


def test_an_old_acknack_changes_nothing() -> None:
    rig = Rig(window=16)
    rig.send(6)
    rig.pull()
    rig.stream.acknowledge(4, 0, 0.1)
    assert not rig.stream.acknowledge(2, 0b11, 0.1)
    assert rig.stream.unacked == 2
    assert rig.pull() == []


def test_missing_messages_are_sent_again_byte_for_byte_before_new_ones() -> None:
    rig = Rig()
    rig.stream.send(b"first")
    rig.stream.send(b"other")
    sent = rig.outbox.pull()
    rig.stream.send(b"new")
    rig.stream.acknowledge(0, 0xFFFF, 0.1)
    assert rig.stream.pull_missed(0.1, limit=1) == sent[:1]
    assert rig.stream.pull_missed(0.1) == sent[1:]
    assert rig.outbox.pull() == [bytes.fromhex("81800200") + b"new"]
    assert rig.counters.resent == 2


def test_one_loss_reported_by_many_acknacks_is_sent_again_once() -> None:
    rig = Rig(window=16)
    rig.send(1)
    rig.pull(0.0)
    rig.stream.acknowledge(1, 0, 0.010)
    assert rig.round_trip.smoothed_s == pytest.approx(0.010)
    rig.send(5)
    assert rig.pull(1.0) == [1, 2, 3, 4, 5]
    resent: list[int] = []
    for index in range(4):
        rig.stream.acknowledge(1, 0b1, 1.010 + index * 0.001)
        resent += rig.pull(1.010 + index * 0.001)
    assert resent == [1]
    rig.stream.acknowledge(1, 0b1, 1.031)
    assert rig.pull(1.031) == [1], "two round trips later it counts as lost again"


def test_what_is_lost_again_is_sent_when_a_heartbeat_has_asked() -> None:
    rig = Rig(window=16)
    rig.send(2)
    rig.pull(0.0)
    rig.stream.acknowledge(0, 0b1, 0.001)
    assert rig.pull(0.001) == [0]
    rig.stream.acknowledge(0, 0b1, 0.010)
    assert rig.pull(0.010) == [], "nothing was measured yet, so only a HEARTBEAT may ask again"
    rig.stream.heartbeat(0.2)
    rig.stream.acknowledge(0, 0b1, 0.201)
    rig.stream.acknowledge(0, 0b1, 0.202)
    assert rig.pull(0.202) == [0]


def test_what_still_waits_for_the_link_is_not_sent_twice() -> None:
    rig = Rig()
    rig.send(2)
    rig.stream.acknowledge(0, 0b11, 0.0)
    assert rig.pull() == [0, 1]


def test_what_was_acknowledged_meanwhile_is_not_sent_again() -> None:
    rig = Rig()
    rig.send(2)
    rig.pull()
    rig.stream.acknowledge(0, 0b1, 0.0)
    rig.stream.acknowledge(1, 0, 0.0)
    assert rig.pull() == []
    assert rig.counters.resent == 0


def test_a_heartbeat_is_due_one_period_after_the_link_took_the_last_message() -> None:
    rig = Rig()
    rig.send(2)
    assert rig.stream.heartbeat_at is None
    rig.pull(1.0)
    assert rig.stream.heartbeat_at == 1.2
    heartbeat = rig.stream.heartbeat(1.2)
    assert (heartbeat.first, heartbeat.last, heartbeat.stream_id) == (0, 1, 0x80)
    assert rig.stream.heartbeat_at is None
    rig.stream.link_drained(1.3, 0.2, 0.005)
    assert rig.stream.heartbeat_at == 1.5
    rig.stream.acknowledge(2, 0, 1.35)
    rig.stream.link_drained(1.35, 0.2, 0.005)
    assert rig.stream.heartbeat_at is None


def test_progress_puts_the_heartbeat_off() -> None:
    rig = Rig()
    rig.send(2)
    rig.pull(0.0)
    rig.stream.acknowledge(1, 0, 0.15)
    rig.stream.link_drained(0.15, 0.2, 0.005)
    assert rig.stream.heartbeat_at == pytest.approx(0.35)


def test_on_a_slow_link_the_heartbeat_waits_for_two_round_trips() -> None:
    rig = Rig()
    rig.send(1)
    rig.pull(0.0)
    rig.stream.acknowledge(1, 0, 0.15)
    rig.send(1)
    rig.pull(1.0)
    assert rig.stream.heartbeat_at == pytest.approx(1.3)


def test_a_busy_peer_puts_the_heartbeat_off_by_five_periods_at_most() -> None:
    rig = Rig()
    rig.send(1)
    rig.pull(0.0)
    rig.stream.acknowledge(1, 0, 100.0)
    rig.send(1)
    rig.pull(200.0)
    assert rig.stream.heartbeat_at == 201.0


def test_after_a_loss_the_heartbeat_comes_sooner_and_then_ever_later() -> None:
    rig = Rig(window=16)
    rig.send(1)
    rig.pull(0.0)
    rig.stream.acknowledge(1, 0, 0.001)
    rig.send(3)
    rig.pull(1.0)
    assert rig.stream.heartbeat_at == 1.2
    rig.stream.acknowledge(1, 0b1, 1.001)
    assert rig.pull(1.001) == [1]
    due = []
    for _ in range(9):
        at = rig.stream.heartbeat_at
        assert at is not None
        due.append(at)
        rig.stream.heartbeat(at)
        rig.pull(at)
    waits = [later - sooner for sooner, later in zip([1.001, *due], due, strict=False)]
    assert waits == pytest.approx([0.005, 0.005, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.2])
    rig.stream.acknowledge(2, 0, 3.0)
    rig.pull(3.0)
    assert rig.stream.heartbeat_at is not None
    assert rig.stream.heartbeat_at < 3.2, "the answer shows that the peer is there"


def test_round_trips_are_smoothed_and_not_measured_on_repetitions() -> None:
    rig = Rig(window=16)
    for at, took in ((0.0, 0.08), (1.0, 0.16)):
        rig.send(1)
        rig.pull(at)
        rig.stream.acknowledge(int(at) + 1, 0, at + took)
    assert rig.round_trip.smoothed_s == pytest.approx(0.09)
    rig.send(2)
    rig.pull(2.0)
    rig.stream.acknowledge(2, 0b1, 3.0)
    rig.stream.acknowledge(4, 0, 3.1)
    assert rig.round_trip.smoothed_s == pytest.approx(0.09)


def test_large_submessages_are_cut_as_the_window_moves() -> None:
    rig = Rig(window=2, mtu=24)
    body = bytes(range(50))
    rig.stream.send(body)
    rig.stream.send(b"small")
    assert not rig.stream.has_room()
    packets = rig.outbox.pull()
    assert [packet[:8].hex() for packet in packets] == ["818000000d011000", "818001000d011000"]
    rig.stream.acknowledge(2, 0, 0.0)
    packets += rig.outbox.pull()
    assert [packet[:8].hex() for packet in packets[2:]] == ["818002000d011000", "818003000d030200"]
    assert b"".join(packet[8:] for packet in packets) == body
    assert not rig.stream.has_room(), "the small one still waits"
    rig.stream.acknowledge(4, 0, 0.0)
    assert [packet[4:] for packet in rig.outbox.pull()] == [b"small"]
    assert rig.stream.has_room()


def test_packed_submessages_share_a_message_until_it_is_full() -> None:
    rig = Rig(window=2, mtu=24)
    for body in (b"12345", b"678", bytes(12), bytes(30)):
        rig.stream.pack(body)
    assert rig.outbox.pull() == []
    rig.stream.advance()
    assert [packet[4:] for packet in rig.outbox.pull()] == [b"12345\0\0\x00678", bytes(12)]
    assert rig.stream.waiting == 1


def test_numbers_wrap() -> None:
    rig = Rig(window=16)
    for nr in range(65540):
        rig.stream.send(b"")
        rig.outbox.pull()
        assert rig.stream.acknowledge((nr + 1) & 0xFFFF, 0, 0.0)
    assert rig.stream.unacked == 0
    assert rig.counters.dropped == {}
