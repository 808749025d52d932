"""One client inside the agent, without links: events in, booked answers out."""

from __future__ import annotations

from functools import partial

import pytest

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.gate import ClientInfo, OpenGate
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.reply_routing import ReplyExchange, client_key_of
from msbot_agent.agent.shared_state import SharedAgentState
from msbot_agent.agent.statistics import Transit
from msbot_agent.space import MemorySpace, Qos, Sample, Topic
from msbot_xrce import AgentSession, ClientSession
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE, DeliveryControl, make_object_id
from msbot_xrce.objects import EndpointQos, participant_variant, reader_variant, subscriber_variant, topic_variant
from msbot_xrce.sessions import ClientEvent, DataReceived, StatusReceived

KEY = 0xAABBCCDD
LIGHT = Topic("light", "T")


class Pair:
    """A client session and its proxy, back to back."""

    def __init__(self, *, echo: bool = True) -> None:
        self.now = 0.0
        self.marked: list[Proxy] = []
        self.resting: list[Proxy] = []
        self.space = MemorySpace()
        surroundings = SharedAgentState(
            space=self.space,
            replies=ReplyExchange(self.space),
            transit=Transit(lambda: self.now),
            gate=OpenGate(),
            settings=AgentSettings(probes=2, probe_period_s=1.0),
            clock=lambda: self.now,
            agent_id=b"AGENT-ID",
            mark=self.marked.append,
            rest=self.resting.append,
        )
        session = partial(AgentSession, KEY, 0x81, 508, epoch_ns=lambda: 0)
        info = ClientInfo(KEY, "fake:", "peer", "peer in words")
        self.proxy = Proxy(info, session, surroundings, 0.0, dead_after_s=10.0, echo=echo)
        self.client = ClientSession(KEY, epoch_ns=lambda: 0)
        self.client.connect(0.0)
        self.client.packets_to_send(0.0)
        self.client.receive_packet(bytes.fromhex("8100000004010b000000585243450100010f00"), 0.0)
        self.settle()

    def settle(self) -> list[ClientEvent]:
        """Exchange packets until nobody has any; the client's events."""
        events: list[ClientEvent] = []
        for _ in range(10):
            for packet in self.client.packets_to_send(self.now):
                self.proxy.receive(packet, self.now)
            for packet in self.proxy.session.packets_to_send(self.now):
                self.client.receive_packet(packet, self.now)
            while (event := self.client.next_event()) is not None:
                events.append(event)
        return events

    def add_readers(self, count: int, *, depth: int = 8) -> None:
        """Readers of the light topic that all read on the reliable stream."""
        self.client.create(0x0011, participant_variant("p"))
        self.client.create(0x0012, topic_variant(LIGHT.name, LIGHT.type_name, 0x0011))
        self.client.create(0x0014, subscriber_variant(0x0011))
        for number in range(1, count + 1):
            reader = make_object_id(number, 6)
            self.client.create(reader, reader_variant(0x0012, 0x0014, EndpointQos(depth=depth)))
            self.client.read(reader, STREAM_RELIABLE, DeliveryControl())
        assert all(event.status == 0 for event in self.settle() if isinstance(event, StatusReceived))


def test_readers_of_a_full_stream_take_turns() -> None:
    pair = Pair()
    pair.add_readers(3)
    writer = pair.space.writer(LIGHT, Qos(), bytes(16))
    for number in range(20):
        writer.write(bytes([number]))
    got: dict[int, list[int]] = {}
    for event in pair.settle():
        assert isinstance(event, DataReceived)
        got.setdefault(event.object_id, []).append(event.payload[0])
    for numbers in got.values():
        assert numbers == sorted(numbers)
        assert numbers[-1] == 19
    assert max(map(len, got.values())) - min(map(len, got.values())) <= 1


def test_marks_itself_when_there_is_something_to_send() -> None:
    pair = Pair()
    pair.add_readers(1)
    pair.marked.clear()
    pair.space.writer(LIGHT, Qos(), bytes(16)).write(b"x")
    assert pair.marked == [pair.proxy]


def test_nothing_waits_for_a_time_when_all_is_acknowledged() -> None:
    pair = Pair()
    pair.add_readers(1)
    pair.space.writer(LIGHT, Qos(), bytes(16)).write(b"x")
    (sample,) = pair.proxy.session.packets_to_send(0.0)
    assert pair.proxy.timer() is not None
    pair.marked.clear()
    pair.proxy.is_marked, pair.proxy.is_timed = False, True
    pair.proxy.receive(bytes.fromhex("810000000000000000000000"), 0.0)
    assert (pair.marked, pair.resting) == ([pair.proxy], [])
    pair.marked.clear()
    pair.client.receive_packet(sample, 0.0)
    (acknack,) = pair.client.packets_to_send(0.0)
    pair.proxy.receive(acknack, 0.0)
    assert (pair.marked, pair.resting) == ([], [pair.proxy])
    assert pair.proxy.timer() is None


