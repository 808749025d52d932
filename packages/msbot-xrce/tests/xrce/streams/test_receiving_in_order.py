"""The receiving half of the streams; sequence numbers as in the recorded answers of a genuine agent and client."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_xrce.streams.receiving_in_order import (
    BEYOND_WINDOW,
    LONGEST_MOVE,
    MOVES_KEPT,
    NO_MEMORY,
    BestEffortInput,
    ReliableInput,
)
from msbot_xrce.streams.settings import Memory, SessionCounters
from tests.effort import tries


def make_reliable(window: int = 16, memory: int = 10_000) -> tuple[ReliableInput, SessionCounters]:
    counters = SessionCounters()
    return ReliableInput(window, Memory(memory), counters), counters


def take(stream: ReliableInput, sequence_nr: int) -> list[int]:
    """Let a message arrive whose packet is its number; the numbers that are handled because of it."""
    handled = [sequence_nr] if stream.accept(sequence_nr, sequence_nr.to_bytes(2, "big")) else []
    if handled:
        while (packet := stream.next_held()) is not None:
            handled.append(int.from_bytes(packet, "big"))
    return handled


def start_at(stream: ReliableInput, sequence_nr: int) -> None:
    """Let HEARTBEATs lead a fresh stream to where that number is the next."""
    for first in (sequence_nr // 3, sequence_nr // 3 * 2, sequence_nr):
        stream.announce(first, (first - 1) & 0xFFFF)
    assert stream.missing() == (sequence_nr, 0)


def test_best_effort_takes_newer_messages_only() -> None:
    stream = BestEffortInput()
    assert [nr for nr in (0, 0, 5, 3, 6) if stream.accept(nr)] == [0, 5, 6]


@pytest.mark.parametrize(("first", "accepted"), [(0x7FFE, True), (0x7FFF, False), (0xFFFF, False), (0, True)])
def test_best_effort_takes_a_first_number_up_to_0x7ffe(first: int, accepted: bool) -> None:
    assert BestEffortInput().accept(first) is accepted


def test_reliable_hands_on_in_order_and_reports_the_gap() -> None:
    stream, counters = make_reliable()
    assert stream.missing() == (0, 0)
    assert take(stream, 1) == []
    assert stream.missing() == (0, 0b1)
    assert take(stream, 0) == [0, 1]
    assert stream.missing() == (2, 0)
    assert take(stream, 0) == []
    assert stream.missing() == (2, 0)
    assert (counters.early, counters.repeated) == (1, 1)


def test_reliable_holds_up_to_a_window_ahead() -> None:
    stream, counters = make_reliable()
    take(stream, 0)
    take(stream, 1)
    assert take(stream, 17) == []
    assert stream.missing() == (2, 0x7FFF)
    assert take(stream, 18) == []
    assert stream.missing() == (2, 0x7FFF)
    assert counters.dropped == {BEYOND_WINDOW: 1}
    take(stream, 17)
    assert counters.repeated == 1


def test_a_message_just_beyond_the_window_is_remembered_as_missing() -> None:
    stream, _ = make_reliable(window=4)
    take(stream, 0)
    take(stream, 1)
    take(stream, 6)
    assert stream.missing() == (2, 0x1F)
    assert stream.announce(2, 5) == []
    assert stream.missing() == (2, 0x1F)


def test_a_number_far_beyond_the_window_is_not_believed() -> None:
    stream, counters = make_reliable(window=4)
    take(stream, 9)
    assert stream.missing() == (0, 0)
    assert counters.dropped == {BEYOND_WINDOW: 1}


def test_heartbeat_announces_what_was_sent() -> None:
    stream, _ = make_reliable()
    assert stream.announce(0, 3) == []
    assert stream.missing() == (0, 0b1111)
    take(stream, 0)
    take(stream, 1)
    assert stream.missing() == (2, 0b11)
    assert stream.announce(2, 5) == []
    assert stream.missing() == (2, 0b1111)


def test_heartbeat_gives_up_what_the_sender_does_not_keep() -> None:
    stream, _ = make_reliable()
    take(stream, 0)
    take(stream, 1)
    assert stream.announce(4, 5) == [None, None]
    assert stream.missing() == (4, 0b11)
    assert take(stream, 4) == [4]


def test_early_messages_below_the_gap_that_is_given_up_are_handed_on() -> None:
    stream, _ = make_reliable()
    take(stream, 3)
    take(stream, 5)
    assert stream.announce(5, 4) == [None, None, None, b"\0\3", None]
    assert stream.next_held() == b"\0\5"
    assert stream.missing() == (6, 0)


def test_a_long_gap_is_given_up_at_once() -> None:
    stream, _ = make_reliable(window=4)
    take(stream, 2)
    assert stream.announce(30_000, 30_001) == [None, None, b"\0\2", None, None]
    assert stream.missing() == (30_000, 0b11)


@pytest.mark.parametrize(("first", "last"), [(0, 1), (65530, 65535), (2, 1), (0x8001, 1)])
def test_heartbeats_of_the_past_change_nothing(first: int, last: int) -> None:
    stream, _ = make_reliable()
    take(stream, 0)
    take(stream, 1)
    assert stream.announce(first, last) == []
    assert stream.missing() == (2, 0)


def test_numbers_wrap() -> None:
    stream, _ = make_reliable()
    start_at(stream, 65534)
    assert take(stream, 0) == []
    assert stream.missing() == (65534, 0b11)
    assert take(stream, 65534) == [65534]
    assert take(stream, 65535) == [65535, 0]
    assert stream.missing() == (1, 0)


def test_early_messages_are_held_only_as_far_as_the_memory_goes() -> None:
    stream, counters = make_reliable(memory=4)
    for nr in (1, 2, 3):
        take(stream, nr)
    assert counters.dropped == {NO_MEMORY: 1}
    assert stream.missing() == (0, 0b1001)
    assert take(stream, 0) == [0, 1, 2]
    assert take(stream, 3) == [3]


def test_reset_forgets_everything_and_gives_the_memory_back() -> None:
    counters, memory = SessionCounters(), Memory(100)
    stream = ReliableInput(16, memory, counters)
    take(stream, 0)
    take(stream, 2)
    stream.joiner.add(b"piece", last=False)
    assert memory.used == 7
    stream.reset()
    assert memory.used == 0
    assert stream.missing() == (0, 0)
    assert take(stream, 0) == [0]
    assert stream.joiner.add(b"whole", last=True) == b"whole"


@settings(deadline=None, max_examples=tries(60, 2000))
@given(st.data(), st.integers(0, 0xFFFF))
def test_any_order_with_repetitions_is_handed_on_exactly_once_in_order(data: st.DataObject, start: int) -> None:
    stream, _ = make_reliable()
    start_at(stream, start)
    wanted = [(start + index) & 0xFFFF for index in range(20)]
    handled: list[int] = []
    while len(handled) < len(wanted):
        for nr in data.draw(st.permutations(wanted)):
            handled += take(stream, nr)
        assert handled == wanted[: len(handled)]
    assert stream.missing() == ((start + 20) & 0xFFFF, 0)


ARRIVALS = st.lists(
    st.tuples(st.sampled_from(["message", "message", "message", "heartbeat", "give up"]), st.integers(-3, 40)),
    max_size=60,
)


@settings(deadline=None, max_examples=tries(60, 2000))
@given(ARRIVALS, st.integers(0, 0xFFFF), st.sets(st.integers(1, 16)))
def test_what_is_missing_is_what_has_not_come(
    arrivals: list[tuple[str, int]], start: int, unripe_places: set[int]
) -> None:
    stream, _ = make_reliable()
    start_at(stream, start)
    for kind, ahead in arrivals:
        number = (stream.last_handled + ahead) & 0xFFFF
        if kind == "message":
            take(stream, number)
        elif kind == "heartbeat":
            stream.announce(number, (number + 5) & 0xFFFF)
        elif stream.announced != stream.last_handled:
            stream.give_up()
        while stream.next_held() is not None:
            pass
        following = [(stream.last_handled + place) & 0xFFFF for place in range(1, 17)]
        known = following[: (stream.announced - stream.last_handled) & 0xFFFF]
        stream.unripe = frozenset(following[place - 1] for place in unripe_places)
        first, bitmap = stream.missing()
        assert first == following[0]
        assert [number for place, number in enumerate(following) if bitmap >> place & 1] == [
            number for number in known if not stream.holds(number) and number not in stream.unripe
        ]


@settings(deadline=None, max_examples=tries(60, 2000))
@given(
    st.lists(st.tuples(st.one_of(st.integers(0, LONGEST_MOVE), st.integers(0, 20_000)), st.booleans()), max_size=80),
    st.integers(-8_000, 8_000),
)
def test_the_reports_on_a_message_end_with_its_acknowledgement(told: list[tuple[int, bool]], apart: int) -> None:
    stream, _ = make_reliable()
    reports, first = 0, 0
    moves: list[tuple[int, int]] = []
    for step, asks in told:
        first += step  # counts on beyond 16 bits
        if step > LONGEST_MOVE:
            moves.clear()
        if step:
            moves.append((first, reports))
        stream.acknack_sent(first & 0xFFFF, 1 if asks else 0, 0.0)
        reports += asks
        for asked in (first + apart, first + apart % 80 - 40):
            after = [count for move, count in moves[-MOVES_KEPT:] if move > asked]
            assert stream.reports_on(asked & 0xFFFF) == (after[0] if after else reports)
