"""The framing of the thesis' firmware: its exact frames, and a receiver that delivers nothing wrong."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import EMPTY_FRAME, FRAME_LOST, REPEATED, TOO_SLOW
from msbot_agent.link.can.protocol.legacy_frames import MTU, NOT_WHOLE, SHORT_FRAME, LegacyJoiner, split_legacy
from msbot_xrce import is_whole
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages import Acknack, CreateClient, Header, Heartbeat, StatusReply, WriteData, encode_message

FRAME_S = 0.0003


def write(payload: bytes, sequence_nr: int = 0) -> bytes:
    return encode_message(Header(0x81, 0x80, sequence_nr), [WriteData(10, 0x0015, payload)], pad_end=False)


LOGIN = encode_message(Header(0x80, 0, 0), [CreateClient(0xBA5EBA11, 0x81, 0x05EC)], pad_end=False)
HEARTBEAT = encode_message(Header(0x81, 0, 0), [Heartbeat(0, 3, 0x80)], pad_end=False)


class Receiver:
    """A joiner with its clock."""

    def __init__(self) -> None:
        self.dropped = Tally()
        self.joiner = LegacyJoiner(is_whole, dropped=self.dropped, repeat_s=FRAME_S * 1.5)
        self.now = 0.0

    def hear(self, *frames: bytes, pause_s: float = FRAME_S) -> list[bytes]:
        packets = []
        for frame in frames:
            self.now += pause_s
            packets.append(self.joiner.receive(frame, self.now))
        return [packet for packet in packets if packet is not None]


@pytest.mark.parametrize(
    ("size", "indexes", "last_dlc"),
    [
        (24, [3, 2, 1, 0], 4),
        (13, [1, 0], 7),
        (19, [2, 1, 0], 6),
        (88, list(range(12, -1, -1)), 5),
        (96, list(range(13, -1, -1)), 6),
        (176, list(range(25, -1, -1)), 2),
        (418, list(range(59, -1, -1)), 6),
        (1, [0], 2),
        (7, [0], 8),
        (8, [1, 0], 2),
        (1792, list(range(255, -1, -1)), 8),
    ],
)
def test_frames_are_those_of_the_original(size: int, indexes: list[int], last_dlc: int) -> None:
    """Thesis 4.2.5 and its code: index counting down, DLC 8 but for the last frame, no padding."""
    packet = bytes(number % 251 for number in range(size))
    frames = split_legacy(packet)
    assert [frame[0] for frame in frames] == indexes
    assert [len(frame) for frame in frames] == [8] * (len(frames) - 1) + [last_dlc]
    assert b"".join(frame[1:] for frame in frames) == packet


def test_the_login_of_the_thesis_octet_by_octet() -> None:
    assert [frame.hex(" ") for frame in split_legacy(LOGIN)] == [
        "03 80 00 00 00 00 01 10",
        "02 00 58 52 43 45 01 00",
        "01 01 0f ba 5e ba 11 81",
        "00 00 ec 05",
    ]


def test_1792_bytes_are_the_limit_and_1793_are_refused() -> None:
    packet = write(bytes(MTU - 12))
    assert Receiver().hear(*split_legacy(packet)) == [packet]
    with pytest.raises(LocalProtocolError, match=r"1793 bytes: the CAN framing of the thesis takes at most 1792"):
        split_legacy(bytes(MTU + 1))
    with pytest.raises(LocalProtocolError, match="empty"):
        split_legacy(b"")


@given(st.lists(st.binary(max_size=MTU - 12).map(write), max_size=5))
def test_every_message_comes_back(packets: list[bytes]) -> None:
    receiver = Receiver()
    assert [heard for packet in packets for heard in receiver.hear(*split_legacy(packet))] == packets
    assert receiver.dropped == {}


def test_the_pauses_of_the_original_do_no_harm() -> None:
    assert Receiver().hear(*split_legacy(LOGIN), pause_s=0.5) == [LOGIN]


@pytest.mark.parametrize("missing", range(4))
def test_each_lost_frame_costs_the_message_and_nothing_else_is_delivered(missing: int) -> None:
    """The original delivers 17 of 24 bytes, or glues the next message on."""
    frames = split_legacy(LOGIN)
    receiver = Receiver()
    assert receiver.hear(*frames[:missing], *frames[missing + 1 :]) == []
    assert receiver.hear(*split_legacy(HEARTBEAT)) == ([] if missing == 3 else [HEARTBEAT])
    assert receiver.hear(*split_legacy(LOGIN)) == [LOGIN]
    assert receiver.dropped == {NOT_WHOLE if missing == 0 else FRAME_LOST: 1}


def test_a_message_begun_anew_after_a_pause_is_heard() -> None:
    receiver = Receiver()
    frames = split_legacy(LOGIN)
    receiver.hear(*frames[:2])
    receiver.now += 3.0
    assert receiver.hear(*frames) == [LOGIN]
    assert receiver.dropped == {TOO_SLOW: 1}


def test_a_pause_ends_the_waiting_for_the_rest_of_a_dropped_message() -> None:
    receiver = Receiver()
    frames = split_legacy(LOGIN)
    receiver.hear(frames[0], frames[2])
    receiver.now += 3.0
    assert receiver.hear(*frames) == [LOGIN]
    assert receiver.dropped == {FRAME_LOST: 1}


def test_frames_that_nobody_sends_are_counted() -> None:
    receiver = Receiver()
    assert receiver.hear(b"", b"\x01\x81", b"\x00\x81\x00") == []
    assert receiver.dropped == {EMPTY_FRAME: 1, SHORT_FRAME: 1}
    assert receiver.hear(b"\x00raw") == []
    assert receiver.dropped[NOT_WHOLE] == 1
    assert receiver.hear(*split_legacy(LOGIN)) == [LOGIN]


def test_a_frame_repeated_by_the_bus_is_taken_once() -> None:
    receiver = Receiver()
    assert receiver.hear(*(frame for frame in split_legacy(LOGIN) for _ in (1, 2))) == [LOGIN]
    assert receiver.dropped == {REPEATED: 4}


MESSAGES = st.one_of(
    st.builds(write, st.binary(max_size=60), st.integers(0, 0xFFFF)),
    st.just(LOGIN),
    st.just(HEARTBEAT),
    st.just(encode_message(Header(0x81, 0, 0), [Acknack(4, 0, 0x80)], pad_end=False)),
    st.just(encode_message(Header(0x81, 0x80, 9), [StatusReply(10, 0x0011, 0)], pad_end=False)),
)


@given(packets=st.lists(MESSAGES, min_size=1, max_size=12), data=st.data())
def test_no_single_loss_or_repetition_ever_gives_a_wrong_message(packets: list[bytes], data: st.DataObject) -> None:
    """Any frames may be lost, but no two in a row; any may come twice. What is delivered was sent, in its order.

    And a message is delivered if nothing of it and of the one before it was lost.
    """
    frames = [(number, frame) for number, packet in enumerate(packets) for frame in split_legacy(packet)]
    lost = set(data.draw(st.sets(st.integers(0, len(frames) - 1))))
    lost -= {later for first, later in pairwise(sorted(lost)) if later == first + 1}
    doubled = data.draw(st.sets(st.integers(0, len(frames) - 1)))
    receiver = Receiver()
    delivered = []
    for place, (number, frame) in enumerate(frames):
        times = 0 if place in lost else 1 + (place in doubled)
        delivered += [(number, packet) for packet in receiver.hear(*[frame] * times)]
    for number, packet in delivered:
        assert packet == packets[number]
    assert len({number for number, _ in delivered}) == len(delivered)
    hurt = {frames[place][0] for place in lost}
    unharmed = {number for number in range(len(packets)) if number not in hurt and number - 1 not in hurt}
    assert unharmed <= {number for number, _ in delivered}


@given(st.lists(st.binary(max_size=8), max_size=40))
def test_arbitrary_frames_never_raise_and_give_whole_messages_only(frames: list[bytes]) -> None:
    assert all(is_whole(packet) for packet in Receiver().hear(*frames))


def test_the_weakness_of_the_format_is_the_one_that_is_documented() -> None:
    """As many frames lost in a row as the next message has: nothing on the wire tells. The native mode does."""
    one, other = write(b"1" * 20, 1), write(b"2" * 20, 2)
    heard = Receiver().hear(*split_legacy(one)[:2], *split_legacy(other)[2:])
    assert len(heard) == 1
    assert heard[0] not in (one, other)


def test_moments_that_are_just_early_enough_and_just_too_late() -> None:
    """Times that are sums of powers of two."""
    for pause_s, dropped in ((1.0, {REPEATED: 1}), (1.25, {FRAME_LOST: 1}), (1.5, {FRAME_LOST: 1})):
        tally = Tally()
        joiner = LegacyJoiner(is_whole, dropped=tally, repeat_s=1.25)
        first = split_legacy(bytes(20))[0]
        joiner.receive(first, 0.0)
        joiner.receive(first, pause_s)
        assert tally == dropped, pause_s
    for pause_s, is_late in ((2.0, False), (2.25, True)):
        tally = Tally()
        joiner = LegacyJoiner(is_whole, dropped=tally)
        first, last = split_legacy(LOGIN)[-2:]
        assert joiner.receive(first, 0.0) is None
        joiner.receive(last, pause_s)
        assert (TOO_SLOW in tally) == is_late


def test_the_rest_of_a_message_that_lost_a_frame_is_skipped_to_its_end_and_counted_once() -> None:
    receiver = Receiver()
    frames = split_legacy(write(bytes(40)))
    assert receiver.hear(*frames[:1], *frames[2:]) == []
    assert receiver.dropped == {FRAME_LOST: 1}
    assert receiver.hear(*split_legacy(LOGIN)) == [LOGIN]
