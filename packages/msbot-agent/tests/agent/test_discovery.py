"""Clients find the agent by multicast (case 72 of the reference)."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from typing import cast

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent.discovery import (
    ANSWERS_AT_ONCE,
    ANSWERS_PER_S,
    DISCOVERY_GROUP,
    LOOK_AGAIN_S,
    DiscoveryResponder,
    discovery_answer,
    host_addresses,
)
from msbot_xrce.errors import LinkDown

QUESTION = bytes.fromhex("80000000 02010800 0009fffd 03000000")


def test_the_answer_names_every_address() -> None:
    # seen: two interfaces, port 28889
    expected = bytes.fromhex(
        "80000000 06012c00 0009fffd 0000 01 0d 58524345 0100 010f 00 01 0d 00 0100 0000 02000000"
        "01 7f000001 00 d970 01 c0000202 00 d970"
    )
    assert discovery_answer(QUESTION, lambda: ["127.0.0.1", "192.0.2.2"], 28889) == expected


@pytest.mark.parametrize(
    "packet",
    [b"", b"\x80", QUESTION[:12], b"\x81" + QUESTION[1:], bytes.fromhex("80000000 0c010000"), bytes(16)],
)
def test_other_packets_are_not_answered(packet: bytes) -> None:
    assert discovery_answer(packet, lambda: ["127.0.0.1"], 8888) is None


def test_this_machine_has_at_least_the_loopback_address() -> None:
    assert "127.0.0.1" in host_addresses()


@contextlib.asynccontextmanager
async def running(responder: DiscoveryResponder) -> AsyncIterator[int]:
    """The responder on a free port, which is yielded."""
    task = asyncio.create_task(responder.run())
    while responder.address is None and not task.done():  # noqa: ASYNC110 - one turn is enough
        await asyncio.sleep(0)
    assert responder.address is not None
    try:
        yield responder.address[1]
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def ask(address: tuple[str, int], packet: bytes) -> bytes:
    """One question from an ephemeral port, and the answer."""
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sock.bind(("127.0.0.1", 0))
        await loop.sock_sendto(sock, b"junk", address)
        await loop.sock_sendto(sock, packet, address)
        async with asyncio.timeout(60):
            return await loop.sock_recv(sock, 2048)


@pytest.mark.parametrize("host", ["127.0.0.1", DISCOVERY_GROUP])
async def test_a_client_that_asks_is_told_the_service_port(host: str) -> None:
    responder = DiscoveryResponder(3018, port=0, interface="127.0.0.1")
    async with running(responder) as port:
        answer = await ask((host, port), QUESTION)
    assert answer == discovery_answer(QUESTION, lambda: ["127.0.0.1"], 3018)
    assert responder.answers == 1
    assert responder.address is None


async def test_without_an_interface_all_addresses_are_announced() -> None:
    async with running(DiscoveryResponder(3018, port=0)) as port:
        answer = await ask(("127.0.0.1", port), QUESTION)
    assert answer == discovery_answer(QUESTION, host_addresses, 3018)


def test_an_interface_that_comes_up_later_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    there: list[str] = []
    monkeypatch.setattr("msbot_agent.agent.discovery.host_addresses", lambda: there)

    async def main() -> None:
        async with running(DiscoveryResponder(3018, port=0)) as port:
            there.append("127.0.0.1")
            await asyncio.sleep(3 * LOOK_AGAIN_S)  # again and again, which changes nothing
            assert await ask((DISCOVERY_GROUP, port), QUESTION) == telling("127.0.0.1")[0]

    run_virtual(main())


async def test_an_interface_that_is_not_there_is_said_in_words() -> None:
    with pytest.raises(LinkDown, match=r"discovery on 239\.255\.0\.2:7400 is not possible"):
        await DiscoveryResponder(3018, interface="192.0.2.77").run()


HERE = ["127.0.0.1", "192.0.2.7", "198.51.100.7"]
"""The addresses of a computer with two interfaces."""
OWN = [("127.0.0.1", HERE[0]), ("127.0.0.9", HERE[0]), ("0.0.0.0", HERE[1]), (HERE[1], HERE[1]), (HERE[2], HERE[1])]
"""From which addresses its programs ask, and at which the questions come in."""


def answers(responder: DiscoveryResponder, sender: str, at: str | None) -> list[bytes]:
    """What is sent when a question comes in from there at that address of ours."""
    told: list[tuple[int, int, bytes]] = []
    if at is not None:
        told = [(socket.IPPROTO_IP, 8, bytes(4) + socket.inet_aton(at) + bytes(4))]
    asked = [(QUESTION, told, 0, (sender, 4711))]
    answered: list[bytes] = []

    class Socket:
        def recvmsg(self, *_: int) -> tuple[bytes, list[tuple[int, int, bytes]], int, tuple[str, int]]:
            if not asked:
                raise BlockingIOError
            return asked.pop()

        def sendto(self, answer: bytes, to: object) -> None:
            assert to == (sender, 4711)
            answered.append(answer)

    responder._drain(cast("socket.socket", Socket()))
    return answered


def telling(*addresses: str) -> list[bytes]:
    """One answer with these addresses."""
    answer = discovery_answer(QUESTION, lambda: addresses, 3018)
    assert answer is not None
    return [answer]


def test_an_agent_answers_every_address_of_its_computer_and_others_only_where_it_serves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("msbot_agent.agent.discovery.host_addresses", lambda: HERE)
    for served, told in (("127.0.0.1", HERE[:1]), (HERE[2], HERE[2:]), (None, HERE)):
        responder = DiscoveryResponder(3018, interface=served)
        for sender, at in OWN:
            assert answers(responder, sender, at) == telling(*told), (served, sender)
    loopback, second, everywhere = (DiscoveryResponder(3018, interface=one) for one in ("127.0.0.1", HERE[2], None))
    assert answers(loopback, "192.0.2.8", HERE[1]) == []
    assert answers(second, "192.0.2.8", HERE[1]) == [], "the other network"
    assert answers(second, "198.51.100.8", HERE[2]) == telling(HERE[2])
    assert answers(second, "198.51.100.8", None) == telling(HERE[2]), "a system that does not say"
    assert answers(everywhere, "192.0.2.8", HERE[1]) == telling(HERE[1], HERE[2]), "no loopback for other computers"
    assert answers(everywhere, "198.51.100.8", HERE[2]) == telling(HERE[2], HERE[1]), "the one that was asked first"


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_who_asks_without_end_is_answered_so_often_and_others_are_answered_meanwhile(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The address may be forged: the answers, which are longer, go to somebody who has not asked."""
    monkeypatch.setattr("msbot_agent.agent.discovery.host_addresses", lambda: HERE)
    now = 0.0
    responder = DiscoveryResponder(3018, clock=lambda: now)
    answered = 0
    for _ in range(10_000):
        now += 0.001
        answered += len(answers(responder, "192.0.2.8", HERE[1]))
    assert 80 <= answered <= ANSWERS_AT_ONCE + 10 * ANSWERS_PER_S
    assert responder.left_out == 10_000 - answered
    assert answers(responder, "192.0.2.9", HERE[1]) == telling(HERE[1], HERE[2])
    assert all(answers(responder, "127.0.0.1", HERE[0]) for _ in range(200)), (
        "programs of this computer are not counted"
    )
    now += 1.0
    assert answers(responder, "192.0.2.8", HERE[1])
    (told,) = caplog.messages
    assert told.startswith("192.0.2.8 looks for an agent too often")
