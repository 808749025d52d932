"""The places of an endpoint in the space: order, back-pressure, limits, the gate."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from msbot_agent.agent.topic_attachment import ReadSide, WriteSide
from msbot_agent.space import MemorySpace, Owner, Qos, Topic
from msbot_xrce.messages import DeliveryControl
from tests.agent.hosts import FakeHost
from tests.effort import tries

TOPIC = Topic("light", "Light")
OWNER = Owner(1, "p")
READER = 0x0016
WRITER = 0x0015


def pair(*, depth: int = 16, latched: bool = False) -> tuple[FakeHost, WriteSide, FakeHost, ReadSide]:
    """A writer of one client and a reader of another."""
    space = MemorySpace()
    one, other = FakeHost(space, key=1), FakeHost(space, key=2)
    writer = WriteSide(one, WRITER, TOPIC, Qos(transient_local=latched, depth=depth), OWNER)
    reader = ReadSide(other, READER, TOPIC, Qos(transient_local=latched, depth=depth), OWNER)
    for side in (writer, reader):
        side.recheck()
    return one, writer, other, reader


def test_samples_wait_for_a_read_and_then_come_in_order() -> None:
    _, writer, host, reader = pair()
    for payload in (b"1", b"2"):
        writer.write(payload)
    assert host.payloads() == []
    reader.start(7, 0x80, DeliveryControl())
    writer.write(b"3")
    assert host.sent == [(7, READER, b"1", 0x80), (7, READER, b"2", 0x80), (7, READER, b"3", 0x80)]
    assert (host.traffic["light"].delivered, reader.delivered) == (3, 3)


def test_without_a_read_the_newest_samples_are_kept() -> None:
    _, writer, host, reader = pair(depth=2)
    for number in range(5):
        writer.write(bytes([number]))
    reader.start(1, 1, DeliveryControl())
    assert host.payloads() == [b"\x03", b"\x04"]


def test_no_control_means_one_sample() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 1, None)
    writer.write(b"1")
    writer.write(b"2")
    assert host.payloads() == [b"1"]
    reader.start(2, 1, None)
    assert host.sent == [(2, READER, b"2", 1)]


def test_no_samples_cancels_and_what_comes_waits_for_the_next_read() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 0x80, DeliveryControl())
    reader.start(2, 0, DeliveryControl(max_samples=0))
    writer.write(b"late")
    assert host.payloads() == []
    reader.start(3, 0x80, DeliveryControl())
    assert host.sent == [(3, READER, b"late", 0x80)]


def test_a_second_read_takes_the_place_of_the_first() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 0x80, DeliveryControl())
    reader.start(2, 0x01, DeliveryControl())
    writer.write(b"x")
    assert host.sent == [(2, READER, b"x", 0x01)]


def test_a_full_window_holds_samples_back_and_loses_none() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 0x80, DeliveryControl())
    host.has_room = False
    for payload in (b"1", b"2", b"3"):
        writer.write(payload)
    host.has_room = True
    writer.write(b"4")
    assert host.payloads() == [], "a new sample must not overtake those that wait"
    reader.pull()
    assert host.payloads() == [b"1", b"2", b"3", b"4"]


def test_pace_holds_samples_back_until_their_time() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 1, DeliveryControl(min_pace_ms=500))
    for payload in (b"1", b"2", b"3"):
        writer.write(payload)
    assert host.payloads() == [b"1"]
    host.pass_time_until(0.4)
    assert host.payloads() == []
    host.pass_time_until(0.6)
    assert host.payloads() == [b"2"]
    host.pass_time_until(5.0)
    assert host.payloads() == [b"3"]


def test_byte_rate_holds_samples_back_until_they_are_affordable() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 1, DeliveryControl(max_bytes_per_second=100))
    for number in range(4):
        writer.write(bytes([number]) * 60)
    assert len(host.payloads()) == 1
    host.pass_time_until(0.3)
    assert len(host.payloads()) == 1
    host.pass_time_until(10.0)
    assert len(host.payloads()) == 2


def test_after_the_elapsed_time_samples_stay_for_the_next_read() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 1, DeliveryControl(max_elapsed_s=1))
    host.now = 1.3
    writer.write(b"late")
    assert host.payloads() == []
    assert reader.read is None
    reader.start(2, 1, DeliveryControl())
    assert host.payloads() == [b"late"]


def test_a_barred_writer_is_not_in_the_space_and_its_samples_are_counted() -> None:
    one, writer, host, reader = pair()
    reader.start(1, 1, DeliveryControl())
    one.barred.add("light")
    writer.recheck()
    writer.write(b"forbidden")
    assert host.payloads() == []
    assert one.refused == {"light": 1}
    assert (one.traffic["light"].published, one.traffic["light"].refused) == (0, 1)
    one.barred.clear()
    writer.recheck()
    writer.write(b"allowed")
    assert host.payloads() == [b"allowed"]
    assert writer.published == 1


def test_a_barred_reader_gets_nothing_and_forgets_what_waited() -> None:
    _, writer, host, reader = pair()
    writer.write(b"before")
    host.barred.add("light")
    reader.recheck()
    writer.write(b"meanwhile")
    reader.start(1, 1, DeliveryControl())
    assert host.payloads() == []
    host.barred.clear()
    reader.recheck()
    writer.write(b"after")
    assert host.payloads() == [b"after"], "the read that was started meanwhile goes on"


def test_a_reader_that_is_let_in_again_gets_the_latched_sample() -> None:
    _, writer, host, reader = pair(depth=1, latched=True)
    reader.start(1, 1, DeliveryControl())
    writer.write(b"profile")
    assert host.payloads() == [b"profile"]
    host.barred.add("light")
    reader.recheck()
    reader.recheck()
    host.barred.clear()
    reader.recheck()
    reader.recheck()
    assert host.payloads() == [b"profile"]


def test_closed_sides_are_quiet() -> None:
    _, writer, host, reader = pair()
    reader.start(1, 1, DeliveryControl())
    reader.close()
    writer.write(b"x")
    reader.pull()
    writer.close()
    writer.close()
    assert host.payloads() == []
    assert writer.topic == reader.topic == "light"


class InOrderExactlyOnce(RuleBasedStateMachine):
    """Whatever the room and the reads do: what arrives is what was written, in order, without gap or repetition."""

    def __init__(self) -> None:
        super().__init__()
        _, self.writer, self.host, self.reader = pair(depth=1000)
        self.written: list[bytes] = []

    @rule(samples=st.integers(1, 5))
    def write(self, samples: int) -> None:
        for _ in range(samples):
            self.written.append(len(self.written).to_bytes(2, "big"))
            self.writer.write(self.written[-1])

    @rule(room=st.booleans())
    def room_changes(self, room: bool) -> None:
        self.host.has_room = room
        if room:
            self.reader.pull()

    @rule(
        samples=st.sampled_from([0, 1, 3, 0xFFFF]),
        pace_ms=st.sampled_from([0, 10]),
        rate=st.sampled_from([0, 4]),
        elapsed_s=st.sampled_from([0, 1]),
    )
    def read(self, samples: int, pace_ms: int, rate: int, elapsed_s: int) -> None:
        self.reader.start(1, 1, DeliveryControl(samples, elapsed_s, rate, pace_ms))

    @rule(seconds=st.sampled_from([0.005, 0.3, 2.0]))
    def time_passes(self, seconds: float) -> None:
        self.host.pass_time_until(self.host.now + seconds)

    @invariant()
    def in_order(self) -> None:
        got = [payload for _, _, payload, _ in self.host.sent]
        assert got == self.written[: len(got)]

    def teardown(self) -> None:
        self.host.has_room = True
        self.reader.start(1, 1, DeliveryControl())
        assert [payload for _, _, payload, _ in self.host.sent] == self.written


TestInOrderExactlyOnce = InOrderExactlyOnce.TestCase
TestInOrderExactlyOnce.settings = settings(deadline=None, max_examples=tries(40, 2000), stateful_step_count=30)
