"""Two data spaces with a participant each, through the loopback interface: as two agents on one computer."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator

import pytest

from msbot_agent.space import Qos, Topic, open_space, parse_space
from msbot_agent.space.dds import DdsSpace
from msbot_xrce.errors import ConfigError
from tests.space.dds.peers import Inbox, until

CHATTER = Topic("rt/chatter", "std_msgs::msg::dds_::String_")
RELIABLE = Qos(depth=64)


def guid(number: int) -> bytes:
    """A writer's."""
    return number.to_bytes(16)


@pytest.fixture
async def pair() -> Iterator[tuple[DdsSpace, DdsSpace]]:  # type: ignore[misc]
    """Here and there."""
    with DdsSpace() as here, DdsSpace() as there:
        yield here, there


async def test_octets_arrive_elsewhere_as_they_were_written(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    there.reader(CHATTER, Qos(transient_local=True, depth=64), inbox)
    writer = here.writer(CHATTER, Qos(transient_local=True, depth=64), guid(1))
    sent = [bytes(range(size % 256)) * 3 for size in (0, 1, 2, 3, 4, 5, 31, 64, 255)] + [b"", bytes(1 << 20)]
    for payload in sent:
        writer.write(payload)
    await until(lambda: len(inbox.samples) == len(sent))
    assert inbox.payloads == sent
    assert [sample.sequence_nr for sample in inbox.samples] == list(range(1, len(sent) + 1))


async def test_endpoints_of_one_space_meet_in_memory_at_once_and_only_there(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    near, far = Inbox(), Inbox()
    here.reader(CHATTER, RELIABLE, near)
    there.reader(CHATTER, RELIABLE, far)
    writer = here.writer(CHATTER, RELIABLE, guid(1))
    number = 0
    while not far.samples:
        writer.write(b"%d" % number)
        number += 1
        assert len(near.samples) == number  # within the call
        await asyncio.sleep(0.01)
    assert near.payloads == [b"%d" % index for index in range(number)]  # none came a second time
    assert {sample.writer for sample in near.samples} == {guid(1)}


async def test_late_joiners_get_what_a_transient_local_writer_keeps(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    writer = here.writer(CHATTER, Qos(transient_local=True, depth=3), guid(1))
    longer = here.writer(CHATTER, Qos(transient_local=True, depth=1, late_depth=5), guid(2))
    for index in range(10):
        writer.write(b"a%d" % index)
        longer.write(b"b%d" % index)
    inbox, volatile = Inbox(), Inbox()
    there.reader(CHATTER, Qos(transient_local=True), inbox)
    there.reader(CHATTER, Qos(), volatile)
    await until(lambda: len(inbox.samples) == 8)
    assert sorted(inbox.payloads) == [b"a7", b"a8", b"a9", b"b5", b"b6", b"b7", b"b8", b"b9"]
    assert volatile.samples == []


async def test_quality_that_does_not_fit_is_told_on_both_ends_and_said_once(
    pair: tuple[DdsSpace, DdsSpace], caplog: pytest.LogCaptureFixture
) -> None:
    here, there = pair
    writer = here.writer(CHATTER, Qos(reliable=False), guid(1))
    reader = there.reader(CHATTER, Qos(), Inbox())
    await until(lambda: writer.troubles() and reader.troubles())
    words = "rt/chatter: RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT (a DDS peer)"
    assert writer.troubles() == reader.troubles() == (words,)
    assert [record.getMessage() for record in caplog.records].count(words) == 2  # once for each end
    writer.close()
    await until(lambda: not reader.troubles())


@pytest.mark.parametrize(
    ("offered", "requested", "policy"),
    [
        (Qos(), Qos(transient_local=True), "DURABILITY"),
        (Qos(), Qos(deadline_s=1.0), "DEADLINE"),
        (Qos(exclusive=True), Qos(), "OWNERSHIP"),
        (Qos(partitions=("a",)), Qos(partitions=("b",)), "PARTITION"),
    ],
)
async def test_each_policy_is_named(pair: tuple[DdsSpace, DdsSpace], offered: Qos, requested: Qos, policy: str) -> None:
    here, there = pair
    inbox = Inbox()
    writer = here.writer(CHATTER, offered, guid(1))
    reader = there.reader(CHATTER, requested, inbox)
    await until(lambda: writer.troubles() and reader.troubles())
    assert f": {policy}: " in writer.troubles()[0]
    assert writer.troubles() == reader.troubles()
    writer.write(b"")
    assert inbox.samples == []


async def test_another_type_on_the_same_topic_is_told(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    writer = here.writer(CHATTER, Qos(), guid(1))
    reader = there.reader(Topic(CHATTER.name, "Foreign"), Qos(), inbox)
    await until(lambda: writer.troubles() and reader.troubles())
    assert writer.troubles() == (
        f"rt/chatter: TYPE: it is read as Foreign by a DDS peer, here it is {CHATTER.type_name}",
    )
    assert reader.troubles() == (
        f"rt/chatter: TYPE: it is written as {CHATTER.type_name} by a DDS peer, here it is Foreign",
    )


async def test_partitions_with_patterns_and_ownership_by_strength(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    there.reader(CHATTER, Qos(partitions=("room*",), exclusive=True, depth=64), inbox)
    weak = here.writer(CHATTER, Qos(partitions=("room1",), exclusive=True, strength=1, depth=64), guid(1))
    await until(lambda: (weak.write(b"weak"), inbox.samples)[1])
    strong = here.writer(CHATTER, Qos(partitions=("room2",), exclusive=True, strength=9, depth=64), guid(2))
    await until(lambda: (strong.write(b"strong"), b"strong" in inbox.payloads)[1])
    count = len(inbox.samples)
    for _ in range(20):
        weak.write(b"weak")
        strong.write(b"strong")
        await asyncio.sleep(0.005)
    await until(lambda: len(inbox.samples) >= count + 20)
    assert set(inbox.payloads[count:]) == {b"strong"}
    strong.close()
    await until(lambda: (weak.write(b"weak again"), b"weak again" in inbox.payloads)[1])


async def test_a_local_and_a_remote_writer_compete_for_one_reader(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    there.reader(CHATTER, Qos(exclusive=True, depth=64), inbox)
    near = there.writer(CHATTER, Qos(exclusive=True, strength=1, depth=64), guid(1))
    far = here.writer(CHATTER, Qos(exclusive=True, strength=5, depth=64), guid(2))
    near.write(b"near")
    assert inbox.payloads == [b"near"]
    await until(lambda: (far.write(b"far"), b"far" in inbox.payloads)[1])
    count = len(inbox.samples)
    near.write(b"near")
    assert len([one for one in inbox.payloads if one == b"near"]) == 1
    far.close()
    await until(lambda: (near.write(b"near"), inbox.payloads[-1] == b"near")[1])
    assert len(inbox.samples) > count


async def test_a_space_in_a_domain_of_its_own_hears_nothing_of_others() -> None:
    inbox = Inbox()
    with DdsSpace(1) as one, DdsSpace(2) as two, DdsSpace(1) as same:
        two.reader(CHATTER, RELIABLE, inbox)
        arrived = Inbox()
        same.reader(CHATTER, RELIABLE, arrived)
        writer = one.writer(CHATTER, RELIABLE, guid(1))
        await until(lambda: (writer.write(b""), arrived.samples)[1])
        assert inbox.samples == []
        elsewhere = one.reader(Topic(CHATTER.name, CHATTER.type_name, 2), RELIABLE, inbox)
        foreign = two.writer(CHATTER, RELIABLE, guid(2))
        await until(lambda: (foreign.write(b"two"), b"two" in inbox.payloads)[1])
        elsewhere.close()


async def test_robots_in_their_partitions_do_not_hear_each_other() -> None:
    with DdsSpace(partition="msbot/A") as a, DdsSpace(partition="msbot/B") as b, DdsSpace(partition="msbot/A") as a2:
        other, same = Inbox(), Inbox()
        reader = b.reader(CHATTER, RELIABLE, other)
        a2.reader(CHATTER, RELIABLE, same)
        writer = a.writer(CHATTER, RELIABLE, guid(1))
        await until(lambda: (writer.write(b""), same.samples)[1])
        assert other.samples == []
        assert reader.troubles() == writer.troubles() == ()


@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
@pytest.mark.parametrize("topic", [Topic("t" * 70_000, "T"), Topic("t", "T" * 70_000)], ids=["topic", "type"])
async def test_a_name_with_which_the_library_ends_the_process_never_reaches_it(topic: Topic) -> None:
    with DdsSpace() as space:
        inbox = Inbox()
        reader = space.reader(topic, RELIABLE, inbox)
        writer = space.writer(topic, RELIABLE, guid(1))
        writer.write(b"x")
        assert inbox.payloads == [b"x"]
        assert "a name has at most 1024 bytes" in writer.troubles()[0]
        assert writer.troubles() == reader.troubles()
        assert len(writer.troubles()[0]) < 200


async def test_a_topic_that_dds_does_not_take_stays_here_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    with DdsSpace() as space:
        inbox = Inbox()
        topic = Topic("a topic", "T")
        reader = space.reader(topic, RELIABLE, inbox)
        writer = space.writer(topic, RELIABLE, guid(1))
        writer.write(b"x")
        assert inbox.payloads == [b"x"]
        assert "names consist of letters, digits, _ and /" in writer.troubles()[0]
        assert writer.troubles() == reader.troubles()
        far = space.writer(Topic("t", "T", domain=240), RELIABLE, guid(2))
        assert far.troubles() == ("DDS domain 240: domains go from 0 to 232, more have no UDP ports",)
    assert len(caplog.records) == 2


async def test_endpoints_come_and_go(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    for round_ in range(20):
        inbox = Inbox()
        topic = Topic(f"t{round_ % 3}", "T")
        reader = there.reader(topic, RELIABLE, inbox)
        writer = here.writer(topic, RELIABLE, guid(round_))
        while not inbox.samples:
            writer.write(b"x")
            await asyncio.sleep(0.005)
        writer.close()
        writer.close()
        reader.close()
        reader.close()
    await until(lambda: here.neighbours == there.neighbours == 0)


async def test_a_reader_closes_itself_in_the_middle_of_a_delivery(pair: tuple[DdsSpace, DdsSpace]) -> None:
    here, there = pair
    seen: list[bytes] = []

    def deliver(sample: object) -> bool:
        seen.append(b"")
        reader.close()
        return True

    writer = here.writer(CHATTER, Qos(transient_local=True, depth=50), guid(1))
    for _ in range(50):
        writer.write(b"x")
    reader = there.reader(CHATTER, Qos(transient_local=True), deliver)
    await until(lambda: seen)
    after = Inbox()
    there.reader(CHATTER, Qos(transient_local=True), after)
    await until(lambda: len(after.samples) == 50)
    assert len(seen) == 1


async def test_spaces_are_told_when_their_neighbours_end(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    with DdsSpace() as here:
        writer = here.writer(CHATTER, RELIABLE, guid(1))
        with DdsSpace() as there:
            inbox = Inbox()
            there.reader(CHATTER, RELIABLE, inbox)
            await until(lambda: (writer.write(b"x"), inbox.samples)[1])
        await until(lambda: here.neighbours == 0)
        writer.write(b"nobody hears it")
    here.close()
    assert caplog.records == []


async def test_what_is_written_after_the_space_has_left_dds_goes_nowhere(pair: tuple[DdsSpace, DdsSpace]) -> None:
    """The library has freed its writers by then: one call with an old one would end the program."""
    here, there = pair
    kept = here.writer(CHATTER, Qos(transient_local=True), guid(1))
    inbox = Inbox()
    there.reader(CHATTER, Qos(transient_local=True), inbox)
    kept.write(b"before")
    await until(lambda: inbox.payloads == [b"before"])
    here.close()
    DdsSpace(0).close()  # what comes next in the library's memory
    for _ in range(100):
        kept.write(b"after")
    assert here.participants() == {}
    assert here.writer(CHATTER, RELIABLE, guid(2)).troubles() == ("topic rt/chatter: the program has left DDS",)
    assert inbox.payloads == [b"before"]


def test_a_space_is_opened_by_its_address() -> None:
    async def main() -> None:
        with open_space(parse_space("dds:9?interface=lo"), partition="p") as space:
            assert space.words == "DDS domain 9, partition p (this computer only)"
        with open_space(parse_space("memory")) as space:
            assert space.words is None
        with pytest.raises(ConfigError, match="there is no network interface 'eth9'; there are lo"):
            open_space(parse_space("dds?interface=eth9"))

    asyncio.run(main())