def test_a_blocked_client_takes_no_samples() -> None:
    pair = Pair()
    pair.add_readers(1)
    pair.proxy.is_blocked = True
    pair.space.writer(LIGHT, Qos(), bytes(16)).write(b"x")
    assert pair.settle() == []
    pair.proxy.is_blocked = False
    pair.proxy.pull()
    assert [event.payload for event in pair.settle() if isinstance(event, DataReceived)] == [b"x"]


def test_a_packet_without_a_complete_header_is_counted() -> None:
    pair = Pair()
    pair.proxy.receive(b"\x01\0\0\0\0", 0.0)
    assert pair.proxy.view(0.0).dropped == {"packet with a broken header": 1}


def test_silence_is_probed_and_then_death() -> None:
    pair = Pair()
    proxy = pair.proxy
    assert proxy.next_life_check(9.0) == 10.0
    assert proxy.next_life_check(10.0) == 11.0
    assert proxy.next_life_check(11.0) == 12.0
    assert len(proxy.session.packets_to_send(11.0)) == 2
    assert proxy.next_life_check(12.0) is None


def test_any_packet_is_a_sign_of_life() -> None:
    pair = Pair()
    proxy = pair.proxy
    assert proxy.next_life_check(10.0) == 11.0
    proxy.receive(bytes.fromhex("810000000000000000000000"), 10.5)
    assert proxy.next_life_check(11.0) == 20.5
    assert proxy.next_life_check(20.5) == 21.5
    assert proxy.next_life_check(21.5) == 22.5
    assert proxy.next_life_check(22.5) is None


def test_guids_name_the_client_and_are_never_the_same() -> None:
    proxy = Pair().proxy
    guids = {proxy.new_guid(0x0015) for _ in range(100)}
    assert len(guids) == 100
    assert {client_key_of(guid) for guid in guids} == {KEY}


@pytest.mark.parametrize("echo", [True, False])
def test_own_samples_come_back_unless_the_client_does_not_want_them(echo: bool) -> None:
    pair = Pair(echo=echo)
    pair.add_readers(1)
    own = pair.space.writer(LIGHT, Qos(), pair.proxy.new_guid(0x0015))
    own.write(b"own")
    other = pair.space.writer(LIGHT, Qos(), bytes(16))
    other.write(b"other")
    got = [event.payload for event in pair.settle() if isinstance(event, DataReceived)]
    assert got == ([b"own", b"other"] if echo else [b"other"])


def test_the_view_says_who_it_is_and_what_it_has() -> None:
    pair = Pair()
    pair.add_readers(2)
    pair.space.writer(LIGHT, Qos(), bytes(16)).write(b"x")
    pair.settle()
    view = pair.proxy.view(4.0)
    assert (view.key, view.session_id, view.link, view.address, view.mtu) == (KEY, 0x81, "fake:", "peer in words", 508)
    assert [(item.object_id, item.kind, item.topic, item.attached) for item in view.objects] == [
        (0x0011, "participant", None, True),
        (0x0012, "topic", "light", True),
        (0x0014, "subscriber", None, True),
        (0x0016, "datareader", "light", True),
        (0x0026, "datareader", "light", True),
    ]
    assert (view.age_s, view.silent_s, view.delivered, view.published, view.waiting) == (4.0, 4.0, 2, 0, 0)
    assert view.packets_in > 0
    assert view.bytes_in > view.packets_in


def test_closing_leaves_the_space() -> None:
    pair = Pair()
    pair.add_readers(1)
    pair.proxy.close()
    writer = pair.space.writer(LIGHT, Qos(), bytes(16))
    writer.write(b"x")
    assert pair.settle() == []
    assert pair.proxy.view(0.0).objects == ()


def test_time_limits_are_served_by_the_timer() -> None:
    pair = Pair()
    pair.add_readers(1)
    pair.client.read(0x0016, STREAM_BEST_EFFORT, DeliveryControl(min_pace_ms=250))
    pair.settle()
    writer = pair.space.writer(LIGHT, Qos(), bytes(16))
    writer.write(b"1")
    writer.write(b"2")
    assert len(pair.settle()) == 1
    assert pair.proxy.timer() == 0.25
    pair.now = 0.25
    pair.proxy.handle_timer(0.25)
    assert len(pair.settle()) == 1
    assert pair.proxy.timer() is None


def test_samples_may_be_written_while_a_sample_is_delivered() -> None:
    pair = Pair()
    pair.add_readers(1)
    echo = pair.space.writer(Topic("echo", "T"), Qos(), bytes(16))

    def answer(sample: Sample) -> bool:
        echo.write(sample.payload)
        return True

    pair.space.reader(LIGHT, Qos(), answer)
    pair.space.writer(LIGHT, Qos(), bytes(16)).write(b"x")
    assert echo.published == 1
    assert len(pair.settle()) == 1


def test_nothing_piles_up_when_a_client_logs_in_again_and_again_with_a_full_stream() -> None:
    pair = Pair()
    pair.add_readers(1)
    writer = pair.space.writer(LIGHT, Qos(), bytes(16))
    for _ in range(5):
        for number in range(20):
            writer.write(bytes([number]))
        pair.proxy.log_in_again(pair.proxy.info, 508, pair.now)
        assert pair.proxy.session.next_event() is None
        pair.proxy.pull()
