"""How long messages take: through the agent, and to a client and back."""

from __future__ import annotations

import asyncio

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Acknowledgements, Agent, Maximum
from msbot_agent.agent.statistics import EVERY_S, MOST_READERS, TimestampedPayload
from msbot_agent.agent.topic_attachment import ReadSide, WriteSide
from msbot_agent.space import THIS_PROGRAM, Qos, Sample, Topic
from msbot_xrce.objects import EndpointQos
from tests.agent.hosts import FakeHost
from tests.agent.scenes import LATCHED, connected, play
from tests.agent.wiring import FakeLink

LIGHT = Topic("light", "Light")


def test_a_few_samples_are_measured_and_what_waits_for_room_counts() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        heard: list[float] = []
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", qos=EndpointQos(keep_all=True))
        writer = await one.add_writer("light")
        await one.write(writer, b"before")
        agent.latency.on_delivery(heard.append)
        for number in range(30):
            await one.write(writer, bytes([number]))
            await asyncio.sleep(0.02)
        assert other.received(reader) == [b"before", *(bytes([number]) for number in range(30))]
        assert 4 <= len(heard) <= 8, f"one in {EVERY_S} s, of fifty a second"
        assert set(heard) == {0.0}, "virtual time stands still within a turn of the loop"

    play(scenario)


def test_a_sample_that_waits_in_the_history_took_that_long() -> None:
    async def main() -> None:
        host, heard = FakeHost(), list[float]()
        host.transit.on_delivery(heard.append)
        writing, reading = (kind(host, 1, LIGHT, Qos(), THIS_PROGRAM) for kind in (WriteSide, ReadSide))
        for side in (writing, reading):
            side.recheck()
        assert isinstance(reading, ReadSide)
        assert isinstance(writing, WriteSide)
        reading.start(7, 0x80, None)
        host.has_room = False
        host.now = 5.0
        writing.write(b"x")
        host.now, host.has_room = 5.75, True
        reading.pull()
        ((_, _, payload, _),) = host.sent
        assert payload == b"x"
        assert host.transit.booked == [5.0]
        host.transit.mark_sent()
        assert heard == [0.75]
        assert host.transit.booked == []

    run_virtual(main())


def test_what_was_kept_for_a_reader_that_came_later_does_not_count() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        heard: list[float] = []
        agent.latency.on_delivery(heard.append)
        one, other = await connected(link, 1, 2)
        await one.write(await one.add_writer("profile", qos=LATCHED), b"new")
        await asyncio.sleep(60.0)
        assert other.received(await other.add_reader("profile", qos=LATCHED)) == [b"new"]
        assert heard == []

    play(scenario)


def test_nothing_is_marked_while_nobody_listens() -> None:
    async def main() -> None:
        host = FakeHost()
        writing = WriteSide(host, 1, LIGHT, Qos(transient_local=True), THIS_PROGRAM)
        writing.recheck()
        seen: list[type[bytes]] = []

        def deliver(sample: Sample) -> bool:
            seen.append(type(sample.payload))
            return True

        host.space.reader(LIGHT, Qos(), deliver)
        writing.write(b"1")
        host.transit.on_delivery(lambda _: None)
        host.transit.on_delivery(lambda _: None)
        writing.write(b"2")
        writing.write(b"3")
        await asyncio.sleep(EVERY_S * 1.5)
        writing.write(b"4")
        assert seen == [bytes, TimestampedPayload, bytes, TimestampedPayload]

    run_virtual(main())


def test_of_very_many_readers_some_are_measured() -> None:
    host, heard = FakeHost(), list[float]()
    host.transit.on_delivery(heard.append)
    timed = TimestampedPayload(b"x")
    timed.began = 1.0
    for _ in range(1000):
        host.transit.mark_queued(timed, 0.0)
    host.transit.mark_sent()
    assert len(heard) == MOST_READERS


def test_each_client_s_acknowledgements_are_found_once() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        looks = Acknowledgements()
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        await other.settle(40)
        assert [*looks.newest(agent.latency.acknowledgements())], "statuses are acknowledged, too"
        assert [*looks.newest(agent.latency.acknowledgements())] == []
        await one.write(writer, b"x")
        await other.settle(40)
        assert other.received(reader) == [b"x"]
        ((key, seconds),) = looks.newest(agent.latency.acknowledgements())
        assert key == 2
        assert 0 <= seconds < 1
        agent.disconnect(2, "test")
        assert 2 not in {key for key, _, _ in agent.latency.acknowledgements()}

    play(scenario)


def test_the_worst_of_a_second_is_taken_once() -> None:
    worst = Maximum()
    assert worst.take_ms() is None
    for seconds in (0.001, 0.003, 0.002):
        worst.add(seconds)
    assert worst.take_ms() == pytest.approx(3.0)
    assert worst.take_ms() is None
