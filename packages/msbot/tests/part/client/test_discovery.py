"""Our client finds agents: ours, and what eProsima's agent answered on the wire."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import AsyncIterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part import FoundAgent, find_agents
from msbot.part.client.discovery import _Search, read_answer
from msbot_agent.agent import DiscoveryResponder
from msbot_agent.agent.discovery import DISCOVERY_GROUP
from msbot_xrce.errors import LinkDown
from msbot_xrce.messages import (
    OBJECT_AGENT,
    REQUEST_DISCOVERY,
    SESSION_NONE,
    Header,
    Info,
    Locator,
    LocatorFormat,
    encode_message,
)
from tests.agent.replay import load
from tests.effort import tries

LOCAL = "127.0.0.1"
QUESTION = bytes.fromhex("80000000 02010800 0009fffd 03000000")


@contextlib.asynccontextmanager
async def agents(*service_ports: int, interface: str | None = LOCAL) -> AsyncIterator[list[int]]:
    """Agents that answer, each on a discovery port of its own."""
    responders = [DiscoveryResponder(port, port=0, interface=interface) for port in service_ports]
    tasks = [asyncio.create_task(responder.run()) for responder in responders]
    while not all(responder.address for responder in responders):  # noqa: ASYNC110 - one turn is enough
        await asyncio.sleep(0)
    try:
        yield [responder.address[1] for responder in responders if responder.address]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def test_an_agent_on_this_machine_is_found_by_multicast() -> None:
    async with agents(3018) as (port,):
        (found,) = await find_agents([(DISCOVERY_GROUP, port)], enough=1)
    assert found == FoundAgent(LOCAL, ((LOCAL, 3018),))
    assert found.address == (LOCAL, 3018)


async def test_agents_are_found_by_asking_their_hosts() -> None:
    async with agents(3018, 3019) as ports:
        found = await find_agents([(LOCAL, port) for port in ports], enough=2)
    assert {agent.address for agent in found} == {(LOCAL, 3018), (LOCAL, 3019)}


async def test_one_that_serves_many_interfaces_is_found_once() -> None:
    async with agents(3018, interface=None) as (port,):
        found = await find_agents([(DISCOVERY_GROUP, port)], attempts=2, period_s=0.05)
    assert len(found) == 1
    assert (LOCAL, 3018) in found[0].addresses


async def test_an_agent_that_serves_this_machine_only_does_not_answer_others() -> None:
    responder = DiscoveryResponder(3018, port=0, interface=LOCAL)
    sent: list[object] = []

    class FromOutside:
        """A socket with a question from another machine."""

        def __init__(self) -> None:
            self.questions: list[tuple[bytes, list[object], int, tuple[str, int]]] = [
                (QUESTION, [], 0, ("192.0.2.9", 4000))
            ]

        def recvmsg(self, *sizes: int) -> tuple[bytes, list[object], int, tuple[str, int]]:
            if not self.questions:
                raise BlockingIOError
            return self.questions.pop()

        def sendto(self, *answer: object) -> None:
            sent.append(answer)

    responder._drain(FromOutside())  # type: ignore[arg-type]  # has all that is needed
    assert sent == []


class Answering:
    """A socket by hand: each `recvfrom` gives the next of these, and the last one for ever."""

    def __init__(self, *results: OSError | tuple[bytes, tuple[str, int]]) -> None:
        self._results = list(results)
        self.calls = 0

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        self.calls += 1
        assert self.calls <= 1000, "the loop would stand still"
        result = self._results.pop(0) if len(self._results) > 1 else self._results[0]
        if isinstance(result, OSError):
            raise result
        return result


@pytest.mark.parametrize("number", [errno.EIO, errno.ENETDOWN, errno.ENOBUFS, errno.EBADF], ids=errno.errorcode.get)
async def test_a_socket_that_fails_for_good_does_not_keep_the_loop(number: int) -> None:
    search = _Search(None)
    sock = Answering(OSError(number, os.strerror(number)))
    search.drain(sock)  # type: ignore[arg-type]  # has all that is needed
    assert sock.calls == 1
    assert search.found == {}


async def test_answers_that_come_without_end_leave_others_their_turn_and_one_after_an_error_is_taken() -> None:
    answer = next(line.packet for line in load("udp_ex_discovery_unicast") if not line.from_client)
    search = _Search(None)
    sock = Answering(ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused"), (answer, (LOCAL, 7400)))
    for _ in range(2):  # the loop calls again as long as something waits
        search.drain(sock)  # type: ignore[arg-type]
    assert len(search.found) == 1
    assert sock.calls < 1000


async def test_nobody_is_found_where_nobody_is() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((LOCAL, 0))
        assert await find_agents([taken.getsockname()], attempts=2, period_s=0.001) == []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOCAL, 0))
        port = free.getsockname()[1]
    assert await find_agents([(LOCAL, port)], attempts=2, period_s=0.001) == []


async def test_without_a_network_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LinkDown, match=r"nobody can be asked for an agent \(.*\): check the network and the interface"):
        await find_agents(interface="192.0.2.77")


@pytest.mark.parametrize("name", ["udp_ex_discovery_multicast", "udp_ex_discovery_unicast"])
def test_the_answers_of_the_genuine_agent_are_understood(name: str) -> None:
    answers = [line.packet for line in load(name) if not line.from_client]
    for answer in answers:
        found = read_answer(answer, "127.0.0.1")
        assert found is not None
        assert found.address[0] == "127.0.0.1"
        assert len(found.addresses) >= 1


def test_addresses_of_ipv6_are_understood_and_others_left_out() -> None:
    locators = (
        Locator(LocatorFormat.LARGE, bytes(15) + b"\x01", 9024),
        Locator(LocatorFormat.STRING, b"somewhere"),
        Locator(LocatorFormat.SMALL, b"\x07\x08", 1),
    )
    info = Info(REQUEST_DISCOVERY, OBJECT_AGENT, locators=locators)
    answer = encode_message(Header(SESSION_NONE), [info], pad_end=False)
    assert read_answer(answer, "::1") == FoundAgent("::1", (("::1", 9024),))


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        bytes.fromhex("80000000 02010800 0009fffd 03000000"),
        bytes.fromhex("80000000 06011c00 0009fffd 0000 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 00000000"),
        bytes.fromhex("80000000 06012400 0009fffd 0000 01 0d 58524345 0200 010f 00 01 0d 00 0100 0000 01000000")
        + bytes.fromhex("017f00000100d970"),
        bytes.fromhex("80000000 06012400 000afffd 0000 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 01000000")
        + bytes.fromhex("017f00000100d970"),
    ],
    ids=["empty", "a question", "no address", "another version", "another request"],
)
def test_other_packets_are_no_answers(packet: bytes) -> None:
    assert read_answer(packet, LOCAL) is None


@given(st.binary(max_size=80))
@settings(max_examples=tries(200, 4000), deadline=None)
def test_junk_is_no_answer(junk: bytes) -> None:
    assert read_answer(junk, LOCAL) is None
    found = read_answer(bytes.fromhex("80000000 06012c00 0009fffd 0000") + junk, LOCAL)
    assert found is None or found.addresses
