from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.space import MemorySpace, Qos, Reader, Sample, Space, Topic, Writer
from msbot_agent.space.memory import FEEDBACK_LIMIT
from msbot_agent.space.qos_matching import mismatch
from msbot_agent.space.readers import FAIR_SHARE
from msbot_xrce.errors import LocalProtocolError
from tests.effort import tries

LIGHT = Topic("light", "Light")
LATCHED = Qos(transient_local=True, depth=1)
BEST_EFFORT = Qos(reliable=False)


def guid(number: int) -> bytes:
    return number.to_bytes(16)


class Inbox:
    """A reader's call-back that remembers payloads and takes samples as long as it is told to."""

    def __init__(self, *, takes: bool = True) -> None:
        self.takes = takes
        self.samples: list[Sample] = []

    def __call__(self, sample: Sample) -> bool:
        if self.takes:
            self.samples.append(sample)
        return self.takes

    @property
    def payloads(self) -> list[bytes]:
        return [sample.payload for sample in self.samples]


@pytest.fixture
def space() -> Space:
    return MemorySpace()


def test_a_sample_reaches_every_reader_of_its_topic_and_no_other(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    inboxes = {
        topic: Inbox()
        for topic in (LIGHT, Topic("dark", "Light"), Topic("light", "Lamp"), Topic("light", "Light", domain=1))
    }
    for topic, inbox in inboxes.items():
        space.reader(topic, Qos(), inbox)
    second = Inbox()
    space.reader(LIGHT, Qos(), second)
    assert writer.write(b"1") == 1
    assert writer.write(b"2", (guid(9), 7)) == 2
    assert (
        inboxes.pop(LIGHT).samples
        == second.samples
        == [
            Sample(b"1", guid(1), 1),
            Sample(b"2", guid(1), 2, (guid(9), 7)),
        ]
    )
    assert not any(inbox.samples for inbox in inboxes.values())
    assert (writer.guid, writer.topic, writer.published) == (guid(1), LIGHT, 2)


def test_two_types_on_one_topic_are_mentioned_in_the_log(space: Space, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "msbot_agent.space"):
        space.writer(LIGHT, Qos(), guid(1))
        space.writer(Topic("light", "Light", domain=1), Qos(), guid(2))
        assert not caplog.messages
        space.reader(Topic("light", "Lamp"), Qos(), Inbox())
    assert caplog.messages == ["topic light has two types, Light and Lamp: they do not meet"]


@pytest.mark.parametrize(
    ("offered", "requested", "meets"),
    [(True, True, True), (True, False, True), (False, False, True), (False, True, False)],
)
def test_a_reliable_reader_needs_a_reliable_writer(space: Space, offered: bool, requested: bool, meets: bool) -> None:
    early, late = Inbox(), Inbox()
    space.reader(LIGHT, Qos(reliable=requested), early)
    writer = space.writer(LIGHT, Qos(reliable=offered, transient_local=True), guid(1))
    writer.write(b"x")
    space.reader(LIGHT, Qos(reliable=requested, transient_local=True), late)
    assert bool(early.samples) is bool(late.samples) is meets


def test_a_late_reader_gets_what_the_writer_keeps_and_only_then_what_follows(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(transient_local=True, depth=2), guid(1))
    for number in range(4):
        writer.write(bytes([number]))
    inbox = Inbox()
    reader = space.reader(LIGHT, LATCHED, inbox)
    assert inbox.payloads == [b"\2", b"\3"]
    writer.write(b"\4")
    assert inbox.payloads == [b"\2", b"\3", b"\4"]
    assert reader.delivered == 3


@pytest.mark.parametrize(
    ("writer_durable", "reader_durable", "old", "new"),
    [
        # DDS 1.4 §2.2.3.4 and §2.2.3: what a late reader gets of what was written before it came, and of what follows.
        (True, True, True, True),
        (True, False, False, True),
        (False, True, False, False),
        (False, False, False, True),
    ],
)
def test_what_a_late_reader_gets_by_durability(
    space: Space, writer_durable: bool, reader_durable: bool, old: bool, new: bool
) -> None:
    writer = space.writer(LIGHT, Qos(transient_local=writer_durable), guid(1))
    writer.write(b"old")
    inbox = Inbox()
    space.reader(LIGHT, Qos(transient_local=reader_durable), inbox)
    writer.write(b"new")
    assert inbox.payloads == [b"old"] * old + [b"new"] * new


def test_a_volatile_or_closed_writer_leaves_nothing_for_late_readers(space: Space) -> None:
    space.writer(LIGHT, Qos(), guid(1)).write(b"volatile")
    gone = space.writer(LIGHT, LATCHED, guid(2))
    gone.write(b"gone")
    gone.close()
    gone.close()
    inbox = Inbox()
    space.reader(LIGHT, Qos(transient_local=True), inbox)
    assert inbox.samples == []
    with pytest.raises(LocalProtocolError, match="the writer of topic light is closed"):
        gone.write(b"x")


def test_what_a_reader_leaves_waits_in_order_and_the_oldest_is_pushed_out(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    inbox = Inbox(takes=False)
    reader = space.reader(LIGHT, Qos(depth=2), inbox)
    for number in range(3):
        writer.write(bytes([number]))
    assert (reader.delivered, reader.lost) == (0, 1)
    inbox.takes = True
    writer.write(b"\3")
    assert inbox.samples == []  # it may not overtake what waits
    taken = [reader.take(), reader.take()]
    assert [sample.payload for sample in taken if sample] == [b"\2", b"\3"]
    assert reader.take() is None
    writer.write(b"\4")
    assert inbox.payloads == [b"\4"]
    assert (reader.delivered, reader.lost) == (3, 2)


def test_kept_samples_wait_too_when_the_reader_does_not_take_them(space: Space) -> None:
    space.writer(LIGHT, LATCHED, guid(1)).write(b"x")
    reader = space.reader(LIGHT, LATCHED, Inbox(takes=False))
    sample = reader.take()
    assert sample is not None
    assert sample.payload == b"x"


def test_a_closed_reader_gets_nothing_more(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    inbox = Inbox(takes=False)
    reader = space.reader(LIGHT, Qos(), inbox)
    writer.write(b"x")
    reader.close()
    reader.close()
    assert reader.take() is None
    inbox.takes = True
    writer.write(b"y")
    assert inbox.samples == []


def test_a_topic_that_everybody_left_is_forgotten() -> None:
    space = MemorySpace()
    writer, reader = space.writer(LIGHT, Qos(), guid(1)), space.reader(LIGHT, Qos(), Inbox())
    writer.close()
    assert space._meetings
    reader.close()
    assert not space._meetings


def test_a_reader_closed_during_a_delivery_is_left_out_at_once(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    readers: list[Reader] = []

    def close_all(sample: Sample) -> bool:
        for reader in readers:
            reader.close()
        return False

    inbox = Inbox()
    readers.append(space.reader(LIGHT, Qos(), close_all))
    readers.append(space.reader(LIGHT, Qos(), inbox))
    writer.write(b"x")
    assert inbox.samples == []
    assert readers[0].take() is None


def test_a_reader_made_during_a_delivery_gets_the_sample_once_if_it_is_kept(space: Space) -> None:
    writer = space.writer(LIGHT, LATCHED, guid(1))
    late = Inbox()

    def make_reader(sample: Sample) -> bool:
        if sample.sequence_nr == 1:
            writer.write(b"2")
            space.reader(LIGHT, LATCHED, late)
        return True

    space.reader(LIGHT, Qos(), make_reader)
    writer.write(b"1")
    assert late.payloads == [b"1", b"2"]


def test_what_is_written_during_a_delivery_follows_after_it_for_every_reader(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    after = Inbox()
    numbers: list[int] = []

    def answer(sample: Sample) -> bool:
        if sample.sequence_nr < 3:
            numbers.append(writer.write(b"again"))
            assert writer.published == numbers[-1]
        return True

    space.reader(LIGHT, Qos(), answer)
    space.reader(LIGHT, Qos(), after)
    assert writer.write(b"first") == 1
    assert numbers == [2, 3]
    assert [sample.sequence_nr for sample in after.samples] == [1, 2, 3]


def test_what_is_written_while_a_reader_catches_up_waits_behind_the_kept_samples(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(transient_local=True, depth=2), guid(1))
    writer.write(b"1")
    writer.write(b"2")
    got: list[bytes] = []

    def answer(sample: Sample) -> bool:
        got.append(sample.payload)
        if sample.payload == b"1":
            writer.write(b"3")
        return True

    space.reader(LIGHT, Qos(transient_local=True), answer)
    assert got == [b"1", b"2", b"3"]


def test_all_histories_together_are_bounded_in_octets_and_nobody_takes_everything() -> None:
    space = MemorySpace(max_octets=10 * FAIR_SHARE)
    hog = space.reader(LIGHT, Qos(depth=1000), Inbox(takes=False))
    writer = space.writer(LIGHT, Qos(), guid(1))
    latched = space.writer(Topic("profile", "P"), Qos(transient_local=True, depth=1000), guid(2))
    for number in range(100):
        writer.write(number.to_bytes(2) + bytes(FAIR_SHARE // 4 - 2))
        latched.write(bytes(FAIR_SHARE // 4))
        assert space.octets_kept <= 10 * FAIR_SHARE + 2 * FAIR_SHARE
    assert hog.lost > 0
    modest = space.reader(Topic("small", "S"), Qos(depth=4), Inbox(takes=False))
    other = space.writer(Topic("small", "S"), Qos(), guid(3))
    for number in range(4):
        other.write(bytes([number]) * 1000)
    assert modest.lost == 0, "a small reader keeps what it needs"
    left = []
    while (sample := hog.take()) is not None:
        left.append(int.from_bytes(sample.payload[:2]))
    assert left == list(range(hog.lost, 100)), "the oldest gave way"
    latched.close()
    modest.close()
    assert space.octets_kept == 0


def test_a_sample_larger_than_all_there_is_to_keep_is_lost() -> None:
    space = MemorySpace(max_octets=FAIR_SHARE)
    reader = space.reader(LIGHT, Qos(), Inbox(takes=False))
    space.writer(LIGHT, Qos(), guid(1)).write(bytes(FAIR_SHARE + 1))
    assert (reader.lost, reader.take(), space.octets_kept) == (1, None, 0)


def test_a_topic_that_feeds_itself_is_stopped(space: Space) -> None:
    writer = space.writer(LIGHT, Qos(), guid(1))
    errors: list[str] = []

    def echo(sample: Sample) -> bool:
        try:
            writer.write(sample.payload)
        except LocalProtocolError as error:
            errors.append(str(error))
        return True

    space.reader(LIGHT, Qos(), echo)
    writer.write(b"x")
    assert errors == ["topic light feeds itself: its readers write to it without end"]
    assert writer.published == FEEDBACK_LIMIT + 1
    writer.write(b"y")
    assert len(errors) == 2


@dataclass
class ModelReader:
    """What a reader should have seen, written down the simplest way."""

    qos: Qos
    inbox: Inbox
    real: Reader
    waiting: deque[bytes] = field(default_factory=deque)
    seen: list[bytes] = field(default_factory=list)
    lost: int = 0

    def accept(self, payload: bytes) -> None:
        if not self.waiting and self.inbox.takes:
            self.seen.append(payload)
            return
        self.waiting.append(payload)
        if len(self.waiting) > self.qos.depth:
            self.waiting.popleft()
            self.lost += 1


@dataclass
class ModelWriter:
    qos: Qos
    real: Writer
    kept: list[bytes] = field(default_factory=list)


qualities = st.builds(Qos, reliable=st.booleans(), transient_local=st.booleans(), depth=st.integers(1, 3))
steps = st.lists(
    st.one_of(
        st.tuples(st.just("writer"), qualities),
        st.tuples(st.just("reader"), qualities),
        st.tuples(
            st.sampled_from(["write", "write", "write", "take", "pause", "close writer", "close reader"]),
            st.integers(0, 5),
        ),
    ),
    max_size=60,
)


@settings(max_examples=tries(200, 4000))
@given(steps)
def test_the_space_does_what_a_simple_model_does(script: list[tuple[str, Qos | int]]) -> None:
    space = MemorySpace()
    writers: list[ModelWriter] = []
    readers: list[ModelReader] = []

    def meets(writer: ModelWriter, reader: ModelReader) -> bool:
        durable = writer.qos.transient_local or not reader.qos.transient_local
        return durable and (writer.qos.reliable or not reader.qos.reliable)

    for number, (verb, argument) in enumerate(script):
        payload = number.to_bytes(2)
        if isinstance(argument, Qos):
            if verb == "writer":
                writers.append(ModelWriter(argument, space.writer(LIGHT, argument, guid(number))))
            else:
                inbox = Inbox(takes=number % 3 != 0)
                reader = ModelReader(argument, inbox, space.reader(LIGHT, argument, inbox))
                for writer in writers:
                    if meets(writer, reader):
                        for old in writer.kept if reader.qos.transient_local else ():
                            reader.accept(old)
                readers.append(reader)
        elif verb == "write" and argument < len(writers):
            writer = writers[argument]
            writer.real.write(payload)
            if writer.qos.transient_local:
                writer.kept = [*writer.kept, payload][-writer.qos.depth :]
            for reader in readers:
                if meets(writer, reader):
                    reader.accept(payload)
        elif verb == "close writer" and argument < len(writers):
            writers.pop(argument).real.close()
        elif argument < len(readers):
            reader = readers[argument]
            if verb == "close reader":
                readers.remove(reader)
                reader.real.close()
            elif verb == "pause":
                reader.inbox.takes = not reader.inbox.takes
            elif verb == "take":
                sample = reader.real.take()
                expected = reader.waiting.popleft() if reader.waiting else None
                assert (sample.payload if sample else None) == expected
        for reader in readers:
            assert reader.inbox.payloads == reader.seen
            assert reader.real.lost == reader.lost


@settings(max_examples=tries(200, 4000))
@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from(["write", "reader", "close", "none"])), max_size=30))
def test_order_holds_whatever_the_readers_do_during_a_delivery(script: list[tuple[int, str]]) -> None:
    space = MemorySpace()
    writers = [space.writer(LIGHT, Qos(transient_local=True, depth=50), guid(number)) for number in range(2)]
    actions = deque(script)
    seen: list[dict[bytes, list[int]]] = []
    readers: list[Reader] = []

    def act() -> None:
        if not actions:
            return
        which, verb = actions.popleft()
        if verb == "write":
            writers[which % 2].write(b"")
        elif verb == "reader" and len(seen) < 6:
            readers.append(space.reader(LIGHT, Qos(transient_local=True), listener()))
        elif verb == "close" and which < len(readers):
            readers[which].close()

    def listener() -> Callable[[Sample], bool]:
        heard: dict[bytes, list[int]] = {writer.guid: [] for writer in writers}
        seen.append(heard)

        def deliver(sample: Sample) -> bool:
            heard[sample.writer].append(sample.sequence_nr)
            act()
            return True

        return deliver

    steady = listener()
    space.reader(LIGHT, Qos(), steady)
    while actions:
        act()
        writers[0].write(b"")
    for heard in seen:
        for numbers in heard.values():
            assert numbers == list(range(1, len(numbers) + 1))
    assert [len(seen[0][writer.guid]) for writer in writers] == [writer.published for writer in writers]


def test_who_comes_and_goes_costs_the_same_however_many_are_there(
    space: Space, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = 0

    def counting(offered: Qos, requested: Qos) -> str | None:
        nonlocal looked_at
        looked_at += 1
        return mismatch(offered, requested)

    monkeypatch.setattr("msbot_agent.space.memory.mismatch", counting)
    writer = space.writer(LIGHT, Qos(), guid(1))
    inboxes = [Inbox() for _ in range(300)]
    readers = [space.reader(LIGHT, Qos(), inbox) for inbox in inboxes]
    writer.write(b"all")
    for reader in readers[:-1]:
        reader.close()
    writer.write(b"one")
    assert looked_at <= 2 * len(readers)
    assert [inbox.payloads for inbox in inboxes] == [*[[b"all"]] * 299, [b"all", b"one"]]
