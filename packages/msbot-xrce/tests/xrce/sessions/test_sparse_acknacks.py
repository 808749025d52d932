"""One ACKNACK for several messages, on links that lose nothing between two ends of MsBOT."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce import AgentSessionSettings, ClientSessionSettings
from msbot_xrce.messages.ids import SubmessageId
from msbot_xrce.sessions import DataReceived, DataWritten
from msbot_xrce.streams.settings import SPARSE_EVERY, SPARSE_HEARTBEAT_S
from tests.xrce.pair import Pair

WRITER, READER, RELIABLE = 0x0015, 0x0016, 0x80
LATENCY_S = 0.001


def sparse_pair(*, agent: bool = True, client: bool = True, loss: float = 0.0, seed: int = 0) -> Pair:
    pair = Pair(
        latency_s=LATENCY_S,
        seed=seed,
        agent_settings=AgentSessionSettings(sparse_acknacks=agent, peer_is_stock=False),
        client_settings=ClientSessionSettings(sparse_acknacks=client),
    )
    pair.carried.clear()
    pair.loss = loss
    return pair


def carried(pair: Pair, kind: SubmessageId) -> int:
    """How many packets of stream NONE carry that."""
    return sum(packet[1] == 0 and packet[4] == kind for _, packet in pair.carried)


def speak(pair: Pair, count: int, period_s: float) -> None:
    """Both ends send so many samples."""
    for number in range(count):
        pair.client.write(WRITER, b"%d" % number, RELIABLE)
        assert pair.agent.send_data(0x1D, READER, b"%d" % number, RELIABLE)
        pair.run(period_s)


def heard(pair: Pair) -> tuple[list[bytes], list[bytes]]:
    """The samples that came to the agent and to the client."""
    at_agent = [event.payload for event in pair.take_agent_events() if isinstance(event, DataWritten)]
    return at_agent, [event.payload for event in pair.take_client_events() if isinstance(event, DataReceived)]


def test_what_comes_often_is_acknowledged_in_groups() -> None:
    pair = sparse_pair()
    speak(pair, 100, 0.1)
    assert heard(pair) == ([b"%d" % number for number in range(100)],) * 2
    assert carried(pair, SubmessageId.ACKNACK) <= 2 * 100 / SPARSE_EVERY + 2
    assert carried(pair, SubmessageId.HEARTBEAT) == 0


def test_what_comes_rarely_is_acknowledged_at_once_and_nobody_asks() -> None:
    pair = sparse_pair()
    for _ in range(20):
        speak(pair, 1, 1.0)
        assert pair.client.is_delivered
        assert pair.agent.is_delivered
    assert carried(pair, SubmessageId.ACKNACK) == 40
    assert carried(pair, SubmessageId.HEARTBEAT) == 0


def test_the_rest_is_asked_for_after_a_silence() -> None:
    pair = sparse_pair()
    speak(pair, SPARSE_EVERY + 1, 0.01)
    assert not pair.client.is_delivered
    assert not pair.agent.is_delivered
    pair.run(SPARSE_HEARTBEAT_S)
    assert pair.client.is_delivered
    assert pair.agent.is_delivered
    assert carried(pair, SubmessageId.HEARTBEAT) == 2
    pair.settle()


def test_a_window_does_not_fill_up() -> None:
    pair = sparse_pair()
    pair.client.write(WRITER, bytes(20_000), RELIABLE)
    assert pair.agent.send_data(0x1D, READER, bytes(20_000), RELIABLE)
    pair.run(0.2)
    assert heard(pair) == ([bytes(20_000)],) * 2
    assert carried(pair, SubmessageId.HEARTBEAT) == 0


def test_who_wants_to_go_asks_at_once_and_once() -> None:
    pair = sparse_pair()
    speak(pair, 2, 0.01)
    assert not pair.client.is_delivered
    assert pair.client.ask_for_delivery(pair.now)
    assert not pair.client.ask_for_delivery(pair.now)
    pair.run(3 * LATENCY_S)
    assert pair.client.is_delivered
    assert not pair.client.ask_for_delivery(pair.now)


def test_elsewhere_nothing_has_to_be_asked_for() -> None:
    pair = sparse_pair(client=False)
    pair.client.write(WRITER, b"one", RELIABLE)
    pair.client.packets_to_send(pair.now)
    assert not pair.client.ask_for_delivery(pair.now)


def test_the_round_trip_is_that_of_a_message_that_is_acknowledged_at_once() -> None:
    pair = sparse_pair()
    speak(pair, 40, 0.1)
    for end in (pair.client, pair.agent):
        count, seconds = end.acknowledged
        assert count >= 40 / SPARSE_EVERY - 1
        assert seconds == pytest.approx(2 * LATENCY_S)


@given(
    seed=st.integers(0, 1 << 32),
    loss=st.sampled_from((0.0, 0.05, 0.3)),
    agent=st.booleans(),
    client=st.booleans(),
    period_s=st.sampled_from((0.02, 0.1, 0.6)),
)
def test_everything_arrives_also_where_only_one_end_is_sparse_and_packets_are_lost(
    seed: int, loss: float, agent: bool, client: bool, period_s: float
) -> None:
    pair = sparse_pair(agent=agent, client=client, loss=loss, seed=seed)
    waiting = {"client": list(range(40)), "agent": list(range(40))}
    for _ in range(2000):
        if waiting["client"] and pair.client.has_room(RELIABLE):
            pair.client.write(WRITER, b"%d" % waiting["client"].pop(0), RELIABLE)
        if waiting["agent"] and pair.agent.send_data(0x1D, READER, b"%d" % waiting["agent"][0], RELIABLE):
            waiting["agent"].pop(0)
        pair.run(period_s)
        if not any(waiting.values()) and pair.client.is_delivered and pair.agent.is_delivered:
            break
    assert heard(pair) == ([b"%d" % number for number in range(40)],) * 2
    pair.heal()
    pair.settle()
