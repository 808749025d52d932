"""Which offers and requests fit, and which policy is named when they do not."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.space import MemorySpace, Qos, Sample, Topic
from msbot_agent.space.qos_matching import mismatch, partitions_meet

LIGHT = Topic("light", "Light")


def taker(seen: list[bytes]) -> Callable[[Sample], bool]:
    """Takes everything and remembers it."""

    def deliver(sample: Sample) -> bool:
        seen.append(sample.payload)
        return True

    return deliver


CASES = [
    (Qos(), Qos(), None),
    (Qos(), Qos(reliable=False), None),
    (Qos(reliable=False), Qos(), "RELIABILITY"),
    (Qos(transient_local=True), Qos(), None),
    (Qos(), Qos(transient_local=True), "DURABILITY"),
    (Qos(exclusive=True, strength=3), Qos(exclusive=True), None),
    (Qos(exclusive=True), Qos(), "OWNERSHIP"),
    (Qos(), Qos(exclusive=True), "OWNERSHIP"),
    (Qos(deadline_s=1), Qos(), None),
    (Qos(deadline_s=1), Qos(deadline_s=1), None),
    (Qos(deadline_s=2), Qos(deadline_s=1), "DEADLINE"),
    (Qos(), Qos(deadline_s=1), "DEADLINE"),
    (Qos(lifespan_s=1), Qos(separation_s=1), None),
    (Qos(partitions=("a",)), Qos(partitions=("a",)), None),
    (Qos(partitions=("a",)), Qos(partitions=("b",)), "PARTITION"),
    (Qos(partitions=("a",)), Qos(), "PARTITION"),
    (Qos(), Qos(partitions=("", "b")), None),
]


@pytest.mark.parametrize(("offered", "requested", "policy"), CASES)
def test_the_policy_that_does_not_fit_is_named(offered: Qos, requested: Qos, policy: str | None) -> None:
    reason = mismatch(offered, requested)
    assert (reason is None) if policy is None else (reason is not None and reason.startswith(f"{policy}: "))


@pytest.mark.parametrize(
    ("one", "other", "meet"),
    [
        (("room*",), ("room1",), True),
        (("room1",), ("room?",), True),
        (("room*",), ("room*",), False),
        (("room*",), ("hall", "room9"), True),
        (("room",), ("Room",), False),
        (("*",), (), True),
    ],
)
def test_patterns_meet_names_and_not_each_other(one: tuple[str, ...], other: tuple[str, ...], meet: bool) -> None:
    assert partitions_meet(one, other) is meet
    assert partitions_meet(other, one) is meet


@given(st.tuples(st.text("ab*?", max_size=3)), st.tuples(st.text("ab*?", max_size=3)))
def test_partitions_meet_both_ways_round(one: tuple[str, ...], other: tuple[str, ...]) -> None:
    assert partitions_meet(one, other) is partitions_meet(other, one)


@pytest.mark.parametrize(("offered", "requested", "policy"), CASES)
def test_the_space_delivers_what_fits_and_tells_both_ends_what_does_not(
    offered: Qos, requested: Qos, policy: str | None
) -> None:
    space = MemorySpace()
    seen: list[bytes] = []
    writer = space.writer(LIGHT, offered, bytes(16))
    reader = space.reader(LIGHT, requested, taker(seen))
    writer.write(b"x")
    assert seen == ([b"x"] if policy is None else [])
    expected = () if policy is None else (f"light: {mismatch(offered, requested)}",)
    assert writer.troubles() == reader.troubles() == expected
    writer.close()
    assert reader.troubles() == ()


def test_another_type_on_the_same_name_is_told() -> None:
    space = MemorySpace()
    writer = space.writer(LIGHT, Qos(), bytes(16))
    reader = space.reader(Topic("light", "Lamp"), Qos(), lambda _: True)
    assert reader.troubles() == ("light: TYPE: it is written as Light elsewhere, here it is Lamp",)
    assert writer.troubles() == ("light: TYPE: it is read as Lamp elsewhere, here it is Light",)


class Clock:
    """Time that stands until it is told to go."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_sample_that_has_outlived_its_lifespan_is_not_delivered() -> None:
    clock = Clock()
    space = MemorySpace(clock=clock)
    writer = space.writer(LIGHT, Qos(transient_local=True, depth=5, lifespan_s=10), bytes(16))
    slow = space.reader(LIGHT, Qos(), lambda _: False)
    writer.write(b"old")
    clock.now += 6
    writer.write(b"new")
    clock.now += 5
    seen: list[bytes] = []
    space.reader(LIGHT, Qos(transient_local=True), taker(seen))
    assert seen == [b"new"]
    sample = slow.take()
    assert sample is not None
    assert sample.payload == b"new"
    assert slow.take() is None


def test_a_time_based_filter_lets_one_sample_through_in_its_time() -> None:
    clock = Clock()
    space = MemorySpace(clock=clock)
    seen: list[bytes] = []
    space.reader(LIGHT, Qos(separation_s=1.0), taker(seen))
    writer = space.writer(LIGHT, Qos(), bytes(16))
    for number in range(35):
        writer.write(bytes([number]))
        clock.now += 0.125
    assert seen == [bytes([number]) for number in (0, 8, 16, 24, 32)]


def test_the_strongest_writer_is_heard_and_the_next_one_when_it_has_gone_or_is_late() -> None:
    clock = Clock()
    space = MemorySpace(clock=clock)
    seen: list[bytes] = []
    qos = Qos(exclusive=True, deadline_s=1.0)
    space.reader(LIGHT, qos, taker(seen))
    weak = space.writer(LIGHT, Qos(exclusive=True, strength=1, deadline_s=1.0), b"w" * 16)
    strong = space.writer(LIGHT, Qos(exclusive=True, strength=5, deadline_s=1.0), b"s" * 16)
    weak.write(b"weak 1")  # heard: the strong one has not written yet
    strong.write(b"strong 1")
    weak.write(b"weak 2")
    clock.now += 1.5
    weak.write(b"weak 3")  # heard: the owner is late
    strong.write(b"strong 2")
    strong.close()
    weak.write(b"weak 4")
    assert seen == [b"weak 1", b"strong 1", b"weak 3", b"strong 2", b"weak 4"]


def test_a_missed_deadline_is_counted_and_told() -> None:
    clock = Clock()
    space = MemorySpace(clock=clock)
    reader = space.reader(LIGHT, Qos(deadline_s=0.5), lambda _: True)
    writer = space.writer(LIGHT, Qos(deadline_s=0.5), bytes(16))
    writer.write(b"")
    clock.now += 0.25
    writer.write(b"")
    assert reader.troubles() == ()
    clock.now += 1.25
    words = "light: DEADLINE: samples are expected every 0.5 s; that was missed 2 times"
    assert reader.troubles() == (words,)
    writer.write(b"")
    assert reader.troubles() == (words,)


def test_what_was_refused_by_a_selective_reader_takes_no_place_in_its_history() -> None:
    clock = Clock()
    space = MemorySpace(clock=clock)
    reader = space.reader(LIGHT, Qos(separation_s=5.0, depth=1), lambda _: False)
    writer = space.writer(LIGHT, Qos(), bytes(16))
    writer.write(b"first")
    writer.write(b"second")
    sample: Sample | None = reader.take()
    assert sample is not None
    assert sample.payload == b"first"
    assert reader.lost == 0
