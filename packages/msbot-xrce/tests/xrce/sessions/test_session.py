"""Both ends of a session back to back: loss, repetition, overtaking, slow links, wrap-around, and any bytes at all."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_xrce import AgentSession, ClientSession, ClientSessionSettings, ClientState
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import DeliveryControl, ObjectVariant
from msbot_xrce.sessions import (
    DataReceived,
    DataWritten,
    Pong,
    ReadRequested,
    SessionClosed,
    StatusReceived,
    TimeSynchronised,
    WindowOpened,
)
from msbot_xrce.streams.sequence_numbers import StreamState
from tests.effort import tries
from tests.xrce.pair import CLOCK_AHEAD_NS, Pair

PARTICIPANT = ObjectVariant(1, 3, blob=b"\0\0", domain_id=0)
WRITER, READER = 0x15, 0x16


def written(pair: Pair) -> list[bytes]:
    return [event.payload for event in pair.agent_events if isinstance(event, DataWritten)]


def received(pair: Pair) -> list[bytes]:
    return [event.payload for event in pair.client_events if isinstance(event, DataReceived)]


def exchange(pair: Pair, samples: list[bytes], *, step_s: float = 0.002) -> None:
    """Send the samples both ways on reliable streams, as fast as the windows allow."""
    to_agent, to_client = iter(samples), iter(samples)
    pending = [next(to_agent, None), next(to_client, None)]
    while pending[0] is not None or pending[1] is not None:
        while pending[0] is not None and pair.client.has_room(0x80):
            pair.client.write(WRITER, pending[0], 0x80)
            pending[0] = next(to_agent, None)
        while pending[1] is not None and pair.agent.send_data(0x1D, READER, pending[1], 0x80):
            pending[1] = next(to_client, None)
        pair.run(step_s)
        assert pair.now < 120.0, "a stream is stuck"


def test_a_whole_session_without_loss() -> None:
    pair = Pair()
    pair.client.create(0x11, PARTICIPANT)
    read = pair.client.read(READER, 0x80, DeliveryControl())
    pair.client.ping(pair.now)
    pair.client.sync_time()
    pair.settle()
    kinds = {type(event) for event in pair.take_client_events()}
    assert {StatusReceived, Pong, TimeSynchronised} <= kinds
    assert any(isinstance(event, ReadRequested) and event.request_id == read for event in pair.agent_events)
    exchange(pair, [b"one", bytes(2000), b"three"])
    pair.client.delete(0x11)
    pair.client.close(pair.now)
    pair.settle()
    assert written(pair) == received(pair) == [b"one", bytes(2000), b"three"]
    assert pair.client_events[-1] == SessionClosed()
    assert pair.client.state is ClientState.CLOSED
    assert pair.client.dropped == pair.agent.dropped == {}
    assert pair.client.counters.heartbeats_out == pair.agent.counters.heartbeats_out == 0


def test_the_clocks_are_compared_over_the_network() -> None:
    pair = Pair()
    pair.client.sync_time()
    pair.settle()
    (event,) = [event for event in pair.client_events if isinstance(event, TimeSynchronised)]
    assert event.offset_ns == pytest.approx(-CLOCK_AHEAD_NS, abs=1000)
    assert event.round_trip_ns == pytest.approx(2_000_000, abs=1000)


@pytest.mark.parametrize("session_id", [0x81, 0x01])
@pytest.mark.parametrize(
    ("loss", "duplicate", "reorder"),
    [(0.01, 0.0, 0.0), (0.05, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.3), (0.2, 0.2, 0.2)],
)
def test_every_reliable_sample_arrives_exactly_once_and_in_order(
    loss: float, duplicate: float, reorder: float, session_id: int
) -> None:
    pair = Pair(seed=7, session_id=session_id)
    pair.loss, pair.duplicate, pair.reorder = loss, duplicate, reorder
    samples = [struct.pack(">I", number) * (1 + number % 7 * 40) for number in range(150)]
    exchange(pair, samples)
    pair.heal()
    pair.settle()
    assert written(pair) == samples
    assert received(pair) == samples


def test_a_client_with_a_history_of_4_is_served_by_a_window_of_16() -> None:
    pair = Pair(seed=1, client_settings=ClientSessionSettings(window=4))
    pair.loss = pair.reorder = 0.2
    samples = [struct.pack(">I", number) for number in range(150)]
    exchange(pair, samples)
    pair.heal()
    pair.settle()
    assert written(pair) == received(pair) == samples


def test_a_lost_message_is_repaired_in_about_two_round_trips_while_others_follow() -> None:
    pair = Pair(latency_s=0.001)
    exchange(pair, [b"measured"], step_s=0.01)
    pair.take_agent_events()
    begun = pair.now
    pair.loss = 1.0
    pair.client.write(WRITER, b"lost", 0x80)
    pair.run(0.0)
    pair.heal()
    pair.client.write(WRITER, b"next", 0x80)
    while not written(pair):
        pair.run(0.0005)
    assert written(pair) == [b"lost", b"next"]
    assert pair.now - begun < 0.0045


def test_where_messages_get_lost_the_last_of_a_burst_is_repaired_in_milliseconds() -> None:
    pair = Pair(latency_s=0.0005)
    exchange(pair, [b"measured"], step_s=0.01)
    pair.loss = 1.0
    pair.client.write(WRITER, b"shows that", 0x80)
    assert pair.agent.send_data(0x1D, READER, b"shows that", 0x80)
    pair.run(0.0)
    pair.heal()
    exchange(pair, [b"this link loses messages"], step_s=0.01)
    pair.loss = 1.0
    pair.client.write(WRITER, b"last", 0x80)
    assert pair.agent.send_data(0x1D, READER, b"last", 0x80)
    pair.run(0.0)
    pair.heal()
    pair.run(0.02)
    assert written(pair)[-1] == received(pair)[-1] == b"last"


def test_resending_stays_in_proportion_to_the_loss() -> None:
    pair = Pair(seed=3)
    pair.loss = 0.1
    samples = [struct.pack(">I", number) for number in range(1000)]
    exchange(pair, samples)
    pair.heal()
    pair.settle()
    assert written(pair) == samples
    assert pair.client.counters.resent < 250
    assert pair.agent.counters.resent < 250


def test_a_login_after_the_cable_was_unplugged_begins_anew() -> None:
    pair = Pair()
    pair.loss = 1.0
    exchange(pair, [b"lost"])
    pair.run(1.0)
    pair.cut()
    pair.heal()
    pair.client.connect(pair.now)
    pair.run(0.01)
    exchange(pair, [b"1", b"2"])
    pair.settle()
    assert written(pair) == received(pair) == [b"1", b"2"]


def test_a_slow_link_gets_no_heartbeats_between_the_messages_that_wait() -> None:
    pair = Pair()
    for _ in range(16):
        pair.client.write(WRITER, bytes(400), 0x80)
        pair.client.packets_to_send(pair.now, limit=0)
    now, packets = pair.now, []
    while batch := pair.client.packets_to_send(now, limit=1):
        packets += batch
        now += 0.054
        if (at := pair.client.timer()) is not None and at <= now:
            pair.client.handle_timer(now)
    assert len(packets) == 16
    assert pair.client.counters.heartbeats_out == 0
    assert pair.client.timer() == pytest.approx(now - 0.054 + 0.1)


def test_the_queue_keeps_the_newest_best_effort_samples() -> None:
    pair = Pair()
    pair.agent.queue_limit = 3
    for number in range(10):
        pair.agent.send_data(0x1D, READER, bytes([number]), 1)
    pair.settle()
    assert received(pair) == [b"\7", b"\x08", b"\x09"]


def test_back_pressure_invites_as_soon_as_there_is_room() -> None:
    pair = Pair()
    while pair.agent.send_data(0x1D, READER, b"sample", 0x80):
        pass
    pair.run(0.01)
    assert WindowOpened(0x80) in pair.agent_events
    assert pair.agent.send_data(0x1D, READER, b"sample", 0x80)


def test_sequence_numbers_wrap_with_70_000_messages_each_way() -> None:
    client, agent = make_open_ends()
    heard: list[bytes] = []
    for number in range(70_000):
        payload = number.to_bytes(4, "big")
        client.write(WRITER, payload, 0x80)
        agent.send_data(0x1D, READER, payload, 0x80)
        for packet in client.packets_to_send(0.0):
            agent.receive_packet(packet, 0.0)
        while (request := agent.next_event()) is not None:
            assert isinstance(request, DataWritten)
            heard.append(request.payload)
        for packet in agent.packets_to_send(0.0):
            client.receive_packet(packet, 0.0)
        while (event := client.next_event()) is not None:
            assert isinstance(event, DataReceived)
            assert event.payload == payload
    assert heard == [number.to_bytes(4, "big") for number in range(70_000)]
    assert client.dropped == agent.dropped == {}


# Any bytes at all.


def make_open_ends(session_id: int = 0x81) -> tuple[ClientSession, AgentSession]:
    pair = Pair(session_id=session_id)
    assert pair.client.state is ClientState.CONNECTED
    return pair.client, pair.agent


SUBMESSAGES = st.builds(
    lambda kind, flags, contents, cheat: struct.pack("<BBH", kind, flags, max(0, len(contents) + cheat)) + contents,
    st.integers(0, 0x20),
    st.integers(0, 255),
    st.binary(max_size=40),
    st.sampled_from([0, 0, 0, 0, -1, -4, 1, 100]),
)
MESSAGES = st.builds(
    lambda header, key, submessages: header + key + b"".join(part + bytes(-len(part) & 3) for part in submessages),
    st.builds(
        lambda session_id, stream_id, nr: struct.pack("<BBH", session_id, stream_id, nr),
        st.sampled_from([0x81, 0x81, 0x81, 0x80, 0x00, 0x01]),
        st.sampled_from([0, 0, 1, 2, 0x80, 0x80, 0x81, 0xFF]),
        st.integers(0, 20),
    ),
    st.sampled_from([b"", bytes.fromhex("aabbccdd")]),
    st.lists(SUBMESSAGES, max_size=4),
)
PACKETS = st.lists(st.one_of(MESSAGES, st.binary(max_size=60)), max_size=12)


def feed_anything(session: AgentSession | ClientSession, packets: list[bytes]) -> Iterator[bytes]:
    """Feed packets as a careless link would; yields what is sent."""
    now = 0.0
    for packet in packets:
        now += 0.05
        try:
            session.receive_packet(packet, now)
        except RemoteProtocolError:
            assert len(packet) < 8, "only a header may be refused"
        while session.next_event() is not None:
            pass
        session.handle_timer(now)
        yield from session.packets_to_send(now)


@settings(deadline=None, max_examples=tries(250, 5000))
@given(PACKETS, st.sampled_from([0x81, 0x01]))
def test_any_bytes_leave_the_agent_in_order(packets: list[bytes], session_id: int) -> None:
    _, agent = make_open_ends(session_id)
    for number in range(20):
        agent.send_data(0x1D, READER, bytes([number]) * 600, 0x80)
    for sent in feed_anything(agent, packets):
        assert 4 < len(sent) <= 508


@settings(deadline=None, max_examples=tries(250, 5000))
@given(PACKETS, st.sampled_from([0x81, 0x01]), st.booleans())
def test_any_bytes_leave_the_client_in_order(packets: list[bytes], session_id: int, closing: bool) -> None:
    client, _ = make_open_ends(session_id)
    client.write(WRITER, bytes(2000), 0x80)
    client.sync_time()
    if closing:
        client.close(0.0)
    for sent in feed_anything(client, packets):
        assert 4 < len(sent) <= 508


def test_how_the_streams_stand_can_be_looked_at() -> None:
    pair = Pair()
    pair.client.write(WRITER, b"1", 0x01)
    pair.client.write(WRITER, b"2", 0x80)
    pair.agent.send_data(0x1D, READER, b"3", 0x80)
    pair.run(0.5)
    assert pair.agent.stream_states() == [
        StreamState(0x01, outgoing=False, last=0),
        StreamState(0x80, outgoing=False, last=0),
        StreamState(0x80, outgoing=True, last=0),
    ]
    for number in range(20):
        pair.agent.send_data(0x1D, READER, bytes([number]), 0x80)
    assert pair.agent.stream_states()[-1] == StreamState(0x80, outgoing=True, last=16, unacked=16)
    pair.agent.reset()
    assert pair.agent.stream_states() == []
