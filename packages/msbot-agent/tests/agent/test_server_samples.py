"""The agent as clients see it: samples, requests and replies."""

from __future__ import annotations

import asyncio
import random

import pytest

from msbot_agent.agent import Agent, OpenGate, client_key_of
from msbot_agent.agent.reply_routing import decode_identity
from msbot_xrce import Status
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_NONE, STREAM_RELIABLE, DeliveryControl
from msbot_xrce.objects import EndpointQos
from tests.agent.scenes import LATCHED, connected, play
from tests.agent.wiring import FakeLink, WiredClient


def test_quality_of_service_that_does_not_fit_is_told_on_both_ends() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        teller, listener = await connected(link, 1, 2)
        await teller.add_writer("light", qos=EndpointQos(reliable=False))
        reader_id = await listener.add_reader("light", qos=EndpointQos(transient_local=True))
        words = ("light: RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT",)
        assert agent.troubles(1) == agent.troubles(2) == words
        assert [item.troubles for view in agent.clients() for item in view.objects if item.troubles] == [words, words]
        await listener.delete(reader_id)
        assert agent.troubles(1) == agent.troubles(3) == ()

    play(scenario)


# Samples.


@pytest.mark.parametrize("stream_id", [STREAM_RELIABLE, STREAM_BEST_EFFORT])
def test_samples_of_one_client_reach_another(stream_id: int) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", stream_id=stream_id)
        writer = await one.add_writer("light")
        await one.write(writer, b"one", b"two", b"", stream_id=stream_id)
        assert other.received(reader) == [b"one", b"two", b""]
        assert agent.topics() == [("light", 3, 3)]

    play(scenario)


def test_samples_may_come_outside_of_all_streams() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light", stream_id=STREAM_NONE)
        await client.write(await client.add_writer("light"), b"x")
        assert client.received(reader) == [b"x"]

    play(scenario)


def test_a_large_sample_is_cut_and_joined_both_ways() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("picture")
        picture = bytes(range(256)) * 40
        await one.write(await one.add_writer("picture"), picture)
        await other.settle(40)
        assert other.received(reader) == [picture]

    play(scenario)


def test_a_burst_longer_than_the_window_arrives_whole_and_in_order() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", qos=EndpointQos(keep_all=True))
        writer = await one.add_writer("light")
        other.unplugged = True
        for number in range(60):
            await one.write(writer, bytes([number]))
        other.unplugged = False
        await asyncio.sleep(2.0)
        assert other.received(reader) == [bytes([number]) for number in range(60)]

    play(scenario)


@pytest.mark.parametrize("seed", range(3))
def test_reliable_samples_survive_a_lossy_link(seed: int) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        chance = random.Random(seed)
        one = WiredClient(link, key=1, lose=lambda _: chance.random() < 0.2)
        other = WiredClient(link, key=2, lose=lambda _: chance.random() < 0.2)
        for client in (one, other):
            client.session.connect(0.0)
            client.transmit()
        await asyncio.sleep(10.0)
        ids = {}
        for client, make in ((one, WiredClient.book_writer), (other, WiredClient.book_reader)):
            ids[client] = make(client, "light", qos=EndpointQos(keep_all=True))
        await asyncio.sleep(10.0)
        for number in range(100):
            await asyncio.sleep(0.3)
            one.session.write(ids[one], bytes([number]), STREAM_RELIABLE)
            one.transmit()
        await asyncio.sleep(10.0)
        assert other.received(ids[other]) == [bytes([number]) for number in range(100)]

    play(scenario)


def test_a_latched_sample_comes_to_a_late_reader() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        await one.write(await one.add_writer("profile", qos=LATCHED), b"old", b"new")
        assert other.received(await other.add_reader("profile", qos=LATCHED)) == [b"new"]

    play(scenario)


def test_a_volatile_reader_gets_no_old_samples_unless_the_gate_says_so() -> None:
    class Latching(OpenGate):
        def is_latched(self, topic: str) -> bool:
            return topic == "profile"

    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        for number, topic in enumerate(("light", "profile"), 1):
            await one.write(await one.add_writer(topic, number=number, qos=LATCHED), b"old")
        assert other.received(await other.add_reader("light", number=1)) == []
        assert other.received(await other.add_reader("profile", number=2)) == [b"old"]

    play(scenario, gate=Latching())


def test_types_and_domains_keep_topics_apart() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", type_name="Lamp")
        await one.write(await one.add_writer("light", type_name="Light"), b"x")
        assert other.received(reader) == []

    play(scenario)


def test_pace_and_rate_are_kept_in_time() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light", control=DeliveryControl(max_samples=3, min_pace_ms=100))
        await one.write(await one.add_writer("light"), b"1", b"2", b"3", b"4")
        counts = [len(other.received(reader))]
        for _ in range(3):
            await asyncio.sleep(0.1)
            await other.settle()
            counts.append(len(other.received(reader)))
        assert counts == [1, 1, 1, 0]

    play(scenario)


def test_a_read_of_nothing_is_refused_on_the_reliable_stream() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        writer = await client.add_writer("light")
        for object_id in (0x0996, writer):
            request_id = client.session.read(object_id, STREAM_BEST_EFFORT)
            assert await client.status_of(request_id) == Status.ERR_UNKNOWN_REFERENCE

    play(scenario)


def test_a_sample_for_nothing_is_counted_and_the_rest_of_the_message_counts() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        reader = await client.add_reader("light")
        writer = await client.add_writer("light")
        client.session.write(0x0995, b"lost", STREAM_RELIABLE)
        client.session.write(writer, b"found", STREAM_RELIABLE)
        await client.settle()
        assert client.received(reader) == [b"found"]
        assert agent.clients()[0].dropped == {"WRITE_DATA for an unknown object": 1}

    play(scenario)


def test_deleting_a_reader_ends_its_read() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        one, other = await connected(link, 1, 2)
        reader = await other.add_reader("light")
        writer = await one.add_writer("light")
        assert await other.delete(reader) == Status.OK
        await one.write(writer, b"x")
        assert other.received() == []

    play(scenario)


# Requests and replies.


def test_a_request_is_answered_and_the_replier_knows_who_asked() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        server, asker, stranger = await connected(link, 9, 0xAABBCCDD, 2)
        replier = await server.add_replier("add")
        requester = await asker.add_requester("add")
        await stranger.add_requester("add")
        request_id = await asker.write(requester, b"2+2")
        (request,) = server.received(replier)
        identity = decode_identity(request)
        assert identity is not None
        assert client_key_of(identity[0]) == 0xAABBCCDD
        await server.write(replier, request[:24] + b"4")
        assert asker.received(requester) == [request_id.to_bytes(2, "big") + requester.to_bytes(2, "big") + b"4"]
        assert stranger.received() == []

    play(scenario)


def test_a_beat_over_best_effort_is_answered_over_best_effort() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        server, asker = await connected(link, 9, 1)
        replier = await server.add_replier("inventory")
        requester = await asker.add_requester("inventory", stream_id=STREAM_BEST_EFFORT)
        await asker.write(requester, b"beat", stream_id=STREAM_BEST_EFFORT)
        (request,) = server.received(replier)
        await server.write(replier, request[:24] + b"yes", stream_id=STREAM_BEST_EFFORT)
        assert [reply[4:] for reply in asker.received(requester)] == [b"yes"]

    play(scenario)


# Sessions begin, are silent, end.
