"""Samples to and from typed programs: Cyclone DDS in C, Cyclone DDS in Python, Fast DDS in C++."""

from __future__ import annotations

import itertools
from ctypes import byref

import pytest

from msbot_agent.space import Qos, Reader, Topic
from msbot_agent.space.dds import DdsSpace
from msbot_agent.space.dds.dds_reader import DdsReader
from msbot_agent.space.dds.libddsc import Matched
from tests.space.dds.foreign_programs import KINDS, TYPE, Command, command_of, message
from tests.space.dds.peers import Inbox, program, until

HELLO = Topic("HelloWorldTopic", TYPE)
COUNT = 50


def bodies(inbox: Inbox) -> list[bytes]:
    """What came, without padding: some peers add up to three octets of it and do not say so."""
    found = []
    for payload in inbox.payloads:
        size = 8 + int.from_bytes(payload[4:8], "little")
        assert payload[size:] in (b"", b"\0", b"\0\0", b"\0\0\0")
        found.append(payload[:size])
    return found


def knows_a_writer(reader: Reader) -> bool:
    """Whether the reader has found somebody who writes for it."""
    assert isinstance(reader, DdsReader)
    (inlet,) = reader.inlets
    matched = Matched()
    assert inlet._library.calls.dds_get_subscription_matched_status(inlet.entity, byref(matched)) >= 0
    return bool(matched.current)


@pytest.fixture(params=KINDS)
def peer(request: pytest.FixtureRequest) -> Command:
    """A program of others."""
    return command_of(request.param)


@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
async def test_a_typed_program_hears_what_is_written_here(peer: Command, reliability: str) -> None:
    reliable = reliability == "reliable"
    with DdsSpace() as space:
        writer = space.writer(HELLO, Qos(reliable=reliable, depth=COUNT), bytes(16))
        async with program(*peer, "read", HELLO.name, str(COUNT), reliability, "volatile") as reader:
            # Each side learns of the other when it does: what is written before both know is for nobody.
            await until(lambda: (writer.write(message(0)), reader.heard)[1])
            if reliable:  # as many as the writer keeps: what it no longer has, it cannot repeat
                for number in range(1, COUNT):
                    writer.write(message(number))
                await until(lambda: len(reader.heard) == COUNT)
            else:
                numbered = map(message, itertools.count(1))
                await until(lambda: (writer.write(next(numbered)), len(reader.heard) == COUNT)[1])
            heard = reader.heard
        numbers = [int(line.split()[1]) for line in heard]
        assert heard == [f"got {number} hello {number}" for number in numbers]
        assert numbers == sorted(numbers)
        if reliable:
            after = [number for number in numbers if number]
            assert after == list(range(1, len(after) + 1))
        assert writer.troubles() == ()


@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
async def test_what_a_typed_program_writes_is_heard_here(peer: Command, reliability: str) -> None:
    reliable = reliability == "reliable"
    with DdsSpace() as space:
        inbox = Inbox()
        reader = space.reader(HELLO, Qos(reliable=reliable, depth=COUNT), inbox)
        async with program(*peer, "write", HELLO.name, str(COUNT), reliability, "when_told") as writer:
            await until(lambda: knows_a_writer(reader))  # and it knows the reader before it waits for a word
            await writer.tell()
            await writer.says("wrote")
            await until(lambda: inbox.samples)
            if reliable:
                await until(lambda: len(inbox.samples) == COUNT)
        if reliable:
            assert bodies(inbox) == [message(number) for number in range(COUNT)]
        assert set(bodies(inbox)) <= {message(number) for number in range(COUNT)}
        assert len({sample.writer for sample in inbox.samples}) == 1
        assert reader.lost == 0


async def test_a_typed_program_that_comes_late_gets_what_was_kept_here(peer: Command) -> None:
    with DdsSpace() as space:
        writer = space.writer(HELLO, Qos(transient_local=True, depth=5), bytes(16))
        for number in range(12):
            writer.write(message(number))
        async with program(*peer, "read", HELLO.name, "5", "reliable", "transient_local") as reader:
            await reader.says("got 11 hello 11")
            heard = reader.heard
        assert heard == [f"got {number} hello {number}" for number in range(7, 12)]


async def test_a_reader_that_comes_late_gets_what_a_typed_program_has_kept(peer: Command) -> None:
    async with program(*peer, "write", HELLO.name, "5", "reliable", "transient_local") as writer:
        await writer.says("wrote")
        with DdsSpace() as space:
            inbox = Inbox()
            space.reader(HELLO, Qos(transient_local=True, depth=10), inbox)
            await until(lambda: len(inbox.samples) == 5)
        assert bodies(inbox) == [message(number) for number in range(5)]


async def test_a_typed_program_asks_for_more_than_is_offered(peer: Command) -> None:
    with DdsSpace() as space:
        writer = space.writer(HELLO, Qos(), bytes(16))
        async with program(*peer, "read", HELLO.name, "1", "reliable", "transient_local"):
            await until(writer.troubles)
            words = "DURABILITY: the reader asks for TRANSIENT_LOCAL, the writer offers VOLATILE (a DDS peer)"
            assert writer.troubles() == (f"{HELLO.name}: {words}",)
