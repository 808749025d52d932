"""Submessages that are booked in one turn share messages, where the settings say so."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.messages.message import Fragment, iter_submessages
from msbot_xrce.messages.submessage import Envelope, data_submessage, frame
from msbot_xrce.streams.sending_and_resending import SLOT_HEAD
from msbot_xrce.streams.session_output import SessionOutput
from msbot_xrce.streams.settings import SessionCounters, SessionSettings
from msbot_xrce.streams.waiting_messages import PACKED_MAX
from tests.stock.reading import complaints

STATUS, DATA = 5, 9
STREAMS = (0x01, 0x80)


def make_sender(mtu: int = 64, *, packs: bool = True, window: int = 16) -> SessionOutput:
    settings = SessionSettings(packs=packs, window=window)
    return SessionOutput(Envelope(0x81, 1, mtu, pads=False), SessionCounters(), settings)


def body(number: int, octets: int = 6) -> bytes:
    """A submessage (shaped as a STATUS) that carries its number."""
    return frame(STATUS, number.to_bytes(2, "big") + bytes(octets - 2))


def send(sender: SessionOutput, stream_id: int, *bodies: bytes) -> None:
    if stream_id < 0x80:
        for one in bodies:
            sender.send_unacknowledged(one, stream_id)
        return
    stream = sender.reliable(stream_id)
    assert stream is not None
    for one in bodies:
        stream.send(one)


def numbers(packet: bytes) -> list[int]:
    """The numbers of the submessages in a message."""
    found, at = [], 4
    while at < len(packet):
        found.append(int.from_bytes(packet[at + 4 : at + 6], "big"))
        at = (at + 4 + int.from_bytes(packet[at + 2 : at + 4], "little") + 3) & ~3
    return found


@pytest.mark.parametrize("stream_id", STREAMS)
def test_what_waits_together_shares_a_message(stream_id: int) -> None:
    sender = make_sender()
    send(sender, stream_id, body(1), body(2), body(3))
    (packet,) = sender.pull(0.0)
    assert numbers(packet) == [1, 2, 3]
    assert packet[2:4] == b"\0\0"
    send(sender, stream_id, body(4))
    (packet,) = sender.pull(0.0)
    assert numbers(packet) == [4]
    assert packet[2:4] == b"\1\0", "the numbers count messages"


REQUESTER, REPLIER, READER = 0x0017, 0x0018, 0x0016


@pytest.mark.parametrize("stream_id", STREAMS)
def test_for_a_stock_client_a_reply_ends_its_message_and_a_status_is_alone(stream_id: int) -> None:
    settings = SessionSettings(packs=True, peer_is_stock=True)
    sender = SessionOutput(Envelope(0x81, 1, 512, pads=False), SessionCounters(), settings)
    begin = (READER, REPLIER, REQUESTER, REQUESTER, READER, None, READER)
    objects = (*begin, None, None, READER, READER, REQUESTER, READER)
    bodies = [
        body(number) if object_id is None else data_submessage(DATA, number, object_id, b"payload")
        for number, object_id in enumerate(objects)
    ]
    send(sender, stream_id, *bodies[:7])
    send(sender, stream_id, *bodies[7:])
    shared = [[0, 1, 2], [3], [4], [5], [6], [7], [8], [9, 10, 11], [12]]
    packets = sender.pull(0.0)
    assert [numbers(packet) for packet in packets] == shared
    assert [complaints(packet[4:]) for packet in packets] == [[]] * len(shared)


@pytest.mark.parametrize("stream_id", STREAMS)
def test_without_the_setting_each_has_its_own(stream_id: int) -> None:
    sender = make_sender(packs=False)
    send(sender, stream_id, body(1), body(2))
    assert [numbers(packet) for packet in sender.pull(0.0)] == [[1], [2]]


@given(st.lists(st.integers(2, 80), max_size=40), st.sampled_from([24, 64, 100, 512, 4000]))
def test_nothing_is_lost_or_turned_round_and_no_message_is_too_long(sizes: list[int], mtu: int) -> None:
    for stream_id, largest in zip(STREAMS, (mtu, mtu - SLOT_HEAD), strict=True):
        sender = make_sender(mtu, window=100)
        bodies = [body(number, size) for number, size in enumerate(sizes) if 4 + size <= mtu - 4]
        send(sender, stream_id, *bodies)
        packets = sender.pull(0.0)
        assert [n for packet in packets for n in numbers(packet)] == [int.from_bytes(b[4:6], "big") for b in bodies]
        assert all(len(packet) <= mtu for packet in packets)
        assert all(len(p) <= min(largest, PACKED_MAX) for p in packets if len(numbers(p)) > 1)
        for earlier, later in itertools.pairwise(packets):
            room = min(largest, PACKED_MAX) - (len(earlier) + 3 & ~3)
            assert len(later) == 4 or (numbers(later) and len(_first(later)) > room), "it would have fitted"


def _first(packet: bytes) -> bytes:
    """The first submessage of a message."""
    return packet[4 : 8 + int.from_bytes(packet[6:8], "little")]


def test_a_message_that_was_sent_takes_no_more_and_is_resent_as_it_was() -> None:
    sender = make_sender()
    send(sender, 0x80, body(1), body(2))
    first = sender.pull(0.0)
    send(sender, 0x80, body(3))
    second = sender.pull(0.0)
    sender.acknowledged(0x80, 0, 0b1, 0.0)
    assert sender.pull(0.0) == first
    sender.acknowledged(0x80, 1, 0b1, 0.0)
    assert sender.pull(0.0) == second
    sender.acknowledged(0x80, 2, 0, 0.0)
    assert sender.is_delivered


def test_fragments_stand_alone() -> None:
    # C clients look at the first submessage only to see whether a message is a fragment.
    sender = make_sender(mtu=64)
    send(sender, 0x80, body(1), body(2, 100), body(3))
    packets = sender.pull(0.0)
    kinds = [[type(one) for one in iter_submessages(packet, 4)] for packet in packets[1:-1]]
    assert kinds == [[Fragment]] * len(kinds)
    assert numbers(packets[0]) == [1]
    assert numbers(packets[-1]) == [3]


def test_the_octets_of_shared_messages_are_given_back() -> None:
    sender = make_sender()
    send(sender, 0x80, body(1), body(2), body(3))
    assert sender._pool.used == len(sender.pull(0.0)[0])
    sender.acknowledged(0x80, 1, 0, 0.0)
    assert sender._pool.used == 0


def test_nothing_joins_a_message_that_was_acknowledged_before_it_was_sent() -> None:
    sender = make_sender()
    send(sender, 0x80, body(1))
    sender.acknowledged(0x80, 1, 0, 0.0)
    send(sender, 0x80, body(2))
    assert [numbers(packet) for packet in sender.pull(0.0)] == [[1], [2]]
    assert not sender.is_delivered
    sender.acknowledged(0x80, 2, 0, 0.0)
    assert sender.is_delivered
    assert sender._pool.used == 0


@pytest.mark.parametrize(("stream_id", "longest"), [(0x01, 64), (0x80, 64 - SLOT_HEAD)])
@pytest.mark.parametrize(("more", "messages"), [(0, [[1, 2]]), (1, [[1], [2]])])
def test_a_message_is_filled_to_its_last_octet(
    stream_id: int, longest: int, more: int, messages: list[list[int]]
) -> None:
    sender = make_sender(64)
    send(sender, stream_id, body(1, 8), body(2, longest - 16 - 4 + more))
    assert [numbers(packet) for packet in sender.pull(0.0)] == messages


def test_a_session_that_ends_gives_its_octets_back() -> None:
    sender = make_sender()
    send(sender, 0x80, body(1), body(2))
    send(sender, 0x81, body(3))
    assert sender._pool.used > 0
    sender.release()
    assert sender._pool.used == 0
